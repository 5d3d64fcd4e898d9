"""`lensfield develop`: take a picture of a lens image with a camera."""

from pathlib import Path

from lensfield.engine import ImageError, InputError, Report, load_camera, photograph
from lensfield.engine.photo.photograph import CameraFacts, held, missing_channels, missing_text
from lensfield.engine.photo.raw_file import check_lens, write_raw_file
from lensfield.engine.runtime.setting import option_of, settings_of
from lensfield.engine.sensor.exposure import FRAMES, covered_px
from lensfield.engine.simulation.report import together

from ..request import IRRADIANCE, RING_FIELDS, RenderRequest
from .arguments import (
    add_lens_settings,
    add_settings,
    add_untrusted,
    check_outputs,
    chosen_lens,
    given_fields,
    given_settings,
)
from .camera import CAMERAS
from .outcome import finish
from .prescription_file import given_reading
from .sequence import find_shots
from .terminal import quiet, say

OUTPUTS = ".dng", ".png", ".exr"


def add_options(develop):
    develop.description = (
        "Take a picture of a lens image with a camera, and write it as a raw file (.dng), developed (.png), or as "
        "linear light in the camera's channels (.exr).")
    develop.add_argument("irradiance", type=Path, metavar="IRRADIANCE.exr",
                         help="lens image; in the name of a sequence, #### or %%04d is the frame number")
    develop.add_argument("--camera", required=True, metavar="NAME|FILE", help=CAMERAS)
    develop.add_argument("-o", "--output", dest="outputs", type=Path, required=True, action="append", metavar="FILE",
                         help="file to write, by its suffix: .dng, .png or .exr; can be repeated")
    develop.add_argument("--mosaic", action="store_true",
                         help="write the .exr before demosaicing: one channel with the pixels behind their filters")
    develop.add_argument("--frames", metavar="SPEC",
                         help="frames of a sequence: 7, 1-50, 1-50:2 or 1,5,10-20 (default: all existing frames)")
    develop.add_argument("--pitch-um", type=float, help="pixel pitch at the sensor, for a file that does not state it")
    develop.add_argument("--seed", type=int, default=0, help="other noise for each (default: 0)")
    add_settings(develop, RenderRequest, ("iso", "shutter_s", "noise"))
    develop.add_argument("--report", type=Path, metavar="FILE.json",
                         help="write a report: the exposure, saturated pixels, signal-to-noise ratio")
    lens = develop.add_argument_group("lens", "that made the picture, for converters to straighten it")
    lens.add_argument("--lens", metavar="NAME|FILE", help="the lens (default: no correction in the raw file)")
    add_lens_settings(develop)
    add_untrusted(develop)
    develop.set_defaults(run=_develop, confines=lambda options: (options.irradiance, options.outputs[0].parent))


def _develop(options):
    camera = load_camera(options.camera)
    _check_mosaic(options, camera)
    _check_lens(options)
    by_output = [find_shots(options.irradiance, output, None, options.frames) for output in options.outputs]
    check_outputs([*((shot.output, _suffix(shot.output)) for shots in by_output for shot in shots),
                   (options.report, ".json")],
                  [options.camera, *(shot.radiance for shot in by_output[0]), *filter(None, [options.lens])])
    for shot in by_output[0]:
        _check_picture(_header(shot, options), options, camera)
    lens = _lens(by_output[0], options) if options.lens else None
    given = {name: value or None for name, value in given_fields(options).items() if name in ("iso", "shutter_s")}
    reports = {}
    for shots in zip(*by_output, strict=True):
        reports[shots[0].frame] = report = Report()
        raw = _take(shots[0], options, camera, given, report)
        given = {"iso": raw.exposure.iso, "shutter_s": raw.exposure.shutter_s,  # of the first frame, for all
                 "factor": report.parts.of(CameraFacts).factor}
        for shot in shots:
            with report.stage(f"write {shot.output.suffix}"):
                _write(raw, shot, options, lens)
            say(shot.output)
    finish(options, reports[None] if None in reports else together(reports), [])


