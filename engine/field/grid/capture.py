"""The overscan of captures for a lens without rotational symmetry."""

from collections.abc import Sequence

import numpy as np

from ...image.pixel_grid import PixelGrid
from ...lens.grid_lens import GridLens
from ..in_capture import in_capture
from .geometry import GridGeometry

ALONG, ACROSS = 65, 17  # places along a border, and inside the frame


def overscan_px(lens: GridLens, capture: PixelGrid, wavelengths_nm: Sequence[float] | np.ndarray,
                psf_radius_px: int) -> tuple[int, int]:
    """See `overscan.overscan_px`."""
    frame = capture.frame()
    ends = [np.linspace(-0.5 - psf_radius_px, n - 0.5 + psf_radius_px, ALONG) for n in frame.shape_px]
    rows, columns = (np.concatenate(part) for part in zip(
        *(np.meshgrid(ends[0], ends[1][[0, -1]])), *(np.meshgrid(ends[0][[0, -1]], ends[1])), strict=False))
    needed = np.zeros(2)
    for shown in _shown_px(lens, capture, frame, wavelengths_nm, rows, columns):
        for axis, (at_px, n) in enumerate(zip(shown, frame.shape_px, strict=True)):
            needed[axis] = max(needed[axis], psf_radius_px, -0.5 - at_px.min(), at_px.max() - (n - 0.5))
    above, left = (int(np.ceil(more)) + 1 for more in needed)
    return above, left


def reach_px(lens: GridLens, capture: PixelGrid, wavelengths_nm: Sequence[float] | np.ndarray,
             psf_radius_px: int) -> int:
    """See `overscan.reach_px`."""
    frame = capture.frame()
    sides = (np.linspace(-0.5, n - 0.5, ACROSS) for n in frame.shape_px)
    rows, columns = (axis.ravel() for axis in np.meshgrid(*sides))
    moved = max(float(np.hypot(row - rows, column - columns).max())
                for row, column in _shown_px(lens, capture, frame, wavelengths_nm, rows, columns))
    return int(np.ceil(moved)) + psf_radius_px + 1


def _shown_px(lens, capture, frame, wavelengths_nm, rows, columns):
    """Yield the rows and columns of a frame, in a capture, where light that lands at places is shown."""
    x_mm, y_mm = frame.position_mm(rows, columns)
    for wavelength_nm in wavelengths_nm:
        geometry = GridGeometry(lens.at_wavelength(wavelength_nm), lens.name)
        at_mm, _ = in_capture(geometry.source_mm(x_mm, y_mm), lens, capture)
        yield frame.index_of(*at_mm)
