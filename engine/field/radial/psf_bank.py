"""The PSF bank: PSFs of a lens on the sensor's pixel grid, at any place in the field."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...lens.radial_lens import MonochromaticLens
from ...lens.symmetry import is_rotation_symmetric, mirror_symmetric
from ..mirror_symmetry import Planes
from ..psf_samples import BATCH_SAMPLES, PsfSamples, samples_of
from .distortion import FieldGeometry

AXIAL_TURNS = 4  # azimuths from 0 to 90 degrees; their mean is the PSF on the axis


@dataclass(frozen=True, eq=False)
class PsfBank(PsfSamples):
    """Pixel PSFs of one lens at one wavelength: samples of light, to be turned and distributed over the pixels.

    Its PSFs are those at the heights of the lens data. v points outwards, u along the tangent.

    Attributes
    ----------
    heights_mm : array (height,)
    mirror_symmetric : bool
        Whether the PSFs are symmetric about the meridional plane.
    round_on_axis : bool
        Whether the first PSF is rotationally symmetric, as it is on the axis. Its pixels are then the same at every
        azimuth, although its samples, squares, are not: uniform light stays uniform where azimuths meet.
    """

    heights_mm: np.ndarray
    mirror_symmetric: bool
    round_on_axis: bool

    @classmethod
    def of(cls, optics: MonochromaticLens, pixel_pitch_um: float) -> "PsfBank":
        """The bank of a MonochromaticLens on pixels of this pitch, with all of its PSFs.

        Raises
        ------
        ImageError
            If there is not enough memory for PSFs of this resolution.
        """
        psf, symmetric = mirror_symmetric(optics.psf)
        samples = samples_of(psf, optics.psf_pitch_um, pixel_pitch_um)
        return cls(**vars(samples), heights_mm=optics.heights_mm, mirror_symmetric=symmetric,
                   round_on_axis=symmetric and is_rotation_symmetric(psf[0]))

    def up_to(self, height_mm: float) -> "PsfBank":
        """A bank with only the heights that contribute to PSFs up to this one."""
        heights = max(2, int(np.searchsorted(self.heights_mm, height_mm)) + 1)
        return replace(self, heights_mm=self.heights_mm[:heights], samples=self.samples[:heights],
                       lost=self.lost[:heights])

    @property
    def last_height(self) -> "PsfBank":
        """A bank with the last height alone."""
        return replace(self, heights_mm=self.heights_mm[-1:], samples=self.samples[-1:], lost=self.lost[-1:],
                       round_on_axis=False)

    def psfs(self, paraxial_height_mm: np.ndarray, azimuth_rad: np.ndarray) -> np.ndarray:
        """PSFs of pixels, integrated over the pixels that the light falls on.

        They are interpolated linearly in field height (section 2.2.3: PSFs, never OTFs), constant beyond the last
        height, rotated to the azimuth, distributed over the pixels by area, and normalised (Eq. 9). The pixel's
        centre determines height and azimuth; its light comes evenly from its area.

        Parameters
        ----------
        paraxial_height_mm, azimuth_rad : arrays (n,)
            Places in the field. The azimuth is measured from +x (right) towards +y (up).

        Returns
        -------
        float64 array (n, row, column), odd square, unit sums, the chief ray in the middle, row 0 at the top
        """
        size = 2 * self.radius_px + 1
        result = np.empty((len(paraxial_height_mm), size, size))
        batch = max(1, BATCH_SAMPLES // self.v_px.size)
        for start in range(0, len(result), batch):
            part = slice(start, start + batch)
            energy, on_axis = self._at_heights(np.asarray(paraxial_height_mm)[part])
            result[part] = self.share_out(energy, np.asarray(azimuth_rad)[part])
            if self.round_on_axis:
                result[part] += on_axis[:, None, None] * self._axial_psf
        result /= result.sum(axis=(1, 2), keepdims=True)
        return result

    def at_table_heights(self, azimuth_rad: np.ndarray) -> np.ndarray:
        """PSFs of all heights of the table at these azimuths: float64 array (azimuth, height, row, column), unit sums.

        The heights share the geometry, so this is several times faster than `psfs`.
        """
        psfs = self.turned(np.asarray(azimuth_rad))
        if self.round_on_axis:
            psfs[:, 0] = self._axial_psf
        return psfs

    @cached_property
    def _axial_psf(self):
        """The first PSF, as the mean over a few azimuths and their quarter turns: array (row, column)."""
        alone = replace(self, heights_mm=self.heights_mm[:1], samples=self.samples[:1])
        turned = alone.turned(np.arange(AXIAL_TURNS) * (np.pi / 2 / AXIAL_TURNS))[:, 0].mean(axis=0)
        return np.mean([np.rot90(turned, turns) for turns in range(4)], axis=0)

    def _at_heights(self, height_mm):
        """The light of samples at these heights, array (n, sample), and the share of a round first PSF, which is not
        part of it."""
        position = np.interp(height_mm, self.heights_mm, np.arange(self.heights_mm.size))
        below = np.minimum(position.astype(int), self.heights_mm.size - 2)
        weight = (position - below)[:, None]
        first = np.where(self.round_on_axis & (below == 0)[:, None], 0, 1 - weight)
        return first * self.samples[below] + weight * self.samples[below + 1], 1 - weight[:, 0] - first[:, 0]

class PlacedPsfs:
    """The PSFs of a lens at the pixels of a grid, by the height that their light comes from.

    Parameters
    ----------
    make_bank : callable () -> PsfBank
        Called for the first PSF, so never if PSFs come from a table.
    field : FieldGeometry
    planes : Planes
        Pixels are rows and columns of one of these planes.
    """

    def __init__(self, make_bank: Callable[[], PsfBank], field: FieldGeometry, planes: Planes) -> None:
        self.field, self.planes = field, planes
        self._make_bank, self._grid = make_bank, planes.grid

    @cached_property
    def bank(self) -> PsfBank:
        """The bank of all PSFs."""
        return self._make_bank()

    @property
    def nbytes(self) -> int:
        """Memory of the bank."""
        return self.bank.nbytes

    @property
    def extent_mm(self) -> float:
        """Distance from the axis that the lens data reach."""
        return self.field.last_real_mm

    def place(self, rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places in the field where the light of these pixels comes from: (paraxial_height_mm, azimuth_rad)."""
        x_mm, y_mm = self._grid.position_mm(rows, columns)
        return self.field.paraxial_height_mm(np.hypot(x_mm, y_mm)), np.arctan2(y_mm, x_mm)

    def psfs(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """PSFs of these pixels: float64 array (n, 2 radius_px + 1, 2 radius_px + 1)."""
        return self.bank.psfs(*self.place(rows, columns))

    def last_height_mm(self) -> float:
        """The largest field height in the planes."""
        rows, columns = self._grid.shape_px
        return float(self.place(*np.meshgrid((0, rows - 1), (0, columns - 1)))[0].max())
