"""Parts of a report: the facts of one subject each, with the remarks that follow from them."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

from ..depth.depth_range import DepthCheck
from ..plan.plan import Plan

NEGATIVE_LIMIT = 1e-3  # of the light
OUT_OF_FIELD_WORDS = {"hold": "its edge continues", "vignette": "black"}  # by the treatment
MOST_BRIGHT = 1e35  # W m^-2 sr^-1 nm^-1; colours of such light are within 1e3 of the largest float32


class Part:
    """A part of a report: a dataclass of facts that words its remarks for the user."""

    def remarks(self, parts: "Parts") -> Iterator[str]:
        """Remarks for the user, one line each, given all parts of the report."""
        yield from ()

    def as_dict(self) -> dict[str, Any]:
        """The facts by name, as the report's JSON contains them."""
        return asdict(self)  # type: ignore[call-overload]  # parts are dataclasses


P = TypeVar("P", bound=Part)


class Parts(list[Part]):
    """The parts of one report, one of each type."""

    def of(self, kind: type[P]) -> P | None:
        """The part of a type, if there is one."""
        return next((part for part in self if isinstance(part, kind)), None)

    def put(self, part: Part) -> None:
        """Add a part; it replaces an existing part of its type."""
        kinds = [type(each) for each in self]
        if type(part) in kinds:
            self[kinds.index(type(part))] = part
        else:
            self.append(part)


@dataclass(frozen=True)
class DistortionFit:
    """The polynomial of a distortion, and its largest deviation from the table; or, for tables over x and y, the spline
    through them, and an estimate of its largest error between nodes."""

    order: int
    residual_mm: float
    highest_order_tried: int


@dataclass(frozen=True)
class IlluminationFit:
    """As `DistortionFit`, for the relative illumination."""

    order: int
    residual: float
    highest_order_tried: int


@dataclass(frozen=True)
class WavelengthFacts:
    """The fits of one wavelength."""

    wavelength_nm: float
    distortion_fit: DistortionFit
    relative_illumination_fit: IlluminationFit


@dataclass(frozen=True)
class Energy:
    """Spectral flux at the sensor, summed over the wavelengths: before and after the blur, and in the frame."""

    in_w_per_nm: float
    out_w_per_nm: float
    in_frame_w_per_nm: float


@dataclass(frozen=True)
class LensImageFacts(Part):
    """Facts about a lens image from `simulate`.

    Attributes
    ----------
    lens : str
    plan : Plan
    pitch_um : float
    frame_px, overscan_px : (int, int)
        Rows and columns.
    wavelengths : tuple of WavelengthFacts
    energy : Energy
    out_of_field_fraction : float
        Fraction of the frame that is farther from the axis than the lens data.
    fireflies_clamped : int
        Number of clamped pixels.
    loops : str
        Implementation of the loops: "numpy", or the instruction set of the compiled ones.
    casting : str
        What cast the out-of-focus light: a graphics processor, "C" or "numpy"; "" without such light.
    spreading : str
        What filtered the in-focus light; a graphics processor if it did so at any wavelength.
    gpu_problems : tuple of str
        Why a graphics processor did not do either, one line each.
    negative_light_fraction : float
        Negative fraction of the in-focus radiance, which is invalid.
    brightest : float
        Largest radiance, W m^-2 sr^-1 nm^-1.
    softening_px : float
        Softening of in-focus light by the pixels, beyond the lens and the pixel's own aperture: see
        `supersampling.softening_px`.
    """

    lens: str
    plan: Plan
    pitch_um: float
    frame_px: tuple[int, int]
    overscan_px: tuple[int, int]
    wavelengths: tuple[WavelengthFacts, ...]
    energy: Energy
    out_of_field_fraction: float
    fireflies_clamped: int
    loops: str
    casting: str = ""
    spreading: str = ""
    gpu_problems: tuple[str, ...] = ()
    negative_light_fraction: float = 0.0
    brightest: float = 0.0
    softening_px: float = 0.0

    def remarks(self, parts: Parts) -> Iterator[str]:
        if self.out_of_field_fraction:
            yield (f"{self.out_of_field_fraction:.1%} of the frame is outside the lens data: "
                   f"{OUT_OF_FIELD_WORDS[self.plan.out_of_field]}")
        if not self.energy.in_frame_w_per_nm and not parts.of(SceneFacts):  # their remarks state the reason
            yield ("the lens image is black: " + ("no light reaches the frame" if self.energy.in_w_per_nm else
                                                  "the radiance is zero everywhere"))
        yield from self.gpu_problems
        if self.negative_light_fraction > NEGATIVE_LIMIT:
            yield (f"{self.negative_light_fraction:.1%} of the radiance is negative, which is not physical: filtered "
                   "unchanged")
        if self.brightest > MOST_BRIGHT:
            yield (f"radiance of up to {self.brightest:.2g} W m^-2 sr^-1 nm^-1 is close to the limit of "
                   "single-precision files: colours may be infinite; use other units")

    def as_dict(self) -> dict[str, Any]:
        return super().as_dict() | {"plan": self.plan.as_dict()}


