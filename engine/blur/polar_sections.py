"""Sections filtered by their spectra, with PSFs interpolated between the nodes of a table of heights and azimuths.

Across the field PSFs change by turning and by the steps of the table's heights. So nodes that lie on the heights and at
even azimuths tell far more than as many on a square grid: between heights the interpolation is exact, for the lens
data are no finer, and between azimuths it is as good as these are close. A pixel has the four nodes around it:

    spectrum of a section = sum over the nodes around it of OTF_node * FT{weight_node * section}

Weights are never negative and sum to 1.
"""

from collections.abc import Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from scipy import fft

from ..field.psf_bank import PlacedPsfs
from ..field.psf_table import PsfTable
from ..memory import MemoryBudget
from .method import (
    AZIMUTHS,
    SECTION_SIZE,
    Method,
    Place,
    Workload,
    section_sizes,
    space_px,
    spectrum_values,
    transform_counts,
)
from .section_needs import SectionNeeds

BATCH_VALUES = 1 << 18  # what the processor's cache holds
NODES_BESIDE, OVER_EDGE = 2, 1.1  # nodes around a section beside those in it; its diagonals reach over its sides


@dataclass(frozen=True)
class Sections(Method):
    """PSFs interpolated inside sections, between the heights of the lens data and some azimuths."""

    name = "sections"
    knobs = "section_size", "azimuths", "psf_energy", "flat_tolerance", "precision"
    by_accuracy = True

    section_size: int
    space_px: int
    azimuths: int = AZIMUTHS

    @classmethod
    def by_knobs(cls, section_size: int | None, azimuths: int | None, psf_radius_px: int, most_px: int) -> Method:
        section = min(section_size or SECTION_SIZE, most_px)
        return cls(section, space_px(section, psf_radius_px), azimuths or AZIMUTHS)

    @classmethod
    def choices(cls, azimuths: int, psf_radius_px: int, most_px: int) -> Iterable[Method]:
        return [cls(size, space_px(size, psf_radius_px), azimuths) for size in section_sizes(most_px)]

    @property
    def text(self) -> str:
        return f"{self.section_size} px sections between {self.azimuths} azimuths"

    def counts(self, work: Workload) -> dict[str, float]:
        down, across = work.sections(self.section_size)
        weighed, nodes = self._nodes(work)
        return transform_counts(work, self.section_size, self.space_px, weighed, nodes) | {"step": down * across}

    def kept_values(self, work: Workload) -> float:
        return self._nodes(work)[1] / 2 * spectrum_values(self.space_px)

    def _nodes(self, work):
        """How many nodes sections have around them, in all; and how many there are."""
        rows, columns = ((np.arange(count) + 0.5) * self.section_size - centre for count, centre in zip(
            work.sections(self.section_size), work.planes.grid.centre_px, strict=True))
        radius_px = np.maximum(np.hypot(rows[:, None], columns), self.section_size / 2)
        azimuths = 2 * self.azimuths * work.planes.quarter_turns + 1
        over = OVER_EDGE * self.section_size
        across = np.minimum(over * self.azimuths / (np.pi / 4 * radius_px) + NODES_BESIDE, azimuths)
        along = min(over / work.height_px + NODES_BESIDE, work.heights)
        nodes = min(work.heights, radius_px.max() / work.height_px + NODES_BESIDE) * azimuths
        return float((along * across).sum()), nodes

    def spreader(self, psfs: PlacedPsfs, table: PsfTable | None, psf_radius_px: int,
                 memory: MemoryBudget) -> "PolarSections":
        assert table is not None  # as every method with azimuths is given one
        return PolarSections(self.section_size, self.space_px, psf_radius_px, table, psfs.place, memory)


