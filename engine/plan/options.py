"""Options: what the user asks of the engine, by its result or by its knobs."""

from dataclasses import dataclass
from numbers import Integral, Real

import numpy as np

from ..blur.isoplanatic import ORDERS
from ..errors import InputError

METHODS = ("auto", "polar", "pixels", "sections", "paper", "exact")
PRECISIONS = ("auto", "float32", "float64")
OUT_OF_FIELD = ("hold", "vignette")
FIREFLIES = ("refuse", "clamp")
DEFAULT_ACCURACY = 0.01
KNOBS = ("section_size", "order", "space_px", "azimuths", "psf_energy", "flat_tolerance", "precision")


@dataclass(frozen=True)
class Options:
    """What is asked of the engine. Where nothing is said, it is an accuracy of 0.01.

    Attributes
    ----------
    section_size : int, optional
        Side of an isoplanatic section in pixels (32). Smaller is more accurate and slower.
    order : 1 to 4, optional
        PSFs inside a section: 1, one PSF for the whole section (the paper); 2, interpolated between its corners (the
        default); 3 and 4, between 9 and 16 nodes in it. Where the PSF varies smoothly the error falls with this power
        of the section size. Orders 3 and 4 can leave slightly negative pixels beside very bright ones.
    accuracy : float, optional
        The largest fraction of any point's light that may land in the wrong place: the sum of |error| over the
        picture is at most this times its light, whatever the scene. The plan then chooses all knobs but `method`, at
        the least predicted time. Errors of the lens data and of resampling the picture by distortion are not in it.
    method : "auto", "polar", "pixels", "sections", "paper" or "exact"
        "pixels" gives every pixel its own PSF from a table of azimuths; "polar" does so in sections, by their spectra;
        "sections" interpolates PSFs on a square grid. "auto" takes the square sections where a knob of theirs is set,
        else what costs least. "paper" is sections of 16 px
        of order 1 in a space of 64 px, whole PSFs, double precision. "exact" turns every pixel's own PSF: what the
        others are measured against, at some hundred times their time.
    space_px : int, optional
        Side of the computational space, where a certain one is wanted. It is made larger where section and PSF need
        it, so this never costs accuracy.
    azimuths : int, optional
        Steps from 0 to 45 degrees of the table that PSFs are mixed from: by "pixels" and "polar" (32), or for the nodes
        of square sections (none: they are turned one by one).
    psf_energy : float, optional
        Fraction of every PSF that is kept, within a circle about the chief ray; the rest is left out, and reported
        (0.999999). Twice the loss is in the wrong place.
    flat_tolerance : float, optional
        Relative error up to which sections with even light all around are not filtered (0: all are). PSFs then come
        from the table.
    precision : "auto", "float32" or "float64", optional
        "auto" is single precision but for sections whose dynamic range needs more.
    non_negative : bool
        Interpolate PSFs by weights that are never negative at orders 3 and 4 as well, at a loss of accuracy.
    out_of_field : "hold" or "vignette"
        Pixels beyond the last tabulated field height: "hold" its PSF and relative illumination, the distortion
        going on in a straight line; "vignette" leaves them black. Either way the report says how many there are.
    fireflies : "refuse" or "clamp"
        Pixels that are no finite number: an error that names the first, or the brightest of their neighbours.
    """

    section_size: int | None = None
    order: int | None = None
    accuracy: float | None = None
    method: str = "auto"
    space_px: int | None = None
    azimuths: int | None = None
    psf_energy: float | None = None
    flat_tolerance: float | None = None
    precision: str | None = None
    non_negative: bool = False
    out_of_field: str = "hold"
    fireflies: str = "refuse"

    def __post_init__(self):
        for field in ("section_size", "space_px", "azimuths"):
            self._check_whole(field, "expected a whole number, 1 or more")
        self._check_whole("order", f"expected one of {', '.join(map(str, ORDERS))}", ORDERS)
        self._check_number("accuracy", "expected a number above 0 and below 2, such as 0.01", 0, 2)
        self._check_number("psf_energy", "expected a number above 0 and up to 1, such as 0.999", 0, 1 + 1e-12)
        self._check_number("flat_tolerance", "expected a number of 0 or more and below 1", -1e-300, 1)
        for field, choices in (("method", METHODS), ("precision", PRECISIONS), ("out_of_field", OUT_OF_FIELD),
                               ("fireflies", FIREFLIES), ("non_negative", (False, True))):
            value = getattr(self, field)
            if value not in choices and not (field == "precision" and value is None):
                raise InputError("options", field, value, f"expected {' or '.join(map(str, choices))}")
        self._check_contradictions()

    def _check_whole(self, field, remedy, choices=None):
        value = getattr(self, field)
        if value is not None and (isinstance(value, bool) or not isinstance(value, Integral) or value < 1
                                  or (choices and value not in choices)):
            raise InputError("options", field, value, remedy)

    def _check_number(self, field, remedy, above, below):
        value = getattr(self, field)
        if value is not None and (isinstance(value, bool) or not isinstance(value, Real) or not np.isfinite(value)
                                  or not above < value < below):
            raise InputError("options", field, value, remedy)

    def _check_contradictions(self):
        """An accuracy chooses the knobs, so none may stand beside it; one method's knobs mean nothing to another."""
        others = {"sections": (), "polar": ("order",), "pixels": ("section_size", "order", "space_px"),
                  "paper": KNOBS, "exact": KNOBS, "auto": ()}[self.method]
        if self.accuracy is not None:
            if self.method not in ("auto", "polar", "pixels"):
                raise InputError("options", "accuracy", self.accuracy,
                                 f"leave it out: the method {self.method!r} goes by its knobs")
            others = KNOBS
        for field in others:
            if getattr(self, field) is not None:
                reason = "an accuracy chooses it" if self.accuracy is not None else f"the method is {self.method!r}"
                raise InputError("options", field, getattr(self, field), f"leave it out: {reason}")

    @property
    def by_result(self):
        """Whether the plan chooses the knobs."""
        return self.accuracy is not None or (self.method in ("auto", "polar", "pixels") and
                                             all(getattr(self, field) is None for field in KNOBS))
