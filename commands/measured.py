"""`lensfield lens measured`: a lens from the distortion that other programs have measured."""

from pathlib import Path

from lensfield.engine import InputError
from lensfield.engine.inspection.info import table_summary
from lensfield.engine.lens.formats import FORMATS, format_mm
from lensfield.engine.lens_files.package import write_package
from lensfield.engine.library import clamped_rings, has_rings
from lensfield.engine.measured.files import DEFAULT_WIDTH_MM, KINDS, blur_rings, lens_of, read_measured
from lensfield.engine.measured.lensfun import installed_database
from lensfield.engine.measured.options import MeasuredOptions

from .arguments import check_outputs, distance_mm, resolution, say_clamped
from .terminal import progress_bar, quiet, say


def add(commands):
    measured = commands.add_parser("measured", help="convert a calibration, an STMap or an entry of Lensfun's database "
                                                    "to a lens package")
    measured.description = (
        "Write a lens package with the distortion that another program has measured. The lens blurs by diffraction, or "
        "as a designed lens does, and defocuses as a thin lens.")
    measured.add_argument("file", type=Path, nargs="?", metavar="FILE",
                          help="; ".join(f"{name}: {each.title}" for name, each in KINDS.items())
                          + ". Optional with --as lensfun: the installed database")
    measured.add_argument("--as", dest="kind", choices=KINDS, metavar="KIND",
                          help="kind of the file (default: by its contents)")
    measured.add_argument("-o", "--output", type=Path, required=True, metavar="X.npz", help="lens package to write")
    measured.add_argument("--which", metavar="NAME",
                          help="selects one of several in a file: COLMAP's CAMERA_ID, Kalibr's camera, nerfstudio's "
                               "frame, or a lens as Lensfun names it")
    measured.add_argument("--sensor", metavar="WIDTHxHEIGHT",
                          help=f"size in mm of the sensor that the picture fits on, or one of {', '.join(FORMATS)} "
                               f"(default: as in the file, or {DEFAULT_WIDTH_MM:g} mm wide)")
    measured.add_argument("--focal-length", type=float, metavar="MM",
                          help="of an STMap, or of a zoom lens in Lensfun's database")
    measured.add_argument("--resolution", metavar="WIDTHxHEIGHT",
                          help="size of the pictures in pixels, if the file does not state it")
    measured.add_argument("--overscan", type=float, default=MeasuredOptions.overscan, metavar="FACTOR",
                          help="of an STMap: width of the undistorted picture relative to the lens's picture (default: "
                               "%(default)s)")
    measured.add_argument("--f-number", type=float, default=MeasuredOptions.f_number, metavar="N",
                          help="of the diffraction, of defocus, and in Lensfun's database (default: %(default)s)")
    measured.add_argument("--focus", default="inf", metavar="DISTANCE",
                          help="distance to the plane of focus: 1.2m, 80cm, 500mm or inf (default: %(default)s)")
    measured.add_argument("--blur", metavar="NAME|FILE",
                          help="a lens with a prescription, whose blur and light the lens has instead of diffraction's")
    measured.add_argument("--name", help="name of the lens (default: the name in the file, or the file's own)")
    measured.set_defaults(run=_measured)


def _measured(options):
    path = _path(options)
    check_outputs([(options.output, ".npz")], [each for each in (path, options.blur) if each])
    reading = MeasuredOptions(
        options.which, resolution(options.resolution) if options.resolution else None, options.focal_length,
        format_mm(options.sensor) if options.sensor else None, options.f_number, distance_mm(options.focus, "--focus"),
        options.overscan)
    with quiet(1, 2):  # the EXR library prints long messages about damage
        measured = read_measured(path, reading, options.kind)
    if options.blur and has_rings(options.blur):
        say_clamped(clamped_rings(options.blur, blur_rings(reading)))
    with progress_bar() as on_progress:
        lens = lens_of(measured, reading, options.blur, on_progress, options.name)
    write_package(lens, options.output)
    say(options.output, f"  {table_summary(lens)}", lens.source, *filter(None, [lens.notes]))


def _path(options):
    """The file, or the installed database."""
    if options.file is not None:
        return options.file
    if options.kind != "lensfun":
        raise InputError("options", "FILE", "not given", "required without --as lensfun")
    return installed_database()
