"""Plan: how one picture will be filtered."""

from dataclasses import asdict, dataclass, field

from ..blur import Method
from ..field.mirror_symmetry import Planes
from ..image.pixel_grid import PixelGrid
from ..values import plain


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
    error_bound : float or None
        No more than this fraction of any point's light lands in the wrong place; None where nobody asked.
    seconds, memory_mb : float
        Predicted for the picture, the latter beyond radiance and irradiance themselves.
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
    error_bound: float | None = field(default=None, compare=False)
    seconds: float = field(default=0.0, compare=False)
    memory_mb: float = field(default=0.0, compare=False)

    @property
    def reach_px(self) -> int:
        """How far PSFs reach, in the picture's own pixels."""
        return -(-self.psf_radius_px // self.supersampling)

    def planes(self, capture: PixelGrid) -> Planes:
        """The planes to filter a capture's picture in, in pixels as they are filtered.

        That is the frame with what lies no more than a PSF beyond it: light from just outside is blurred into it.
        """
        return Planes(capture.within_reach(self.psf_radius_px), self.folded)

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
                f"about {max(self.seconds, 0.1):.1f} s, {self.memory_mb:.0f} MB")
