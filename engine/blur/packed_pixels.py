"""What `pixels` does, by the compiled loops: every pixel spread by its own PSF, a row of sections at a time."""

from collections.abc import Iterator
from concurrent.futures import Executor

import numpy as np

from .. import kernels
from ..field.psf_bank import PlacedPsfs
from ..field.psf_table import PsfCells, TurnedPsfs
from .section_needs import SectionNeeds

CURVE_SAMPLES = 1 << 12  # linear interpolation between them is good to 1e-8 of the field


class PackedPsfs(PsfCells):
    """The PSFs of a table in the pieces that the compiled loops take.

    Attributes
    ----------
    pieces : PackedTable
    """

    def __init__(self, turned: TurnedPsfs) -> None:
        super().__init__(turned)
        self.pieces = kernels.PackedTable.of(turned.reached(), turned.azimuths, turned.taps)

    @property
    def nbytes(self) -> int:
        """See `PsfCells`."""
        return self.pieces.nbytes


class PackedPixels:
    """A Spreader that goes pixel by pixel, by the compiled loops.

    Parameters
    ----------
    section_size : int
    table : PackedPsfs
    psfs : PlacedPsfs
    """

    def __init__(self, section_size: int, table: PackedPsfs, psfs: PlacedPsfs) -> None:
        self.section_size, self.radius_px = section_size, table.radius_px
        self.space_px = section_size + 2 * table.radius_px
        grid = psfs.planes.grid
        distances_px = np.linspace(0, grid.farthest_px, CURVE_SAMPLES + 1)
        self._pieces, self._places = table.pieces, kernels.TablePlaces.of(
            grid.centre_px, CURVE_SAMPLES / grid.farthest_px,
            psfs.field.paraxial_height_mm(distances_px * grid.pitch_um * 1e-3), table.heights_mm,
            (table.azimuths - 1) // table.quarter_turns, table.quarter_turns)

    def prepare(self, rows: np.ndarray, needs: SectionNeeds, pool: Executor) -> None:
        """Nothing: all is in the table."""

    def spread(self, i: int, columns: np.ndarray, band: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """See `Spreader`. There is one patch, as wide as the band."""
        size = self.section_size
        lit = np.zeros((1, band.shape[2] // size), dtype=bool)
        lit[0, columns] = True
        yield 0, kernels.spread(self._pieces, self._places.lower(i * size), band, lit, size, slice(size))
