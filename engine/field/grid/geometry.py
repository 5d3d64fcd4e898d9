"""Where light lands and how bright it is, by splines between the nodes of the lens data."""

from functools import cached_property

import numpy as np
import scipy

from ...image.pixel_grid import PixelGrid
from ...lens.grid_lens import GridLens, MonochromaticGrid
from ...runtime.errors import LensError

DEGREE = 3
CONVERGENCE = 16  # a spline through every other node is that much farther off, because errors fall with the 4th power
NEWTON_STEPS, NEWTON_TOLERANCE = 60, 1e-12  # tolerance relative to the extent of the field
LONGEST_STEP = 0.25  # of the extent
ROUNDING = 1e-9  # of the end of the field
CHECKED = 4  # places between nodes at which the distortion is checked


class GridTable:
    """A table over the field, between whose nodes values follow a spline.

    Parameters
    ----------
    y_mm, x_mm : arrays (row,) and (column,), ascending
    values : array (row, column)
    """

    def __init__(self, y_mm: np.ndarray, x_mm: np.ndarray, values: np.ndarray) -> None:
        self.y_mm, self.x_mm, self._values = y_mm, x_mm, values
        self._spline = _spline(y_mm, x_mm, values)

    @classmethod
    def of(cls, lens: GridLens | MonochromaticGrid, values: np.ndarray, signs: tuple[int, int] = (1, 1)
           ) -> "GridTable":
        """From a table of a lens, whose values in mirrored rows and columns are multiplied by these signs."""
        y_mm, x_mm = (_unfolded(places_mm, 0, mirrored, -1)
                      for places_mm, mirrored in zip((lens.y_mm, lens.x_mm), lens.mirrored, strict=True))
        for axis in (0, 1):
            values = _unfolded(values, axis, lens.mirrored[axis], signs[axis])
        return cls(y_mm, x_mm, values)

    def __call__(self, x_mm: np.ndarray, y_mm: np.ndarray, dx: int = 0, dy: int = 0) -> np.ndarray:
        """Values, or derivatives of these orders, at places on the grid: x_mm and y_mm broadcast."""
        x_mm, y_mm = np.asarray(x_mm, float), np.asarray(y_mm, float)
        if x_mm.ndim == y_mm.ndim == 2 and x_mm.shape[0] == y_mm.shape[1] == 1:  # rows and columns: much faster
            rows, columns = np.argsort(y_mm[:, 0]), np.argsort(x_mm[0])
            values = np.empty((rows.size, columns.size))
            values[np.ix_(rows, columns)] = self._spline(y_mm[rows, 0], x_mm[0, columns], dy, dx)
            return values
        return self._spline.ev(y_mm, x_mm, dy, dx)

    def held(self, x_mm: np.ndarray, y_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The nearest places on the grid."""
        return np.clip(x_mm, self.x_mm[0], self.x_mm[-1]), np.clip(y_mm, self.y_mm[0], self.y_mm[-1])

    @cached_property
    def residual(self) -> float:
        """Estimate of the largest error between nodes: from the nodes that a spline through the others misses."""
        coarse = _spline(self.y_mm[::2], self.x_mm[::2], self._values[::2, ::2])
        rows, columns = (axis[:(axis.size - 1) // 2 * 2 + 1] for axis in (self.y_mm, self.x_mm))
        missed = coarse(rows, columns) - self._values[:rows.size, :columns.size]
        return float(np.abs(missed).max()) / CONVERGENCE


class FieldEnd:
    """The end of a lens's field, which is the same at all wavelengths."""

    def __init__(self, lens: GridLens) -> None:
        self._table = GridTable.of(lens, lens.within)
        self._shares: dict[PixelGrid, float] = {}

    def __call__(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """Distance from the middle relative to the end of the field or of the grid, whichever is nearer."""
        sides = (np.abs(place - (axis[0] + axis[-1]) / 2) / (np.ptp(axis) / 2)
                 for place, axis in ((x_mm, self._table.x_mm), (y_mm, self._table.y_mm)))
        return np.maximum(self._table(*self._table.held(x_mm, y_mm)), np.maximum(*sides))

    def within(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """Whether the lens data cover places."""
        return self(x_mm, y_mm) <= 1 + ROUNDING

    def share_beyond(self, frame: PixelGrid) -> float:
        """The fraction of a frame's pixels that are beyond the lens data."""
        if frame not in self._shares:
            x_mm, y_mm = frame.axes_mm()
            self._shares = {frame: 1 - float(self.within(x_mm[None, :], y_mm[:, None]).mean())}
        return self._shares[frame]


class SplineFit:
    """A `Fit` of splines, which pass through the tables' nodes.

    `residual` is an estimate of the largest error between nodes, in the unit of the tables.
    """

    order = highest_order = DEGREE

    def __init__(self, *tables: GridTable) -> None:
        self._tables = tables

    @property
    def residual(self) -> float:
        return max(table.residual for table in self._tables)


class GridGeometry:
    """Positions in the ideal image and relative illumination over the field, at one wavelength.

    Beyond the grid, positions continue linearly, and all other quantities are constant.

    Parameters
    ----------
    optics : MonochromaticGrid
    lens_name : str

    Raises
    ------
    LensError
        If the distortion folds the field back over itself.
    """

    def __init__(self, optics: MonochromaticGrid, lens_name: str) -> None:
        self._source = tuple(GridTable.of(optics, optics.source_mm[..., axis], signs)
                             for axis, signs in enumerate(((1, -1), (-1, 1))))
        self.y_mm, self.x_mm = self._source[0].y_mm, self._source[0].x_mm
        self._illumination = GridTable.of(optics, optics.relative_illumination)
        self._flux = GridTable.of(optics, optics.point_flux)
        self.distortion, self.illumination = SplineFit(*self._source), SplineFit(self._illumination)
        self._check_distortion(optics.wavelength_nm, lens_name)

    @property
    def nbytes(self) -> int:
        return 4 * self.y_mm.size * self.x_mm.size * np.dtype(float).itemsize

    def source_mm(self, x_mm: np.ndarray, y_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions in the ideal image of light that lands at places: two arrays (...)."""
        x, y = self._held(x_mm, y_mm)
        beyond_x, beyond_y = x_mm - x, y_mm - y
        if not (beyond_x.any() or beyond_y.any()):
            across, upwards = (table(x, y) for table in self._source)
        else:
            across, upwards = (table(x, y) + table(x, y, dx=1) * beyond_x + table(x, y, dy=1) * beyond_y
                               for table in self._source)
        return across, upwards

    def source_slopes(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """Derivatives of `source_mm`, first its x and then its y, with respect to x and y: array (2, 2, ...)."""
        x, y = self._held(x_mm, y_mm)
        return np.stack([np.stack([table(x, y, dx=1), table(x, y, dy=1)]) for table in self._source])

    def landing_mm(self, x_mm: np.ndarray, y_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places where light at these positions in the ideal image lands: the inverse of `source_mm`."""
        wanted = np.stack([each.ravel() for each in np.broadcast_arrays(x_mm, y_mm)]).astype(float)
        extent_mm = min(np.ptp(self.x_mm), np.ptp(self.y_mm))
        found, left = wanted.copy(), np.arange(wanted.shape[1])
        for _ in range(NEWTON_STEPS):
            at = found[:, left]
            missing = wanted[:, left] - self.source_mm(*at)
            (a, b), (c, d) = self.source_slopes(*at)
            step = np.stack([d * missing[0] - b * missing[1], a * missing[1] - c * missing[0]]) / (a * d - b * c)
            step *= np.minimum(1, LONGEST_STEP * extent_mm / np.maximum(np.hypot(*step), NEWTON_TOLERANCE * extent_mm))
            found[:, left] += step
            left = left[np.abs(step).max(axis=0) > NEWTON_TOLERANCE * extent_mm]
            if not left.size:
                break
        shape = np.broadcast_shapes(np.shape(x_mm), np.shape(y_mm))
        return found[0].reshape(shape), found[1].reshape(shape)

    def relative_illumination(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """Relative illumination of the bundles that land at places."""
        return np.maximum(self._illumination(*self._held(x_mm, y_mm)), 0)

    def relative_flux(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """Relative flux of points that land at places, before their PSFs spread it: relative illumination times
        `point_flux`."""
        held = self._held(x_mm, y_mm)
        return self.relative_illumination(*held) * np.maximum(self._flux(*held), 0)

    def _held(self, x_mm, y_mm):
        return self._flux.held(x_mm, y_mm)

    def _check_distortion(self, wavelength_nm, lens_name):
        y_mm, x_mm = (np.interp(np.arange(CHECKED * (axis.size - 1) + 1) / CHECKED, np.arange(axis.size), axis)
                      for axis in (self.y_mm, self.x_mm))
        (a, b), (c, d) = self.source_slopes(x_mm[None, :], y_mm[:, None])
        folded = np.argwhere((a <= 0) | (d <= 0) | (a * d - b * c <= 0))
        if folded.size:
            row, column = folded[0]
            raise LensError(lens_name, "source_mm", f"folded at x = {x_mm[column]:.4g} mm, y = {y_mm[row]:.4g} mm",
                            f"distortion must be monotonic over the field in use (at {wavelength_nm:g} nm)")


def _spline(y_mm, x_mm, values):
    for axis, places in enumerate((y_mm, x_mm)):
        if places.size == 2:  # derivatives need at least a parabola
            values = np.insert(values, 1, values.mean(axis=axis), axis=axis)
    y_mm, x_mm = (np.insert(places, 1, places.mean()) if places.size == 2 else places for places in (y_mm, x_mm))
    return scipy.interpolate.RectBivariateSpline(y_mm, x_mm, values, kx=min(DEGREE, y_mm.size - 1),
                                                 ky=min(DEGREE, x_mm.size - 1))


def _unfolded(table, axis, mirrored, sign):
    """A table with the mirror image, times a sign, of its half along an axis in front of it."""
    if not mirrored:
        return table
    half = np.moveaxis(table, axis, 0)
    return np.moveaxis(np.concatenate([sign * half[:0:-1], half]), 0, axis)
