"""PSFs tabulated over height and azimuth on the pixel grid, from which every pixel's own is mixed in no time.

Turning is what makes pixel PSFs expensive. Between two tabulated heights a PSF is a mixture (section 2.2.3), and
between two close azimuths nearly so: a table of a few dozen azimuths holds all PSFs of a lens to 0.1 % of their light.
"""

from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ..threads import thread_pool
from .mirror_symmetry import Planes
from .psf_bank import PsfBank

if TYPE_CHECKING:
    from ..lens.lens import Lens

PORTION = 16  # azimuths
BATCH_VALUES = 1 << 18  # what the processor's cache holds


class PsfTable:
    """PSFs at the heights of a lens and at evenly spaced azimuths, for one wavelength.

    Attributes
    ----------
    table : array (height, azimuth, tap)
        Azimuths from 0 clockwise, over so many quarter turns, 1 or 4, both ends included.
    rows, columns : int arrays (tap,)
        Where the taps lie in the square of 2 radius_px + 1: the pixels that some PSF reaches.
    radius_px : int
    """

    def __init__(self, table: np.ndarray, rows: np.ndarray, columns: np.ndarray, radius_px: int, quarter_turns: int,
                 heights_mm: np.ndarray) -> None:
        self.table, self.rows, self.columns, self.radius_px = table, rows, columns, radius_px
        self._turn_rad = np.pi / 2 * quarter_turns
        self.heights_mm = heights_mm
        self._by_cell = table.reshape(-1, table.shape[-1])

    @property
    def nbytes(self) -> int:
        return self.table.nbytes

    def corners(self, paraxial_height_mm: np.ndarray, azimuth_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The four cells of the table around places, and their weights: int and float arrays (4, place).

        Cells are numbered height by height. Weights are 0 to 1 and sum to 1.
        """
        heights, azimuths = self.table.shape[:2]
        height = np.interp(paraxial_height_mm, self.heights_mm, np.arange(heights))
        azimuth = (-azimuth_rad % (2 * np.pi)) * ((azimuths - 1) / self._turn_rad)
        below = np.minimum(height.astype(np.intp), heights - 2)
        before = np.minimum(azimuth.astype(np.intp), azimuths - 2)
        up, on = (height - below).astype(self.table.dtype), (azimuth - before).astype(self.table.dtype)
        first = below * azimuths + before
        return (np.stack([first, first + 1, first + azimuths, first + azimuths + 1]),
                np.stack([(1 - up) * (1 - on), (1 - up) * on, up * (1 - on), up * on]))

    def mixed(self, paraxial_height_mm: np.ndarray, azimuth_rad: np.ndarray) -> np.ndarray:
        """PSFs at these places: array (tap, place), so that what one tap does to many pixels lies together."""
        cells, weights = self.corners(paraxial_height_mm, azimuth_rad)
        taps, places = self.table.shape[2], cells.shape[1]
        psfs = np.empty((taps, places), self.table.dtype)
        step = max(1, BATCH_VALUES // taps)
        mixture, part = (np.empty((min(step, places), taps), self.table.dtype) for _ in range(2))
        for start in range(0, places, step):
            some = slice(start, min(start + step, places))
            into, one = (buffer[:some.stop - start] for buffer in (mixture, part))
            into[:] = 0
            for cell, weight in zip(cells, weights, strict=True):
                np.take(self._by_cell, cell[some], axis=0, out=one, mode="clip")  # the mode that needs no copy
                one *= weight[some, None]
                into += one
            psfs[:, some] = into.T
        return psfs

    def mean_offsets_px(self, paraxial_height_mm: np.ndarray, azimuth_rad: np.ndarray) -> np.ndarray:
        """How far light lies from the chief ray on the mean, downwards and to the right: array (2, place)."""
        cells, weights = self.corners(paraxial_height_mm, azimuth_rad)
        return np.einsum("kp,kpd->dp", weights, self._offsets_px[cells])

    @cached_property
    def _offsets_px(self):
        return self._by_cell @ np.stack([self.rows, self.columns], axis=1) - self.radius_px

    def node_psfs(self, cells: np.ndarray) -> np.ndarray:
        """The PSFs of these cells: array (cell, row, column), odd square, the chief ray in the middle."""
        return self._squares(self._by_cell[cells])

    def psfs(self, paraxial_height_mm: np.ndarray, azimuth_rad: np.ndarray) -> np.ndarray:
        """PSFs at these places: array (place, row, column), odd square, the chief ray in the middle."""
        return self._squares(self.mixed(paraxial_height_mm, azimuth_rad).T)

    def _squares(self, taps):
        side = 2 * self.radius_px + 1
        psfs = np.zeros((len(taps), side, side), self.table.dtype)
        psfs[:, self.rows, self.columns] = taps
        return psfs


class PsfTables:
    """The PSF tables of a lens: made at the wavelengths of its data and mixed between them like the data, where that
    makes fewer of them.

    Parameters
    ----------
    lens : Lens
    wavelengths_nm : array
        Those that will be asked for.
    planes : Planes
        In which they are looked up: quadrants need a quarter of the table.
    support_um : float
    azimuths : int
        Steps from 0 to 45 degrees.
    precision : dtype
    """

    def __init__(self, lens: "Lens", wavelengths_nm: Sequence[float] | np.ndarray, planes: Planes,
                 support_um: float, azimuths: int, precision: str) -> None:
        self._lens, self._pitch_um, self._support_um = lens, planes.picture.pitch_um, support_um
        self._azimuths, self._quarter_turns, self._precision = azimuths, planes.quarter_turns, precision
        self._made = lru_cache(maxsize=2)(self._make)  # wavelengths come in order
        self._mix = len(lens.wavelengths_around(wavelengths_nm)) < len(wavelengths_nm)

    def at_wavelength(self, wavelength_nm: float) -> PsfTable:
        """A PsfTable."""
        psfs = self._mixed(wavelength_nm) if self._mix else self._make(wavelength_nm)
        size = int(np.sqrt(psfs.shape[-1]))
        taps = np.flatnonzero(psfs.any(axis=(0, 1)))
        return PsfTable(np.ascontiguousarray(psfs[..., taps], dtype=self._precision), taps // size, taps % size,
                        size // 2, self._quarter_turns, self._lens.heights_mm)

    def _mixed(self, wavelength_nm):
        below, weight = self._lens.wavelength_position(wavelength_nm)
        psfs = self._made(self._lens.wavelengths_nm[below])
        if weight:
            psfs = (1 - weight) * psfs + weight * self._made(self._lens.wavelengths_nm[below + 1])
        return psfs

    def _make(self, wavelength_nm):
        """All PSFs at one wavelength: array (height, azimuth, pixel)."""
        bank = PsfBank.of(self._lens.at_wavelength(wavelength_nm), self._pitch_um, self._support_um)
        own = self._azimuths + 1 if bank.mirror_symmetric else 2 * self._azimuths
        angles_rad = -np.arange(own) * (np.pi / 4 / self._azimuths)
        with thread_pool() as pool:
            portions = np.array_split(angles_rad, -(-own // PORTION))
            quarter = [psfs.astype(self._precision)
                       for part in pool.map(bank.at_table_heights, portions) for psfs in part]
        if bank.mirror_symmetric:  # mirrored in the diagonal
            quarter += [psfs.swapaxes(1, 2) for psfs in quarter[-2:0:-1]]
        every = [np.rot90(psfs, -turn, axes=(1, 2)) for turn in range(self._quarter_turns) for psfs in quarter]
        every.append(np.rot90(quarter[0], -self._quarter_turns, axes=(1, 2)))
        return np.stack(every, axis=1).reshape(self._lens.heights_mm.size, len(every), -1)
