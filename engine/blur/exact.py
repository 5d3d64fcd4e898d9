"""The exact operator: a PSF turned for every pixel. A reference for other methods, at some hundred times their time."""

from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from ..field.field_map import PlacedPsfs, Table
from ..runtime.memory import MemoryBudget
from .method import SECTION_SIZE, Method, Psfs, Spreader, Workload
from .section_needs import SectionNeeds


@dataclass(frozen=True)
class Exact(Method):
    """A PSF turned for every pixel. The sections are only portions of work."""

    name = "exact"
    summary = "A PSF for each pixel, without a table: very slow"
    yardstick = True
    transforms = False

    section_size: int = SECTION_SIZE

    @classmethod
    def by_knobs(cls, section_size: int | None, steps: int | None, psf_radius_px: int, most_px: int) -> Method:
        return cls()

    @property
    def text(self) -> str:
        return "a PSF for every pixel, without a table"

    def counts(self, work: Workload) -> dict[str, float]:
        return {"turned sample": work.pixels * work.samples}

    def cached_values(self, work: Workload) -> float:
        return 0

    def spreader(self, psfs: PlacedPsfs, table: Table | None, psf_radius_px: int,
                 memory: MemoryBudget) -> "ExactSections":
        return ExactSections(self.section_size, psf_radius_px, psfs.psfs)


class ExactSections(Spreader):
    """A Spreader that turns the PSF of every lit pixel.

    Parameters
    ----------
    section_size, psf_radius_px : int
    psfs : callable (rows, columns) -> array (n, 2 psf_radius_px + 1, 2 psf_radius_px + 1)
        Unit-sum PSFs of the pixels at these rows and columns of a plane.
    """

    def __init__(self, section_size: int, psf_radius_px: int, psfs: Psfs) -> None:
        self.section_size, self.radius_px = section_size, psf_radius_px
        self.space_px = section_size + 2 * psf_radius_px
        self._psfs = psfs

    def prepare(self, rows: np.ndarray, needs: SectionNeeds, pool: Executor) -> None:
        """Do nothing: PSFs are turned when they are used."""

    def spread(self, i: int, columns: np.ndarray, band: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """See `Spreader`."""
        size, side = self.section_size, 2 * self.radius_px + 1
        for left in columns * size:
            section = band[:, :, left:left + size]
            patch = np.zeros((len(band), self.space_px, self.space_px), band.dtype)
            rows, across = np.nonzero(section.any(axis=0))
            for row, column, psf in zip(rows, across, self._psfs(rows + i * size, across + left), strict=True):
                patch[:, row:row + side, column:column + side] += section[:, row, column, None, None] * psf
            yield left, patch
