"""PSFs tabulated over height and azimuth on the pixel grid, for mixing the PSF of any pixel quickly.

Pixel PSFs are expensive because they are turned. Between two tabulated heights a PSF is a mixture (section 2.2.3), and
nearly so between two close azimuths: a table of a few dozen azimuths contains all PSFs of a lens to 0.1 % of their
light.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...kernels.library import NUMPY, running
from ...kernels.spreading import PackedTable, TablePlaces
from ...lens.radial_lens import RadialLens
from ...runtime.threads import thread_pool
from ..mirror_symmetry import Planes
from ..psf_table import CompiledTable, PlainTable, TableCells, TablesByWavelength, corners_between, mixed_by_row
from .psf_bank import PlacedPsfs, PsfBank

PORTION = 16  # azimuths
CURVE_SAMPLES = 1 << 12  # linear interpolation between them is accurate to 1e-8 of the field

Place = tuple[np.ndarray, np.ndarray]
"""Paraxial heights in mm and azimuths in radians: arrays (place,), from `PlacedPsfs.place`."""


@dataclass(frozen=True, eq=False)
class TurnedPsfs:
    """PSFs at the heights of a lens, turned to the azimuths of a table, without mirrored azimuths and quarter turns.

    Attributes
    ----------
    psfs : array (height, azimuth, pixel)
        The turned PSFs, in squares of 2 radius_px + 1, each followed by a black pixel.
    mirrored : bool
        Whether the azimuths end at 45 degrees, both ends included, and are mirrored there; or at 90 without the end.
    quarter_turns : int
        Number of quarter turns, 1 or 4, of a table.
    heights_mm : array (height,)
    """

    psfs: np.ndarray
    mirrored: bool
    quarter_turns: int
    heights_mm: np.ndarray

    @property
    def side(self) -> int:
        """Side of the squares, in pixels."""
        return int(np.sqrt(self.psfs.shape[-1] - 1))

    @property
    def azimuths(self) -> int:
        """Number of azimuths of a table: clockwise from 0, both ends included."""
        return sum(self.psfs[0, turned, 0].size for turned, _ in self._parts)

    @cached_property
    def _parts(self):
        """A table's azimuths in order: pairs of indices of turned PSFs, and indices of pixels in these."""
        square = np.arange(self.side**2).reshape(self.side, self.side)
        quarter = [(slice(None), square)]
        if self.mirrored:  # about the diagonal
            quarter.append((slice(-2, 0, -1), square.T))
        parts = [(turned, np.rot90(pixels, -turn)) for turn in range(self.quarter_turns) for turned, pixels in quarter]
        parts.append((slice(1), np.rot90(square, -self.quarter_turns)))
        return [(turned, np.append(pixels, square.size)) for turned, pixels in parts]

    def table(self) -> "PsfTable":
        """The table in plain arrays."""
        return PsfTable(self)

    def packed(self) -> "PackedPsfs | None":
        """The table for the compiled loops; None without these, and for double precision."""
        return PackedPsfs(self) if self.psfs.dtype == np.float32 and running() != NUMPY else None

    def unmirrored(self) -> "TurnedPsfs":
        """The same PSFs with all azimuths of a quarter turn."""
        if not self.mirrored:
            return self
        turned, lookup_index = self._parts[1]
        psfs = np.concatenate([self.psfs, self.psfs[:, turned][..., lookup_index]], axis=1)
        return replace(self, psfs=psfs, mirrored=False)

    def taps(self, heights: slice, pixels: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """These pixels of a table's PSFs of some heights: array (height, azimuth, tap)."""
        psfs = self.psfs[heights]
        if out is None:
            out = np.empty((len(psfs), self.azimuths, pixels.size), psfs.dtype)
        start = 0
        for turned, lookup_index in self._parts:
            stop, indices = start + psfs[0, turned, 0].size, lookup_index[pixels]
            for of_height, into in zip(psfs[:, turned], out[:, start:stop], strict=True):
                np.take(of_height, indices, axis=1, out=into, mode="clip")  # the mode that needs no copy
            start = stop
        return out

    def reached(self) -> np.ndarray:
        """Whether any of a table's PSFs of a height reaches a pixel: bool array (height, pixel)."""
        lit = np.any(self.psfs, axis=1)
        return np.any([lit[:, lookup_index[:-1]] for _, lookup_index in self._parts], axis=0)

    def pieces(self) -> PackedTable:
        """A table, in pieces for the compiled loops."""
        reached = self.reached()
        return PackedTable.of(reached[:-1] | reached[1:], self.azimuths,
                              lambda low, pixels, out: self.taps(slice(low, low + 2), pixels, out))

    def mean_distance_px(self) -> float:
        """Mean distance of light from the chief ray, at the height where it is largest."""
        down, right = np.indices((self.side, self.side)).reshape(2, -1) - self.side // 2
        return float((self.psfs[:, 0, :-1] @ np.hypot(down, right).astype(self.psfs.dtype)).max())

    def offsets_px(self) -> np.ndarray:
        """Mean offset of the light of a table's PSFs from the chief ray, downwards and to the right: array (height,
        azimuth, 2)."""
        grid_px = np.indices((self.side, self.side)).reshape(2, -1).T - self.side // 2
        places_px = np.concatenate([grid_px[np.argsort(lookup_index[:-1])] for _, lookup_index in self._parts], axis=1)
        every = self.psfs[..., :-1] @ places_px.astype(self.psfs.dtype)
        return np.concatenate([every[:, turned, 2 * k:2 * k + 2] for k, (turned, _) in enumerate(self._parts)], axis=1)


class PsfCells(TableCells):
    """The cells between the heights and azimuths of a table.

    Attributes
    ----------
    heights_mm : array (height,)
    azimuths : int
        Number of azimuths, clockwise from 0, both ends included.
    quarter_turns : int
        Their range.
    """

    def __init__(self, turned: TurnedPsfs) -> None:
        super().__init__(turned.side // 2, turned.mean_distance_px(), turned.offsets_px().reshape(-1, 2))
        self.heights_mm, self.azimuths, self.quarter_turns = turned.heights_mm, turned.azimuths, turned.quarter_turns

    def corners(self, place: Place) -> tuple[np.ndarray, np.ndarray]:
        """The four nodes of the table around places, and their weights: int and float arrays (4, place).

        Nodes are numbered height by height. Weights are 0 to 1 and sum to 1.
        """
        paraxial_height_mm, azimuth_rad = place
        heights = self.heights_mm.size
        height = np.interp(paraxial_height_mm, self.heights_mm, np.arange(heights))
        azimuth = (-azimuth_rad % (2 * np.pi)) * ((self.azimuths - 1) / (np.pi / 2 * self.quarter_turns))
        return corners_between(height, azimuth, (heights, self.azimuths), self.offsets_px.dtype)


class PsfTable(PlainTable, PsfCells):
    """PSFs at the heights of a lens and at evenly spaced azimuths, for one wavelength."""

    def __init__(self, turned: TurnedPsfs) -> None:
        PsfCells.__init__(self, turned)
        reached = turned.reached()
        taps = np.flatnonzero(reached.any(axis=0))
        PlainTable.__init__(self, turned.taps(slice(None), taps), taps, reached[:, taps])

    def psfs(self, paraxial_height_mm: np.ndarray, azimuth_rad: np.ndarray) -> np.ndarray:
        """PSFs at these places: array (place, row, column), odd square, the chief ray in the middle."""
        rows, columns, taps = self.mixed((paraxial_height_mm, azimuth_rad))
        return self.squares(rows, columns, taps.T)


class PackedPsfs(CompiledTable, PsfCells):
    """The PSFs of a table, in pieces for the compiled loops."""

    def __init__(self, turned: TurnedPsfs) -> None:
        PsfCells.__init__(self, turned)
        self.pieces = turned.pieces()

    def places(self, psfs: PlacedPsfs) -> TablePlaces:
        """Positions of the pixels of these PSFs' planes among the nodes."""
        grid = psfs.planes.grid
        distances_px = np.linspace(0, grid.farthest_px, CURVE_SAMPLES + 1)
        return TablePlaces.of(
            grid.centre_px, CURVE_SAMPLES / grid.farthest_px,
            psfs.field.paraxial_height_mm(distances_px * grid.pitch_um * 1e-3), self.heights_mm,
            (self.azimuths - 1) // self.quarter_turns, self.quarter_turns)


class PsfTables(TablesByWavelength[TurnedPsfs]):
    """The turned PSFs of a lens for tables.

    Parameters
    ----------
    lens : RadialLens
    wavelengths_nm : array
        As for `TablesByWavelength`.
    planes : Planes
        The planes for their lookup: quadrants need a quarter of the table.
    part : callable (PsfBank) -> PsfBank
        Returns the part of the complete PSFs to turn, such as the trimmed ones.
    azimuths : int
        Steps from 0 to 45 degrees.
    precision : dtype
    """

    def __init__(self, lens: RadialLens, wavelengths_nm: Sequence[float] | np.ndarray, planes: Planes,
                 part: Callable[[PsfBank], PsfBank], azimuths: int, precision: str) -> None:
        super().__init__(lens, wavelengths_nm)
        self._pitch_um, self._part = planes.picture.pitch_um, part
        self._azimuths, self._quarter_turns, self._precision = azimuths, planes.quarter_turns, precision

    def _mixed(self, psfs, others, weight):
        if psfs.mirrored != others.mirrored:
            psfs, others = psfs.unmirrored(), others.unmirrored()
        return replace(psfs, psfs=mixed_by_row(psfs.psfs, others.psfs, weight))

    def _make(self, wavelength_nm):
        bank = self._part(PsfBank.of(self._lens.at_wavelength(wavelength_nm), self._pitch_um))
        azimuths = self._azimuths + 1 if bank.mirror_symmetric else 2 * self._azimuths
        psfs = np.zeros((bank.heights_mm.size, azimuths, (2 * bank.radius_px + 1) ** 2 + 1), self._precision)

        def turn(part):
            turned = bank.at_table_heights(-np.arange(azimuths)[part] * (np.pi / 4 / self._azimuths))
            psfs[:, part, :-1] = turned.swapaxes(0, 1).reshape(psfs.shape[0], -1, psfs.shape[2] - 1)

        with thread_pool() as pool:
            list(pool.map(turn, (slice(first, first + PORTION) for first in range(0, azimuths, PORTION))))
        return TurnedPsfs(psfs, bank.mirror_symmetric, self._quarter_turns, bank.heights_mm)
