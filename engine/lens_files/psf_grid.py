"""Point spread functions as programs export them, and their conversion to a lens's table."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..runtime.errors import LensError

LARGEST_TABLE, SMALL_TABLE = 2**28, 2**22  # samples
MOST_FINER = 16  # limit of samples per imported sample: pitches that differ by 4, or chief rays at corners of grids
SAME_PITCH = 1e-4
NEGLIGIBLE_MM = 1e-6
ROUNDING = 1e-3  # of the peak: negative samples up to this may stem from another program's interpolation


@dataclass(frozen=True, eq=False)
class PsfGrid:
    """One PSF on its grid, upright: rows ascend with y and columns with x of the image plane.

    Attributes
    ----------
    where : Path
        Its file, for errors.
    values : array (row, column)
        Irradiance on any scale.
    pitch_um : float
    centre : (int, int)
        Row and column of the chief ray.
    wavelength_nm : float or None
        If the file states it.
    image_mm : (float, float) or None
        The chief ray's point (x, y) in the image plane, if the file states it.
    """

    where: Path
    values: np.ndarray
    pitch_um: float
    centre: tuple[int, int]
    wavelength_nm: float | None = None
    image_mm: tuple[float, float] | None = None

    def __post_init__(self):
        peak = _checked_peak(self)
        object.__setattr__(self, "values", np.clip(self.values / peak, 0, None).astype(np.float32))


def _checked_peak(grid):
    """The largest sample; raise a LensError if the grid is invalid or not a PSF."""
    if np.ndim(grid.values) != 2:
        raise LensError(grid.where, "PSF", f"of shape {np.shape(grid.values)}", "expected rows and columns")
    rows, columns = grid.values.shape
    if grid.wavelength_nm is not None and not 0 < grid.wavelength_nm < np.inf:
        raise LensError(grid.where, "PSF wavelength", grid.wavelength_nm, "expected a positive number of nm")
    if grid.image_mm is not None and not np.all(np.isfinite(grid.image_mm)):
        raise LensError(grid.where, "PSF image point", grid.image_mm, "expected x and y in mm")
    if min(rows, columns) < 3:
        raise LensError(grid.where, "PSF", f"{rows} x {columns} samples", "expected at least 3 x 3")
    if not (np.isfinite(grid.pitch_um) and grid.pitch_um > 0):
        raise LensError(grid.where, "PSF spacing", grid.pitch_um, "expected a positive number of um")
    if not (0 <= grid.centre[0] < rows and 0 <= grid.centre[1] < columns):
        raise LensError(grid.where, "PSF centre", grid.centre, f"expected a sample of the {rows} x {columns}")
    peak = grid.values.max()
    if not (np.isfinite(grid.values).all() and peak > 0):
        raise LensError(grid.where, "PSF", f"{peak:g} at its peak", "expected finite samples and a positive peak")
    if grid.values.min() < -ROUNDING * peak:
        raise LensError(grid.where, "PSF", f"{grid.values.min():g} at its minimum",
                        "expected irradiance on a linear scale, 0 or more")
    return peak


def psf_table(grids: list[list[PsfGrid]], image_side: str) -> tuple[np.ndarray, float]:
    """A lens's table of PSFs: turned outwards, with one pitch and one window, each of unit sum.

    PSFs with different pitches, as from FFTs at different wavelengths, are interpolated as band-limited functions to
    the finest pitch. The small negative samples that result are clipped.

    Parameters
    ----------
    grids : list of lists of PsfGrid, [wavelength][height]
    image_side : "+y" or "-y"
        The side of the axis with the image points, unless a grid states it.

    Returns
    -------
    psf : float32 array (wavelength, height, v, u)
        The chief ray at `[n // 2, n // 2]`, +v away from the axis, u to the right of it. n is odd, which preserves
        symmetry: the row and column of an even grid without a partner across the chief ray are omitted.
    pitch_um : float
    """
    side = _stated_side([grid for row in grids for grid in row]) or image_side
    turned = [[_turned(grid) if side == "-y" else grid for grid in row] for row in grids]
    every = [grid for row in turned for grid in row]
    pitch = min(grid.pitch_um for grid in every)
    reach = max(_reach(grid, pitch) for grid in every)
    window = 2 * reach + 1
    samples = sum(grid.values.size for grid in every)
    if len(every) * window**2 > min(LARGEST_TABLE, SMALL_TABLE + MOST_FINER * samples):
        raise LensError(every[0].where, "PSFs", f"{len(every)} of {window} x {window} samples",
                        f"too many to interpolate from {samples}: expected similar pitches")
    psf = np.stack([[_windowed(grid, pitch, reach) for grid in row] for row in turned])
    return psf, pitch


def _stated_side(grids):
    """The side of the axis with the image points, from grids off the axis that state their image point; or None."""
    side = None
    for grid in grids:
        x, y = grid.image_mm or (0.0, 0.0)
        if abs(x) > NEGLIGIBLE_MM + 1e-3 * abs(y):
            raise LensError(grid.where, "image point", f"x = {x:g}, y = {y:g} mm", "expected field points along y")
        stated = None if abs(y) <= NEGLIGIBLE_MM else "+y" if y > 0 else "-y"
        if stated and side and stated != side:
            raise LensError(grid.where, "image point", f"y = {y:g} mm", "expected it on the same side as the others'")
        side = side or stated
    return side


def _turned(grid):
    """The grid turned by 180 degrees: for image points below the axis, rows then point away from it."""
    rows, columns = grid.values.shape
    return PsfGrid(grid.where, grid.values[::-1, ::-1], grid.pitch_um,
                   (rows - 1 - grid.centre[0], columns - 1 - grid.centre[1]))


def _reach(grid, pitch_um):
    """Number of samples of this pitch on each side of the chief ray that a window needs to contain the grid."""
    row, column = grid.centre
    rows, columns = grid.values.shape
    sides = (row, column, rows - 1 - row, columns - 1 - column)
    reach = min(sides) if min(sides) >= max(sides) - 1 else max(sides)
    return max(1, int(reach * grid.pitch_um / pitch_um + 1e-6))


def _windowed(grid, pitch_um, reach):
    """float32 array (2 reach + 1, 2 reach + 1) of unit sum: the grid around its chief ray, at this pitch."""
    if abs(grid.pitch_um / pitch_um - 1) < SAME_PITCH:
        row, column = grid.centre
        padded = np.pad(grid.values, reach)
        window = padded[row:row + 2 * reach + 1, column:column + 2 * reach + 1].astype(float)
    else:
        along_v, along_u = (_interpolation(samples, centre, pitch_um / grid.pitch_um, reach)
                            for samples, centre in zip(grid.values.shape, grid.centre, strict=True))
        window = np.clip(along_v @ grid.values.astype(float) @ along_u.T, 0, None)
    if not window.sum() > 0:
        raise LensError(grid.where, "PSF", "0 around its centre", "expected light around the centre")
    return (window / window.sum()).astype(np.float32)


def _interpolation(samples, centre, step, reach):
    """Matrix (2 reach + 1, samples) that evaluates samples, one period of a band-limited function, around their centre.

    An FFT's PSF is sampled as coarsely as its band allows. Linear interpolation would then misplace a fifth of the
    light; this misplaces a thousandth. Beyond the samples it is 0.
    """
    position = centre + step * np.arange(-reach, reach + 1)
    frequency = np.fft.fftfreq(samples)
    waves = np.exp(2j * np.pi * np.outer(position, frequency))
    matrix = (waves @ np.exp(-2j * np.pi * np.outer(frequency, np.arange(samples)))).real / samples
    matrix[(position < -0.5) | (position > samples - 0.5)] = 0
    return matrix
