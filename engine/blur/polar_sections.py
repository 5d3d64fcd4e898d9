"""Sections filtered by their spectra, with PSFs interpolated between the nodes of the field map's table.

The nodes follow the lens and describe its PSFs better than the same number of nodes on a square grid. For a
rotationally symmetric lens they are at the heights of its data, between which the interpolation is exact, and at evenly
spaced azimuths. A pixel uses the four nodes around it:

    spectrum of a section = sum over the nodes around it of OTF_node * FT{weight_node * section}

Weights are never negative and sum to 1.
"""

from collections.abc import Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import scipy

from ..field.field_map import PlacedPsfs, Table
from ..runtime.memory import MemoryBudget
from .method import (
    AZIMUTHS,
    SECTION_SIZE,
    Method,
    PlaceOf,
    Spreader,
    Workload,
    section_sizes,
    space_px,
    spectrum_values,
    transform_counts,
)
from .section_needs import SectionNeeds

BATCH_VALUES = 1 << 18  # to fit in the processor's cache


@dataclass(frozen=True)
class Sections(Method):
    """PSFs interpolated in sections, between the nodes of a table."""

    name = "sections"
    summary = "PSFs that vary within each section, from a table"
    knobs = "section_size", "azimuths", "psf_energy", "flat_tolerance", "precision"
    by_accuracy = True
    tabulated = True

    section_size: int
    space_px: int
    azimuths: int = AZIMUTHS

    @classmethod
    def by_knobs(cls, section_size: int | None, steps: int | None, psf_radius_px: int, most_px: int) -> Method:
        section = min(section_size or SECTION_SIZE, most_px)
        return cls(section, space_px(section, psf_radius_px), steps or AZIMUTHS)

    @classmethod
    def choices(cls, steps: int, psf_radius_px: int, most_px: int) -> Iterable[Method]:
        return [cls(size, space_px(size, psf_radius_px), steps) for size in section_sizes(most_px)]

    @property
    def text(self) -> str:
        return f"{self.section_size} px sections between {self.nodes_text}"

    def counts(self, work: Workload) -> dict[str, float]:
        down, across = work.sections(self.section_size)
        weighed, nodes = work.layout.nodes_around(self.azimuths, work.planes, self.section_size)
        return transform_counts(work, self.section_size, self.space_px, weighed, nodes) | {"step": down * across}

    def cached_values(self, work: Workload) -> float:
        nodes = work.layout.nodes_around(self.azimuths, work.planes, self.section_size)[1]
        return nodes / 2 * spectrum_values(self.space_px)

    def spreader(self, psfs: PlacedPsfs, table: Table | None, psf_radius_px: int,
                 memory: MemoryBudget) -> "PolarSections":
        assert table is not None  # this method is tabulated
        return PolarSections(self.section_size, self.space_px, psf_radius_px, table, psfs.place, memory)


class PolarSections(Spreader):
    """A Spreader that multiplies spectra of sections by the OTFs of the nodes around them.

    Parameters
    ----------
    section_size, space_px, psf_radius_px : int
        The computational space is at least section_size + 2 psf_radius_px, to avoid wraparound.
    table : Table
    place : callable (rows, columns) -> Place
        Places in the field of the pixels at these rows and columns of a plane.
    memory : MemoryBudget
        For OTFs that the next picture reuses.
    """

    def __init__(self, section_size: int, space_px: int, psf_radius_px: int, table: Table, place: PlaceOf,
                 memory: MemoryBudget) -> None:
        self.section_size, self.space_px, self.radius_px = section_size, space_px, psf_radius_px
        self._table, self._place, self._memory = table, place, memory
        self._otfs, self._cached = {}, set()
        self._nodes = {}

    def prepare(self, rows: np.ndarray, needs: SectionNeeds, pool: Executor) -> None:
        """Find the nodes of the lit sections of these rows, and compute their OTFs."""
        sections = [(i, j) for i in rows for j in np.flatnonzero(needs.lit[i])]
        self._nodes |= zip(sections, pool.map(lambda section: self._nodes_around(*section), sections), strict=True)
        wanted = {np.complex64: set(), np.complex128: set()}
        for i, j in sections:
            wanted[np.complex128 if needs.double[i, j] else np.complex64].update(self._nodes[i, j][0])
        keys = {(node, precision) for precision, nodes in wanted.items() for node in nodes}
        self._otfs = {key: otf for key, otf in self._otfs.items() if key in keys or key in self._cached}
        for precision, nodes in wanted.items():
            self._make_otfs([node for node in sorted(nodes) if (node, precision) not in self._otfs], precision, pool)

    def _make_otfs(self, nodes, precision, pool):
        step = max(1, BATCH_VALUES // self.space_px**2)
        batches = [nodes[start:start + step] for start in range(0, len(nodes), step)]
        real = np.float32 if precision is np.complex64 else np.float64

        def transform(batch):
            psfs = self._table.node_psfs(batch).astype(real, copy=False)
            return scipy.fft.rfft2(psfs, (self.space_px, self.space_px))

        for batch, otfs in zip(batches, pool.map(transform, batches), strict=True):
            for node, otf in zip(batch, otfs, strict=True):
                self._otfs[node, precision] = otf
                if self._memory.take(otf.nbytes):
                    self._cached.add((node, precision))

    def _nodes_around(self, i, j):
        """Nodes around section (i, j), and their weights in its pixels: arrays (node,) and (node, row, column)."""
        if (i, j) in self._nodes:
            return self._nodes[i, j]
        size = self.section_size
        row, column = np.mgrid[i * size:(i + 1) * size, j * size:(j + 1) * size]
        cells, corner_weights = self._table.corners(self._place(row.ravel(), column.ravel()))
        present = np.bincount(cells.ravel()) > 0
        nodes, index = np.flatnonzero(present), np.cumsum(present) - 1
        weights = np.zeros((nodes.size, size * size), corner_weights.dtype)
        weights[index[cells], np.arange(size * size)] = corner_weights
        return nodes, weights.reshape(-1, size, size)

    def spread(self, i: int, columns: np.ndarray, band: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """See `Spreader`."""
        size, side = self.section_size, self.space_px
        lit = size + 2 * self.radius_px  # the rest is rounding
        for j in columns:
            spectrum = self._filtered(band[:, None, :, j * size:(j + 1) * size], *self._nodes[i, j])
            if (i, j) not in self._cached:
                if self._memory.take(self._nodes[i, j][1].nbytes):
                    self._cached.add((i, j))
                else:
                    del self._nodes[i, j]
            yield j * size, scipy.fft.irfft2(spectrum, (side, side), overwrite_x=True)[:, :lit, :lit]

    def _filtered(self, section, nodes, weights):
        """The spectrum of a section, (plane, 1, row, column), filtered by its nodes and summed."""
        side, precision = self.space_px, np.result_type(section.dtype, np.complex64).type
        spectrum, filtered = (np.zeros((len(section), side, side // 2 + 1), precision) for _ in range(2))
        step = max(1, BATCH_VALUES // (len(section) * side**2))
        for some in (slice(start, start + step) for start in range(0, nodes.size, step)):
            along_x = scipy.fft.rfft(section * weights[some].astype(section.dtype, copy=False), side)
            part = scipy.fft.fft(along_x, side, axis=-2, overwrite_x=True)
            for k, node in enumerate(nodes[some]):
                spectrum += np.multiply(part[:, k], self._otfs[node, precision], out=filtered)
        return spectrum
