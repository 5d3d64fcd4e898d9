"""`lensfield lens bake` and `lens convert`: from a prescription to lens data, or to a Lensfield .toml file."""

import math
import sys
from dataclasses import replace
from pathlib import Path

from lensfield.engine import InputError
from lensfield.engine.bake.bake import bake as bake_lens
from lensfield.engine.bake.quality import QUALITIES
from lensfield.engine.bake.sampling import LEAST_SAMPLES, MOST_SAMPLES
from lensfield.engine.inspection.info import table_summary
from lensfield.engine.lens.conventions import WAVELENGTHS
from lensfield.engine.lens_files.package import write_package
from lensfield.engine.library import bundled_names, prescription_path
from lensfield.engine.prescription.readers import READABLE, read_prescription
from lensfield.engine.prescription.readers.toml import write_prescription
from lensfield.engine.rays.focus import focused
from lensfield.engine.rays.rings import Rings, turned
from lensfield.engine.runtime.files import atomic_path
from lensfield.engine.spectral.spectra import parse_wavelengths

from .arguments import check_outputs, distance_mm, say_clamped
from .prescription_file import add_reading, errors_of, reading_options
from .terminal import progress_bar, say


def add(commands):
    bake = commands.add_parser("bake", help="trace a prescription and write a lens package")
    _add_file(bake)
    bake.add_argument("-o", "--output", type=Path, required=True, metavar="X.npz", help="lens package to write")
    bake.add_argument("--quality", choices=QUALITIES, default="standard",
                      help="density of field heights, rays and PSF sums (default: %(default)s)")
    bake.add_argument("--heights", type=int, metavar="N",
                      help="number of field heights, closest where blur changes fastest (default: by quality, up to "
                           + ", ".join(f"{each.most_heights} for {name}" for name, each in QUALITIES.items()) + ")")
    bake.add_argument("--wavelengths", default=WAVELENGTHS, metavar="SPEC",
                      help="in nm: first:last:number, or a list (default: %(default)s)")
    bake.add_argument("--pitch", type=float, metavar="UM",
                      help="pitch of the PSF samples (default: the finest that keeps 99.5 %% of the light inside)")
    bake.add_argument("--samples", type=int, metavar="N",
                      help=f"samples across each PSF, odd (default: {LEAST_SAMPLES} to {MOST_SAMPLES}, by the pixels "
                           "of a picture)")
    bake.add_argument("--focus", metavar="DISTANCE",
                      help="focus distance from the entrance pupil: 1.2m, 80cm, 500mm or inf")
    bake.add_argument("--object-distance", metavar="MM[,MM...]",
                      help="distance from the object to the first surface, or inf; the focus stays the same. Several "
                           "distances write one package each, named after its distance")
    bake.add_argument("--workers", type=int, metavar="N", help="number of threads (default: one for each core)")
    bake.set_defaults(run=_bake)
    convert = commands.add_parser("convert", help="convert a prescription of another program to a Lensfield .toml")
    _add_file(convert)
    convert.add_argument("-o", "--output", type=Path, required=True, metavar="X.toml", help="prescription to write")
    convert.set_defaults(run=_convert)


def _add_file(command):
    command.add_argument("prescription", type=Path, metavar="NAME|FILE",
                         help=f"a bundled lens, {READABLE}")
    command.add_argument("--f-number", type=float, metavar="N", help="set the stop to this f-number")
    command.add_argument("--name", help="name of the lens")
    add_reading(command)


def _bake(options):
    wavelengths_nm = parse_wavelengths(options.wavelengths)
    _check(options)
    with errors_of(options.prescription):
        prescription = _requested_prescription(options)
        targets = _targets(_focused(prescription, options), options)
    _print_notes(options, prescription)
    check_outputs([(path, ".npz") for path in targets], [options.prescription])
    for path, single in targets.items():
        with errors_of(options.prescription), progress_bar() as on_progress:
            lens = bake_lens(single, quality=options.quality, heights=options.heights, wavelengths_nm=wavelengths_nm,
                             pitch_um=options.pitch, samples=options.samples, workers=options.workers,
                             progress=on_progress)
        write_package(lens, path)
        say(path, f"  {table_summary(lens)}")


def _convert(options):
    with errors_of(options.prescription):
        prescription = _requested_prescription(options)
    text = write_prescription(prescription)
    check_outputs([(options.output, ".toml")], [options.prescription])
    with atomic_path(options.output) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
    say(options.output)
    _print_notes(options, prescription)


def _print_notes(options, prescription):
    """Print the reader's notes on the file; the notes of bundled lenses do not come from a reader."""
    if prescription.notes and str(options.prescription) not in bundled_names():
        say(f"notes: {prescription.notes}", file=sys.stderr)


def _requested_prescription(options):
    """The file's prescription, with the changes that the command line requests."""
    prescription = read_prescription(prescription_path(options.prescription), reading_options(options))
    changes = {"name": options.name, "aperture": None if options.f_number is None else ("f_number", options.f_number)}
    return replace(prescription, **{field: value for field, value in changes.items() if value is not None})


def _focused(prescription, options):
    """The prescription, focused as `--focus` requests; prints notes on values that the lens cannot reach."""
    if options.focus is None:
        return prescription
    lens = turned(prescription, Rings(distance_mm(options.focus)))
    say_clamped(lens.words)
    return lens.prescription


def _check(options):
    if options.workers is not None and options.workers < 1:
        raise InputError("options", "--workers", options.workers, "expected at least 1")


def _targets(prescription, options):
    """{file: prescription} for each object distance; the focus does not depend on the distance."""
    if options.object_distance is None:
        return {options.output: prescription}
    distances_mm = _distances_mm(options.object_distance)
    prescription = focused(prescription)
    if len(distances_mm) == 1:
        return {options.output: replace(prescription, object_distance_mm=distances_mm[0])}
    names = ["inf" if math.isinf(distance) else f"{distance:g}mm" for distance in distances_mm]
    return {options.output.with_stem(f"{options.output.stem}_{name}"):
            replace(prescription, object_distance_mm=distance)
            for name, distance in zip(names, distances_mm, strict=True)}


def _distances_mm(text):
    """Object distances from a list such as 500,1000,inf."""
    try:
        distances_mm = [float(word) for word in text.split(",")]
    except ValueError:
        raise InputError("options", "--object-distance", text, "expected distances in mm, or inf") from None
    if len({f"{distance:g}" for distance in distances_mm}) < len(distances_mm):  # file names contain these
        raise InputError("options", "--object-distance", text, "expected each distance once")
    return distances_mm
