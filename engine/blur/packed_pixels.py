"""The method of `pixels` by the compiled loops: a PSF for every pixel, one row of sections at a time, or all of them on
a graphics processor."""

from collections.abc import Iterator
from concurrent.futures import Executor

import numpy as np

from ..field.field_map import PackedTable, PlacedPsfs
from .method import Spreader
from .section_needs import SectionNeeds


class PackedPixels(Spreader):
    """A Spreader of single pixels, by the compiled loops.

    Parameters
    ----------
    section_size : int
    table : PackedTable
    psfs : PlacedPsfs
    """

    def __init__(self, section_size: int, table: PackedTable, psfs: PlacedPsfs) -> None:
        self.section_size, self.radius_px = section_size, table.radius_px
        self.space_px = section_size + 2 * table.radius_px
        self._table, self._places = table, table.places(psfs)

    def at_once(self, light: np.ndarray, lit: np.ndarray) -> np.ndarray | None:
        """See `Spreader`."""
        spread = self._table.spread_at_once(self._places, light, lit, self.section_size)
        picture, self.gpu = spread or (None, "")
        return picture

    def prepare(self, rows: np.ndarray, needs: SectionNeeds, pool: Executor) -> None:
        """Do nothing: the table contains everything."""

    def spread(self, i: int, columns: np.ndarray, band: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """See `Spreader`. It yields one patch, as wide as the band."""
        size = self.section_size
        lit = np.zeros((1, band.shape[2] // size), dtype=bool)
        lit[0, columns] = True
        yield 0, self._table.spread(self._places, i * size, band, lit, size)
