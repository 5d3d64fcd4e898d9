"""NaN and infinite pixels, which renderers occasionally produce."""

import numpy as np

from ..runtime.errors import ImageError
from .layers import LayeredRadiance
from .spectral_image import SpectralImage


def refuse_fireflies(radiance: SpectralImage | LayeredRadiance) -> None:
    """Raise an ImageError that names the first pixel that is NaN or infinite."""
    if isinstance(radiance, LayeredRadiance):
        for layer in radiance.layers:
            _refuse(layer.cube, radiance.wavelengths_nm, layer.origin_px)
    else:
        _refuse(radiance.cube, radiance.wavelengths_nm, (0, 0))


def _refuse(cube, wavelengths_nm, origin_px):
    for plane, wavelength_nm in zip(cube, wavelengths_nm, strict=True):
        if _all_finite(plane):
            continue
        wrong = np.argwhere(~np.isfinite(plane))
        row, column = wrong[0]
        place = f"pixel at row {row + origin_px[0]}, column {column + origin_px[1]}, {wavelength_nm:g} nm"
        raise ImageError("image", place, str(plane[row, column]),
                         f"{len(wrong)} of {plane.size} values at this wavelength are not finite: set fireflies to "
                         "'clamp' to replace them")


def _all_finite(plane):
    with np.errstate(invalid="ignore", over="ignore"):  # infinities are expected here
        return np.isfinite(plane.sum(dtype=np.float64))


def count_nonfinite(plane: np.ndarray) -> int:
    """The number of NaN and infinite pixels of a plane."""
    return 0 if _all_finite(plane) else int((~np.isfinite(plane)).sum())


def clamp_layers(layered: LayeredRadiance) -> tuple[LayeredRadiance, int]:
    """Layers with non-finite pixels replaced as by `clamp_fireflies`, and the number of these pixels."""
    number, cubes = 0, []
    for layer in layered.layers:
        planes, numbers = zip(*map(clamp_fireflies, layer.cube), strict=True)
        number += sum(numbers)
        cubes.append(np.stack(planes) if any(numbers) else layer.cube)
    return (layered.with_light(cubes), number) if number else (layered, 0)


def clamp_fireflies(plane: np.ndarray) -> tuple[np.ndarray, int]:
    """A plane with NaN and infinite pixels replaced by their brightest finite neighbour, and their number."""
    if _all_finite(plane):
        return plane, 0
    bad = ~np.isfinite(plane)
    brightest = np.pad(np.where(bad, 0, plane), 1)
    brightest = np.maximum(np.maximum(brightest[:-2], brightest[1:-1]), brightest[2:])
    brightest = np.maximum(np.maximum(brightest[:, :-2], brightest[:, 1:-1]), brightest[:, 2:])
    return np.where(bad, brightest, plane), int(bad.sum())
