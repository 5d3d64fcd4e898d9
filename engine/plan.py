"""Options: what the user asks of the engine; Plan: what it comes to for one image."""

from dataclasses import asdict, dataclass
from numbers import Integral

from scipy import fft

from .errors import ImageError, InputError
from .psf import psf_radius_px
from .sections import ORDERS

OUT_OF_FIELD = ("hold", "vignette")
METHODS = ("sections", "exact")
LARGEST_PSF_RADIUS_PX = 2048


@dataclass(frozen=True)
class Options:
    """The knobs of the engine.

    Attributes
    ----------
    section_size : int
        Side of an isoplanatic section in pixels. Smaller is more accurate and slower.
    order : 1 to 4
        PSFs inside a section: 1, one PSF for the whole section (the paper); 2, interpolated between its corners;
        3 and 4, between 9 and 16 nodes in it. Where the PSF varies smoothly the error falls with this power of the
        section size. Orders 3 and 4 can leave slightly negative pixels beside very bright ones.
    space_px : int or None
        Side of the computational space, where a certain one is wanted (the paper: 64). The space is made larger
        where section and PSF need it, so this never costs accuracy.
    out_of_field : "hold" or "vignette"
        Pixels beyond the last tabulated field height: "hold" its PSF and relative illumination, the distortion
        going on in a straight line; "vignette" leaves them black. Either way the report says how many there are.
    method : "sections" or "exact"
        "exact" gives every pixel its own PSF: what sections are measured against, at some hundred times their time.
    """

    section_size: int = 32
    order: int = 2
    space_px: int | None = None
    out_of_field: str = "hold"
    method: str = "sections"

    def __post_init__(self):
        self._check_whole("section_size", "expected a whole number of pixels, 1 or more")
        self._check_whole("order", f"expected one of {', '.join(map(str, ORDERS))}")
        if self.order not in ORDERS:
            raise InputError("options", "order", self.order, f"expected one of {', '.join(map(str, ORDERS))}")
        if self.space_px is not None:
            self._check_whole("space_px", "expected a whole number of pixels, 1 or more")
        for field, choices in (("out_of_field", OUT_OF_FIELD), ("method", METHODS)):
            if getattr(self, field) not in choices:
                raise InputError("options", field, getattr(self, field), f"expected {' or '.join(choices)}")

    def _check_whole(self, field, remedy):
        value = getattr(self, field)
        if isinstance(value, bool) or not isinstance(value, Integral) or value < 1:
            raise InputError("options", field, value, remedy)


@dataclass(frozen=True)
class Plan:
    """How one image will be filtered: sizes in pixels."""

    section_size: int
    order: int
    psf_radius_px: int
    space_px: int
    out_of_field: str
    method: str

    def as_dict(self):
        return asdict(self)


def make_plan(options, lens, pitch_um, frame_px):
    """The plan for filtering a frame of (rows, columns) px at this pitch.

    A section larger than the frame is cut down to it; the computational space always holds a section and the
    PSFs that reach out of it, so that nothing wraps around.
    """
    radius = psf_radius_px(lens, pitch_um)
    if radius > LARGEST_PSF_RADIUS_PX:
        raise ImageError("image", "pitch_um", pitch_um,
                         f"a point spread function would reach {radius} px; at most {LARGEST_PSF_RADIUS_PX} are done")
    section = min(options.section_size, max(frame_px) + 2 * radius)
    space = fft.next_fast_len(max(section + 2 * radius, options.space_px or 0), real=True)
    return Plan(section, options.order, radius, space, options.out_of_field, options.method)
