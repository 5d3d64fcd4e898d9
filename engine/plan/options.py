"""Options: the user's settings of the engine, as a target accuracy or as knobs."""

from dataclasses import dataclass
from numbers import Integral, Real

import numpy as np

from ..blur import METHODS
from ..blur.method import AZIMUTHS, SECTION_SIZE
from ..runtime.errors import InputError
from ..runtime.setting import check_choices, setting

AUTO, OFF, ON = "auto", "off", "on"
DEFAULT_ACCURACY = 0.01
TIER_ACCURACY = {"preview": 0.1, "standard": DEFAULT_ACCURACY, "reference": 0.001}
RAYS = ((0.05, 64, 256, 1.0), (0.005, 64, 1024, 0.7), (0.0, 256, 4096, 0.5))
"""From each accuracy on: the most rays of a pixel, without and with lamps, and the smallest side of their cells in a
blur, in pixels."""
KNOBS = ("section_size", "azimuths", "psf_energy", "flat_tolerance", "precision")
MOST_SUPERSAMPLING = 16  # it reduces the error to a 256th
BY_KNOBS = "sections"  # if a knob is set and no method


@dataclass(frozen=True)
class Options:
    """Settings of the engine. The default is an accuracy of 0.01.

    Attributes
    ----------
    accuracy : float, optional
        The largest fraction of any point's light that may land in the wrong place: for any scene, the sum of |error|
        over the picture is at most this times its light. The plan then chooses all knobs except `method`, for the
        least predicted time. Not included are errors of the lens data, of resampling the picture by distortion, and of
        treating pixels as points of light in their centres (see `supersampling`).
    method : "auto", "sections", "pixels", "paper" or "exact"
        "sections" interpolates PSFs inside sections of the picture, between the heights of the lens data and some
        azimuths; "pixels" gives every pixel a separate PSF from the same table; "auto" chooses the cheapest. "paper" is
        the paper's method, one PSF for each section: by default as published, with sections of 16 px in a space of
        64 px, complete PSFs and double precision. "exact" turns a PSF for every pixel: the reference for the other
        methods, at about a hundred times their time. "paper" is for rotationally symmetric lenses.
    section_size : int, optional
        Side of a section in pixels, for "sections" (32) and "paper" (16). With "paper" smaller is more accurate and
        slower; with "sections" it affects only speed.
    azimuths : int, optional
        Steps from 0 to 45 degrees of the table that PSFs are mixed from, for "sections" and "pixels" with a
        rotationally symmetric lens (32). More is more accurate, and takes more time and memory. Tables of other lenses
        contain the PSFs of the lens data, without steps.
    psf_energy : float, optional
        Fraction of each PSF that is used (0.999999): the light in a circle around the chief ray, whose radius depends
        on the PSF. The rest is left out; the misplaced light is twice this loss.
    flat_tolerance : float, optional
        Relative error up to which sections surrounded by uniform light are not filtered (0: all are filtered).
    precision : "auto", "float32" or "float64", optional
        "auto" is single precision, except for sections whose dynamic range requires double.
    out_of_field : "hold" or "vignette"
        Pixels beyond the last tabulated field height: "hold" uses its PSF and relative illumination, with linear
        extrapolation of the distortion; "vignette" leaves them black. In both cases the report states their number.
    detail : "auto", "off" or "on"
        Whether in-focus light that is known inside pixels, by the detail of a radiance, is blurred and sharpened in
        finer pixels: "auto" does so if the picture's pixels need little work without it, and no knobs are set.
    supersampling : int
        Number of pixels that each pixel is divided into, across and down, for PSFs finer than a pixel (1): up to 16.
        The radiance of a pixel is then a uniform square instead of a point in its centre, and the result is averaged
        to the original pixels. Seconds and memory are as for a picture that much larger. Sections are counted in the
        finer pixels.
    fireflies : "refuse" or "clamp"
        NaN and infinite pixels: "refuse" raises an error that names the first; "clamp" replaces them with the
        brightest of their neighbours.

    Raises
    ------
    InputError
        If a value is invalid, or does not apply with the others.

    Examples
    --------
    >>> from lensfield import Options
    >>> Options(accuracy=0.001).accuracy  # at most 0.1 % of any point's light in the wrong place
    0.001
    >>> Options(accuracy=0.1, fireflies="clamp", out_of_field="vignette").fireflies
    'clamp'
    """

    accuracy: float | None = setting(
        None, name="Misplaced Light", kind=float, limits=(1e-6, 1.0), soft_limits=(0.001, 0.1), precision=4,
        subtype="FACTOR", panel="", panel_default=DEFAULT_ACCURACY, metavar="FRACTION",
        unset=f"{DEFAULT_ACCURACY:g}",
        text="Largest fraction of any point's light that may land in the wrong place: 0.01 keeps at least 99 % of it "
             "where the lens puts it. Smaller values are slower")
    method: str = setting(
        AUTO, name="Method", text="How the lens's blur is applied", panel="", panel_default=BY_KNOBS,
        choices={AUTO: ("Automatic", "The fastest that is accurate enough")} | {
            name: (name.title(), method.summary) for name, method in METHODS.items()})
    section_size: int | None = setting(
        None, name="Section Size", kind=int, limits=(1, np.inf), soft_limits=(1, 256), subtype="PIXEL", metavar="PX",
        panel="", panel_default=SECTION_SIZE,
        text="Side length of the sections. With the paper's method, smaller sections are more accurate and slower; "
             "otherwise the size affects only speed")
    azimuths: int | None = setting(
        None, name="Azimuths", kind=int, limits=(1, np.inf), soft_limits=(1, 256), metavar="N",
        panel="", panel_default=AZIMUTHS,
        text="Steps of the PSF table from 0 to 45 degrees. More steps are more accurate and take more time and memory")
    psf_energy: float | None = setting(
        None, name="PSF Energy", kind=float, metavar="FRACTION",
        text="Fraction of each PSF to use, in a circle around the chief ray")
    flat_tolerance: float | None = setting(
        None, name="Flat Tolerance", kind=float, metavar="FRACTION",
        text="Largest relative error from leaving sections in uniform light unfiltered")
    precision: str | None = setting(
        None, name="Precision", text="Floating-point precision of the filtering",
        choices={AUTO: ("Automatic", "Double where the dynamic range requires it"), "float32": ("Single", "Single"),
                 "float64": ("Double", "Double")})
    out_of_field: str = setting(
        "hold", name="Out of Field", text="Area of the frame that the lens's field does not cover", panel="view",
        choices={"hold": ("Continue the Edge", "The blur and the light of the edge of the field, so that the picture "
                                               "fills the frame"),
                 "vignette": ("Black, as the Real Lens", "The lens's image circle, with black around it")})
    fireflies: str = setting(
        "refuse", name="Fireflies", text="NaN and infinite pixels", panel="quality",
        choices={"refuse": ("Refuse", "Stop with an error that names the first"),
                 "clamp": ("Clamp", "Replace them with their brightest neighbour")})
    detail: str = setting(
        AUTO, name="Detail", panel="quality",
        text="Sharpness of in-focus light in Standard, with at least 32 samples",
        choices={AUTO: ("Automatic", "On, unless the lens spreads light so far that this would take long"),
                 OFF: ("Off", "Light is even inside each pixel of the capture"),
                 ON: ("On", "One pass is rendered in pixels of half the side, and light is blurred and sharpened in "
                            "these. Edges are as sharp as the lens and the pixels; the lens takes longer, and noise "
                            "increases slightly")})
    supersampling: int = setting(
        1, name="Supersampling", kind=int, limits=(1, MOST_SUPERSAMPLING), metavar="N", panel="",
        text="Divide each pixel into N x N for filtering, for lens blur finer than a pixel. Takes the time and memory "
             "of a picture with that many pixels")

    def __post_init__(self) -> None:
        for field in ("section_size", "azimuths"):
            if getattr(self, field) is not None:
                self._check_integer(field, np.inf, "1 or more")
        self._check_integer("supersampling", MOST_SUPERSAMPLING, f"from 1 to {MOST_SUPERSAMPLING}")
        self._check_number("accuracy", "expected a number above 0 and below 2, such as 0.01", 0, 2)
        self._check_number("psf_energy", "expected a number above 0 and up to 1, such as 0.999", 0, 1 + 1e-12)
        self._check_number("flat_tolerance", "expected a number from 0 to below 1", -1e-300, 1)
        check_choices(self)
        self._check_contradictions()

    def _check_integer(self, field, most, which):
        value = getattr(self, field)
        if isinstance(value, bool) or not isinstance(value, Integral) or not 1 <= value <= most:
            raise InputError("options", field, value, f"expected a whole number, {which}")

    def _check_number(self, field, remedy, above, below):
        value = getattr(self, field)
        if value is not None and (isinstance(value, bool) or not isinstance(value, Real) or not np.isfinite(value)
                                  or not above < value < below):
            raise InputError("options", field, value, remedy)

    def _check_contradictions(self):
        """Refuse knobs together with an accuracy, which chooses them, and knobs of other methods."""
        method = METHODS[self.method if self.method != AUTO else BY_KNOBS]
        if self.accuracy is not None and not method.by_accuracy:
            raise InputError("options", "accuracy", self.accuracy,
                             f"leave it out: the method {self.method!r} uses its own settings")
        reason = f"the method is {self.method!r}" if self.accuracy is None else "the accuracy determines it"
        for field in self.knobs:
            if self.accuracy is not None or field not in method.knobs:
                raise InputError("options", field, getattr(self, field), f"leave it out: {reason}")

    @property
    def depth_accuracy(self) -> float:
        """Accuracy of out-of-focus light, which knobs do not set."""
        return self.accuracy or DEFAULT_ACCURACY

    @property
    def most_rays(self) -> int:
        """Maximum number of rays through the lens for a pixel's out-of-focus light."""
        return self._rays[0]

    @property
    def most_of_lamps(self) -> int:
        """As `most_rays`, for light from something small and bright."""
        return self._rays[1]

    @property
    def finest_cell_px(self) -> float:
        """Smallest side of a ray's part of a blur, in pixels of the capture."""
        return self._rays[2]

    @property
    def _rays(self):
        return next(rays for least, *rays in RAYS if self.depth_accuracy >= least)

    @property
    def knobs(self) -> dict[str, object]:
        """The knobs that are set."""
        return {field: getattr(self, field) for field in KNOBS if getattr(self, field) is not None}

    @property
    def by_result(self) -> bool:
        """Whether the plan chooses the knobs."""
        return self.accuracy is not None or (
            not self.knobs and (self.method == AUTO or METHODS[self.method].by_accuracy))
