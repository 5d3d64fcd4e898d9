"""Pictures that are smooth except in a few places, in cells of several pixels."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Protocol

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..image.pixel_grid import PixelGrid
from .arrivals import CELL_PX, Arrivals

FAR_NODES = 12  # along each side of the frame, for light from far beyond it
MEAN_CELLS = 8  # from a point: closer cells receive the mean of their pixels

MOST_TRANSFORMS = 4  # in memory: for the next frames, and if they are computed before the light is known


class Spread(Protocol):
    """How a point spreads its light: a value, which compares and hashes by its contents."""

    def __call__(self, right_px: np.ndarray, up_px: np.ndarray) -> np.ndarray:
        """The share that falls on pixels at these distances from the point: smooth over a cell except near 0."""

    def __hash__(self) -> int: ...


Spreads = Sequence[tuple[np.ndarray, Spread]]


class Cells:
    """The cells of a picture. Light is interpolated between their corners.

    Parameters
    ----------
    shape_px : (int, int)

    Attributes
    ----------
    shape : (int, int)
        Rows and columns of cells; the last ones may extend beyond the picture.
    corner_rows, corner_columns : arrays
        Places of the corners, as indices of pixels.
    """

    def __init__(self, shape_px: Sequence[int]) -> None:
        self.shape = rows, columns = [-(-n // CELL_PX) for n in shape_px]
        self.corner_rows, self.corner_columns = (np.arange(n + 1) * CELL_PX - 0.5 for n in (rows, columns))
        inner = (np.arange(CELL_PX) + 0.5) / CELL_PX
        weights = np.stack([1 - inner, inner])
        self._weights = np.einsum("ar,bc->abrc", weights, weights).reshape(4, -1).astype(np.float32)

    def pixels(self, cells: np.ndarray, place: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
        """Places of the pixels of cells, a mask, from a row and column, to the right and up: arrays (cell, pixel)."""
        rows, columns = (CELL_PX * at[:, None] - start for at, start in zip(np.nonzero(cells), place, strict=True))
        return columns + np.tile(np.arange(CELL_PX), CELL_PX), -(rows + np.repeat(np.arange(CELL_PX), CELL_PX))

    def interpolated(self, corners: np.ndarray, cells: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Values of pixels between corners, array (row, column), of all cells or of a mask: array (..., pixel)."""
        around = np.stack([corners[:-1, :-1], corners[:-1, 1:], corners[1:, :-1], corners[1:, 1:]], axis=-1)
        return around[cells] @ self._weights

    def add_to(self, plane: np.ndarray, pixels: np.ndarray) -> None:
        """Add values, array (row, column, pixel) of all cells, to a picture."""
        rows, columns = self.shape
        values = pixels.reshape(rows, columns, CELL_PX, CELL_PX).swapaxes(1, 2).reshape(rows * CELL_PX, -1)
        plane += values[:plane.shape[0], :plane.shape[1]]

    def add_corners(self, cube: np.ndarray, corners: np.ndarray) -> None:
        """Add corners, array (wavelength, row, column), to a cube."""
        for plane, values in zip(cube, corners.astype(np.float32), strict=True):
            self.add_to(plane, self.interpolated(values))


class FineCells(Cells):
    """A spectral picture as the sum of light at the corners of cells and of values for the pixels of some cells.

    Parameters
    ----------
    waves : int
        Number of wavelengths.
    shape_px : (int, int)

    Attributes
    ----------
    corners : float32 array (wavelength, row, column)
    """

    def __init__(self, waves: int, shape_px: Sequence[int]) -> None:
        super().__init__(shape_px)
        rows, columns = self.shape
        self.corners = np.zeros((waves, rows + 1, columns + 1), np.float32)
        self._fine = np.zeros((rows * columns, waves, CELL_PX**2), np.float32)

    def add(self, factors: np.ndarray, cells: np.ndarray, pixels: np.ndarray) -> None:
        """Add values of the pixels of a mask's cells, array (cell, pixel), times a factor for each wavelength."""
        self._fine[np.flatnonzero(cells)] += factors.astype(np.float32)[:, None] * pixels.astype(np.float32)[:, None]

    def add_all(self, cube: np.ndarray) -> None:
        """Add the sum to a cube."""
        for index, plane in enumerate(cube):
            fine = self._fine[:, index].reshape(*self.shape, -1)
            self.add_to(plane, self.interpolated(self.corners[index]) + fine)


def spread_in_cells(frame: PixelGrid, light: Arrivals, spreads: Spreads,
                    discs: Sequence[tuple[float, ArrayLike]] = ((0.0, 1.0),)) -> np.ndarray:
    """The irradiance that light spreads over a frame, at the corners of its cells of CELL_PX pixels.

    Light counts up to half a frame beyond the frame; `spread_from_afar` spreads the rest.

    Parameters
    ----------
    frame : PixelGrid
    light : Arrivals
    spreads : sequence of (array (wavelength,), Spread)
        With factors.
    discs : sequence of (radius_px, part)
        Discs over which parts of each spot's light, array (spot,), are spread first.

    Returns
    -------
    array (wavelength, row, column)
    """
    shape, margins, size = _spaces(frame.shape_px)
    wide = [n + 2 * margin for n, margin in zip(shape, margins, strict=True)]
    kernels = [(factors, transformed(frame.shape_px, spread)) for factors, spread in spreads]
    blurs = [_disc(radius_px / CELL_PX, size) if radius_px else 1.0 for radius_px, _ in discs]
    inside = tuple(slice(margin, margin + n) for n, margin in zip(shape, margins, strict=True))
    result = np.empty((len(light.light), *shape))
    for index, each in enumerate(light.light):
        rows, columns = ((at + 0.5) / CELL_PX + margin for at, margin in zip(
            frame.index_of(light.x_mm[index], light.y_mm[index]), margins, strict=True))
        shared = _shared_out([each * part for _, part in discs], rows, columns, wide)
        spectrum = sum(blur * plane for blur, plane in zip(blurs, scipy.fft.rfft2(shared, size), strict=True))
        kernel = sum(factors[index] * one for factors, one in kernels)
        result[index] = scipy.fft.irfft2(spectrum * kernel, size)[inside]
    return np.maximum(result, 0)