class PolarSections:
    """A Spreader that multiplies spectra of sections by the OTFs of the nodes around them.

    Parameters
    ----------
    section_size, space_px, psf_radius_px : int
        The computational space is at least section_size + 2 psf_radius_px, so that nothing wraps around.
    table : PsfTable
    place : callable (rows, columns) -> (paraxial_height_mm, azimuth_rad)
        Where in the field the pixels of these index terms lie.
    memory : MemoryBudget
        For OTFs, to keep them for the next picture.
    """

    def __init__(self, section_size: int, space_px: int, psf_radius_px: int, table: PsfTable, place: Place,
                 memory: MemoryBudget) -> None:
        self.section_size, self.space_px, self.radius_px = section_size, space_px, psf_radius_px
        self._table, self._place, self._memory = table, place, memory
        self._otfs, self._kept = {}, set()
        self._nodes = {}

    def prepare(self, rows: np.ndarray, needs: SectionNeeds, pool: Executor) -> None:
        """Find the nodes of the lit sections of these rows, and make their OTFs."""
        sections = [(i, j) for i in rows for j in np.flatnonzero(needs.lit[i])]
        self._nodes |= zip(sections, pool.map(lambda section: self._nodes_around(*section), sections), strict=True)
        wanted = {np.complex64: set(), np.complex128: set()}
        for i, j in sections:
            wanted[np.complex128 if needs.double[i, j] else np.complex64].update(self._nodes[i, j][0])
        keys = {(node, precision) for precision, nodes in wanted.items() for node in nodes}
        self._otfs = {key: otf for key, otf in self._otfs.items() if key in keys or key in self._kept}
        for precision, nodes in wanted.items():
            self._make_otfs([node for node in sorted(nodes) if (node, precision) not in self._otfs], precision, pool)

    def _make_otfs(self, nodes, precision, pool):
        step = max(1, BATCH_VALUES // self.space_px**2)
        batches = [nodes[start:start + step] for start in range(0, len(nodes), step)]
        real = np.float32 if precision is np.complex64 else np.float64

        def transform(batch):
            return fft.rfft2(self._table.node_psfs(batch).astype(real, copy=False), (self.space_px, self.space_px))

        for batch, otfs in zip(batches, pool.map(transform, batches), strict=True):
            for node, otf in zip(batch, otfs, strict=True):
                self._otfs[node, precision] = otf
                if self._memory.take(otf.nbytes):
                    self._kept.add((node, precision))

    def _nodes_around(self, i, j):
        """Nodes around section (i, j), and the weights that they have in its pixels: (node,), (node, row, column)."""
        if (i, j) in self._nodes:
            return self._nodes[i, j]
        size = self.section_size
        row, column = np.mgrid[i * size:(i + 1) * size, j * size:(j + 1) * size]
        cells, corner_weights = self._table.corners(*self._place(row.ravel(), column.ravel()))
        present = np.bincount(cells.ravel()) > 0
        nodes, index = np.flatnonzero(present), np.cumsum(present) - 1
        weights = np.zeros((nodes.size, size * size), corner_weights.dtype)
        weights[index[cells], np.arange(size * size)] = corner_weights
        return nodes, weights.reshape(-1, size, size)

    def spread(self, i: int, columns: np.ndarray, band: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """See `Spreader`."""
        size, side = self.section_size, self.space_px
        lit = size + 2 * self.radius_px  # what is beyond is rounding
        for j in columns:
            spectrum = self._filtered(band[:, None, :, j * size:(j + 1) * size], *self._nodes[i, j])
            if (i, j) not in self._kept:
                if self._memory.take(self._nodes[i, j][1].nbytes):
                    self._kept.add((i, j))
                else:
                    del self._nodes[i, j]
            yield j * size, fft.irfft2(spectrum, (side, side), overwrite_x=True)[:, :lit, :lit]

    def _filtered(self, section, nodes, weights):
        """The spectrum of a section, (plane, 1, row, column), filtered by its nodes and summed."""
        side, precision = self.space_px, np.result_type(section.dtype, np.complex64).type
        spectrum, filtered = (np.zeros((len(section), side, side // 2 + 1), precision) for _ in range(2))
        step = max(1, BATCH_VALUES // (len(section) * side**2))
        for some in (slice(start, start + step) for start in range(0, nodes.size, step)):
            along_x = fft.rfft(section * weights[some].astype(section.dtype, copy=False), side)
            part = fft.fft(along_x, side, axis=-2, overwrite_x=True)
            for k, node in enumerate(nodes[some]):
                spectrum += np.multiply(part[:, k], self._otfs[node, precision], out=filtered)
        return spectrum
