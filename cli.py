"""The `lensfield` command: parses and calls. `render` imports bpy, the rest needs no Blender."""

import argparse
import json
import os
import sys
from contextlib import contextmanager
from pathlib import Path

from .engine import InputError, Lens, Options, Report, simulate
from .engine.lens_files import bundled_names
from .engine.lens_info import lens_info, lens_text
from .engine.plan import OUT_OF_FIELD
from .engine.sections import ORDERS
from .engine.spectra import parse_wavelengths

BAR_CELLS = 24
FAILURES = (InputError, OSError, MemoryError)


def main(arguments=None):
    """Run the command; the exit status: 0, 1 for bad input (told in one line), 2 for a command that is not one."""
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
        return 130
    return 0


def console():
    """Entry point of the console script."""
    status = main()
    sys.stdout.flush()
    sys.stderr.flush()
    if "bpy" in sys.modules:
        os._exit(status)  # some of Blender's wheels crash while the interpreter exits, after all is done
    sys.exit(status)


def _parser():
    parser = argparse.ArgumentParser(prog="lensfield", description="Blender scenes through real lenses.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    render = commands.add_parser("render", help="render a .blend multispectrally and put it through a lens")
    render.add_argument("scene", type=Path, metavar="SCENE.blend")
    render.add_argument("--wavelengths", default="400:700:9", metavar="SPEC",
                        help="nm: first:last:number, or a list such as 450,550,650 (default %(default)s)")
    render.add_argument("--frame", type=int, help="frame to render (default: the scene's current one)")
    render.add_argument("--samples", type=int, help="Cycles samples per pixel (default: the scene's)")
    render.add_argument("--resolution", metavar="WIDTHxHEIGHT", help="size in pixels (default: the scene's)")
    render.add_argument("--denoise", action="store_true", help="let Cycles denoise its passes")
    render.add_argument("--output", type=Path, required=True, metavar="DIR")
    render.set_defaults(run=_render)

    filter_ = commands.add_parser("filter", help="put a spectral radiance EXR through a lens")
    filter_.add_argument("radiance", type=Path, metavar="RADIANCE.exr")
    filter_.add_argument("--pitch-um", type=float, help="pixel pitch at the sensor, for a file that does not tell it")
    filter_.add_argument("--output", type=Path, required=True, metavar="IRRADIANCE.exr")
    filter_.add_argument("--preview", type=Path, metavar="FILE.png", help="also write an sRGB picture")
    filter_.set_defaults(run=_filter)

    for command in (render, filter_):
        command.add_argument("--lens", required=True, metavar="NAME|FILE",
                             help=f"a bundled lens ({', '.join(bundled_names())}) or a lens package")
        command.add_argument("--section-size", type=int, default=Options.section_size, metavar="PX",
                             help="side of an isoplanatic section (default %(default)s)")
        command.add_argument("--order", type=int, default=Options.order, choices=ORDERS,
                             help="1: one PSF per section; 2: bilinear between corners (default %(default)s)")
        command.add_argument("--out-of-field", choices=OUT_OF_FIELD, default=Options.out_of_field,
                             help="pixels beyond the lens data (default %(default)s)")
        command.add_argument("--report", type=Path, metavar="FILE.json",
                             help="write stages with seconds, the plan, and energy in and out")

    lens = commands.add_parser("lens", help="about lenses").add_subparsers(required=True, metavar="COMMAND")
    info = lens.add_parser("info", help="first-order data, distortion, relative illumination, lateral colour")
    info.add_argument("lens", metavar="NAME|FILE")
    info.add_argument("--json", action="store_true", help="as JSON")
    info.set_defaults(run=_lens_info)
    listing = lens.add_parser("list", help="names of the bundled lenses")
    listing.set_defaults(run=lambda _: print("\n".join(bundled_names())))
    return parser


def _render(options):
    try:
        import bpy
    except ImportError as error:
        raise InputError("bpy", "module", "not there", f"install Blender's Python wheel ({error})") from None
    from . import addon

    lens = Lens.load(options.lens)
    wavelengths_nm = parse_wavelengths(options.wavelengths)
    engine_options = _engine_options(options)
    if not options.scene.is_file():
        raise InputError(options.scene, "scene", "not there", "expected a .blend file")
    if not hasattr(bpy.types.Scene, "lensfield"):  # in the wheel nobody has registered the add-on yet
        addon.register()
    try:
        with _quiet_stdout():
            bpy.ops.wm.open_mainfile(filepath=str(options.scene.resolve()))
    except RuntimeError as error:
        raise InputError(options.scene, "scene", "not readable", str(error).strip()) from None
    scene = bpy.context.scene
    if options.samples is not None:
        scene.cycles.samples = _positive("--samples", options.samples)
    if options.resolution:
        scene.render.resolution_x, scene.render.resolution_y = _resolution(options.resolution)
        scene.render.resolution_percentage = 100
    with _progress_bar() as tell, _quiet_stdout():
        result = addon.render_through_lens(
            scene, lens, wavelengths_nm, options.output.resolve(), options=engine_options, frame=options.frame,
            denoise=options.denoise, progress=tell)
    _write_report(options, result.report)
    for path in (result.radiance, result.irradiance, result.lens_image, result.before, result.after):
        print(path)
    _print_stages(result.report)


def _filter(options):
    from .engine.colour import auto_exposure, to_rec709, write_png
    from .engine.exr import read_exr, write_exr

    report = Report()
    lens = Lens.load(options.lens)
    engine_options = _engine_options(options)
    with report.stage("read radiance"):
        radiance = read_exr(options.radiance, options.pitch_um)
    with _progress_bar() as tell:
        irradiance = simulate(radiance, lens, engine_options, report=report,
                              progress=lambda done: tell(done, f"Through {lens.name}"))
    with report.stage("write irradiance"):
        write_exr(irradiance, options.output)
    if options.preview:
        with report.stage("write preview"):
            picture = to_rec709(irradiance)
            write_png(picture, options.preview, auto_exposure(picture))
    _write_report(options, report)
    print(options.output)
    _print_stages(report)


def _lens_info(options):
    info = lens_info(Lens.load(options.lens))
    print(json.dumps(info, indent=2) if options.json else lens_text(info))


def _engine_options(options):
    return Options(section_size=options.section_size, order=options.order, out_of_field=options.out_of_field)


def _positive(name, value):
    if value < 1:
        raise InputError("options", name, value, "expected 1 or more")
    return value


def _resolution(text):
    try:
        width, height = (_positive("--resolution", int(side)) for side in text.lower().split("x"))
    except ValueError:
        raise InputError("options", "--resolution", text, "expected WIDTHxHEIGHT such as 768x576") from None
    return width, height


def _write_report(options, report):
    if options.report:
        report.write(options.report)


def _print_stages(report):
    for stage, seconds in report.stages.items():
        print(f"  {stage:<40}{seconds:8.2f} s")


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
def _quiet_stdout():
    """Keep Blender's own chatter, which comes from its C++ side, off standard output."""
    sys.stdout.flush()
    kept = os.dup(1)
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)
