"""Plan: how one picture will be filtered."""

from dataclasses import asdict, dataclass, field

import numpy as np

from ..blur import Method
from ..blur.pixels import Pixels
from ..field.mirror_symmetry import Planes
from ..field.psf_bank import PsfBank
from ..image.pixel_grid import PixelGrid
from ..values import plain

HALO_AZIMUTHS = 8


@dataclass(frozen=True)
class Plan:
    """How one picture will be filtered.

    Attributes
    ----------
    method : Method
        The way, with its knobs.
    psf_radius_px : int
        The farthest that a PSF reaches, in pixels as they are filtered: `supersampling` of them make up one of the
        picture's, across and down.
    psf_energy : float
        The fraction of each PSF, at every height and wavelength, that is kept: what the least circle about the chief
        ray has that holds so much.
    taps : float
        Pixels that a PSF covers, on the mean over the picture.
    precision : "float32" or "float64"
        Of the planes and sums.
    single_range, flat_tolerance : float
        See `section_needs` and `even_light`.
    folded : bool
        Whether to use the symmetry of a centred axis, which lens and picture then have.
    out_of_field : "hold" or "vignette"
    supersampling : int
    halo_energy : float or None
        The fraction that is kept where light is so bright that the halo of what is trimmed would show; None where that
        is no more.
    halo_radius_px : int
        How far those halos reach.
    error_bound : float or None
        No more than this fraction of any point's light lands in the wrong place; None where nobody asked.
    seconds, memory_mb : float
        Predicted for the picture, the latter beyond radiance and irradiance themselves.
    peak_mb : float
        Predicted: the most memory that the process will hold, all that it holds included; 0 where nobody asked.
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
    halo_energy: float | None = None
    halo_radius_px: int = 0
    error_bound: float | None = field(default=None, compare=False)
    seconds: float = field(default=0.0, compare=False)
    memory_mb: float = field(default=0.0, compare=False)
    peak_mb: float = field(default=0.0, compare=False)

    @property
    def reach_px(self) -> int:
        """How far PSFs reach, in the picture's own pixels."""
        return -(-self.psf_radius_px // self.supersampling)

    def planes(self, capture: PixelGrid) -> Planes:
        """The planes to filter a capture's picture in, in pixels as they are filtered.

        That is the frame with what lies no more than a PSF beyond it, or a halo: light from just outside is blurred
        into it.
        """
        return Planes(capture.within_reach(max(self.psf_radius_px, self.halo_radius_px)), self.folded)

    def trimmed(self, bank: PsfBank) -> PsfBank:
        """The PSFs that pixels are spread by, of whole ones."""
        return bank.trimmed(self.psf_energy, self.psf_radius_px)

    def halo(self, bank: PsfBank) -> PsfBank:
        """What bright pixels are spread by beside, of whole PSFs; there must be halos."""
        assert self.halo_energy is not None
        return bank.halo(self.psf_energy, self.halo_energy, self.halo_radius_px)

    @property
    def halo_method(self) -> Pixels:
        """The way to spread halos: smooth, and a hundredth of the light, they ask for few azimuths."""
        return Pixels(self.method.section_size, max(HALO_AZIMUTHS, self.method.azimuths // 4))

    @property
    def halo_density(self) -> float:
        """The fraction of a pixel's light that falls on each pixel of its halo; 0 where there are none."""
        if self.halo_energy is None or self.halo_radius_px <= self.psf_radius_px:
            return 0.0
        pixels = np.pi * (self.halo_radius_px**2 - self.psf_radius_px**2)
        return (self.halo_energy - self.psf_energy) / pixels

    def as_dict(self) -> dict:
        """The plan as JSON can hold it: None stands for inf."""
        facts = asdict(self) | {"method": self.method.name} | asdict(self.method) | {"azimuths": self.method.azimuths}
        return plain(facts)

    @property
    def text(self) -> str:
        """The plan in one line: the way; and the result, where that was asked for."""
        way = f"{self.method.text}, {'double' if self.precision == 'float64' else 'single'} precision"
        if self.supersampling > 1:
            way += f", each pixel {self.supersampling} x {self.supersampling}"
        if self.error_bound is None:
            return way
        return (f"{way}: at most {100 * self.error_bound:.2g} % of any point's light misplaced; "
                f"about {max(self.seconds, 0.1):.1f} s, {self.peak_mb or self.memory_mb:.0f} MB")
