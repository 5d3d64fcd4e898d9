"""`lensfield lens calibration`: a lens's camera model, in the files of other programs."""

from pathlib import Path

from lensfield.engine import InputError
from lensfield.engine.calibration.fit import TARGET_PX
from lensfield.engine.calibration.formats import FORMATS, OPTION, calibrated_alike, check_model
from lensfield.engine.calibration.models import MODELS
from lensfield.engine.calibration.views import View, overscan_lines, summary
from lensfield.engine.inspection.curves import reference_nm
from lensfield.engine.runtime.files import atomic_path

from .arguments import check_outputs
from .cameras import add_cameras, cameras, check_cameras, sources
from .terminal import say

WHOLE = 0.9995  # of the frame


def add(commands):
    calibration = commands.add_parser("calibration", help="write the lens's camera model for OpenCV, COLMAP and others")
    calibration.description = (
        "Fit a camera model to the rays of a lens, at its focus and f-stop, and write it for another program: the "
        f"simplest model that is nowhere more than {TARGET_PX:g} px off.")
    calibration.add_argument(OPTION, dest="format", required=True, choices=FORMATS, metavar="PROGRAM", help="; ".join(
        f"{name}: {each.title} ({each.suffix})" for name, each in FORMATS.items()))
    calibration.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="file to write")
    calibration.add_argument("--model", choices=MODELS, metavar="NAME",
                             help=f"{', '.join(MODELS)} (default: the simplest that fits)")
    calibration.add_argument("--wavelength", metavar="NM[,NM...]",
                             help="wavelength in nm (default: the lens's reference wavelength). Several, such as "
                                  "610,540,465 for red, green and blue, write one file each, named after it")
    add_cameras(calibration)
    calibration.set_defaults(run=_calibration)


def _calibration(options):
    _check(options)
    targets = _targets(options)
    check_outputs([(path, FORMATS[options.format].suffix) for path in targets], sources(options))
    shown = cameras(options)
    for path, wavelength_nm in targets.items():
        _write(options, path, _views(options, shown, wavelength_nm))


def _check(options):
    check_model(options.format, options.model)
    check_cameras(options)
    if options.frames is not None and not FORMATS[options.format].poses:
        several = ", ".join(name for name, each in FORMATS.items() if each.poses)
        raise InputError("options", "--frames", options.frames,
                         f"a file for {options.format} has one camera: leave it out, or use --for {several}")


def _views(options, shown, wavelength_nm):
    """The View of each camera at a wavelength; None for the reference wavelength of each lens."""
    calibrations = calibrated_alike(options.format, [
        (camera.lens, camera.grid, reference_nm(camera.lens) if wavelength_nm is None else wavelength_nm)
        for camera in shown], options.model)
    return [View(calibration, camera.pose, camera.picture)
            for calibration, camera in zip(calibrations, shown, strict=True)]


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
    if len({f"{nm:g}" for nm in wavelengths_nm}) < len(wavelengths_nm):  # file names contain these
        raise InputError("options", "--wavelength", options.wavelength, "expected each wavelength once")
    if len(wavelengths_nm) == 1:
        return {options.output: wavelengths_nm[0]}
    return {options.output.with_stem(f"{options.output.stem}_{nm:g}nm"): nm for nm in wavelengths_nm}
