"""The settings of a render, each defined once, at its field.

A scene's panel fills in a request; the command line and Python replace its fields. Blender's properties, the options
of `lensfield render`, the arguments of a render in the background and the record of a finished frame follow from the
fields (`engine/runtime/setting.py`). To add a setting, add its field here and obey it in the render.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf
from pathlib import Path

from lensfield.engine import Lens, Options
from lensfield.engine.bake.quality import QUALITIES
from lensfield.engine.depth.depth_range import AUTO, OFF, TRACED
from lensfield.engine.field.overscan import CAMERA_VIEW, LENS_VIEW, VIEWS
from lensfield.engine.image.spectral_image import IRRADIANCE, RADIANCE
from lensfield.engine.lens.formats import FORMATS, format_mm
from lensfield.engine.lens.iris import Iris
from lensfield.engine.library import LensSource
from lensfield.engine.library.bodies import CameraSource, load_camera
from lensfield.engine.prescription.coatings import AS_LENS, IDEAL, MULTI, NONE, SINGLE
from lensfield.engine.prescription.tolerances import GRADES
from lensfield.engine.rays.rings import MOST_TILT_DEG
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.runtime.setting import check_choices, documented, option_of, setting, settings_of
from lensfield.engine.spectral.spectra import parse_wavelengths
from lensfield.engine.spectral.wavelength_choice import IMAGE_WAVELENGTHS, SpectralOptions
from lensfield.engine.stray.options import StrayOptions

CAMERA = "camera"
"""The camera's focus distance, and the owner of settings that each camera has."""
BY_SCENE, ON = "scene", "on"
ALL_FILES, PICTURES = "all", "pictures"
SPECTRAL_FILES = RADIANCE, IRRADIANCE
TRUTH = {"depth": ("Depth", "Depth along the optical axis, and distance along the ray"),
         "position": ("Position", "Position in the world"),
         "normal": ("Normal", "Normal in the world, as shaded"),
         "uv": ("UV", "UV coordinates"),
         "flow": ("Flow", "Motion since the frame before and until the next one"),
         "index": ("Index", "Pass indices of objects and materials"),
         "object": ("Object", "Object, for annotations (lensfield coco)"),
         "cryptomatte": ("Cryptomatte", "Mattes of objects, materials and assets, by their names"),
         "coverage": ("Coverage", "The share of each pixel's light that comes from each object, through the lens's "
                                  "blur"),
         "material-coverage": ("Material Coverage", "The same, by materials"),
         "collection-coverage": ("Collection Coverage", "The same, by collections")}
FLARE, BOKEH = "flare", "bokeh"
PAIRS = {FLARE: "the same light with and without stray light",
         BOKEH: "the same light at the highest f-number and at the others"}
"""Kinds of pairs of pictures in a dataset."""
RING_FIELDS = "focus", "f_number", "focused_wide_open", "tilt_deg", "copy", "copy_grade", "coating"
CAMERA_FIELDS = "camera", "iso", "shutter_s", "noise", "develop", "dng"
EXPOSED_FIELDS = "camera", "iso", "shutter_s", "develop"
"""Settings of the camera that a preview shows."""
FOLLOWER_FIELDS = "picture", "state", "source", "view_settings"
"""Fields that a program sets when it starts a render and monitors it."""


