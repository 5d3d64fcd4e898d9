"""Plan: how one picture will be filtered."""

from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..blur import METHODS, Method
from ..errors import ImageError
from ..field.mirror_symmetry import Planes
from ..field.psf_bank import psf_radius_px, psf_support
from ..image.pixel_grid import PixelGrid
from ..values import plain
from .options import AUTO, BY_KNOBS, Options

if TYPE_CHECKING:
    from ..lens.lens import Lens

LARGEST_PSF_RADIUS_PX = 2048
SINGLE_RANGE = 1e3  # leaves the dimmest pixel right to some 1e-4
PSF_ENERGY = 1 - 1e-6


@dataclass(frozen=True)
class Plan:
    """How one picture will be filtered.

    Attributes
    ----------
    method : Method
        The way, with its knobs.
    psf_radius_px : int
    support_um : float
        Radius of the circle that PSFs are trimmed to; inf for none.
    trimmed_energy : float
        The largest fraction of a PSF outside of it.
    precision : "float32" or "float64"
        Of the planes and sums.
    single_range, flat_tolerance : float
        See `section_needs` and `even_light`.
    folded : bool
        Whether to use the symmetry of a centred axis, which lens and picture then have.
    out_of_field : "hold" or "vignette"
    error_bound : float or None
        No more than this fraction of any point's light lands in the wrong place; None where nobody asked.
    seconds, memory_mb : float
        Predicted for the picture, the latter beyond radiance and irradiance themselves.
    """

    method: Method
    psf_radius_px: int
    support_um: float
    trimmed_energy: float
    precision: str
    single_range: float
    flat_tolerance: float
    folded: bool
    out_of_field: str
    error_bound: float | None = field(default=None, compare=False)
    seconds: float = field(default=0.0, compare=False)
    memory_mb: float = field(default=0.0, compare=False)

    def planes(self, capture: PixelGrid) -> Planes:
        """The planes to filter a capture's picture in.

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
        if self.error_bound is None:
            return way
        return (f"{way}: at most {100 * self.error_bound:.2g} % of any point's light misplaced; "
                f"about {max(self.seconds, 0.1):.1f} s, {self.memory_mb:.0f} MB")


def knob_plan(options: Options, lens: "Lens", capture: PixelGrid) -> Plan:
    """The plan that the knobs come to, what is not set being the default.

    A section larger than the picture is cut down to it; the computational space always holds a section and the
    PSFs that reach out of it, so that nothing wraps around.

    Raises
    ------
    ImageError
        A pixel pitch so small that the PSFs come out larger than anybody wants.
    """
    way = METHODS[BY_KNOBS if options.method == AUTO else options.method]
    energy = options.psf_energy or (1.0 if way.yardstick else PSF_ENERGY)
    precision = options.precision or ("float64" if way.yardstick else AUTO)
    support = psf_support_on(lens, capture.pitch_um, energy)
    radius = support["psf_radius_px"]
    single_range = {AUTO: SINGLE_RANGE, "float32": np.inf, "float64": 0.0}[precision]
    return Plan(
        method=way.by_knobs(options.section_size, options.azimuths, radius, max(capture.frame_px) + 2 * radius),
        precision="float64" if precision == "float64" else "float32",
        single_range=single_range if way.transforms or not single_range else np.inf,
        flat_tolerance=options.flat_tolerance or 0.0, folded=not way.yardstick and foldable(lens, capture),
        out_of_field=options.out_of_field, **support)


def psf_support_on(lens: "Lens", pitch_um: float, energy: float) -> dict:
    """The fields of a plan that say how far PSFs reach which hold this energy."""
    support_um, lost = psf_support(lens, energy) if energy < 1 else (np.inf, 0.0)
    radius = psf_radius_px(lens, pitch_um, support_um)
    if radius > LARGEST_PSF_RADIUS_PX:
        raise ImageError("image", "pitch_um", pitch_um,
                         f"a point spread function would reach {radius} px; at most {LARGEST_PSF_RADIUS_PX} are done")
    return {"psf_radius_px": radius, "support_um": support_um, "trimmed_energy": lost}


def foldable(lens: "Lens", capture: PixelGrid) -> bool:
    """Whether four mirrored quadrants share all of the optics."""
    return capture.centred and lens.mirror_symmetric
