"""Plan: how one picture will be filtered."""

from dataclasses import asdict, dataclass, field

import numpy as np
from scipy import fft

from ..errors import ImageError
from ..field.psf_bank import psf_radius_px, psf_support

LARGEST_PSF_RADIUS_PX = 2048
SECTION_SIZE, ORDER, AZIMUTHS = 32, 2, 32  # where they are not set
PIXELS_SECTION = 32
PAPER = {"section_size": 16, "order": 1, "space_px": 64}
SINGLE_RANGE = 1e3  # leaves the dimmest pixel right to some 1e-4
PSF_ENERGY = 1 - 1e-6


@dataclass(frozen=True)
class Plan:
    """How one picture will be filtered.

    Attributes
    ----------
    method : "polar", "pixels", "sections", "paper" or "exact"
    section_size, order, non_negative, space_px
        As in `Options`; order 0 is one PSF for the whole picture; of "pixels", the section is a portion of work.
    azimuths : int
        Steps of the polar table of PSFs from 0 to 45 degrees; 0 where PSFs are turned one by one.
    psf_radius_px : int
    support_um : float
        Radius of the circle that PSFs are trimmed to; inf for none.
    trimmed_energy : float
        The largest fraction of a PSF outside of it.
    precision : "float32" or "float64"
        Of the planes and sums.
    single_range, flat_tolerance : float
        See `content.judge_content`.
    folded : bool
        Whether to use the symmetry of a centred axis, which lens and picture then have.
    out_of_field : "hold" or "vignette"
    error_bound : float or None
        No more than this fraction of any point's light lands in the wrong place; None where nobody asked.
    seconds, memory_mb : float
        Predicted for the picture, the latter beyond radiance and irradiance themselves.
    """

    method: str
    section_size: int
    order: int
    non_negative: bool
    space_px: int
    azimuths: int
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

    def as_dict(self):
        """The plan as JSON can hold it: None stands for inf."""
        return {name: None if value == np.inf else value for name, value in asdict(self).items()}

    @property
    def weights_positive(self):
        """Whether no light can come out negative but for rounding."""
        return self.method != "sections" or self.order <= 2 or self.non_negative


def knob_plan(options, lens, radiance):
    """The plan that the knobs come to, what is not set being the default.

    A section larger than the picture is cut down to it; the computational space always holds a section and the
    PSFs that reach out of it, so that nothing wraps around.

    Raises
    ------
    ImageError
        A pixel pitch so small that the PSFs come out larger than anybody wants.
    """
    whole_psfs = options.method in ("paper", "exact")
    support = psf_support_on(lens, radiance.pitch_um, 1.0 if whole_psfs else options.psf_energy or PSF_ENERGY)
    radius = support["psf_radius_px"]
    of_sections = options.section_size or options.order or options.space_px
    method = options.method
    if method == "auto":
        method = "pixels" if options.azimuths and not of_sections else "sections"
    sizes = {"paper": PAPER, "pixels": {"section_size": PIXELS_SECTION}}.get(method, {})
    wanted = sizes.get("section_size") or options.section_size or SECTION_SIZE
    section = min(wanted, max(radiance.frame_px) + 2 * radius)
    precision = "float64" if whole_psfs else options.precision or "auto"
    single_range = {"auto": SINGLE_RANGE, "float32": np.inf, "float64": 0.0}[precision]
    return Plan(
        method=method, section_size=section, order=sizes.get("order") or options.order or ORDER,
        non_negative=options.non_negative,
        space_px=space_px(section, radius, sizes.get("space_px") or options.space_px or 0),
        azimuths=options.azimuths or (AZIMUTHS if method in ("pixels", "polar") or options.flat_tolerance else 0),
        precision="float64" if precision == "float64" else "float32",
        single_range=np.inf if method == "pixels" and single_range else single_range,
        flat_tolerance=options.flat_tolerance or 0.0, folded=not whole_psfs and foldable(lens, radiance),
        out_of_field=options.out_of_field, **support)


def psf_support_on(lens, pitch_um, energy):
    """The fields of a plan that say how far PSFs reach which hold this energy."""
    support_um, lost = psf_support(lens, energy) if energy < 1 else (np.inf, 0.0)
    radius = psf_radius_px(lens, pitch_um, support_um)
    if radius > LARGEST_PSF_RADIUS_PX:
        raise ImageError("image", "pitch_um", pitch_um,
                         f"a point spread function would reach {radius} px; at most {LARGEST_PSF_RADIUS_PX} are done")
    return {"psf_radius_px": radius, "support_um": support_um, "trimmed_energy": lost}


def space_px(section_size, radius_px, wanted_px=0):
    """Side of the computational space: one that is quickly transformed."""
    return fft.next_fast_len(max(section_size + 2 * radius_px, wanted_px), real=True)


def foldable(lens, radiance):
    """Whether four mirrored quadrants share all of the optics."""
    return radiance.centred and lens.mirror_symmetric
