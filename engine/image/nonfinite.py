"""Pixels that are no finite number, as renderers leave them now and then."""

import numpy as np

from ..errors import ImageError
from .spectral_image import SpectralImage


def refuse_fireflies(radiance: SpectralImage) -> None:
    """Raise an ImageError that names the first pixel that is NaN or infinite."""
    for plane, wavelength_nm in zip(radiance.cube, radiance.wavelengths_nm, strict=True):
        if _all_finite(plane):
            continue
        found = np.argwhere(~np.isfinite(plane))
        row, column = found[0]
        raise ImageError("image", f"pixel at row {row}, column {column}, {wavelength_nm:g} nm",
                         str(plane[row, column]), f"every value must be finite; {len(found)} of {plane.size} at this "
                                                  "wavelength are not; 'clamp' for fireflies mends them")


def _all_finite(plane):
    with np.errstate(invalid="ignore", over="ignore"):  # of infinities, which are what is looked for
        return np.isfinite(plane.sum(dtype=np.float64))


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
