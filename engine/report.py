"""Report: what a run did, how long each stage took, and what became of the light."""

import json
import re
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from .files import MARK, atomic_path
from .image.depth_range import DepthCheck
from .plan.plan import Plan
from .values import plain

NEGATIVE_TOLD = 1e-3  # of the light
MOST_BRIGHT = 1e35  # W m^-2 sr^-1 nm^-1, of which colours are within 1e3 of the largest float32
FIGURE = re.compile(r"\d[\d.]*")


@dataclass(frozen=True)
class DistortionFit:
    """The polynomial of a distortion, and by how much it misses the table at the most."""

    order: int
    residual_mm: float
    highest_order_tried: int


@dataclass(frozen=True)
class IlluminationFit:
    """The polynomial of a relative illumination, and by how much it misses the table at the most."""

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
    """Spectral flux at the sensor, summed over the wavelengths: before and after the blur, and inside the frame."""

    in_w_per_nm: float
    out_w_per_nm: float
    in_frame_w_per_nm: float


@dataclass(frozen=True)
class LensImageFacts:
    """What `simulate` did.

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
        Of the frame, that lies farther from the axis than the lens data.
    fireflies_clamped : int
    loops : str
        What did them: "numpy", or compiled ones for so new a processor.
    negative_light_fraction : float
        Of the radiance in focus: there is no such light.
    brightest : float
        Radiance, W m^-2 sr^-1 nm^-1.
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
    negative_light_fraction: float = 0.0
    brightest: float = 0.0


@dataclass(frozen=True)
class SceneFacts:
    """How a Blender scene was rendered.

    Attributes
    ----------
    passes, wavelengths_per_pass : int
    rendered_nm, wavelengths_nm : list of float
        The wavelengths that Cycles rendered, and those that were made of them.
    scene_plan : str
        The passes, and why these, in one line.
    lamps : list of str
    predicted_colour_error, predicted_sensor_error, predicted_spectral_error : float
        Of making all wavelengths of those rendered: CIEDE2000; relative, of sensor bands and of single wavelengths.
    spectral_surprise : float
        How much more the passes differ from one another than the plan foresaw.
    foreign_spectra : bool
        Whether that is so much that the scene must hold spectra that the plan did not know of.
    estimated_colour_error : float
        The predicted one, after what the passes told.
    depth : DepthCheck
    lens_warning : str
        What it means that the lens was made larger or smaller; "" where it was not.
    scene_remarks : tuple of str
        What of the scene's settings took no part, or another, a line each.
    layers : str
        How depth enters; "" where it does not.
    capture_peak_mb : float
        Predicted: the most memory that the process will hold while the scene is rendered; what slabs of depth take
        beside each other comes on top.
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
    capture_peak_mb: float = 0.0


@dataclass(frozen=True)
class Upsampling:
    """What a picture in RGB was taken for.

    Attributes
    ----------
    layer : str
    fov_deg : (float, float)
        Field of view across and down.
    wavelengths_nm : list of float
        That it was upsampled to.
    negative_fraction : float
        Of its light, of colours that no light has, and so left out.
    """

    layer: str
    fov_deg: tuple[float, float]
    wavelengths_nm: list[float]
    negative_fraction: float


@dataclass(frozen=True)
class FileFacts:
    """What `lensfield filter` or `lensfield apply` read.

    Attributes
    ----------
    radiance : str
        The file.
    overscan_needed_px : (int, int)
        Rows and columns that the lens brings in from beyond the frame.
    picture : Upsampling or None
        None for spectral radiance.
    lens_warning : str
        What the picture's field of view means for the lens; "" where it is the lens's own.
    depth : DepthCheck or None
        None where the file does not tell its depth, or it does not enter.
    layers : str
        How depth enters; "" where it does not.
    """

    radiance: str
    overscan_needed_px: tuple[int, int]
    picture: Upsampling | None
    lens_warning: str = ""
    depth: DepthCheck | None = None
    layers: str = ""


def together(reports: dict[int, "Report"], earlier: dict[int, dict] | None = None) -> "Report":
    """One report of a sequence: the seconds of its frames, and a report of each; and those of an earlier run."""
    stages: Counter[str] = Counter()
    for report in reports.values():
        stages.update(report.stages)
    return Report(dict(stages), frames=dict(reports), earlier=earlier or {})