def _suffix(path):
    """The suffix that an output must have: its own, if its kind can be written."""
    if path.suffix.lower() not in OUTPUTS:
        raise InputError(path, "suffix", path.suffix or "missing", f"expected {', '.join(OUTPUTS)}")
    return path.suffix.lower()


def _check_mosaic(options, camera):
    if options.mosaic and not camera.filters:
        raise InputError("options", "--mosaic", "given", f"leave it out: all pixels of {camera.name} have all channels")
    if options.mosaic and not any(path.suffix.lower() == ".exr" for path in options.outputs):
        raise InputError("options", "--mosaic", "given", "also give an output with the suffix .exr")


def _check_lens(options):
    """Raise an InputError for a lens that no file states, or for settings without a lens."""
    rings, settings = given_settings(options, RenderRequest), settings_of(RenderRequest)
    given = [*given_reading(options), *(option_of(name, settings[name]) for name in (*RING_FIELDS, "lens_quality")
                                        if name in rings)]
    if given and not options.lens:
        option = given[0].replace("_", "-")
        raise InputError("options", f"--{option}", "given", "leave it out, or also give the lens (--lens)")
    if options.lens and not any(path.suffix.lower() == ".dng" for path in options.outputs):
        raise InputError("options", "--lens", options.lens, "leave it out: only raw files (.dng) state the lens")


def _check_picture(image, options, camera):
    """Raise an error unless the camera's picture of a lens image can be written in all files."""
    from lensfield.engine.pictures.develop import check_demosaicable
    from lensfield.engine.pictures.dng import check_channels

    suffixes, camera = {path.suffix.lower() for path in options.outputs}, held(camera, image.frame_px)
    if suffixes & {".dng", ".png"}:
        check_channels(camera)
    if suffixes & ({".png"} if options.mosaic else {".png", ".exr"}):
        check_demosaicable(camera, covered_px(image, camera))


def _lens(shots, options):
    """The lens that made these lens images."""
    lens = chosen_lens(options)
    for shot in shots:
        try:
            check_lens(_header(shot, options), lens)
        except ImageError as error:
            raise error.at(shot.radiance) from None
    return lens


def _header(shot, options):
    """A lens image without its light."""
    from lensfield.engine.pictures.frame_record import check_left_out
    from lensfield.engine.pictures.spectral_exr import read_header

    check_left_out(shot.radiance, IRRADIANCE)
    return read_header(shot.radiance, options.pitch_um)[0]


def _take(shot, options, camera, given, report):
    """The raw picture of one lens image, which is read again for each."""
    from lensfield.engine.pictures.spectral_exr import read_exr

    with report.stage("read irradiance"), quiet(1, 2):  # the EXR library prints long messages about damage
        irradiance = read_exr(shot.radiance, options.pitch_um)
    if line := missing_text(missing_channels(camera, irradiance.wavelengths_nm)):
        say(f"camera: {line}")
    try:
        with report.stage("camera"):
            return photograph(irradiance, camera, **given, report=report, noise=options.noise is not False,
                              seed=options.seed, frame=(shot.frame or 0) % FRAMES)
    except ImageError as error:
        raise error.at(shot.radiance) from None


def _write(raw, shot, options, lens):
    from lensfield.engine.pictures.develop import camera_rgb, developed, signal, write_linear_exr
    from lensfield.engine.pictures.preview import write_png

    suffix = shot.output.suffix.lower()
    if suffix == ".dng":
        for line in write_raw_file(raw, _header(shot, options), shot.output, lens):
            say(f"lens: {line}")
    elif suffix == ".png":
        write_png(developed(raw), shot.output, 1.0)
    else:
        write_linear_exr(signal(raw) if options.mosaic else camera_rgb(raw), raw.camera, shot.output)