def spread_from_afar(frame: PixelGrid, light: Arrivals, spreads: Spreads) -> np.ndarray:
    """As `spread_in_cells`, of light farther from the frame, which is smooth over all of it."""
    shape = [-(-n // CELL_PX) + 1 for n in frame.shape_px]
    corners = [np.arange(n) * CELL_PX - 0.5 for n in shape]
    nodes = [np.linspace(-0.5, each[-1], FAR_NODES) for each in corners]
    result = np.zeros((len(light.light), *shape))
    for index, each in enumerate(light.light):
        rows, columns = frame.index_of(light.x_mm[index], light.y_mm[index])
        away = [np.abs((at + 0.5) / CELL_PX - (n - 1) / 2) >= (n - 1) / 2 + -(-n // 2)
                for at, n in zip((rows, columns), shape, strict=True)]
        spots = np.flatnonzero((away[0] | away[1]) & (each > 0))
        if spots.size:
            right, up = nodes[1] - columns[spots, None, None], rows[spots, None, None] - nodes[0][:, None]
            values = sum(factors[index] * np.tensordot(each[spots], spread(right, up), 1)
                         for factors, spread in spreads)
            result[index] = scipy.interpolate.RectBivariateSpline(*nodes, values)(*corners)
    return result


def _spaces(frame_px):
    """Corners of the cells of a frame; those beyond each edge whose light counts; and the size of the transforms: rows
    and columns of each."""
    shape = [-(-n // CELL_PX) + 1 for n in frame_px]
    margins = [-(-n // 2) for n in shape]
    size = [scipy.fft.next_fast_len(2 * (n + margin) - 1, real=True) for n, margin in zip(shape, margins, strict=True)]
    return shape, margins, size


@lru_cache(maxsize=MOST_TRANSFORMS)
def transformed(frame_px: tuple[int, int], spread: Spread) -> np.ndarray:
    """The transform of a point's light in the cells of a frame, around the first cell."""
    shape, margins, size = _spaces(frame_px)
    reach = [n + margin - 1 for n, margin in zip(shape, margins, strict=True)]
    kernel = np.zeros(size)
    kernel[:2 * reach[0] + 1, :2 * reach[1] + 1] = _kernel(reach, spread)
    return scipy.fft.rfft2(np.roll(kernel, [-n for n in reach], axis=(0, 1)))


def _kernel(reach, spread):
    """Values of `spread` at distances of up to `reach` cells (rows, columns); close to 0, means over cells."""
    rows, columns = (np.arange(-n, n + 1) for n in reach)
    kernel = spread(columns * CELL_PX, -rows[:, None] * CELL_PX)
    near = [min(n, MEAN_CELLS) for n in reach]
    inner_rows, inner_columns = (np.arange(-n * CELL_PX, (n + 1) * CELL_PX) - (CELL_PX - 1) / 2 for n in near)
    means = spread(inner_columns, -inner_rows[:, None]).reshape(2 * near[0] + 1, CELL_PX, -1, CELL_PX).mean(axis=(1, 3))
    kernel[tuple(slice(n - m, n + m + 1) for n, m in zip(reach, near, strict=True))] = means
    return kernel


def _disc(radius, size):
    """The transform of an even disc of unit light, whose radius is in cells: of the shape of `scipy.fft.rfft2`."""
    rows, columns = scipy.fft.fftfreq(size[0])[:, None], scipy.fft.rfftfreq(size[1])
    turns = np.maximum(2 * np.pi * radius * np.hypot(rows, columns), np.finfo(float).eps)
    return 2 * scipy.special.j1(turns) / turns


def _shared_out(lights, rows, columns, shape):
    """Lights at places shared out among the four points around each: array of this shape for each."""
    first = np.floor([rows, columns]).astype(int)
    down, right = np.array([rows, columns]) - first
    step = shape[1] + 2  # with a rim of points
    index, planes = (first[0] + 1) * step + first[1] + 1, np.zeros((len(lights), (shape[0] + 2) * step))
    near = (rows > -1) & (rows < shape[0]) & (columns > -1) & (columns < shape[1])
    for plane, light in zip(planes, lights, strict=True):
        spots = np.flatnonzero((light != 0) & near)
        for row, row_share in ((0, 1 - down[spots]), (1, down[spots])):
            for column, column_share in ((0, 1 - right[spots]), (1, right[spots])):
                plane += np.bincount(index[spots] + row * step + column, light[spots] * row_share * column_share,
                                     plane.size)
    return planes.reshape(-1, shape[0] + 2, step)[:, 1:-1, 1:-1]