@documented
@dataclass(frozen=True, kw_only=True)
class RenderRequest:
    """The settings of a render through a lens, for one frame of a scene.

    Raises
    ------
    InputError
        If a value is not one of its setting's choices.
    """

    lens: Lens | LensSource = setting(
        "", name="Lens", owner=CAMERA, metavar="NAME|FILE", recorded=False,
        text="A bundled lens, a lens package, or a prescription")
    view: str = setting(
        LENS_VIEW, name="Field of View", owner=CAMERA, metavar="VIEW", panel="", recorded=False,
        text="Field of view of the lens image: of the lens, of the scene's camera, or of the lens on another sensor. "
             "Also accepts a sensor as WIDTHxHEIGHT in mm",
        choices={LENS_VIEW: ("Lens", "The lens's field of view on its own sensor; Match Camera to Lens shows it "
                                     "beforehand"),
                 CAMERA_VIEW: ("Camera", "The field of view of the scene's camera. The lens and its blur are scaled to "
                                         "it, as is the focus distance if the camera does not set it"),
                 **{name: (title, "On {:g} \u00d7 {:g} mm".format(*sensor_mm))
                    for name, (title, sensor_mm) in FORMATS.items()}})
    depth: str = setting(
        AUTO, name="Depth", text="How out-of-focus light is blurred", panel="",
        choices={AUTO: ("As Needed", "In layers of depth that are rendered separately, if the scene is deeper than "
                                     "the depth of field"),
                 OFF: ("Off", "Not at all: everything is as sharp as in focus"),
                 TRACED: ("Traced Lens", "Cycles traces rays through the lens itself: slow and without diffraction, "
                                         "but also correct for glass, mirrors and volumes. Needs a prescription")})
    focus: float | str | None = setting(
        None, name="Focus", owner=CAMERA, metavar="DISTANCE", recorded=False,
        text="Focus distance from the camera, which is at the entrance pupil: 1.2m, 80cm, 500mm or inf (in Python, a "
             "number in mm)",
        unset="the camera's focus distance if its Depth of Field is on, otherwise from the prescription, "
              "usually infinity; camera: always the camera's focus distance")
    f_number: float | None = setting(
        None, name="F-Number", owner=CAMERA, kind=float, metavar="N", recorded=False, text="F-number of the lens",
        unset="the camera's F-Stop if its Depth of Field is on, otherwise the widest")
    focused_wide_open: bool = setting(
        False, name="Focused Wide Open", owner=CAMERA, kind=bool, panel="", recorded=False,
        text="Focus at the widest aperture, then stop down, as with a rangefinder: a lens with focus shift is then "
             "slightly out of focus. Otherwise, focus at the f-stop in use")
    tilt_deg: tuple[float, float] = setting(
        (0.0, 0.0), name="Tilt", owner=CAMERA, kind=float, option="tilt", metavar="X,Y", panel="", subtype="EULER",
        recorded=False, limits=(-MOST_TILT_DEG, MOST_TILT_DEG),
        text="Tilt of the lens relative to the sensor, in degrees. X tilts it down: the lower part of the picture, "
             "such as the ground, is in focus nearer. Y tilts it to the right. The view stays",
        unset="from the camera")
    copy: int = setting(
        0, name="Copy", owner=CAMERA, kind=int, metavar="NUMBER", limits=(0, 2**31 - 1), panel="", recorded=False,
        unset="from the camera",
        text="Number of a copy of the lens, whose elements are slightly displaced: one corner is softer than another. "
             "The same number is the same copy everywhere. 0: the lens as designed")
    copy_grade: str = setting(
        "vintage", name="Grade", owner=CAMERA, panel="", recorded=False, unset="from the camera",
        text="Tolerances of copies",
        choices={name: (name.title(), f"Elements displaced by {grade.decentre_um:g} \u00b5m and turned by "
                                      f"{grade.tilt_arcmin:g}\u2032, all in front of the stop or behind it by "
                                      f"{grade.group_decentre_um:g} \u00b5m and {grade.group_tilt_arcmin:g}\u2032; "
                                      "standard deviations")
                 for name, grade in GRADES.items()})
    coating: str = setting(
        AS_LENS, name="Coating", owner=CAMERA, panel="", recorded=False, unset="from the camera",
        text="Coating of the surfaces between glass and air, which determines the light that they reflect and the lens "
             "loses",
        choices={AS_LENS: ("As the Lens", "The coatings that the lens states"),
                 NONE: ("None", "Bare glass, as in lenses until about 1940"),
                 SINGLE: ("Single", "A quarter wave of magnesium fluoride, as until about 1970"),
                 MULTI: ("Multi", "Three layers"),
                 IDEAL: ("Ideal", "No reflections: only the glass absorbs light")})
    lens_quality: str | None = setting(
        None, name="Lens Quality", recorded=False, text="Quality at which a prescription is baked",
        unset="from the tier", choices={quality: (quality.title(), "") for quality in QUALITIES})
    iris: Iris | None = setting(
        None, name="Iris", owner=CAMERA, option=None,
        text="Blades that shape out-of-focus light when the lens is stopped down; by default the blades of the "
             "camera's Aperture if its Depth of Field is on")
    wavelengths_nm: tuple[float, ...] = setting(
        tuple(parse_wavelengths(IMAGE_WAVELENGTHS).tolist()), name="Wavelengths", option="wavelengths", metavar="SPEC",
        text="Ascending wavelengths of the lens image in nm: first:last:number, or a list such as 450,550,650 (in "
             "Python, a sequence)")
    spectral: SpectralOptions = setting(
        SpectralOptions(), name="Spectra", option=None,
        text="Accuracy of the spectra, which determines how many wavelengths Cycles renders")
    options: Options = setting(Options(), name="Options", option=None, text="Accuracy of the lens image")
    stray: StrayOptions = setting(
        StrayOptions(), name="Stray Light", option=None, text="Ghosts, veiling glare and stars that are added to it")
    unfit: str = setting(
        "refuse", name="Unfit Nodes", panel="wavelengths",
        text="Nodes that Cycles renders in red, green and blue only; Check Scene and lensfield lint list them",
        choices={"refuse": ("Refuse", "Stop with an error that names the first"),
                 "render": ("Render Anyway", "Upsample the colours that Cycles renders for them, like other colours. "
                                             "Above Preview, each wavelength then takes a render")})
    denoise: str = setting(
        BY_SCENE, name="Denoise", panel="quality",
        text="Let Cycles denoise its passes. This shifts means by up to 1 %, by more for dim wavelengths",
        choices={BY_SCENE: ("As the Scene", "Follow the Denoise setting of Cycles, but never denoise in Reference"),
                 ON: ("On", "Denoise, regardless of the scene"),
                 OFF: ("Off", "Do not denoise, regardless of the scene")})
    device: str = setting(
        "auto", name="Device", recorded=False, unset="auto", text="Device that Cycles renders on, for this render only",
        choices={"auto": ("As the Scene", "as the scene, on the GPU that the preferences choose; where Blender is a "
                                          "Python module, which has none, on all GPUs of the first kind found"),
                 "cpu": ("CPU", ""), "optix": ("OptiX", ""), "cuda": ("CUDA", ""), "hip": ("HIP", ""),
                 "metal": ("Metal", ""), "oneapi": ("oneAPI", "")})
    camera: CameraSource = setting(
        "", name="Camera", owner=CAMERA, metavar="NAME|FILE", recorded=False,
        text="Camera that takes a picture of the lens image: a bundled camera (lensfield camera list), or a camera's "
             "file (.toml); or none. Its sensor replaces the lens's sensor unless --view names another", unset="none")
    iso: float = setting(
        0.0, name="ISO", owner=CAMERA, kind=float, metavar="ISO", limits=(0, inf), precision=0, panel="",
        unset="auto",
        text="ISO of the camera. 0, or auto: the camera's base ISO, or the metered one if only the shutter is given")
    shutter_s: float = setting(
        0.0, name="Shutter (s)", owner=CAMERA, kind=float, option="shutter", metavar="SECONDS", limits=(0, inf),
        precision=4, panel="", unset="auto",
        text="Exposure time of the camera in seconds, such as 1/60. 0, or auto: metered, for each picture or for each "
             "shot of an animation")
    noise: bool = setting(
        True, name="Noise", kind=bool, panel="camera",
        text="Photon noise, read noise, dark current, and the differences between pixels")
    develop: bool = setting(
        True, name="Develop", kind=bool, panel="camera",
        text="The lens image for the compositor and the PNG are the camera's developed picture. Otherwise they show "
             "the light itself. The spectral files are the same")
    dng: bool = setting(
        False, name="Raw File (DNG)", kind=bool, panel="camera", text="Also write the camera's raw picture")
    view_layer: str = setting(
        "", name="View Layer", text="View layer to render. Empty: the one enabled for rendering",
        metavar="NAME", panel="")
    room: float = setting(
        0.0, name="Room", kind=float, metavar="FRACTION",
        text="Minimum margin to capture beyond each edge, as a fraction of the picture's longer side, so that "
             "lensfield apply can use lenses with more distortion")
    output_folder: Path | None = setting(
        None, name="Output", kind=Path, option="output", metavar="DIR", subtype="DIR_PATH", panel="",
        panel_default="//lensfield/", recorded=False, text="Folder for the spectral EXRs and the pictures")
    files: str = setting(
        ALL_FILES, name="Spectral Files", metavar="LIST", panel="", recorded=False,
        text="Spectral files to write with the pictures, which are always written. Also accepts a list: "
             "radiance,irradiance,pictures",
        choices={ALL_FILES: ("All", "Radiance and irradiance"),
                 RADIANCE: ("Radiance", "The light of the scene: other lenses can be applied to the render"),
                 IRRADIANCE: ("Irradiance", "The light on the sensor: cameras can be put behind the render"),
                 PICTURES: ("None", "Pictures only: another lens or camera takes a new render")})
    truth: str = setting(
        "", name="Ground Truth", metavar="LIST", panel="", several=True, unset="from the scene",
        text="What the chief ray of each pixel meets, without blur, and what its light is made of, in a file of layers "
             "(docs/truth.md). A list such as depth,normal,flow", choices=TRUTH)
    look: str = setting(
        BY_SCENE, name="Look", recorded=False,
        text="Look of PNGs: the finished picture, the one without the lens, and contact sheets. EXRs are linear",
        choices={"scene": ("Scene", "The scene's view transform, look, exposure, gamma and display, as in its window"),
                 "standard": ("Standard", "sRGB, at an exposure that suits the picture")})
    to_compositor: bool = setting(
        False, name="To Compositor", kind=bool, option=None, panel="", panel_default=True, recorded=False,
        text="Add the lens image to the scene's compositor when it is finished")
    picture: Path | None = setting(
        None, name="Picture", kind=Path, metavar="FILE.png", recorded=False,
        text="After each pass, write the light so far to this file, as seen through a perfect pinhole")
    state: str = setting(
        "", name="Scene State", option="scene-state", metavar="TEXT", recorded=False, unset="its fingerprint",
        text="State of the scene to store in the records of frames")
    source: str = setting(
        "", name="Scene Source", option="scene-source", metavar="TEXT", recorded=False,
        text="Digest of the files that the scene was opened from and still matches (source_digest): finished passes "
             "are then stored next to the output until the frame is finished, so that an interrupted render can "
             "resume. Empty: none are stored")

    view_settings: str = setting(
        "", name="View Settings", metavar="TEXT", recorded=False, unset="from the scene or the radiance file",
        text="Colour management for the look of the scene, as JSON text")

    def __post_init__(self) -> None:
        check_choices(self)
        if self.view not in VIEWS:
            format_mm(self.view, "view", VIEWS)
        if self.files != ALL_FILES and set(self.files.split(",")) - {*SPECTRAL_FILES, PICTURES}:
            raise InputError("options", "files", self.files or "empty",
                             f"expected {ALL_FILES}, or some of {', '.join((*SPECTRAL_FILES, PICTURES))}, separated by "
                             "commas")

    @property
    def view_on_sensor(self) -> str:
        """The field of view, with the camera's sensor instead of the lens's sensor."""
        return view_on_sensor(self.view, self.camera)

    def writes(self, spectral_file: str) -> bool:
        """Whether one of the SPECTRAL_FILES is to be written."""
        return self.files == ALL_FILES or spectral_file in self.files.split(",")

    @property
    def exposure(self) -> tuple[float | None, float | None]:
        """The shutter in seconds and the ISO; None for those that the camera's meter chooses."""
        return self.shutter_s or None, self.iso or None

    @property
    def traced(self) -> bool:
        """Whether Cycles renders the film behind the lens instead of a pinhole's view."""
        return self.depth == TRACED