@dataclass(frozen=True)
class SceneFacts(Part):
    """How a Blender scene was rendered.

    Attributes
    ----------
    passes, wavelengths_per_pass : int
    rendered_nm, wavelengths_nm : list of float
        The wavelengths that Cycles rendered, and the wavelengths computed from these.
    scene_plan : str
        The passes and the reason for them, in one line.
    lamps : list of str
    predicted_colour_error, predicted_sensor_error, predicted_spectral_error : float
        Predicted errors of computing all wavelengths from those rendered: CIEDE2000; relative errors of sensor bands
        and of single wavelengths.
    spectral_surprise : float
        How much more the passes differ from one another than the plan predicted.
    foreign_spectra : bool
        Whether they differ so much that the scene must contain spectra unknown to the plan.
    estimated_colour_error : float
        The predicted colour error, corrected by the rendered passes.
    depth : DepthCheck
    lens_warning : str
        The effect of scaling the lens; "" for a lens that is not scaled.
    scene_remarks : tuple of str
        Settings of the scene that were ignored or replaced, one line each.
    layers : str
        How depth is rendered; "" without depth.
    rgb_difference : float
        Predicted: largest CIEDE2000 between glass or volumes here and in an RGB render, which takes powers of red,
        green and blue instead of spectra. Not an error: `predicted_colour_error` is the error of few wavelengths.
    samples : str
        The samples of passes that take few of them, and the noise; "" if each takes all.
    capture_peak_mb : float
        Predicted peak memory of the process while the scene is rendered. It excludes the additional memory for several
        slabs of depth.
    device : str
        That rendered the passes.
    """

    passes: int
    wavelengths_per_pass: int
    rendered_nm: list[float]
    wavelengths_nm: list[float]
    scene_plan: str
    lamps: list[str]
    predicted_colour_error: float
    predicted_sensor_error: float
    predicted_spectral_error: float
    spectral_surprise: float
    foreign_spectra: bool
    estimated_colour_error: float
    depth: DepthCheck
    lens_warning: str
    scene_remarks: tuple[str, ...] = ()
    layers: str = ""
    rgb_difference: float = 0.0
    samples: str = ""
    capture_peak_mb: float = 0.0
    device: str = ""

    def remarks(self, parts: Parts) -> Iterator[str]:
        if self.foreign_spectra:
            yield "the scene contains spectra that the plan did not predict: use the Reference tier"
        if self.lens_warning:
            yield self.lens_warning
        yield from self.scene_remarks
        yield from _depth_remarks(self.depth, self.layers)

    def as_dict(self) -> dict[str, Any]:
        return super().as_dict() | {"depth": _depth_facts(self.depth)}


@dataclass(frozen=True)
class Upsampling:
    """How an RGB picture was upsampled to radiance.

    Attributes
    ----------
    layer : str
    fov_deg : (float, float)
        Field of view across and down.
    wavelengths_nm : list of float
        Wavelengths of the radiance.
    negative_fraction : float
        Fraction of the light that would be negative, in colours too pure for these wavelengths, and is left out.
    """

    layer: str
    fov_deg: tuple[float, float]
    wavelengths_nm: list[float]
    negative_fraction: float


@dataclass(frozen=True)
class FileFacts(Part):
    """Facts about the file that `lensfield filter` or `lensfield apply` read.

    Attributes
    ----------
    radiance : str
        Path of the file.
    overscan_needed_px : (int, int)
        Rows and columns beyond the frame whose light the lens brings into it.
    picture : Upsampling or None
        None for spectral radiance.
    lens_warning : str
        The effect of a field of view that differs from the lens; "" if they are the same.
    depth : DepthCheck or None
        None if the file does not contain depth, or depth is not used.
    layers : str
        How depth is rendered; "" without depth.
    """

    radiance: str
    overscan_needed_px: tuple[int, int]
    picture: Upsampling | None
    lens_warning: str = ""
    depth: DepthCheck | None = None
    layers: str = ""

    def remarks(self, parts: Parts) -> Iterator[str]:
        if self.lens_warning:
            yield self.lens_warning
        yield from _depth_remarks(self.depth, self.layers)
        image = parts.of(LensImageFacts)
        if image and any(needed > available for needed, available in
                         zip(self.overscan_needed_px, image.overscan_px, strict=True)):
            yield ("the border lacks light from outside the frame: the lens needs {1} x {0} px of overscan on each "
                   "side, the picture has {3} x {2}".format(*self.overscan_needed_px, *image.overscan_px))
        if self.picture and self.picture.negative_fraction > NEGATIVE_LIMIT:
            yield (f"{self.picture.negative_fraction:.1%} of the light would be negative, because colours are too "
                   "pure for these wavelengths: set to 0")

    def as_dict(self) -> dict[str, Any]:
        return super().as_dict() | {"depth": _depth_facts(self.depth)}


def _depth_remarks(depth: DepthCheck | None, layers: str) -> Iterator[str]:
    """A remark on how depth is rendered, or on pixels outside the lens data's depth."""
    if layers:
        yield layers
    elif depth and depth.outside_fraction:
        yield depth.text


def _depth_facts(depth: DepthCheck | None) -> dict[str, Any] | None:
    return asdict(depth) | {"text": depth.text} if depth else None
