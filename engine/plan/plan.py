"""Plan: how one picture will be filtered."""

from dataclasses import asdict, dataclass, field

import numpy as np

from ..blur import Method
from ..blur.pixels import Pixels
from ..field.field_map import PsfSet
from ..field.mirror_symmetry import Planes
from ..image.pixel_grid import PixelGrid
from ..runtime.values import json_value

HALO_STEPS = 8


@dataclass(frozen=True)
class Plan:
    """How one picture will be filtered.

    Attributes
    ----------
    method : Method
        The method, with its knobs.
    psf_radius_px : int
        Largest reach of a PSF, in the pixels of the filter: each of the picture's pixels is `supersampling` of them
        across and down.
    psf_energy : float
        The fraction of each PSF, at every height and wavelength, that is used: the light in the smallest circle around
        the chief ray that contains at least this fraction.
    taps : float
        Pixels that a PSF covers, averaged over the picture.
    precision : "float32" or "float64"
        Precision of the planes and sums.
    single_range, flat_tolerance : float
        See `section_needs` and `even_light`.
    folded : bool
        Whether to use the symmetry of lens and picture about a centred axis.
    out_of_field : "hold" or "vignette"
    supersampling : int
    known : int
        Parts of a pixel, down and across, in which in-focus light is known, by a detail of the radiance: 1 if it is
        even inside each pixel.
    halo_energy : float or None
        The fraction of the PSFs of highlights that is used, because their trimmed light would be visible as a halo;
        None without halos.
    halo_radius_px : int
        Reach of the halos.
    error_bound : float or None
        Upper limit of the misplaced fraction of any point's light; None if no accuracy was requested.
    uniform_light_error : float or None
        Upper limit of a pixel's relative error under uniform radiance, because each pixel has one PSF. This is an error
        of the resolution, not of the method: more pixels, or supersampling, reduce it. None if no accuracy was
        requested.
    seconds, memory_mb : float
        Predictions for the picture; memory in addition to radiance and irradiance.
    peak_mb : float
        Predicted peak memory of the process, including its present memory; 0 if not computed.
    """

    method: Method
    psf_radius_px: int
    psf_energy: float
    taps: float = field(compare=False)
    precision: str
    single_range: float
    flat_tolerance: float
    folded: bool
    out_of_field: str
    supersampling: int = 1
    known: int = 1
    halo_energy: float | None = None
    halo_radius_px: int = 0
    error_bound: float | None = field(default=None, compare=False)
    uniform_light_error: float | None = field(default=None, compare=False)
    seconds: float = field(default=0.0, compare=False)
    memory_mb: float = field(default=0.0, compare=False)
    peak_mb: float = field(default=0.0, compare=False)

    @property
    def reach_px(self) -> int:
        """Largest reach of a PSF, in the picture's pixels."""
        return -(-self.psf_radius_px // self.supersampling)

    @property
    def parts(self) -> int:
        """Parts of a pixel, down and across, that radiance is split into: as many as are known, or as are filtered."""
        return self.known if self.known > 1 else self.supersampling

    def planes(self, capture: PixelGrid) -> Planes:
        """The planes of a capture's picture for the filter, in the filter's pixels.

        They contain the frame and a margin as wide as PSFs or halos reach, because light from just outside the frame
        is blurred into it.
        """
        return Planes(capture.within_reach(max(self.psf_radius_px, self.halo_radius_px)), self.folded)

    def trimmed(self, psfs: PsfSet) -> PsfSet:
        """Trim complete PSFs to those that spread the pixels' light."""
        return psfs.trimmed(self.psf_energy, self.psf_radius_px)

    def halo(self, psfs: PsfSet) -> PsfSet:
        """The additional halos of bright pixels, from complete PSFs; only for a plan with halos."""
        assert self.halo_energy is not None
        return psfs.halo(self.psf_energy, self.halo_energy, self.halo_radius_px)

    @property
    def halo_method(self) -> Pixels:
        """The method for halos. They are smooth and contain a hundredth of the light, so few steps are sufficient."""
        steps = self.method.azimuths
        return Pixels(self.method.section_size, max(HALO_STEPS, steps // 4) if steps else 0)

    @property
    def halo_density(self) -> float:
        """The fraction of a pixel's light that falls on each pixel of its halo; 0 without halos."""
        if self.halo_energy is None or self.halo_radius_px <= self.psf_radius_px:
            return 0.0
        pixels = np.pi * (self.halo_radius_px**2 - self.psf_radius_px**2)
        return (self.halo_energy - self.psf_energy) / pixels

    def as_dict(self) -> dict:
        """The plan as values for JSON, with None for inf."""
        facts = asdict(self) | {"method": self.method.name} | asdict(self.method) | {"azimuths": self.method.azimuths}
        return json_value(facts)

    @property
    def text(self) -> str:
        """The plan in one line: the method; for a requested accuracy also bound, time and memory."""
        way = f"{self.method.text}, {'double' if self.precision == 'float64' else 'single'} precision"
        if self.supersampling > 1:
            way += f", {self.supersampling} x {self.supersampling} per pixel{' with detail' * (self.known > 1)}"
        if self.error_bound is None or self.uniform_light_error is None:
            return way
        return (f"{way}: at most {100 * self.error_bound:.2g} % of any point's light misplaced, uniform light within "
                f"{100 * self.uniform_light_error:.2g} %; "
                f"about {max(self.seconds, 0.1):.1f} s, {self.peak_mb or self.memory_mb:.0f} MB")
