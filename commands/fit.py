"""`lensfield lens fit`: rims of a lens fitted to photographs of even fields."""

from datetime import date
from pathlib import Path

from lensfield.engine import InputError
from lensfield.engine.fitting.cat_eyes import compare_points
from lensfield.engine.fitting.fit import fit_rims, fit_to_files
from lensfield.engine.fitting.flat_fields import read_flat_fields
from lensfield.engine.fitting.lensfun import find_photographed, vignetting_of
from lensfield.engine.fitting.points import read_point
from lensfield.engine.fitting.raw_light import camera_sensor_mm, f_numbers_of
from lensfield.engine.fitting.typical import is_like_measured, with_typical_rims
from lensfield.engine.fitting.vignetting import COLUMNS, read_vignetting
from lensfield.engine.lens.formats import FORMATS, format_mm
from lensfield.engine.library import has_rings, prescription_of
from lensfield.engine.prescription.readers.toml import write_prescription
from lensfield.engine.runtime.files import atomic_path

from .arguments import LENSES, check_outputs, distance_mm
from .fit_kit import KIT
from .prescription_file import add_reading, errors_of, lens_source
from .terminal import say


def add(commands):
    fit = commands.add_parser("fit", help="fit the rims of a lens to photographs of even fields")
    fit.description = (
        "Fit the rims of a lens to the light of even fields in photographs, at all f-stops and distances at once. "
        "Patents print no rims, and rims shape cat's eyes and the corners' light. Radii and glasses stay as they are.")
    fit.add_argument("lens", nargs="?", metavar="NAME|FILE", help=LENSES.replace("a lens package, ", ""))
    source = fit.add_mutually_exclusive_group()
    source.add_argument("--lensfun", metavar="'MAKER MODEL'",
                        help="a lens in Lensfun's database, which the package lensfunpy contains")
    source.add_argument("--vignetting", type=Path, metavar="FILE.csv",
                        help=f"a table with the columns {', '.join(COLUMNS)}: metres or inf, the distance from the "
                             "axis on the sensor, and the light relative to the axis")
    source.add_argument("--flat", type=Path, nargs="+", metavar="RAW",
                        help="raw pictures of an even field (DNG, or others that LibRaw opens), one for each f-stop")
    source.add_argument("--typical", action="store_true",
                        help="without photographs: rims that give the lens the light of a typical lens for full frame")
    source.add_argument("--kit", action="store_true", help="write a page on how to take these photographs")
    fit.add_argument("--points", type=Path, nargs="+", metavar="RAW",
                     help="raw pictures of a distant point with the lens set to its closest distance: the shapes of "
                          "the discs check the rims, before and after a fit, or without one")
    fit.add_argument("-o", "--output", type=Path, metavar="FITTED.toml",
                     help="prescription to write; with --kit, the page, a .md file")
    raw = fit.add_argument_group("raw pictures")
    raw.add_argument("--f-numbers", metavar="LIST",
                     help="of the pictures, --flat before --points, for a lens that does not report them: 2,2.8,4")
    raw.add_argument("--focus", metavar="DISTANCE",
                     help="that the lens was set to for --flat, from its entrance pupil (default: inf)")
    raw.add_argument("--camera-sensor", metavar="WIDTHxHEIGHT",
                     help=f"of the camera in mm, or one of {', '.join(FORMATS)} (default: the sensor of the lens)")
    add_reading(fit)
    fit.set_defaults(run=_fit)


def _fit(options):
    _check_options(options)
    if options.kit:
        check_outputs([(options.output, ".md")])
        _write(options.output, KIT)
        return
    _check_lens(options.lens)
    given = [*(options.flat or []), *filter(None, [options.vignetting])]
    check_outputs([(options.output, ".toml")], [options.lens, *given, *(options.points or [])])
    prescription = prescription_of(lens_source(options, options.lens))
    pictures = _Pictures(options, prescription)
    discs = pictures.discs()
    if not options.output:
        _say_points(options, discs, {"this lens": prescription})
        return
    fitted = _fitted(options, prescription, pictures, given)
    _say_points(options, discs, {"before": prescription, "after": fitted})
    _write(options.output, write_prescription(fitted))


