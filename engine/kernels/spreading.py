"""Spreading of light with a PSF per pixel, interpolated in a table of heights and azimuths, or of a grid of nodes."""

from collections.abc import Callable
from ctypes import Structure, byref
from dataclasses import dataclass
from math import isqrt

import numpy as np

from .arrays import address, picture
from .declarations import NUMBERS, STRUCTURES
from .library import check, chosen

PLACES, TABLE, SECTIONS = STRUCTURES["places"], STRUCTURES["table"], STRUCTURES["sections"]
LONGEST, SLACK = NUMBERS["LONGEST"], NUMBERS["SLACK"]
LINE_BYTES = 64
MOST_TAPS = 8 * LONGEST - 3  # in a piece: the last three are zero

Fill = Callable[[int, np.ndarray, np.ndarray], object]


@dataclass(frozen=True, eq=False)
class TablePlaces:
    """Positions of a picture's pixels among the heights and azimuths, or the cells, of a table of PSFs.

    Attributes
    ----------
    arrays : tuple of arrays
        Of a curve: paraxial heights and intervals (sample,), and the table's heights. Of cells: those of rows and of
        columns, and fractions of both on to the next nodes.
    structure : Structure
        As the loops read them.
    """

    arrays: tuple[np.ndarray, ...]
    structure: Structure

    @classmethod
    def of(cls, centre_px: tuple[float, float], samples_per_px: float, paraxial: np.ndarray, heights: np.ndarray,
           quarter_steps: int, quarter_turns: int) -> "TablePlaces":
        """From a curve, evenly spaced over the distance from the axis, and constant beyond the last sample.

        Parameters
        ----------
        centre_px : (row, column)
            Position of the axis.
        samples_per_px : float
        paraxial : array (sample,)
            Paraxial height: never falling, and rising by less than a step of the table's heights between samples.
        heights : array (height,)
            The table's heights, in the same unit.
        quarter_steps, quarter_turns : int
            Steps between azimuths of the table in a quarter turn, and number of quarter turns, clockwise from the
            right.
        """
        paraxial, heights = (np.ascontiguousarray(each, dtype=np.float64) for each in (paraxial, heights))
        interval = np.clip(np.searchsorted(heights, paraxial, side="right") - 1, 0, heights.size - 2).astype(np.int32)
        structure = PLACES(*centre_px, samples_per_px, address(paraxial, np.float64), address(interval, np.int32),
                           address(heights, np.float64), paraxial.size - 1, heights.size,
                           quarter_steps * quarter_turns + 1, quarter_steps)
        return cls((paraxial, interval, heights), structure)

    @classmethod
    def in_cells(cls, rows: tuple[np.ndarray, np.ndarray], columns: tuple[np.ndarray, np.ndarray],
                 cells_across: int) -> "TablePlaces":
        """From rows and columns of cells, whose intervals of the table are numbered row by row.

        Parameters
        ----------
        rows, columns : pairs of arrays (row,) and (column,)
            The row, or column, of the cell of each of the picture's; and fractions on to the nodes below, or to the
            right. The last ones continue beyond the picture.
        cells_across : int
            Number of cells in a row.
        """
        (row_cell, row_on), (column_cell, column_on) = rows, columns
        cells = tuple(np.ascontiguousarray(each, np.int32) for each in (row_cell * cells_across, column_cell))
        on = tuple(np.ascontiguousarray(each, np.float32) for each in (row_on, column_on))
        addresses = zip(("row_cell", "column_cell", "row_on", "column_on"), (*cells, *on),
                        2 * (np.int32,) + 2 * (np.float32,), strict=True)
        return cls((*cells, *on), PLACES(azimuths=2, rows=row_on.size, columns=column_on.size,
                                         **{name: address(array, dtype) for name, array, dtype in addresses}))

    def lower(self, rows: int) -> "TablePlaces":
        """The positions for a picture that begins `rows` rows below this one."""
        structure = PLACES.from_buffer_copy(self.structure)
        structure.centre_row -= rows
        if structure.row_cell:
            structure.row_cell += int(rows) * np.dtype(np.int32).itemsize
            structure.row_on += int(rows) * np.dtype(np.float32).itemsize
            structure.rows -= rows
        return TablePlaces(self.arrays, structure)


