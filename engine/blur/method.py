"""What every way of filtering has in common: its name, its knobs, its work, and what spreads the light by it."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from scipy import fft

from ..field.mirror_symmetry import Planes
from ..field.psf_bank import PlacedPsfs
from ..field.psf_table import PsfCells, PsfTable, TurnedPsfs
from ..memory import MemoryBudget
from .section_needs import SectionNeeds

SECTION_SIZE, AZIMUTHS = 32, 32  # where they are not set
SECTION_SIZES = (16, 24, 32, 48, 64, 96, 128, 192, 256)  # to choose from by accuracy


Place = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Where in the field, (paraxial_height_mm, azimuth_rad), pixels of these rows and columns lie."""
Psfs = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""PSFs, array (n, row, column) of unit sums, of the pixels of these n rows and columns."""


class Spreader(Protocol):
    """Spreads the light of sections, for `overlap_add`."""

    section_size: int
    space_px: int
    """Side of the patches of light that come out."""
    radius_px: int
    """How far patches begin above and left of their sections."""

    def prepare(self, rows: np.ndarray, needs: SectionNeeds, pool: Executor) -> None:
        """Make what these rows of sections need."""

    def spread(self, i: int, columns: np.ndarray, band: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """Patches (plane, row, column) of the light of these sections of row i, and at which column each begins.

        The light is given as a band (plane, row, column) of all sections of the row.
        """


@dataclass(frozen=True)
class Workload:
    """What the cost of filtering one wavelength depends on, beside the way that it is done.

    Attributes
    ----------
    planes : Planes
    psf_radius_px : int
    taps : float
        Pixels that a PSF covers, on the mean.
    heights : int
        Field heights of the lens data.
    height_px : float
        From one of them to the next.
    samples, window_samples : float
        Of a trimmed PSF and of a whole one, as fine as the pixels ask for.
    tables : float
        PSF tables that each wavelength comes to: they are shared where the lens data have fewer wavelengths.
    mirror_symmetric : bool
        Whether the PSFs are.
    """

    planes: Planes
    psf_radius_px: int
    taps: float
    heights: int
    height_px: float
    samples: float
    window_samples: float
    tables: float
    mirror_symmetric: bool

    @property
    def pixels(self) -> int:
        rows, columns = self.planes.picture.shape_px
        return rows * columns

    @property
    def covered(self) -> float:
        """Pixels that some PSF covers."""
        return np.pi * (self.psf_radius_px + 0.5) ** 2

    def sections(self, section_size: int) -> tuple[int, int]:
        """Rows and columns of the sections of a plane."""
        rows, columns = self.planes.grid.shape_px
        return -(-rows // section_size), -(-columns // section_size)


@dataclass(frozen=True)
class Method(ABC):
    """A way to spread the light of every point by its PSF, with its knobs.

    Attributes
    ----------
    name : str
        What it is asked for by.
    knobs : tuple of str
        The fields of `Options` that mean something to it.
    by_accuracy : bool
        Whether an accuracy can choose its knobs.
    yardstick : bool
        Whether it is there to measure the others by: with whole PSFs, in double precision, without mirror symmetry,
        but where a knob says otherwise.
    transforms : bool
        Whether it works by Fourier transforms, whose rounding goes with the brightest pixel of a section.
    section_size : int
        Side in pixels of the sections of the picture, or of portions of work.
    azimuths : int
        Steps from 0 to 45 degrees of the table that its PSFs are mixed from; 0 where they are turned one by one.
    """

    name: ClassVar[str]
    knobs: ClassVar[tuple[str, ...]] = ()
    by_accuracy: ClassVar[bool] = False
    yardstick: ClassVar[bool] = False
    transforms: ClassVar[bool] = True

    section_size: int
    azimuths = 0  # no field here, so that those that have one may put it last

    @classmethod
    def by_knobs(cls, section_size: int | None, azimuths: int | None, psf_radius_px: int, most_px: int) -> "Method":
        """The method with these knobs, what is None being its own choice; sections of up to most_px."""
        raise NotImplementedError(f"only an accuracy chooses {cls.name}")

    @classmethod
    def choices(cls, azimuths: int, psf_radius_px: int, most_px: int) -> Iterable["Method"]:
        """What an accuracy that takes so many azimuths may choose from."""
        return ()

    @property
    @abstractmethod
    def text(self) -> str:
        """The way, in a few words."""

    @abstractmethod
    def counts(self, work: Workload) -> dict[str, float]:
        """How much of each kind of work it is: a dict with names of `cost.NANOSECONDS`."""

    @abstractmethod
    def kept_values(self, work: Workload) -> float:
        """How many real numbers it holds beside the picture and the table of PSFs."""

    def table(self, turned: TurnedPsfs) -> PsfCells:
        """The table that its PSFs are mixed from."""
        return PsfTable(turned)

    @abstractmethod
    def spreader(self, psfs: PlacedPsfs, table: Any, psf_radius_px: int,
                 memory: MemoryBudget) -> Spreader:
        """What spreads light by it, with its table, None where it needs none; it keeps what the next picture shares."""


def section_sizes(most_px: int) -> list[int]:
    """The sizes to choose from for a picture whose sides are up to this."""
    return sorted({min(size, most_px) for size in SECTION_SIZES})


def space_px(section_size: int, psf_radius_px: int, least_px: int = 0) -> int:
    """Side of a computational space that holds a section and all light that leaves it; one quickly transformed."""
    return fft.next_fast_len(max(section_size + 2 * psf_radius_px, least_px), real=True)


def spectrum_values(side_px: int) -> int:
    """Real numbers in the spectrum of a square of real ones."""
    return 2 * side_px * (side_px // 2 + 1)


def transform_counts(work: Workload, section_size: int, side_px: int, weighed: float, nodes: float) -> dict[str, float]:
    """Work on the spectra of so many weighed sections of a plane, with the OTFs of so many nodes."""
    down, across = work.sections(section_size)
    space, patches, weighed = side_px**2, work.planes.count * down * across, weighed * work.planes.count
    values = weighed * (section_size * side_px + space) / 2 + (patches + nodes) * space
    return {"transformed value": values * np.log2(side_px), "spectrum value": weighed * space / 2}
