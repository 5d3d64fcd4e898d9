"""Options: what the user asks of the engine, by its result or by its knobs."""

from dataclasses import dataclass
from numbers import Integral, Real

import numpy as np

from ..blur import METHODS
from ..errors import InputError

AUTO = "auto"
PRECISIONS = (AUTO, "float32", "float64")
OUT_OF_FIELD = ("hold", "vignette")
FIREFLIES = ("refuse", "clamp")
DEFAULT_ACCURACY = 0.01
TIER_ACCURACY = {"preview": 0.1, "standard": DEFAULT_ACCURACY, "reference": 0.001}
MOST_RAYS = ((0.05, 256, 256), (0.005, 512, 2048), (0.0, 1024, 4096))  # of a pixel, from these accuracies on; of lamps
KNOBS = ("section_size", "azimuths", "psf_energy", "flat_tolerance", "precision")
MOST_SUPERSAMPLING = 16  # the error that it mends is a 256th by then
BY_KNOBS = "sections"  # where a knob is set and no method


@dataclass(frozen=True)
class Options:
    """What is asked of the engine. Where nothing is said, it is an accuracy of 0.01.

    Attributes
    ----------
    accuracy : float, optional
        The largest fraction of any point's light that may land in the wrong place: the sum of |error| over the
        picture is at most this times its light, whatever the scene. The plan then chooses all knobs but `method`, at
        the least predicted time. Errors of the lens data, of resampling the picture by distortion, and of pixels that
        shine from their middles (see `supersampling`) are not in it.
    method : "auto", "sections", "pixels", "paper" or "exact"
        "sections" interpolates PSFs inside sections of the picture, between the heights of the lens data and some
        azimuths; "pixels" gives every pixel its own PSF from the same table; "auto" takes what costs least. "paper" is
        the paper's method: one PSF for each section; as it was written, sections of 16 px in a space of 64 px, whole
        PSFs, double precision. "exact" turns every pixel's own PSF: what the others are measured against, at some
        hundred times their time.
    section_size : int, optional
        Side in pixels of a section, by "sections" (32) or "paper" (16). By "paper" smaller is more accurate and
        slower; by "sections" it is a matter of speed alone.
    azimuths : int, optional
        Steps from 0 to 45 degrees of the table that PSFs are mixed from, by "sections" and "pixels" (32). More is more
        accurate, and takes more time and memory.
    psf_energy : float, optional
        Fraction of every PSF that is kept: each one's own circle about the chief ray holds so much, and the rest is
        left out (0.999999). Twice the loss is in the wrong place.
    flat_tolerance : float, optional
        Relative error up to which sections with even light all around are not filtered (0: all are).
    precision : "auto", "float32" or "float64", optional
        "auto" is single precision but for sections whose dynamic range needs more.
    out_of_field : "hold" or "vignette"
        Pixels beyond the last tabulated field height: "hold" its PSF and relative illumination, the distortion
        going on in a straight line; "vignette" leaves them black. Either way the report says how many there are.
    supersampling : int
        Into how many pixels each one is divided across and down, for PSFs finer than it (1): up to 16. Its radiance
        is an even square then, and not a point in its middle; what comes out is averaged back. Seconds and memory are
        those of a picture so much larger. Sections are counted in the finer pixels.
    fireflies : "refuse" or "clamp"
        Pixels that are no finite number: an error that names the first, or the brightest of their neighbours.

    Raises
    ------
    InputError
        A value that cannot be, or one that means nothing beside the others.
    """

    accuracy: float | None = None
    method: str = AUTO
    section_size: int | None = None
    azimuths: int | None = None
    psf_energy: float | None = None
    flat_tolerance: float | None = None
    precision: str | None = None
    out_of_field: str = "hold"
    fireflies: str = "refuse"
    supersampling: int = 1

    def __post_init__(self) -> None:
        for field in ("section_size", "azimuths"):
            if getattr(self, field) is not None:
                self._check_whole(field, np.inf, "1 or more")
        self._check_whole("supersampling", MOST_SUPERSAMPLING, f"from 1 to {MOST_SUPERSAMPLING}")
        self._check_number("accuracy", "expected a number above 0 and below 2, such as 0.01", 0, 2)
        self._check_number("psf_energy", "expected a number above 0 and up to 1, such as 0.999", 0, 1 + 1e-12)
        self._check_number("flat_tolerance", "expected a number of 0 or more and below 1", -1e-300, 1)
        for field, choices in (("method", (AUTO, *METHODS)), ("precision", PRECISIONS),
                               ("out_of_field", OUT_OF_FIELD), ("fireflies", FIREFLIES)):
            value = getattr(self, field)
            if value not in choices and not (field == "precision" and value is None):
                raise InputError("options", field, value, f"expected {' or '.join(choices)}")
        self._check_contradictions()

    def _check_whole(self, field, most, which):
        value = getattr(self, field)
        if isinstance(value, bool) or not isinstance(value, Integral) or not 1 <= value <= most:
            raise InputError("options", field, value, f"expected a whole number, {which}")

    def _check_number(self, field, remedy, above, below):
        value = getattr(self, field)
        if value is not None and (isinstance(value, bool) or not isinstance(value, Real) or not np.isfinite(value)
                                  or not above < value < below):
            raise InputError("options", field, value, remedy)

    def _check_contradictions(self):
        """An accuracy chooses the knobs, so none may stand beside it; one method's knobs mean nothing to another."""
        method = METHODS[self.method if self.method != AUTO else BY_KNOBS]
        if self.accuracy is not None and not method.by_accuracy:
            raise InputError("options", "accuracy", self.accuracy,
                             f"leave it out: the method {self.method!r} goes by its knobs")
        reason = f"the method is {self.method!r}" if self.accuracy is None else "an accuracy chooses it"
        for field in self.knobs:
            if self.accuracy is not None or field not in method.knobs:
                raise InputError("options", field, getattr(self, field), f"leave it out: {reason}")

    @property
    def depth_accuracy(self) -> float:
        """That of what is out of focus, which knobs do not tell."""
        return self.accuracy or DEFAULT_ACCURACY

    @property
    def most_rays(self) -> int:
        """Rays through the lens at the most by which a pixel sees what is out of focus."""
        return self._rays[0]

    @property
    def most_of_lamps(self) -> int:
        """As `most_rays`, where something small and bright is among it."""
        return self._rays[1]

    @property
    def _rays(self):
        return next(rays for least, *rays in MOST_RAYS if self.depth_accuracy >= least)

    @property
    def knobs(self) -> dict[str, object]:
        """The knobs that are set."""
        return {field: getattr(self, field) for field in KNOBS if getattr(self, field) is not None}

    @property
    def by_result(self) -> bool:
        """Whether the plan chooses the knobs."""
        return self.accuracy is not None or (
            not self.knobs and (self.method == AUTO or METHODS[self.method].by_accuracy))