@dataclass(frozen=True, eq=False)
class PackedTable:
    """A table of PSFs packed for `spread`: for each interval, the nonzero pieces of rows.

    An interval is between two adjacent heights, or it is a cell of a grid of nodes.

    Attributes
    ----------
    side_px : int
        Side of the PSFs' square of pixels.
    taps_by_interval : int array (interval,)
        Number of taps for a pixel in the interval.
    arrays : tuple of arrays
        Taps, and the arrays of `structure`, in its order.
    structure : Structure
        As the loops read them.
    """

    side_px: int
    taps_by_interval: np.ndarray
    arrays: tuple[np.ndarray, ...]
    structure: Structure

    @classmethod
    def of(cls, reached: np.ndarray, azimuths: int, fill: Fill) -> "PackedTable":
        """From PSFs that a function writes.

        Parameters
        ----------
        reached : bool array (interval, pixel)
            The pixels of a square, row by row, that the PSFs around an interval reach.
        azimuths : int
        fill : callable (interval, pixels, out)
            Writes these pixels of the PSFs around an interval to out, float32 array (2, azimuth, tap): at the heights
            below and above, or of the nodes above and below a cell. The index after the square's last pixel stands for
            a black pixel.
        """
        intervals, pixels = reached.shape
        side = isqrt(pixels)
        interval, eights, row, column, count = _pieces(reached.reshape(-1, side, side))
        start = np.cumsum(8 * eights) - 8 * eights
        piece = np.repeat(np.arange(eights.size), 8 * eights)
        along = np.arange(piece.size) - start[piece]
        source = np.where(along < count[piece], row[piece] * side + column[piece] + along, pixels)
        length = np.bincount(interval, 8 * eights, intervals).astype(np.int64)
        begin = SLACK + np.cumsum(2 * azimuths * np.append(0, length))
        taps = _aligned_zeros(begin[-1] + SLACK)
        for index, interval_source in enumerate(np.split(source, np.cumsum(length)[:-1])):
            fill(index, interval_source, taps[begin[index]:begin[index + 1]].reshape(2, azimuths, -1))
        counts = np.bincount(interval * (LONGEST + 1) + eights, minlength=intervals * (LONGEST + 1))
        first_piece = np.searchsorted(interval, np.arange(intervals))
        numbers = [np.ascontiguousarray(each, dtype=np.int64)
                   for each in (begin, length, first_piece, counts, row, column)]
        return cls(side, length, (taps, *numbers), TABLE(
            address(taps, np.float32), taps.size, side, intervals, *(address(each, np.int64) for each in numbers),
            row.size))

    @property
    def nbytes(self) -> int:
        return sum(array.nbytes for array in self.arrays)


def _aligned_zeros(count):
    """Single-precision zeros that start a line of the processor's cache: reading vectors across lines is slower."""
    zeros = np.zeros(count + LINE_BYTES // 4, np.float32)
    start = -zeros.ctypes.data % LINE_BYTES // 4
    return zeros[start:start + count]


def _pieces(reached):
    """Cut rows of the pixels that PSFs reach in each interval, (interval, row, column), into pieces.

    Returns arrays of their intervals, eights of taps, rows, first columns and taps, with the shortest pieces of each
    interval first.
    """
    interval, row = np.nonzero(reached.any(axis=2))
    across = reached[interval, row]
    first, end = across.argmax(axis=1), across.shape[1] - across[:, ::-1].argmax(axis=1)
    cuts = -(-(end - first) // MOST_TAPS)
    line = np.repeat(np.arange(row.size), cuts)
    column = first[line] + MOST_TAPS * (np.arange(line.size) - (np.cumsum(cuts) - cuts)[line])
    count = np.minimum(MOST_TAPS, end[line] - column)
    eights = -(-(count + 3) // 8)
    order = np.lexsort((column, row[line], eights, interval[line]))
    return tuple(each[order] for each in (interval[line], eights, row[line], column, count))


def spread(table: PackedTable, places: TablePlaces, light: np.ndarray, lit: np.ndarray, section_px: int,
           rows: slice) -> np.ndarray:
    """Spread the light of some rows of a picture by its PSFs.

    Parameters
    ----------
    table : PackedTable
    places : TablePlaces
    light : float32 array (plane, row, column)
        One plane, or the four planes of a folded picture, which share the PSFs.
    lit : bool array (section row, section column)
        The square sections of section_px pixels to spread.
    section_px : int
    rows : slice

    Returns
    -------
    float32 array (plane, row, column)
        The rows and columns of the light, and those beyond that the PSFs reach. It is a view of an array with longer
        rows.
    """
    loops, variant = chosen()
    planes, _, columns = light.shape
    first, end, _ = rows.indices(light.shape[1])
    out = np.zeros((planes, end - first + table.side_px - 1, columns + table.side_px - 1 + SLACK), np.float32)
    lit = np.ascontiguousarray(lit, dtype=np.bool_)
    work = np.empty(loops.lf_spread_work(table.structure.pieces, columns), np.uint8)
    check(loops.lf_spread(variant, byref(places.structure), byref(table.structure), byref(picture(light)),
                          byref(SECTIONS(lit.ctypes.data, *lit.shape, section_px)), first, end, byref(picture(out)),
                          work.ctypes.data))
    return out[:, :, :-SLACK]
