"""The PSFs of a lens on a picture's pixels: how far they reach and how many pixels they cover, trimmed to an energy."""

from collections.abc import Iterator
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from ..errors import ImageError
from ..field.distortion import FieldGeometry
from ..field.mirror_symmetry import Planes
from ..field.psf_bank import PlacedPsfs, PsfBank, psf_radius_px
from ..image.spectral_image import SpectralImage
from ..threads import thread_pool

if TYPE_CHECKING:
    from ..lens.lens import Lens

LARGEST_PSF_RADIUS_PX = 2048
PLACES = 48  # along each side of a picture, to tell how much of it lies at which height


class PicturePsfs:
    """The PSFs of a lens on the pixels of a picture, at the wavelengths that tell of all.

    Parameters
    ----------
    lens : Lens
    radiance : SpectralImage
    most_energy : float
        The largest fraction of a PSF that will be asked for.

    Raises
    ------
    ImageError
        A pixel pitch so small that the PSFs come out larger than anybody wants.
    LensError
        A wavelength outside the lens data; a distortion that folds the field.
    """

    def __init__(self, lens: "Lens", radiance: SpectralImage, most_energy: float) -> None:
        self.whole_radius_px = psf_radius_px(lens, radiance.pitch_um)
        if self.whole_radius_px > LARGEST_PSF_RADIUS_PX:
            raise ImageError("image", "pitch_um", radiance.pitch_um, f"a point spread function would reach "
                             f"{self.whole_radius_px} px; at most {LARGEST_PSF_RADIUS_PX} are done")
        self._optics = [lens.at_wavelength(nm) for nm in telling_wavelengths(lens, radiance)]
        self._fields = [FieldGeometry(each, lens.name) for each in self._optics]
        self._grid, self._most_energy, self._reaches = radiance.grid, most_energy, {}

    @cached_property
    def _banks(self):
        """A PsfBank for each wavelength, of no more than will be asked for: whole PSFs take a lot of memory."""
        with thread_pool() as pool:
            return list(pool.map(lambda each: PsfBank.of(each, self._grid.pitch_um).trimmed(self._most_energy),
                                 self._optics))

    @cached_property
    def mirror_symmetric(self) -> bool:
        """Whether all of them are symmetric about the meridional plane."""
        return all(bank.mirror_symmetric for bank in self._banks)

    def reach(self, energy: float) -> tuple[int, float]:
        """How many pixels PSFs reach that are trimmed to this energy, and how many they cover on the mean."""
        if energy >= 1:
            return self.whole_radius_px, _covered(self.whole_radius_px - 1)
        if energy not in self._reaches:
            self._reaches[energy] = self._reach(energy)
        return self._reaches[energy]

    def _reach(self, energy):
        supports = [bank.support_px(energy) for bank in self._banks]
        radius_px = max(bank.radius_within_px(support) for bank, support in zip(self._banks, supports, strict=True))
        taps = np.mean([_covered(support + bank.sample_size_px / 2)
                        for bank, support in zip(self._banks, supports, strict=True)], axis=0)
        return radius_px, float(self._height_shares @ np.maximum(taps[:-1], taps[1:]))

    def trimmed(self, energy: float, planes: Planes) -> Iterator[PlacedPsfs]:
        """The PSFs trimmed to this energy, in the planes that they are to blur, wavelength by wavelength."""
        radius_px, _ = self.reach(energy)
        for bank, field in zip(self._banks, self._fields, strict=True):
            yield PlacedPsfs(partial(bank.trimmed, energy, radius_px), field, planes)

    @cached_property
    def _height_shares(self):
        """Which share of the picture lies between each height of the lens data and the next: array (height - 1,)."""
        rows, columns = ((np.arange(PLACES) + 0.5) * n / PLACES - 0.5 for n in self._grid.frame().shape_px)
        x_mm, y_mm = self._grid.frame().position_mm(rows[:, None], columns)
        heights_mm = self._optics[0].heights_mm
        interval = np.searchsorted(heights_mm[1:-1], self._fields[0].paraxial_height_mm(np.hypot(x_mm, y_mm)))
        return np.bincount(interval.ravel(), minlength=heights_mm.size - 1) / interval.size


def telling_wavelengths(lens: "Lens", radiance: SpectralImage) -> np.ndarray:
    """The wavelengths that tell the errors of all: those of the picture, or those of the lens data around them,
    whichever are fewer. For between these the PSFs are mixtures, and so are their errors."""
    around = lens.wavelengths_around(radiance.wavelengths_nm)
    return around if len(around) < radiance.wavelengths_nm.size else radiance.wavelengths_nm


def _covered(reach_px):
    """How many pixels a PSF covers that reaches so far from the middle of one."""
    return np.pi * (reach_px + 0.5) ** 2
