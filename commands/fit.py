"""`lensfield lens fit`: rims of a lens fitted to photographs of even fields."""

from datetime import date
from pathlib import Path

from ..engine import InputError
from ..engine.fitting.fit import fit_rims, fit_to_files
from ..engine.fitting.flat_fields import read_flat_fields
from ..engine.fitting.lensfun import find_photographed, vignetting_of
from ..engine.fitting.typical import is_like_measured, with_typical_rims
from ..engine.fitting.vignetting import COLUMNS, read_vignetting
from ..engine.lens.formats import FORMATS, format_mm
from ..engine.library import has_rings, prescription_of
from ..engine.prescription.readers.toml import write_prescription
from ..engine.runtime.files import atomic_path
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
    source = fit.add_mutually_exclusive_group(required=True)
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
    fit.add_argument("-o", "--output", type=Path, required=True, metavar="FITTED.toml",
                     help="prescription to write; with --kit, the page, a .md file")
    flat = fit.add_argument_group("flat fields")
    flat.add_argument("--f-numbers", metavar="LIST",
                      help="of the pictures, in their order, for a lens that does not report them: 2,2.8,4")
    flat.add_argument("--focus", metavar="DISTANCE",
                      help="that the lens was set to, from its entrance pupil (default: inf)")
    flat.add_argument("--camera-sensor", metavar="WIDTHxHEIGHT",
                      help=f"of the camera in mm, or one of {', '.join(FORMATS)} (default: the sensor of the lens)")
    add_reading(fit)
    fit.set_defaults(run=_fit)


def _fit(options):
    if options.kit:
        check_outputs([(options.output, ".md")])
        _write(options.output, KIT)
        return
    _check_lens(options.lens)
    given = options.flat or [path for path in [options.vignetting] if path]
    check_outputs([(options.output, ".toml")], [options.lens, *given])
    prescription = prescription_of(lens_source(options, options.lens))
    if options.typical:
        _write_typical(options, prescription)
        return
    fit = _fitted(options, prescription, given)
    say(*fit.lines())
    _write(options.output, write_prescription(fit.prescription))


def _write_typical(options, prescription):
    if not is_like_measured(prescription):
        say("warning: typical rims are measured for full frame, f/0.95 to f/5.6: this lens may have others")
    with errors_of(options.lens):
        _write(options.output, write_prescription(with_typical_rims(prescription)))


def _check_lens(name):
    if name is None:
        raise InputError("options", "lens", "missing", "give the name or the prescription of the lens")
    if not has_rings(name):
        raise InputError(name, "kind of file", "a lens package", "it contains no rims: give the lens's prescription")


def _write(path, text):
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
    say(path)


def _fitted(options, prescription, paths):
    """The fit to Lensfun's photographs or to the ones in files."""
    if options.lensfun:
        photographed = find_photographed(options.lensfun)
        curves = vignetting_of(photographed, prescription)
        with errors_of(options.lens):
            return fit_rims(prescription, curves, f"Lensfun: {photographed.name}", date.today().isoformat())
    curves = read_vignetting(options.vignetting) if options.vignetting else _flat_curves(options, prescription)
    with errors_of(options.lens):
        return fit_to_files(prescription, curves, paths)


def _flat_curves(options, prescription):
    """The curves of the raw pictures; prints a line about each."""
    sensor_mm = format_mm(options.camera_sensor) if options.camera_sensor else None
    fields = list(read_flat_fields(options.flat, prescription, options.f_numbers or "", sensor_mm,
                                   distance_mm(options.focus or "inf", "--focus")))
    say(*fields)
    return [field.curve for field in fields]
