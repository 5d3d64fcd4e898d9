"""Isoplanatic sections with one PSF each, the paper's method (Eq. 7-9); or one PSF for the complete picture."""

from collections.abc import Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import scipy

from ..field.field_map import PlacedPsfs, Table
from ..runtime.memory import MemoryBudget
from .method import Method, Psfs, Spreader, Workload, section_sizes, space_px, spectrum_values, transform_counts
from .section_needs import SectionNeeds

PAPER_SECTION, PAPER_SPACE = 16, 64
BATCH_VALUES = 1 << 18  # to fit in the processor's cache


@dataclass(frozen=True)
class Paper(Method):
    """One PSF for each section, computed at its middle: the method of the paper.

    By default as in the paper: sections of 16 px in a space of 64 px, complete PSFs, double precision. For other
    sections, the space is the smallest possible.
    """

    name = "paper"
    summary = "One PSF for each section, as in the paper"
    knobs = "section_size", "psf_energy", "precision"
    yardstick = True

    section_size: int
    space_px: int

    @classmethod
    def by_knobs(cls, section_size: int | None, steps: int | None, psf_radius_px: int, most_px: int) -> Method:
        wanted = section_size or PAPER_SECTION
        section = min(wanted, most_px)
        return cls(section, space_px(section, psf_radius_px, PAPER_SPACE if wanted == PAPER_SECTION else 0))

    @property
    def text(self) -> str:
        text = f"{self.section_size} px sections with one PSF each"
        return f"{text}, as in the paper" if self.section_size == PAPER_SECTION else text

    def counts(self, work: Workload) -> dict[str, float]:
        down, across = work.sections(self.section_size)
        return transform_counts(work, self.section_size, self.space_px, down * across, down * across) | {
            "turned sample": down * across * work.samples, "step": down}

    def cached_values(self, work: Workload) -> float:
        return 2 * work.sections(self.section_size)[1] * spectrum_values(self.space_px)

    def spreader(self, psfs: PlacedPsfs, table: Table | None, psf_radius_px: int,
                 memory: MemoryBudget) -> "IsoplanaticSections":
        rows, columns = ((np.arange(-(-n // self.section_size)) + 0.5) * self.section_size - 0.5
                         for n in psfs.planes.grid.shape_px)
        return IsoplanaticSections(self.section_size, self.space_px, psf_radius_px, psfs.psfs, (rows, columns), memory)


@dataclass(frozen=True)
class OnePsf(Method):
    """The PSF at the middle of the picture for all of it: for lenses whose PSFs differ less than the accuracy."""

    name = "one PSF"

    section_size: int
    space_px: int

    @classmethod
    def choices(cls, steps: int, psf_radius_px: int, most_px: int) -> Iterable[Method]:
        return [cls(size, space_px(size, psf_radius_px)) for size in section_sizes(most_px)]

    @property
    def text(self) -> str:
        return "one PSF for the picture"

    def counts(self, work: Workload) -> dict[str, float]:
        down, across = work.sections(self.section_size)
        return transform_counts(work, self.section_size, self.space_px, down * across, 1) | {
            "turned sample": work.samples, "step": down}

    def cached_values(self, work: Workload) -> float:
        return 2 * spectrum_values(self.space_px)

    def spreader(self, psfs: PlacedPsfs, table: Table | None, psf_radius_px: int,
                 memory: MemoryBudget) -> "IsoplanaticSections":
        row, column = (np.array([(n - 1) / 2]) for n in psfs.planes.grid.shape_px)
        return IsoplanaticSections(self.section_size, self.space_px, psf_radius_px, psfs.psfs, (row, column), memory)


class IsoplanaticSections(Spreader):
    """A Spreader that multiplies the spectrum of a section by the OTF of one place.

    Parameters
    ----------
    section_size, space_px, psf_radius_px : int
        The computational space is at least section_size + 2 psf_radius_px, to avoid wraparound.
    psfs : callable (rows, columns) -> array (n, 2 psf_radius_px + 1, 2 psf_radius_px + 1)
        Unit-sum PSFs at these rows and columns of a plane.
    places : (array (section row,), array (section column,))
        Rows and columns at which the sections' PSFs are computed; a single one applies to all sections.
    memory : MemoryBudget
        For OTFs that the next picture reuses.
    """

    def __init__(self, section_size: int, space_px: int, psf_radius_px: int, psfs: Psfs,
                 places: tuple[np.ndarray, np.ndarray], memory: MemoryBudget) -> None:
        self.section_size, self.space_px, self.radius_px = section_size, space_px, psf_radius_px
        self._psfs, self._memory = psfs, memory
        self._rows, self._columns = places
        self._otfs, self._cached = {}, set()

    def prepare(self, rows: np.ndarray, needs: SectionNeeds, pool: Executor) -> None:
        """Compute the OTFs that the lit sections of these rows need."""
        wanted = {}
        for i in rows:
            for precision, lit in ((np.complex64, needs.lit[i] & ~needs.double[i]), (np.complex128, needs.double[i])):
                if lit.any():
                    nodes = wanted.setdefault((self._node(self._rows, i), precision), set())
                    nodes.update(self._node(self._columns, j) for j in np.flatnonzero(lit))
        self._otfs = {key: otfs for key, otfs in self._otfs.items() if key in wanted or key in self._cached}
        list(pool.map(self._make_otfs, wanted, wanted.values()))

    @staticmethod
    def _node(places, section):
        """Index of a section's place."""
        return section if places.size > 1 else 0

    def _make_otfs(self, key, nodes):
        row, precision = key
        side = self.space_px
        otfs, ready = self._otfs.setdefault(key, (np.empty((self._columns.size, side, side // 2 + 1), precision),
                                                  np.zeros(self._columns.size, dtype=bool)))
        if key not in self._cached and self._memory.take(otfs.nbytes):
            self._cached.add(key)
        missing = [node for node in sorted(nodes) if not ready[node]]
        if missing:
            psfs = self._psfs(np.full(len(missing), self._rows[row]), self._columns[missing])
            real = np.float32 if precision == np.complex64 else np.float64
            otfs[missing] = scipy.fft.rfft2(psfs.astype(real, copy=False), (side, side))
            ready[missing] = True

    def spread(self, i: int, columns: np.ndarray, band: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """See `Spreader`."""
        size, side, lit = self.section_size, self.space_px, self.section_size + 2 * self.radius_px
        sections = band.reshape(len(band), size, -1, size).swapaxes(1, 2)
        step = max(1, BATCH_VALUES // (len(band) * side**2))
        for some in (columns[start:start + step] for start in range(0, columns.size, step)):
            spectrum = scipy.fft.rfft2(sections[:, some], (side, side))
            otfs, _ = self._otfs[self._node(self._rows, i), spectrum.dtype.type]
            spectrum *= otfs[[self._node(self._columns, j) for j in some]]
            patches = scipy.fft.irfft2(spectrum, (side, side), overwrite_x=True)
            patches = patches[..., :lit, :lit]  # the rest is rounding
            yield from zip(some * size, patches.swapaxes(0, 1), strict=True)
