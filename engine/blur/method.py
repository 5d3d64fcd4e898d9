"""The interface of all blur methods: name, knobs, amount of work, and the spreader of the light."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import scipy

from ..field.field_map import Cells, NodePsfs, Place, PlacedPsfs, TableLayout
from ..field.mirror_symmetry import Planes
from ..runtime.memory import MemoryBudget
from .section_needs import SectionNeeds

SECTION_SIZE, AZIMUTHS = 32, 32  # defaults
SECTION_SIZES = (16, 24, 32, 48, 64, 96, 128, 192, 256)  # choices for a target accuracy


PlaceOf = Callable[[np.ndarray, np.ndarray], Place]
"""Places in the field of the pixels at these rows and columns."""
Psfs = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""PSFs of the pixels at these n rows and columns: array (n, row, column), of unit sums."""


class Spreader(ABC):
    """Spreads the light of sections, for `overlap_add`."""

    section_size: int
    space_px: int
    """Side of the resulting patches of light."""
    radius_px: int
    """Number of rows and columns that patches extend above and to the left of their sections."""
    gpu = ""
    """The graphics processor that has spread the last picture; "" for none."""

    def at_once(self, light: np.ndarray, lit: np.ndarray) -> np.ndarray | None:
        """The light (plane, row, column) of all lit sections, spread as by `overlap_add`; None if only `spread` can."""
        return None

    @abstractmethod
    def prepare(self, rows: np.ndarray, needs: SectionNeeds, pool: Executor) -> None:
        """Compute the data that these rows of sections need."""

    @abstractmethod
    def spread(self, i: int, columns: np.ndarray, band: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """Yield the first column and the patch (plane, row, column) of the light of these sections of row i.

        The light is given as a band (plane, row, column) of all sections of the row.
        """


@dataclass(frozen=True)
class Workload:
    """The figures that the cost of filtering one wavelength depends on, in addition to the method.

    Attributes
    ----------
    planes : Planes
    psf_radius_px : int
    taps : float
        Pixels that a PSF covers on average.
    layout : TableLayout
    samples, window_samples : float
        Number of samples of a trimmed PSF and of a complete PSF, at the resolution that the pixels require.
    tables : float
        PSF tables per wavelength: less than 1 if the lens data have fewer wavelengths, which then share tables.
    """

    planes: Planes
    psf_radius_px: int
    taps: float
    layout: TableLayout
    samples: float
    window_samples: float
    tables: float

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
    """A method to spread the light of every point by its PSF, with its knobs.

    Attributes
    ----------
    name : str
        Its name in `Options.method`.
    summary : str
        One sentence for panels and the command line.
    knobs : tuple of str
        The fields of `Options` that apply to it.
    by_accuracy : bool
        Whether the plan can choose its knobs for a target accuracy.
    yardstick : bool
        Whether it is a reference for the others: with complete PSFs, in double precision, without mirror symmetry,
        unless a knob sets these.
    transforms : bool
        Whether it uses Fourier transforms, whose rounding errors are proportional to the brightest pixel of a section.
    section_size : int
        Side in pixels of the sections of the picture, or of portions of work.
    tabulated : bool
        Whether its PSFs are mixed from a table; otherwise each is computed separately.
    azimuths : int
        Steps of the table from 0 to 45 degrees; 0 without a table, and for a table of the nodes of the lens data, if
        the lens is not rotationally symmetric.
    """

    name: ClassVar[str]
    summary: ClassVar[str] = ""
    knobs: ClassVar[tuple[str, ...]] = ()
    by_accuracy: ClassVar[bool] = False
    yardstick: ClassVar[bool] = False
    transforms: ClassVar[bool] = True
    tabulated: ClassVar[bool] = False

    section_size: int
    azimuths = 0  # not a dataclass field here, so that subclasses can make it their last

    @classmethod
    def by_knobs(cls, section_size: int | None, steps: int | None, psf_radius_px: int, most_px: int) -> "Method":
        """The method with these knobs, or its defaults for None; with sections up to most_px."""
        raise NotImplementedError(f"{cls.name} is available only for a target accuracy")

    @classmethod
    def choices(cls, steps: int, psf_radius_px: int, most_px: int) -> Iterable["Method"]:
        """The choices for a target accuracy that requires this number of steps."""
        return ()

    @property
    def nodes_text(self) -> str:
        """The nodes of its table, in a few words."""
        return f"{self.azimuths} azimuths" if self.azimuths else "the nodes of the lens data"

    @property
    @abstractmethod
    def text(self) -> str:
        """The method, in a few words."""

    @abstractmethod
    def counts(self, work: Workload) -> dict[str, float]:
        """The amount of each kind of work: a dict with names of `cost.NANOSECONDS`."""

    @abstractmethod
    def cached_values(self, work: Workload) -> float:
        """Number of real values that it holds in addition to the picture and the table of PSFs."""

    def table(self, psfs: NodePsfs) -> Cells:
        """The table that its PSFs are mixed from."""
        return psfs.table()

    @abstractmethod
    def spreader(self, psfs: PlacedPsfs, table: Any, psf_radius_px: int,
                 memory: MemoryBudget) -> Spreader:
        """The spreader, which caches data for the next picture. `table` is None for a method without tables."""


def section_sizes(most_px: int) -> list[int]:
    """The choices of section sizes for a picture whose sides are up to this."""
    return sorted({min(size, most_px) for size in SECTION_SIZES})


def space_px(section_size: int, psf_radius_px: int, least_px: int = 0) -> int:
    """Side of a computational space for a section and all light that leaves it; a size with a fast transform."""
    return scipy.fft.next_fast_len(max(section_size + 2 * psf_radius_px, least_px), real=True)


def spectrum_values(side_px: int) -> int:
    """Real values in the spectrum of a square of real values."""
    return 2 * side_px * (side_px // 2 + 1)


def transform_counts(work: Workload, section_size: int, side_px: int, weighed: float, nodes: float) -> dict[str, float]:
    """Work on the spectra of this number of weighted sections of a plane, with OTFs of this number of nodes."""
    down, across = work.sections(section_size)
    space, patches, weighed = side_px**2, work.planes.count * down * across, weighed * work.planes.count
    values = weighed * (section_size * side_px + space) / 2 + (patches + nodes) * space
    return {"transformed value": values * np.log2(side_px), "spectrum value": weighed * space / 2}
