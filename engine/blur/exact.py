"""The exact operator: every pixel spreads by its own PSF, turned for it. For measuring the other ways, at some hundred
times their time."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .method import SECTION_SIZE, Method, Workload


@dataclass(frozen=True)
class Exact(Method):
    """Every pixel its own PSF, turned for it alone. The sections are only portions of work."""

    name = "exact"
    yardstick = True
    transforms = False

    section_size: int = SECTION_SIZE

    @classmethod
    def by_knobs(cls, section_size, azimuths, psf_radius_px, most_px):
        return cls()

    @property
    def text(self):
        return "every pixel's own PSF"

    def counts(self, work: Workload):
        return {"turned sample": 2 * work.pixels * work.samples}  # Python's lock leaves little to a second core

    def kept_values(self, work: Workload):
        return 0

    def spreader(self, psfs, table, psf_radius_px, memory):
        return ExactSections(self.section_size, psf_radius_px, psfs.psfs)


class ExactSections:
    """A Spreader that turns the PSF of every lit pixel.

    Parameters
    ----------
    section_size, psf_radius_px : int
    psfs : callable (rows, columns) -> array (n, 2 psf_radius_px + 1, 2 psf_radius_px + 1)
        Unit-sum PSFs of the pixels of these index terms.
    """

    def __init__(self, section_size: int, psf_radius_px: int, psfs) -> None:
        self.section_size, self.radius_px = section_size, psf_radius_px
        self.space_px = section_size + 2 * psf_radius_px
        self._psfs = psfs

    def prepare(self, rows, needs, pool) -> None:
        """Nothing: PSFs are turned where they are used."""

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
