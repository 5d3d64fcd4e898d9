"""A PSF for every pixel, mixed from a table, without interpolation in sections and without FFT.

For a rotationally symmetric lens, the remaining error comes from the table's azimuths: a few tenths of a per cent of a
point's light, or as little as required with more azimuths. Light stays positive, and dim pixels next to bright ones
keep the accuracy of single precision. The work is to multiply every pixel by every tap of its PSF: the best method for
PSFs of some tens of pixels.
"""

from collections.abc import Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..field.field_map import Cells, NodePsfs, PackedTable, PlacedPsfs, Table
from ..runtime.memory import MemoryBudget
from .method import AZIMUTHS, SECTION_SIZE, Method, PlaceOf, Spreader, Workload
from .packed_pixels import PackedPixels
from .section_needs import SectionNeeds

RUN_VALUES = 1 << 21  # in the PSFs of a run of sections


@dataclass(frozen=True)
class Pixels(Method):
    """A PSF for every pixel, mixed from a table. The sections are only portions of work."""

    name = "pixels"
    summary = "A PSF for each pixel, from a table: suits small PSFs"
    knobs = "azimuths", "psf_energy", "flat_tolerance", "precision"
    by_accuracy = True
    transforms = False
    tabulated = True

    section_size: int
    azimuths: int = AZIMUTHS

    @classmethod
    def by_knobs(cls, section_size: int | None, steps: int | None, psf_radius_px: int, most_px: int) -> Method:
        return cls(min(SECTION_SIZE, most_px), steps or AZIMUTHS)

    @classmethod
    def choices(cls, steps: int, psf_radius_px: int, most_px: int) -> Iterable[Method]:
        return [cls(min(SECTION_SIZE, most_px), steps)]

    @property
    def text(self) -> str:
        return f"a PSF for every pixel, from {self.nodes_text}"

    def counts(self, work: Workload) -> dict[str, float]:
        apart = work.pixels / work.planes.count
        runs = apart / max(self.section_size**2, RUN_VALUES / work.covered)
        return {"tap": work.pixels * work.taps, "mixed tap": apart * work.taps, "tap of a run": runs * work.taps}

    def cached_values(self, work: Workload) -> float:
        return RUN_VALUES * 3 / 2

    def table(self, psfs: NodePsfs) -> Cells:
        """The table, packed if the compiled loops support these PSFs."""
        return psfs.packed() or psfs.table()

    def spreader(self, psfs: PlacedPsfs, table: Table | PackedTable, psf_radius_px: int,
                 memory: MemoryBudget) -> "PixelSections | PackedPixels":
        if isinstance(table, PackedTable):
            return PackedPixels(self.section_size, table, psfs)
        return PixelSections(self.section_size, psf_radius_px, table, psfs.place, memory)


class PixelSections(Spreader):
    """A Spreader of single pixels.

    Parameters
    ----------
    section_size, psf_radius_px : int
    table : Table
    place : callable (rows, columns) -> Place
        Places in the field of the pixels at these rows and columns of a plane.
    memory : MemoryBudget
        For the pixels' PSFs that the next picture reuses.
    """

    def __init__(self, section_size: int, psf_radius_px: int, table: Table, place: PlaceOf,
                 memory: MemoryBudget) -> None:
        self.section_size, self.radius_px = section_size, psf_radius_px
        self.space_px = section_size + 2 * psf_radius_px
        self._table, self._place, self._memory = table, place, memory
        self._psfs = {}

    def prepare(self, rows: np.ndarray, needs: SectionNeeds, pool: Executor) -> None:
        """Do nothing: PSFs are mixed when they are used."""

    def spread(self, i: int, columns: np.ndarray, band: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """See `Spreader`. Adjacent sections share a patch, because long rows are faster."""
        size, reach = self.section_size, 2 * self.radius_px
        for left, right in self._runs(columns):
            light = band[:, :, left * size:right * size]
            patch = np.zeros((len(band), size + reach, light.shape[2] + reach), band.dtype)
            part = np.empty_like(light)
            for row, column, psf in zip(*self._run_psfs(i, left, right), strict=True):
                np.multiply(light, psf, out=part)
                patch[:, row:row + size, column:column + light.shape[2]] += part
            yield left * size, patch

    def _runs(self, columns):
        """Runs of adjacent sections that fit in the cache: pairs (first, one after the last)."""
        most = max(1, RUN_VALUES // (len(self._table.rows) * self.section_size**2))
        ends = [*(np.flatnonzero(np.diff(columns) > 1) + 1), columns.size]
        for start, end in pairwise([0, *ends]):
            for first in range(start, end, most):
                yield columns[first], columns[min(first + most, end) - 1] + 1

    def _run_psfs(self, i, left, right):
        """PSFs of the pixels of a run of sections: rows and columns of their taps, and array (tap, row, column)."""
        key = i, left, right
        if key in self._psfs:
            return self._psfs[key]
        size = self.section_size
        row, column = np.mgrid[i * size:(i + 1) * size, left * size:right * size]
        *taps, psfs = self._table.mixed(self._place(row.ravel(), column.ravel()))
        result = *taps, psfs.reshape(-1, *row.shape)
        if self._memory.take(psfs.nbytes):
            self._psfs[key] = result
        return result
