"""Every pixel's light spread by a PSF of its own, mixed from a table of heights and azimuths."""

from ctypes import Structure, byref
from dataclasses import dataclass

import numpy as np

from .library import PLACES, SECTIONS, TABLE, address, check, chosen, picture

LONGEST, SLACK = 8, 16  # those of kernels.h
MOST_TAPS = 8 * LONGEST - 3  # of a piece: the last three are zero


@dataclass(frozen=True, eq=False)
class TablePlaces:
    """Where among the heights and azimuths of a table of PSFs the pixels of a picture lie."""

    _height: np.ndarray
    _structure: Structure

    @classmethod
    def of(cls, centre_px: tuple[float, float], samples_per_px: float, height: np.ndarray,
           table_shape: tuple[int, int], turn_rad: float) -> "TablePlaces":
        """Of a curve over the distance from the axis, evenly spaced from there on; the last sample is held.

        Parameters
        ----------
        centre_px : (row, column)
            Of the axis.
        samples_per_px : float
        height : array (sample,)
            Place among the heights of the table, in index terms.
        table_shape : (heights, azimuths)
        turn_rad : float
            Over which the azimuths go, both ends included, clockwise from the right.
        """
        heights, azimuths = table_shape
        height = np.ascontiguousarray(height, dtype=np.float32)
        return cls(height, PLACES(*centre_px, samples_per_px, address(height, np.float32), height.size - 1, heights,
                                  azimuths, (azimuths - 1) / turn_rad))


@dataclass(frozen=True, eq=False)
class PackedTable:
    """A table of PSFs in the pieces that `spread` takes: between two heights, rows of what is not zero there.

    Attributes
    ----------
    side_px : int
        Of the square of pixels that the PSFs lie in.
    taps_by_interval : int array (interval,)
        How many are touched for a pixel that lies between two heights.
    """

    side_px: int
    taps_by_interval: np.ndarray
    _arrays: tuple[np.ndarray, ...]
    _structure: Structure

    @classmethod
    def of(cls, psfs: np.ndarray, rows: np.ndarray, columns: np.ndarray, side_px: int) -> "PackedTable":
        """Of PSFs (height, azimuth, tap), float32, whose taps lie at these rows and columns of the square."""
        heights, azimuths, taps = psfs.shape
        used = (psfs != 0).any(axis=1)
        tap_at = np.full((side_px, side_px), taps)
        tap_at[rows, columns] = np.arange(taps)
        sources, counts, first_piece, corners = [], [], [], []
        for taken in used[:-1] | used[1:]:
            pieces = _pieces(np.flatnonzero(taken), rows, columns, side_px)
            first_piece.append(len(corners))
            counts.append(np.bincount([eights for eights, *_ in pieces], minlength=LONGEST + 1))
            source = np.full((8 * sum(eights for eights, *_ in pieces),), taps)
            at = 0
            for eights, row, column, count in pieces:
                source[at:at + count] = tap_at[row, column:column + count]
                at += 8 * eights
                corners.append((row, column))
            sources.append(source)
        length = np.array([source.size for source in sources])
        begin = SLACK + np.concatenate([[0], np.cumsum(2 * azimuths * length)])
        packed = np.zeros(begin[-1] + SLACK, np.float32)
        with_zero = np.concatenate([psfs, np.zeros((heights, azimuths, 1), np.float32)], axis=2)
        for b, source in enumerate(sources):
            part = packed[begin[b]:begin[b + 1]].reshape(azimuths, 2, -1)
            np.take(with_zero[b:b + 2].swapaxes(0, 1), source, axis=2, out=part, mode="clip")
        corner = np.array(corners, np.int64).reshape(-1, 2)
        arrays = (packed, *(np.ascontiguousarray(each, dtype=np.int64) for each in (
            begin, length, first_piece, counts, corner[:, 0], corner[:, 1])))
        whole, *numbers = arrays
        return cls(side_px, length, arrays, TABLE(
            address(whole, np.float32), whole.size, side_px, heights - 1,
            *(address(each, np.int64) for each in numbers), len(corner)))

    @property
    def nbytes(self) -> int:
        return sum(array.nbytes for array in self._arrays)


def _pieces(taps, rows, columns, side_px):
    """Rows of these taps cut into pieces, the shortest first: lists of (eights, row, first column, taps)."""
    first = np.full(side_px, side_px)
    end = np.zeros(side_px, int)
    np.minimum.at(first, rows[taps], columns[taps])
    np.maximum.at(end, rows[taps], columns[taps] + 1)
    return sorted((-(-(min(MOST_TAPS, end[row] - column) + 3) // 8), row, column, min(MOST_TAPS, end[row] - column))
                  for row in range(side_px) for column in range(first[row], end[row], MOST_TAPS))


def spread(table: PackedTable, places: TablePlaces, light: np.ndarray, lit: np.ndarray, section_px: int,
           rows: slice) -> np.ndarray:
    """The light of some rows of a picture, spread by its PSFs.

    Parameters
    ----------
    table : PackedTable
    places : TablePlaces
    light : float32 array (plane, row, column)
        Of one plane, or of the four of a folded picture, which share the PSFs.
    lit : bool array (section row, section column)
        Which square sections of section_px pixels to spread.
    section_px : int
    rows : slice

    Returns
    -------
    float32 array (plane, row, column)
        As many rows and columns as the light has, and those that the PSFs reach on both sides. It is a view of an array
        with longer rows.
    """
    loops, variant = chosen()
    planes, _, columns = light.shape
    first, end, _ = rows.indices(light.shape[1])
    out = np.zeros((planes, end - first + table.side_px - 1, columns + table.side_px - 1 + SLACK), np.float32)
    lit = np.ascontiguousarray(lit, dtype=np.bool_)
    work = np.empty(loops.lf_spread_work(table._structure.pieces, columns), np.uint8)
    check(loops.lf_spread(variant, byref(places._structure), byref(table._structure), byref(picture(light)),
                          byref(SECTIONS(lit.ctypes.data, *lit.shape, section_px)), first, end, byref(picture(out)),
                          work.ctypes.data))
    return out[:, :, :-SLACK]
