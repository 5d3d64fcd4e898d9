"""Footprints: the rectangles of a capture that the pixels of a distorted picture average."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

LARGEST_FOOTPRINT_PX = 16  # of a larger footprint, only the middle is averaged
RIM_PX = LARGEST_FOOTPRINT_PX + 1


@dataclass(frozen=True, eq=False)
class Footprints:
    """The rectangle of a capture that each pixel averages. It conserves the energy of uniform light and points.

    Attributes
    ----------
    first : intp array (row, column)
        The first pixel that each rectangle touches, in the flattened capture.
    row_shares, column_shares : lists of arrays (row, column)
        The shares of the rectangle in that pixel's row or column and in the next ones.
    """

    first: np.ndarray
    row_shares: list
    column_shares: list

    @classmethod
    def of(cls, row: np.ndarray, column: np.ndarray, height_px: np.ndarray, width_px: np.ndarray,
           shape_px: tuple[int, int], precision: str) -> "Footprints":
        """Rectangles around positions in a capture of this shape, with shares of this precision: arrays (row, column).
        """
        rows, columns = shape_px
        first_row, row_shares = _overlaps(row, height_px, rows, precision)
        first_column, column_shares = _overlaps(column, width_px, columns, precision)
        return cls(first_row * columns + first_column, row_shares, column_shares)

    def average(self, planes: np.ndarray) -> np.ndarray:
        """Averages of a stack of captures: array (plane, row, column)."""
        values = planes.reshape(len(planes), -1)
        total = np.zeros((len(planes), *self.first.shape), planes.dtype)
        part = np.empty(self.first.shape, planes.dtype)
        for down, row_share in enumerate(self.row_shares):
            for across, column_share in enumerate(self.column_shares):
                pixel, share = self.first + (down * planes.shape[2] + across), row_share * column_share
                for plane, result in zip(values, total, strict=True):
                    np.take(plane, pixel, out=part, mode="clip")  # the mode that needs no copy
                    part *= share
                    result += part
        return total

    @property
    def nbytes(self) -> int:
        return self.first.nbytes + sum(share.nbytes for share in self.row_shares + self.column_shares)


def _overlaps(position, extent_px, length_px, precision):
    """First pixel that each interval around a position touches, and shares of the interval in it and the next ones.

    Intervals are 1 to LARGEST_FOOTPRINT_PX wide; intervals outside 0 to length_px are moved onto the rim.
    """
    extent_px = np.clip(extent_px, 1, LARGEST_FOOTPRINT_PX)
    touched = int(np.ceil(extent_px.max())) + 1
    begin = position - extent_px / 2
    first = np.floor(begin + 0.5)
    up_to = [np.clip((first + k + 0.5 - begin) / extent_px, 0, 1).astype(precision) for k in range(touched)]
    shares = [up_to[0], *(later - earlier for earlier, later in pairwise(up_to))]
    return np.clip(first, 0, length_px - touched).astype(np.intp), shares
