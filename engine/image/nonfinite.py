"""Pixels that are no finite number, as renderers leave them now and then."""

import numpy as np

from ..errors import ImageError
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
        found = np.argwhere(~np.isfinite(plane))
        row, column = found[0]
        place = f"pixel at row {row + origin_px[0]}, column {column + origin_px[1]}, {wavelength_nm:g} nm"
        raise ImageError("image", place, str(plane[row, column]),
                         f"every value must be finite; {len(found)} of {plane.size} at this wavelength are not; "
                         "'clamp' for fireflies mends them")


def _all_finite(plane):
    with np.errstate(invalid="ignore", over="ignore"):  # of infinities, which are what is looked for
        return np.isfinite(plane.sum(dtype=np.float64))


def clamp_layers(layered: LayeredRadiance) -> tuple[LayeredRadiance, int]:
    """Layers in which pixels that are not finite are mended as `clamp_fireflies` does, and their number."""
    number, cubes = 0, []
    for layer in layered.layers:
        planes, numbers = zip(*map(clamp_fireflies, layer.cube), strict=True)
        number += sum(numbers)
        cubes.append(np.stack(planes) if any(numbers) else layer.cube)
    return (layered.with_light(cubes), number) if number else (layered, 0)


def clamp_fireflies(plane: np.ndarray) -> tuple[np.ndarray, int]:
    """A plane whose pixels that are not finite take the brightest finite value beside them, and their number."""
    if _all_finite(plane):
        return plane, 0
    bad = ~np.isfinite(plane)
    padded = np.pad(np.where(bad, 0, plane), 1)
    mended = plane.copy()
    for row, column in np.argwhere(bad):
        mended[row, column] = padded[row:row + 3, column:column + 3].max()
    return mended, int(bad.sum())
