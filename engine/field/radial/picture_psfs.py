"""The PSFs of a lens on a picture's pixels: their reach, the pixels that they cover, and their errors."""

from collections.abc import Iterator
from functools import cached_property, partial

import numpy as np

from ...image.sampling import Sampling
from ...lens.radial_lens import RadialLens
from ...runtime.threads import thread_pool
from ..mirror_symmetry import Planes
from ..psf_samples import covered_px, supported_radius_px, telling_wavelengths
from .distortion import FieldGeometry
from .error_bound import AzimuthErrors, azimuth_error, isoplanatic_error
from .psf_bank import PlacedPsfs, PsfBank
from .uniform_light import unevenness

UNIFORM_WAVELENGTHS = 3  # to examine
PLACES = 48  # samples along each side of a picture, for the shares of heights


class PicturePsfs:
    """The PSFs of a lens on the pixels of a picture, at the `telling_wavelengths`.

    Parameters
    ----------
    lens : RadialLens
    sampling : Sampling
    most_energy : float
        The largest fraction of a PSF that will be used.

    Raises
    ------
    ImageError
        If the pixel pitch is so small that PSFs exceed LARGEST_PSF_RADIUS_PX.
    LensError
        If a wavelength is outside the lens data, or the distortion folds the field.
    """

    def __init__(self, lens: RadialLens, sampling: Sampling, most_energy: float) -> None:
        self.full_radius_px = supported_radius_px(lens, sampling.grid.pitch_um)
        self._optics = [lens.at_wavelength(nm) for nm in telling_wavelengths(lens, sampling)]
        self._fields = [FieldGeometry(each, lens.name) for each in self._optics]
        self._grid, self._most_energy, self._reaches = sampling.grid, most_energy, {}

    @cached_property
    def _banks(self):
        """A PsfBank for each wavelength, trimmed to the largest energy in use: complete PSFs need much memory."""
        with thread_pool() as pool:
            return list(pool.map(lambda each: PsfBank.of(each, self._grid.pitch_um).trimmed(self._most_energy),
                                 self._optics))

    def reach(self, energy: float) -> tuple[int, float]:
        """Radius in pixels of PSFs trimmed to this energy, and the mean number of pixels that they cover."""
        if energy >= 1:
            return self.full_radius_px, float(covered_px(np.array(self.full_radius_px - 1), 0))
        if energy not in self._reaches:
            self._reaches[energy] = self._reach(energy)
        return self._reaches[energy]

    def _reach(self, energy):
        supports = [bank.support_px(energy) for bank in self._banks]
        radius_px = max(bank.radius_within_px(support) for bank, support in zip(self._banks, supports, strict=True))
        taps = np.mean([covered_px(support, bank.sample_size_px)
                        for bank, support in zip(self._banks, supports, strict=True)], axis=0)
        return radius_px, float(self._height_shares @ np.maximum(taps[:-1], taps[1:]))

    def mixing(self, energy: float, planes: Planes) -> Iterator[AzimuthErrors]:
        """Yield the errors of PSFs trimmed to this energy in these planes, wavelength by wavelength."""
        for optics, psfs in zip(self._optics, self._trimmed(energy, planes), strict=True):
            yield AzimuthErrors(psfs.bank, partial(PsfBank.of, optics, self._grid.pitch_um), psfs.last_height_mm())

    def mixing_error(self, wavelengths: list[AzimuthErrors], steps: int) -> float:
        """Largest error of trimmed PSFs mixed from a table with these steps."""
        return azimuth_error(wavelengths, steps)

    def mixing_estimate(self, wavelength: AzimuthErrors, steps: int) -> float:
        """As `mixing_error` for one wavelength, from the middle of the steps alone."""
        return wavelength.largest(steps, np.array([steps // 2]))

    def one_psf_error(self, energy: float, planes: Planes, enough: float) -> float:
        """Largest error of the PSF in the middle of the planes for the complete field, or some error above `enough`."""
        worst = 0.0
        for optics, psfs in zip(self._optics, self._trimmed(energy, planes), strict=True):
            middle = [np.array([(n - 1) / 2]) for n in psfs.planes.grid.shape_px]
            worst = max(worst, isoplanatic_error(psfs.bank, partial(PsfBank.of, optics, self._grid.pitch_um),
                                                 psfs.psfs(*middle)[0], psfs.last_height_mm(),
                                                 planes.quarter_turns, enough))
            if worst > enough:
                break
        return worst

    def uniform_light_error(self) -> float:
        """Largest relative error of a pixel under uniform radiance, from a few wavelengths."""
        some = np.unique(np.linspace(0, len(self._banks) - 1, UNIFORM_WAVELENGTHS).round().astype(int))
        return max(unevenness(self._banks[index], self._fields[index], self._grid) for index in some)

    def _trimmed(self, energy, planes):
        radius_px, _ = self.reach(energy)
        for bank, field in zip(self._banks, self._fields, strict=True):
            yield PlacedPsfs(partial(bank.trimmed, energy, radius_px), field, planes)

    @cached_property
    def _height_shares(self):
        """Share of the picture between each height of the lens data and the next: array (height - 1,)."""
        rows, columns = ((np.arange(PLACES) + 0.5) * n / PLACES - 0.5 for n in self._grid.frame().shape_px)
        x_mm, y_mm = self._grid.frame().position_mm(rows[:, None], columns)
        heights_mm = self._optics[0].heights_mm
        interval = np.searchsorted(heights_mm[1:-1], self._fields[0].paraxial_height_mm(np.hypot(x_mm, y_mm)))
        return np.bincount(interval.ravel(), minlength=heights_mm.size - 1) / interval.size