@dataclass
class Report:
    """What a run did, gathered as it goes.

    Attributes
    ----------
    stages : dict of str: float
        Seconds spent in each stage, without the stages inside it.
    lens_image, scene, file
        Facts about the lens image, and about the scene or the file that it was made of.
    files : dict of str: str
        Where what it made is, by what it is.
    frames : dict of int: Report
        Of a sequence, by the number of the frame; it has no other facts.
    earlier : dict of int: dict
        Of a sequence, the reports of frames that an earlier run has made, as JSON holds them.
    """

    stages: dict[str, float] = field(default_factory=dict)
    lens_image: LensImageFacts | None = None
    scene: SceneFacts | None = None
    file: FileFacts | None = None
    files: dict[str, str] = field(default_factory=dict)
    frames: dict[int, "Report"] = field(default_factory=dict)
    earlier: dict[int, dict] = field(default_factory=dict)
    _started: list[float] = field(default_factory=list, repr=False)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time a stage. Stages may be inside one another and may come again."""
        self._started.append(0.0)
        begin = time.perf_counter()
        try:
            yield
        finally:
            elapsed = time.perf_counter() - begin
            inside = self._started.pop()
            if self._started:
                self._started[-1] += elapsed
            self.stages[name] = self.stages.get(name, 0.0) + elapsed - inside

    def remarks(self) -> list[str]:
        """What whoever made the picture should know, a line each; of many frames that differ by their figures one."""
        alike: dict[str, list[tuple[int, str]]] = {}
        for number, report in self.frames.items():
            for line in report._own_remarks():
                alike.setdefault(FIGURE.sub("", line), []).append((number, line))
        return [*self._own_remarks(), *(self._remark_of_frames(lines) for lines in alike.values())]

    def _remark_of_frames(self, lines):
        (number, first), *others = lines
        if len(lines) == len(self.frames) and all(line == first for _, line in others):
            return first
        return f"frame {number}: {first}{f' ({len(others)} more much alike)' if others else ''}"

    def _own_remarks(self):
        if self.scene and self.scene.foreign_spectra:
            yield "the scene holds spectra that its plan did not foresee: take the Reference tier"
        made_of = self.scene or self.file
        if made_of and made_of.lens_warning:
            yield made_of.lens_warning
        yield from self.scene.scene_remarks if self.scene else ()
        if made_of and made_of.layers:
            yield made_of.layers
        elif made_of and made_of.depth and made_of.depth.outside_fraction:
            yield made_of.depth.text
        image, file = self.lens_image, self.file
        if image and image.out_of_field_fraction:
            yield (f"{image.out_of_field_fraction:.1%} of the frame lies beyond the lens data: "
                   f"{image.plan.out_of_field}")
        if image and image.negative_light_fraction > NEGATIVE_TOLD:
            yield (f"{image.negative_light_fraction:.1%} of the radiance is negative, as no light is: filtered as it "
                   "comes")
        if image and image.brightest > MOST_BRIGHT:
            yield (f"radiance of up to {image.brightest:.2g} W m^-2 sr^-1 nm^-1 comes near to what files of single "
                   "precision hold: its colours may be infinite; give it in other units")
        if image and file and any(needed > there for needed, there in
                                  zip(file.overscan_needed_px, image.overscan_px, strict=True)):
            yield ("the border lacks light from beyond the frame: of overscan on each side the lens needs {1} x {0} "
                   "px, the picture has {3} x {2}".format(*file.overscan_needed_px, *image.overscan_px))
        if file and file.picture and file.picture.negative_fraction > NEGATIVE_TOLD:
            yield (f"{file.picture.negative_fraction:.1%} of the light would be negative, in colours too pure for "
                   "these wavelengths: left out")

    def as_dict(self) -> dict:
        """The report as JSON can hold it."""
        facts: dict[str, Any] = {"stages_s": dict(self.stages), "total_s": sum(self.stages.values())}
        for part in (self.lens_image, self.scene, self.file):
            facts |= asdict(part) if part else {}
        if self.lens_image:
            facts["plan"] = self.lens_image.plan.as_dict()
        if depth := getattr(self.scene or self.file, "depth", None):
            facts["depth"]["text"] = depth.text
        if self.files:
            facts["files"] = dict(self.files)
        frames = {number: {"frame": number} | report.as_dict() for number, report in self.frames.items()}
        frames |= {number: {"frame": number, "earlier": True} | report for number, report in self.earlier.items()}
        if frames:
            each = [frames[number] for number in sorted(frames)]
            facts |= {name: each[0][name] for name in ("lens", "plan") if name in each[0]}
            beyond = [frame["out_of_field_fraction"] for frame in each if "out_of_field_fraction" in frame]
            facts |= {"out_of_field_fraction": max(beyond)} if beyond else {}
            facts["frames"] = each
        return plain(facts)

    def write(self, path: Path) -> None:
        """Write the report as JSON, whole or not at all."""
        with atomic_path(path) as temporary:
            temporary.write_text(json.dumps({"software": MARK} | self.as_dict(), indent=2) + "\n", encoding="utf-8")
