"""Tables of PSFs on the pixel grid: the PSF of a pixel is mixed from the four nodes around it.

The nodes are in rows: of the heights of a lens at some azimuths, or of its places on the sensor.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import DTypeLike

from ..kernels.spread_picture import spread_picture
from ..kernels.spreading import PackedTable, TablePlaces, spread
from ..lens import Lens

Psfs = TypeVar("Psfs")
BATCH_VALUES = 1 << 18  # to fit in the processor's cache


def corners_between(row: np.ndarray, column: np.ndarray, shape: tuple[int, int],
                    precision: DTypeLike) -> tuple[np.ndarray, np.ndarray]:
    """The four nodes around places, numbered row by row, and their weights: int and float arrays (4, place).

    Parameters
    ----------
    row, column : arrays (place,)
        Positions among the table's rows of nodes, and among the nodes of a row.
    shape : (int, int)
        Number of rows, and of nodes in a row.
    precision : dtype
        Of the weights, which are 0 to 1 and sum to 1.
    """
    below = np.minimum(row.astype(np.intp), shape[0] - 2)
    before = np.minimum(column.astype(np.intp), shape[1] - 2)
    up, on = (row - below).astype(precision), (column - before).astype(precision)
    first = below * shape[1] + before
    return (np.stack([first, first + 1, first + shape[1], first + shape[1] + 1]),
            np.stack([(1 - up) * (1 - on), (1 - up) * on, up * (1 - on), up * on]))


class TableCells(ABC):
    """The cells between the nodes of a table of PSFs.

    Attributes
    ----------
    radius_px : int
        Radius of the PSFs.
    mean_distance_px : float
        Mean distance of light from the chief ray, where it is largest.
    offsets_px : array (node, 2)
        Mean offset of the light of each node from the chief ray, downwards and to the right.
    """

    def __init__(self, radius_px: int, mean_distance_px: float, offsets_px: np.ndarray) -> None:
        self.radius_px, self.mean_distance_px, self.offsets_px = radius_px, mean_distance_px, offsets_px

    @property
    @abstractmethod
    def nbytes(self) -> int:
        """Memory of the PSFs."""

    @abstractmethod
    def corners(self, place: Any) -> tuple[np.ndarray, np.ndarray]:
        """The four nodes of the table around places, and their weights, as by `corners_between`."""

    def mean_offsets_px(self, place: Any) -> np.ndarray:
        """Mean offset of light from the chief ray, downwards and to the right: array (2, place)."""
        nodes, weights = self.corners(place)
        return np.einsum("kp,kpd->dp", weights, self.offsets_px[nodes])


class PlainTable(TableCells):
    """A table of PSFs in plain arrays.

    Parameters
    ----------
    table : array (row, node, tap)
    taps : int array (tap,)
        Indices of the taps in the square of 2 radius_px + 1: the pixels that any PSF reaches.
    reached : bool array (row, tap)
        Whether the PSFs of a row of nodes reach a tap.

    Attributes
    ----------
    table
    rows, columns : int arrays (tap,)
        Positions of the taps in the square.
    """

    def __init__(self, table: np.ndarray, taps: np.ndarray, reached: np.ndarray) -> None:
        self.table, self._reached = table, reached
        self.rows, self.columns = np.divmod(taps, 2 * self.radius_px + 1)
        self._in_row, self._by_node = table.shape[1], table.reshape(-1, taps.size)

    @property
    def nbytes(self) -> int:
        """See `TableCells`."""
        return self.table.nbytes

    def mixed(self, place: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """PSFs at these places: rows and columns of taps, and array (tap, place), contiguous for each tap.

        Taps that no PSF reaches between the first and the last row of nodes around the places are left out.
        """
        nodes, weights = self.corners(place)
        first, last = nodes.min(), nodes.max()
        taps = np.flatnonzero(self._reached[first // self._in_row:last // self._in_row + 1].any(axis=0))
        by_node, places = np.take(self._by_node[first:last + 1], taps, axis=1), nodes.shape[1]
        psfs = np.empty((taps.size, places), by_node.dtype)
        step = max(1, BATCH_VALUES // max(1, taps.size))
        mixture, part = (np.empty((min(step, places), taps.size), by_node.dtype) for _ in range(2))
        for start in range(0, places, step):
            some = slice(start, min(start + step, places))
            into, one = (buffer[:some.stop - start] for buffer in (mixture, part))
            into[:] = 0
            for node, weight in zip(nodes - first, weights, strict=True):
                np.take(by_node, node[some], axis=0, out=one, mode="clip")  # the mode that needs no copy
                one *= weight[some, None]
                into += one
            psfs[:, some] = into.T
        return self.rows[taps], self.columns[taps], psfs

    def node_psfs(self, nodes: Sequence[int] | np.ndarray) -> np.ndarray:
        """The PSFs of these nodes: array (node, row, column), odd square, the chief ray in the middle."""
        return self.squares(self.rows, self.columns, self._by_node[nodes])

    def squares(self, rows: np.ndarray, columns: np.ndarray, taps: np.ndarray) -> np.ndarray:
        """PSFs in squares from taps (PSF, tap) at these rows and columns: array (PSF, row, column)."""
        side = 2 * self.radius_px + 1
        psfs = np.zeros((len(taps), side, side), self.table.dtype)
        psfs[:, rows, columns] = taps
        return psfs


class CompiledTable(TableCells):
    """A table of PSFs in pieces for the compiled loops.

    Attributes
    ----------
    pieces : PackedTable
    """

    pieces: PackedTable

    @property
    def nbytes(self) -> int:
        """See `TableCells`."""
        return self.pieces.nbytes

    def spread(self, places: TablePlaces, first_row: int, light: np.ndarray, lit: np.ndarray,
               section_px: int) -> np.ndarray:
        """Spread the light of a row of sections, (plane, row, column), that starts at this row."""
        return spread(self.pieces, places.lower(first_row), light, lit, section_px, slice(section_px))

    def spread_at_once(self, places: TablePlaces, light: np.ndarray, lit: np.ndarray,
                       section_px: int) -> tuple[np.ndarray, str] | None:
        """Spread the light of all sections, and name the graphics processor; None if it does not do this."""
        return spread_picture(self.pieces, places, light, lit, section_px)


class TablesByWavelength(ABC, Generic[Psfs]):
    """The PSFs of a lens for tables. If the data have fewer wavelengths, PSFs are made at these, then mixed.

    Parameters
    ----------
    lens : Lens
    wavelengths_nm : array
        All wavelengths that will be used.
    """

    def __init__(self, lens: Lens, wavelengths_nm: Sequence[float] | np.ndarray) -> None:
        self._lens = lens
        self._cached = lru_cache(maxsize=2)(self._make)  # wavelengths come in order
        self._mix = len(lens.wavelengths_around(wavelengths_nm)) < len(wavelengths_nm)

    def at_wavelength(self, wavelength_nm: float) -> Psfs:
        """The PSFs for a table at this wavelength."""
        if not self._mix:
            return self._make(wavelength_nm)
        below, weight = self._lens.wavelength_position(wavelength_nm)
        psfs = self._cached(self._lens.wavelengths_nm[below])
        return self._mixed(psfs, self._cached(self._lens.wavelengths_nm[below + 1]), weight) if weight else psfs

    @abstractmethod
    def _make(self, wavelength_nm: float) -> Psfs:
        """The PSFs at one wavelength of the lens data, or of `wavelengths_nm`."""

    @abstractmethod
    def _mixed(self, psfs: Psfs, others: Psfs, weight: float) -> Psfs:
        """The PSFs between two wavelengths, by the weight of the second."""


def mixed_by_row(psfs: np.ndarray, others: np.ndarray, weight: float) -> np.ndarray:
    """The PSFs at a wavelength between two, by the weight of the second: array (row, ...)."""
    mixture = np.empty_like(psfs)
    for mixed, one, other in zip(mixture, psfs, others, strict=True):  # saves memory
        np.multiply(one, 1 - weight, out=mixed)
        mixed += weight * other
    return mixture
