"""`lensfield lens calibration`: a lens's camera model, in the files of other programs."""

from pathlib import Path

from lensfield.engine import InputError
from lensfield.engine.calibration.fit import TARGET_PX
from lensfield.engine.calibration.formats import FORMATS, OPTION, calibrated_for, check_model
from lensfield.engine.calibration.models import MODELS
from lensfield.engine.calibration.views import View, overscan_lines, summary
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.inspection.curves import reference_nm
from lensfield.engine.lens.pinhole import fitting_pitch_um
from lensfield.engine.runtime.files import atomic_path

from .arguments import LENSES, add_lens_settings, check_outputs, chosen_lens, given_fields, resolution
from .blend import open_scene
from .prescription_file import lens_source
from .render_options import requested_frames
from .terminal import progress_bar, say

WHOLE = 0.9995  # of the frame


def add(commands):
    calibration = commands.add_parser("calibration", help="write the lens's camera model for OpenCV, COLMAP and others")
    calibration.description = (
        "Fit a camera model to the rays of a lens, at its focus and f-stop, and write it for another program: the "
        f"simplest model that is nowhere more than {TARGET_PX:g} px off.")
    calibration.add_argument("lens", metavar="NAME|FILE", nargs="?", help=f"{LENSES} (default: the camera's, with "
                                                                           "--scene)")
    calibration.add_argument(OPTION, dest="format", required=True, choices=FORMATS, metavar="PROGRAM", help="; ".join(
        f"{name}: {each.title} ({each.suffix})" for name, each in FORMATS.items()))
    calibration.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="file to write")
    calibration.add_argument("--model", choices=MODELS, metavar="NAME",
                             help=f"{', '.join(MODELS)} (default: the simplest that fits)")
    calibration.add_argument("--wavelength", metavar="NM[,NM...]",
                             help="wavelength in nm (default: the lens's reference wavelength). Several, such as "
                                  "610,540,465 for red, green and blue, write one file each, named after it")
    view = calibration.add_mutually_exclusive_group(required=True)
    view.add_argument("--resolution", metavar="WIDTHxHEIGHT", help="size in pixels of the picture on the sensor")
    view.add_argument("--scene", type=Path, metavar="SCENE.blend",
                      help="take the camera of this file's scene: its lens, focus, resolution, Shift and place")
    calibration.add_argument("--frames", metavar="SPEC",
                             help="with --scene: the frames whose cameras are written, as for lensfield render "
                                  "(default: the current frame)")
    add_lens_settings(calibration)
    calibration.set_defaults(run=_calibration)


def _calibration(options):
    _check(options)
    targets = _targets(options)
    check_outputs([(path, FORMATS[options.format].suffix) for path in targets],
                  [path for path in (options.lens, options.scene) if path])
    cameras = _scene_cameras(options) if options.scene else [_lens_camera(options)]
    for path, wavelength_nm in targets.items():
        _write(options, path, [_view(options, *camera, wavelength_nm) for camera in cameras])


def _check(options):
    check_model(options.format, options.model)
    if not options.lens and not options.scene:
        raise InputError("options", "NAME|FILE", "not given", "required without --scene")
    if options.frames is not None and not options.scene:
        raise InputError("options", "--frames", options.frames, "also give --scene")
    if options.frames is not None and not FORMATS[options.format].poses:
        several = ", ".join(name for name, each in FORMATS.items() if each.poses)
        raise InputError("options", "--frames", options.frames,
                         f"a file for {options.format} has one camera: leave it out, or use --for {several}")


def _lens_camera(options):
    """The lens of the command line, its frame, no pose and no picture."""
    width, height = resolution(options.resolution)

    def frame_of(lens):
        return PixelGrid((height, width), fitting_pitch_um(lens, (height, width)))

    lens = chosen_lens(options, frame_of)
    return lens, frame_of(lens), None, ""


def _scene_cameras(options):
    """The lens, the frame, the pose and the picture's name of each of the scene's frames."""
    given = given_fields(options)
    if options.lens:
        given["lens"] = lens_source(options, options.lens)
    frames = None if options.frames is None else requested_frames(options.frames)
    scene = open_scene(options.scene)
    from ..addon import frame_camera, frames_of

    if options.frames is None:
        frames = [scene.frame_current]
    elif frames is None:
        frames = frames_of(scene)
    with progress_bar() as on_progress:
        cameras = [frame_camera(scene, frame, on_progress, **given) for frame in frames]
    return [(camera.lens, camera.grid, camera.pose, camera.picture) for camera in cameras]


def _view(options, lens, frame, pose, picture, wavelength_nm):
    nm = reference_nm(lens) if wavelength_nm is None else wavelength_nm
    return View(calibrated_for(options.format, lens, frame, nm, options.model), pose, picture)


def _write(options, path, views):
    """Write views for the requested program, and print how closely they agree with the lens."""
    text = FORMATS[options.format].text(views)
    with atomic_path(path, overwrite=True) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
    for calibration in dict.fromkeys(view.calibration for view in views):
        say(summary(calibration), *_remarks(options, calibration), *overscan_lines(calibration))
    say(path)


def _remarks(options, calibration):
    if calibration.largest_px > TARGET_PX:
        models = "the requested model is not" if options.model else f"no model of {options.format} is"
        yield f"{models} within {TARGET_PX:g} px of this lens; lensfield lens stmap writes its exact distortion"
    if calibration.covered < WHOLE:
        yield f"the lens data cover {calibration.covered:.1%} of the frame; the model continues beyond them"


def _targets(options):
    """{file: its wavelength in nm, or None for the reference wavelength}."""
    if options.wavelength is None:
        return {options.output: None}
    try:
        wavelengths_nm = [float(word) for word in options.wavelength.split(",")]
    except ValueError:
        raise InputError("options", "--wavelength", options.wavelength,
                         "expected wavelengths in nm, such as 550 or 610,540,465") from None
    if len(wavelengths_nm) == 1:
        return {options.output: wavelengths_nm[0]}
    return {options.output.with_stem(f"{options.output.stem}_{nm:g}nm"): nm for nm in wavelengths_nm}