def view_on_sensor(view: str, camera: CameraSource) -> str:
    """A field of view; with a camera, on its sensor instead of the lens's sensor."""
    return "{:.6g}x{:.6g}".format(*load_camera(camera).size_mm) if camera and view == LENS_VIEW else view


def to_arguments(**given: object) -> list[str]:
    """Arguments of `lensfield` that set fields of a RenderRequest.

    Parameters
    ----------
    given : by name
        Values of fields; fields with None are omitted. `iris` may be None for a round stop.

    Returns
    -------
    list of str
    """
    return [word for name, value in given.items() for word in _arguments(name, value)]


def _arguments(name: str, value: object) -> Iterator[str]:
    if name == "iris":
        value = value or Iris()
    if isinstance(value, Options | SpectralOptions | StrayOptions | Iris):
        yield from (word for field in settings_of(value) for word in _option(value, field, getattr(value, field)))
    else:
        yield from _option(RenderRequest, name, value)


def _option(owner: object, name: str, value: object) -> Iterator[str]:
    if value is not None:
        option = option_of(name, settings_of(owner)[name])
        yield argument(option, value if isinstance(value, bool) else _text(name, value))


def argument(option: str, value: object) -> str:
    """The argument of `lensfield` that sets an option, given without its dashes."""
    if isinstance(value, bool):
        return f"--{option}" if value else f"--no-{option}"
    return f"--{option}={value}"


def _text(name: str, value: object) -> str:
    if name == "focus" and isinstance(value, int | float):
        return "inf" if value == inf else f"{float(value)!r}mm"
    if isinstance(value, float):
        return repr(value)
    return ",".join(f"{each!r}" for each in value) if isinstance(value, tuple) else str(value)