def _check_options(options):
    fits = any((options.lensfun, options.vignetting, options.flat, options.typical, options.kit))
    if not fits and not options.points:
        raise InputError("options", "photographs", "missing",
                         "give --flat, --vignetting, --lensfun or --points; or --typical, or --kit")
    if options.kit and options.points:
        raise InputError("options", "--points", "given with --kit", "write the page first")
    if options.focus and not options.flat:
        raise InputError("options", "--focus", options.focus, "omit it: it is the distance of --flat, and for "
                         "--points the lens is at its closest distance")
    for option, value in (("--f-numbers", options.f_numbers), ("--camera-sensor", options.camera_sensor)):
        if value and not (options.flat or options.points):
            raise InputError("options", option, value, "omit it: it is of raw pictures (--flat, --points)")
    if fits and not options.output:
        raise InputError("options", "--output", "missing", "name the file to write")
    if options.output and not fits:
        raise InputError("options", "--output", str(options.output), "--points only checks rims: omit --output, or "
                         "give the photographs to fit the rims to")


def _check_lens(name):
    if name is None:
        raise InputError("options", "lens", "missing", "give the name or the prescription of the lens")
    if not has_rings(name):
        raise InputError(name, "kind of file", "a lens package", "it contains no rims: give the lens's prescription")


def _write(path, text):
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
    say(path)


def _fitted(options, prescription, pictures, paths):
    """The lens with typical rims, or fitted to Lensfun's photographs or to the ones in files; prints the fit."""
    if options.typical:
        if not is_like_measured(prescription):
            say("warning: typical rims are measured for full frame, f/0.95 to f/5.6: this lens may have others")
        with errors_of(options.lens):
            return with_typical_rims(prescription)
    fit = _rim_fit(options, prescription, pictures, paths)
    say(*fit.lines())
    return fit.prescription


def _rim_fit(options, prescription, pictures, paths):
    if options.lensfun:
        photographed = find_photographed(options.lensfun)
        curves = vignetting_of(photographed, prescription)
        with errors_of(options.lens):
            return fit_rims(prescription, curves, f"Lensfun: {photographed.name}", date.today().isoformat())
    curves = read_vignetting(options.vignetting) if options.vignetting else pictures.flat_curves()
    with errors_of(options.lens):
        return fit_to_files(prescription, curves, paths)


class _Pictures:
    """The raw pictures among the options, with an f-number for each: `--flat` before `--points`."""

    def __init__(self, options, prescription):
        self._flat, self._points, self._prescription = options.flat or [], options.points or [], prescription
        self._f_numbers = f_numbers_of(options.f_numbers or "", len(self._flat) + len(self._points))
        self._sensor_mm = format_mm(options.camera_sensor) if options.camera_sensor else None
        self._focus_mm = distance_mm(options.focus or "inf", "--focus")

    def flat_curves(self):
        """The curves of the flat fields; prints a line about each."""
        fields = list(read_flat_fields(self._flat, self._prescription, self._f_numbers[:len(self._flat)],
                                       self._sensor_mm, self._focus_mm))
        say(*fields)
        return [field.curve for field in fields]

    def discs(self):
        """The discs of points."""
        if not self._points:
            return []
        sensor_mm, focal_mm = camera_sensor_mm(self._prescription, self._sensor_mm), self._prescription.focal_length_mm
        return [read_point(path, sensor_mm, focal_mm, f_number) for path, f_number in
                zip(self._points, self._f_numbers[len(self._flat):], strict=True)]


def _say_points(options, discs, lenses):
    with errors_of(options.lens):
        say(*compare_points(discs, lenses))
