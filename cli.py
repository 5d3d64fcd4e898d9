"""The `lensfield` command: parses and calls. `render` imports bpy, the rest needs no Blender."""

import argparse
import json
import os
import shutil
import signal
import sys
import threading
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path

from . import __version__
from .engine import ImageError, InputError, Kept, Lens, Options, Report, simulate
from .engine.atomic import check_target, remove_pending
from .engine.errors import absence
from .engine.lens_files import bundled_names
from .engine.lens_info import lens_info, lens_text
from .engine.options import DEFAULT_ACCURACY, FIREFLIES, METHODS, OUT_OF_FIELD, PRECISIONS
from .engine.sections import ORDERS
from .engine.spectra import parse_wavelengths

BAR_CELLS = 24
FAILURES = (InputError, OSError, MemoryError)
CANCELLED = 130
LIMITS = {"frame": (-1048574, 1048574), "samples": (1, 1 << 24)}  # Blender's own
RESOLUTION_LIMITS = (4, 65536)


def main(arguments=None):
    """Run the command; the exit status: 0, 1 for bad input (told in one line), 2 for a command line that is none."""
    try:
        options = _parser().parse_args(arguments)
    except SystemExit as stop:  # inside Blender the process is not ours to end
        return stop.code or 0
    try:
        options.run(options)
    except FAILURES as error:
        print(f"lensfield: {error or type(error).__name__}".replace("\n", " "), file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("lensfield: cancelled", file=sys.stderr)
        return CANCELLED
    return 0


def console():
    """Entry point of the console script, whose process is its own."""
    _open_closed_streams()
    _stop_on_signals()
    _leave(main())


def _open_closed_streams():
    """Daemons start programs with standard streams closed: let what is written there go nowhere."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            nowhere = os.open(os.devnull, os.O_RDWR)
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)
            setattr(sys, name, open(number, "r" if number == 0 else "w"))


def _stop_on_signals():
    """Let Ctrl-C and SIGTERM end the process at once and leave nothing behind.

    An exception would not do: Python raises it when the main thread is back from C++, minutes later, and Blender's
    own callbacks lose it. But a byte is written as soon as a signal comes, and a thread can wait for that.
    """
    if os.name == "nt":  # whose pipes cannot do this; there Ctrl-C ends the process as it is
        return
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)

    def wait():
        os.read(reader, 1)
        remove_pending()
        print("\nlensfield: cancelled", file=sys.stderr)
        _leave(CANCELLED)

    threading.Thread(target=wait, daemon=True).start()


def _leave(status):
    """End the process with this status, whatever the interpreter's own end would come to."""
    sys.stdout.flush()
    sys.stderr.flush()
    if "bpy" in sys.modules:
        shutil.rmtree(sys.modules["bpy"].app.tempdir, ignore_errors=True)
    os._exit(status)  # some of Blender's wheels crash while the interpreter exits, after all is done


def _parser():
    parser = argparse.ArgumentParser(prog="lensfield", description="Blender scenes through real lenses.")
    parser.add_argument("--version", action="version", version=f"lensfield {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_render(commands)
    _add_filter(commands)
    _add_tradeoff(commands)
    _add_lens(commands)
    return parser


def _add_render(commands):
    render = commands.add_parser("render", help="render a .blend multispectrally and put it through a lens")
    render.add_argument("scene", type=Path, metavar="SCENE.blend")
    render.add_argument("--wavelengths", default="400:700:9", metavar="SPEC",
                        help="nm: first:last:number, or a list such as 450,550,650 (default %(default)s)")
    render.add_argument("--frame", type=int, help="frame to render (default: the scene's current one)")
    render.add_argument("--samples", type=int, help="Cycles samples per pixel (default: the scene's)")
    render.add_argument("--resolution", metavar="WIDTHxHEIGHT", help="size in pixels (default: the scene's)")
    render.add_argument("--denoise", action="store_true", help="let Cycles denoise its passes")
    render.add_argument("--output", type=Path, required=True, metavar="DIR")
    _add_engine_options(render)
    render.set_defaults(run=_render)


def _add_filter(commands):
    filter_ = commands.add_parser("filter", help="put a spectral radiance EXR through a lens")
    filter_.add_argument("radiance", type=Path, metavar="RADIANCE.exr")
    filter_.add_argument("--pitch-um", type=float, help="pixel pitch at the sensor, for a file that does not tell it")
    filter_.add_argument("--output", type=Path, required=True, metavar="IRRADIANCE.exr")
    filter_.add_argument("--preview", type=Path, metavar="FILE.png", help="also write an sRGB picture")
    _add_engine_options(filter_)
    filter_.set_defaults(run=_filter)


def _add_tradeoff(commands):
    tradeoff = commands.add_parser("tradeoff", help="measure error against time and memory: a table and a plot")
    tradeoff.add_argument("--lens", required=True, metavar="NAME|FILE", help="a bundled lens or a lens package")
    tradeoff.add_argument("--image", type=Path, metavar="RADIANCE.exr",
                          help="measure on this picture (default: points, a checkerboard and a colour chart)")
    tradeoff.add_argument("--size", metavar="WIDTHxHEIGHT",
                          help="pixels (default 384x288, or the whole image): the exact operator takes half a minute "
                               "for 384x288 and longer in proportion, for each wavelength of an image")
    tradeoff.add_argument("--pitch-um", type=float, help="pixel pitch at the sensor (default: what the image says, or "
                                                         "what lays the size on the width of the lens's sensor)")
    tradeoff.add_argument("--quick", action="store_true", help="fewer settings, each timed once")
    tradeoff.add_argument("--output", type=Path, required=True, metavar="DIR",
                          help="where tradeoff.csv and tradeoff.png go")
    tradeoff.set_defaults(run=_tradeoff)


def _add_engine_options(command):
    command.add_argument("--lens", required=True, metavar="NAME|FILE",
                         help=f"a bundled lens ({', '.join(bundled_names())}) or a lens package")
    command.add_argument("--out-of-field", choices=OUT_OF_FIELD,
                         help=f"pixels beyond the lens data (default {Options.out_of_field})")
    command.add_argument("--fireflies", choices=FIREFLIES,
                         help="pixels that are no finite number: an error, or the brightest of their neighbours "
                              f"(default {Options.fireflies})")
    command.add_argument("--report", type=Path, metavar="FILE.json",
                         help="write stages with seconds, the plan, and energy in and out")
    _add_accuracy(command.add_argument_group("accuracy"))
    _add_knobs(command.add_argument_group("knobs, for who wants them", "setting one turns the choice by accuracy off"))


def _add_accuracy(group):
    group.add_argument("--accuracy", type=float, metavar="FRACTION",
                       help="the largest fraction of any point's light that may land in the wrong place; the quickest "
                            f"way to that is chosen (default {DEFAULT_ACCURACY:g})")
    group.add_argument("--method", choices=METHODS,
                       help="each pixel's PSF from a table, in polar sections or pixel by pixel; square sections; the "
                            f"paper's way; or the exact one (default {Options.method})")
    group.add_argument("--non-negative", action="store_true", default=None,
                       help="leave no pixel negative beside very bright ones, at orders 3 and 4 either")


def _add_knobs(group):
    """Each is None where it is not set: what it is then is the engine's business."""
    group.add_argument("--section-size", type=int, metavar="PX",
                       help="side of an isoplanatic section; smaller is more accurate and slower")
    group.add_argument("--order", type=int, choices=ORDERS,
                       help="1: one PSF per section, 2: bilinear between corners, 3 and 4: finer")
    group.add_argument("--azimuths", type=int, metavar="N", help="steps of the table of PSFs from 0 to 45 degrees")
    group.add_argument("--psf-energy", type=float, metavar="FRACTION", help="what is kept of each PSF, in a circle")
    group.add_argument("--flat-tolerance", type=float, metavar="FRACTION",
                       help="relative error up to which sections in even light are not filtered")
    group.add_argument("--precision", choices=PRECISIONS, help="auto: double where the light's range needs it")


def _add_lens(commands):
    lens = commands.add_parser("lens", help="about lenses").add_subparsers(required=True, metavar="COMMAND")
    info = lens.add_parser("info", help="first-order data, distortion, relative illumination, lateral colour")
    info.add_argument("lens", metavar="NAME|FILE")
    info.add_argument("--json", action="store_true", help="as JSON")
    info.set_defaults(run=_lens_info)
    listing = lens.add_parser("list", help="names of the bundled lenses")
    listing.set_defaults(run=lambda _: print("\n".join(bundled_names())))


def _render(options):
    try:
        import bpy
    except ImportError as error:
        raise InputError("bpy", "module", "not there", f"install Blender's Python wheel ({error})") from None
    from . import addon

    lens = Lens.load(options.lens)
    wavelengths_nm = parse_wavelengths(options.wavelengths)
    engine_options = _engine_options(options)
    _check_targets(options.report)
    if not hasattr(bpy.types.Scene, "lensfield"):  # in the wheel nobody has registered the add-on yet
        addon.register()
    scene = _open_scene(bpy, options)
    with _progress_bar() as tell, _quiet(1):
        result = addon.render_through_lens(
            scene, lens, wavelengths_nm, options.output.resolve(), options=engine_options, frame=options.frame,
            denoise=options.denoise, progress=tell)
    print(f"plan: {plan_text(result.report.facts['plan'])}")  # it could not be made before the capture
    _finish(options, result.report, result.files)


def _open_scene(bpy, options):
    """The scene of the .blend, with what the command line asks of it."""
    if not options.scene.is_file():
        raise InputError(options.scene, "scene", absence(options.scene), "expected a .blend file")
    for name, limits in LIMITS.items():
        value = getattr(options, name)
        if value is not None and not limits[0] <= value <= limits[1]:
            raise InputError("options", f"--{name}", value, "expected {} to {}".format(*limits))
    size = _resolution(options.resolution) if options.resolution else None
    try:
        with _quiet(1):
            bpy.ops.wm.open_mainfile(filepath=str(options.scene.resolve()))
    except RuntimeError as error:
        raise InputError(options.scene, "scene", "not readable", str(error).strip()) from None
    scene = bpy.context.scene
    if options.samples is not None:
        scene.cycles.samples = options.samples
    if size:
        scene.render.resolution_x, scene.render.resolution_y = size
        scene.render.resolution_percentage = 100
    return scene


def _filter(options):
    from .engine.colour import auto_exposure, to_rec709, write_png
    from .engine.exr import read_exr, write_exr

    report, kept = Report(), Kept(limit_mb=0)  # there is no second picture to keep anything for
    lens = Lens.load(options.lens)
    engine_options = _engine_options(options)
    _check_targets(options.output, options.preview, options.report)
    with report.stage("read radiance"), _quiet(1, 2):  # of damage the EXR library tells at length
        radiance = read_exr(options.radiance, options.pitch_um)
    try:
        with report.stage("plan"):
            print(f"plan: {plan_text(kept.plan(engine_options, lens, radiance).as_dict())}", flush=True)
        with _progress_bar() as tell:
            irradiance = simulate(radiance, lens, engine_options, report=report, kept=kept,
                                  progress=lambda done: tell(done, f"Through {lens.name}"))
    except ImageError as error:
        raise ImageError(options.radiance, error.field, error.value, error.remedy) from None
    with report.stage("write irradiance"):
        write_exr(irradiance, options.output)
    if options.preview:
        with report.stage("write preview"):
            picture = to_rec709(irradiance)
            write_png(picture, options.preview, auto_exposure(picture))
    _finish(options, report, [path for path in (options.output, options.preview) if path])


def _tradeoff(options):
    from .engine.tradeoff import description, measure, write_table
    from .engine.tradeoff_plot import require_matplotlib, write_plot

    require_matplotlib()
    table, plot = (options.output / f"tradeoff.{kind}" for kind in ("csv", "png"))
    lens = Lens.load(options.lens)
    pictures, spectral = _tradeoff_pictures(options, lens)
    _check_targets(table, plot)
    try:
        with _progress_bar() as tell:
            rows = measure(lens, pictures, spectral, quick=options.quick, progress=tell)
    except ImageError as error:
        raise ImageError(options.image or error.where, error.field, error.value, error.remedy) from None
    write_table(rows, table)
    write_plot(rows, plot, description(lens, pictures))
    print(table, plot, sep="\n")


def _tradeoff_pictures(options, lens):
    """What to measure on: pictures by name, and one picture by the number of its wavelengths."""
    from .engine.exr import read_exr
    from .engine.tradeoff import DEFAULT_SHAPE_PX, cropped_frame, standard_pictures, thinned

    shape_px = _resolution(options.size, "--size")[::-1] if options.size else None
    if not options.image:
        return standard_pictures(lens, shape_px or DEFAULT_SHAPE_PX, options.pitch_um)
    with _quiet(1, 2):
        radiance = read_exr(options.image, options.pitch_um)
    if shape_px:
        radiance = cropped_frame(radiance, lens, shape_px)
    return {options.image.stem: radiance}, thinned(options.image.stem, radiance)


def _lens_info(options):
    info = lens_info(Lens.load(options.lens))
    print(json.dumps(info, indent=2) if options.json else lens_text(info))


def _engine_options(options):
    """What the command line asks for; what it leaves open is the engine's to choose."""
    named = {field.name: getattr(options, field.name, None) for field in fields(Options)}
    return Options(**{name: value for name, value in named.items() if value is not None})


def plan_text(plan):
    """What a plan, as its dict, comes to, in one line: the way; and the result, where that was asked for."""
    way = {"polar": "{section_size} px sections between {azimuths} azimuths",
           "pixels": "a PSF for every pixel, from {azimuths} azimuths",
           "sections": "{section_size} px sections of order {order}" if plan["order"] else "one PSF for the picture",
           "paper": "{section_size} px sections in a space of {space_px} px, as in the paper",
           "exact": "every pixel's own PSF"}[plan["method"]].format(**plan)
    way += ", double precision" if plan["precision"] == "float64" else ", single precision"
    if plan["error_bound"] is None:
        return way
    return (f"{way}: at most {100 * plan['error_bound']:.2g} % of any point's light misplaced; "
            f"about {max(plan['seconds'], 0.1):.1f} s, {plan['memory_mb']:.0f} MB")


def _check_targets(*paths):
    """Raise an InputError for a file that could not be written, before the work is done."""
    named = [path for path in paths if path]
    for index, path in enumerate(named):
        check_target(path)
        if path.resolve() in [other.resolve() for other in named[:index]]:
            raise InputError(path, "file", "named twice", "give every output a name of its own")


def _resolution(text, option="--resolution"):
    least, most = RESOLUTION_LIMITS
    try:
        width, height = (int(side) for side in text.lower().split("x"))
        if not least <= min(width, height) <= max(width, height) <= most:
            raise ValueError
    except ValueError:
        raise InputError("options", option, text,
                         f"expected WIDTHxHEIGHT such as 768x576, each {least} to {most}") from None
    return width, height


def _finish(options, report, files):
    """Write the report, and say where the files are, how long each stage took, and what lies out of field."""
    if options.report:
        report.write(options.report)
    for path in files:
        print(path)
    for stage, seconds in report.stages.items():
        print(f"  {stage:<40}{seconds:8.2f} s")
    beyond = report.facts["out_of_field_fraction"]
    if beyond:
        print(f"  {beyond:.1%} of the frame lies beyond the lens data: {report.facts['plan']['out_of_field']}")


@contextmanager
def _progress_bar():
    """A function (fraction, label) that draws a bar, on a terminal; elsewhere it says nothing."""
    if not sys.stderr.isatty():
        yield lambda fraction, label: None
        return

    def draw(fraction, label):
        filled = round(BAR_CELLS * fraction)
        print(f"\r[{'#' * filled}{'.' * (BAR_CELLS - filled)}] {fraction:4.0%}  {label:<48.48}", end="",
              file=sys.stderr, flush=True)

    try:
        yield draw
    finally:
        print(f"\r{'':{BAR_CELLS + 58}}\r", end="", file=sys.stderr, flush=True)


@contextmanager
def _quiet(*descriptors):
    """Keep the chatter of C++ libraries, Blender's or OpenEXR's, off these descriptors: 1 is output, 2 is errors."""
    sys.stdout.flush()
    kept = [(number, os.dup(number)) for number in descriptors]
    with open(os.devnull, "w") as nowhere:
        for number in descriptors:
            os.dup2(nowhere.fileno(), number)
    try:
        yield
    finally:
        sys.stdout.flush()
        for number, original in kept:
            os.dup2(original, number)
            os.close(original)
