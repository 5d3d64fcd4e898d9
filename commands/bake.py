"""`lensfield lens bake` and `lens convert`: from what a lens is made of to its lens data, or to a file of our own."""

import math
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from ..engine import InputError, LensError
from ..engine.bake.bake import LEAST_SAMPLES, MOST_SAMPLES, focused
from ..engine.bake.bake import bake as bake_lens
from ..engine.bake.prescription import FOCUSES
from ..engine.bake.prescriptions import read_prescription
from ..engine.bake.prescriptions.toml import write_prescription
from ..engine.bake.quality import QUALITIES
from ..engine.bake.rings import Rings, turned
from ..engine.files import MARK, atomic_path
from ..engine.lens.readers.package import write_package
from ..engine.lens.sampling import WAVELENGTHS
from ..engine.library import bundled_names, prescription_of
from ..engine.spectral.spectra import parse_wavelengths
from .arguments import check_outputs, distance_mm, sides_mm
from .terminal import progress_bar


def add(commands):
    bake = commands.add_parser("bake", help="trace a prescription to a lens package")
    _add_file(bake)
    bake.add_argument("-o", "--output", type=Path, required=True, metavar="X.npz")
    bake.add_argument("--quality", choices=QUALITIES, default="standard",
                      help="how finely heights, rays and sums lie (default %(default)s)")
    bake.add_argument("--heights", type=int, metavar="N",
                      help="field heights, closest where blur changes fastest (default: as the quality needs, up to "
                           + ", ".join(f"{each.most_heights} of {name}" for name, each in QUALITIES.items()) + ")")
    bake.add_argument("--wavelengths", default=WAVELENGTHS, metavar="SPEC",
                      help="nm: first:last:number, or a list (default %(default)s)")
    bake.add_argument("--pitch", type=float, metavar="UM",
                      help="of the PSF samples (default: the finest that keeps 99.5 %% of the light inside)")
    bake.add_argument("--samples", type=int, metavar="N",
                      help=f"of each PSF, odd (default: {LEAST_SAMPLES} to {MOST_SAMPLES}, as a picture's pixels need)")
    bake.add_argument("--focus", metavar="DISTANCE",
                      help="turn the focus ring: 1.2m, 80cm, 500mm or inf, from the entrance pupil")
    bake.add_argument("--object-distance", metavar="MM[,MM...]",
                      help="from the object to the first surface, or inf; the focus stays. Several make a set: one "
                           "package each, called after its distance")
    _add_overrides(bake.add_argument_group("in place of what the file says"))
    bake.add_argument("--workers", type=int, metavar="N", help="threads (default: one on each core)")
    bake.set_defaults(run=_bake)
    convert = commands.add_parser("convert", help="another program's prescription to Lensfield's .toml")
    _add_file(convert)
    convert.add_argument("-o", "--output", type=Path, required=True, metavar="X.toml")
    _add_overrides(convert.add_argument_group("in place of what the file says"))
    convert.set_defaults(run=_convert)


def _add_file(command):
    command.add_argument("prescription", type=Path, metavar="NAME|FILE",
                         help="a bundled lens, Lensfield .toml, Zemax .zmx, Code V .seq, pbrt .dat, Optical Bench "
                              ".txt, .lens, or .json of Optiland, DeepLens or lentil")
    command.add_argument("--which", metavar="NUMBER",
                         help="of a file that holds several: the position of zoom and focus (Optical Bench; default: "
                              "the first for infinity), or the lens (lentil)")


def _add_overrides(group):
    add_field(group)
    group.add_argument("--f-number", type=float, metavar="N", help="set the stop to this f-number")
    group.add_argument("--image-plane", choices=FOCUSES, help="where it lies")
    group.add_argument("--glass", action="append", default=[], metavar="OLD=NEW",
                       help="another name, or n/V, for a glass of the file; may be repeated")
    group.add_argument("--sensor", metavar="WIDTHxHEIGHT", help="mm")
    group.add_argument("--name", help="what the lens is called")


def add_field(command):
    """Where the field ends, of a prescription that does not say."""
    field = command.add_mutually_exclusive_group()
    field.add_argument("--field-angle", type=float, metavar="DEG", help="half angle where the field ends")
    field.add_argument("--field-height", type=float, metavar="MM", help="paraxial image height where it ends")


def _bake(options):
    wavelengths_nm = parse_wavelengths(options.wavelengths)
    _check(options)
    with _errors_of(options.prescription):
        targets = _targets(_focused(_asked_for(options), options), options)
    check_outputs([(path, ".npz") for path in targets], [options.prescription])
    for path, single in targets.items():
        with _errors_of(options.prescription), progress_bar() as tell:
            lens = bake_lens(single, quality=options.quality, heights=options.heights, wavelengths_nm=wavelengths_nm,
                             pitch_um=options.pitch, samples=options.samples, workers=options.workers, progress=tell)
        write_package(lens, path)
        print(f"{path}\n  {_summary(lens)}")


def _convert(options):
    with _errors_of(options.prescription):
        text = write_prescription(_asked_for(options))
    check_outputs([(options.output, ".toml")], [options.prescription])
    with atomic_path(options.output) as temporary:
        temporary.write_text(f"# {MARK}\n{text}", encoding="utf-8", newline="\n")
    print(options.output)


def _asked_for(options):
    """The file's prescription as the command line has it."""
    field, bundled = told_field(options), str(options.prescription) in bundled_names() and options.which is None
    prescription = (prescription_of(options.prescription, field) if bundled
                    else read_prescription(options.prescription, field, options.which))
    return _with_overrides(prescription, options)


def _focused(prescription, options):
    """The prescription with its focus ring turned, where that is asked for; what cannot be is printed."""
    if options.focus is None:
        return prescription
    there = turned(prescription, Rings(distance_mm(options.focus)))
    for line in there.words:
        print(f"lens: {line}")
    return there.prescription


def _check(options):
    if options.workers is not None and options.workers < 1:
        raise InputError("options", "--workers", options.workers, "expected at least 1")


@contextmanager
def _errors_of(path):
    """Errors about the prescription name its file, not the lens; those about a glass say how to call it otherwise."""
    try:
        yield
    except LensError as error:
        remedy = f"{error.remedy} (--glass OLD=NEW)" if error.field.endswith(", glass") else error.remedy
        raise LensError(path, error.field, error.value, remedy) from None


def told_field(options):
    """Where the command line says that the field ends, or None."""
    if options.field_angle is not None:
        return "angle_deg", options.field_angle
    return None if options.field_height is None else ("image_height_mm", options.field_height)


def _with_overrides(prescription, options):
    """The prescription as the command line changes it."""
    changes = {"name": options.name, "focus": options.image_plane,
               "aperture": None if options.f_number is None else ("f_number", options.f_number),
               "sensor_mm": None if options.sensor is None else sides_mm(options.sensor)}
    prescription = replace(prescription, **{field: value for field, value in changes.items() if value is not None})
    glasses = sorted({surface.glass for surface in prescription.surfaces} - {""})
    return prescription.with_glasses({old: new for pair in options.glass for old, new in _glass_names(pair, glasses)})


def _glass_names(pair, glasses):
    """(old, new) names of the glasses that OLD=NEW is about; OLD may go without the catalogue."""
    old, _, new = (word.strip() for word in pair.partition("="))
    named = [glass for glass in glasses if old in (glass, glass.split()[-1])]
    if not new or not named:
        raise InputError("options", "--glass", pair, f"expected OLD=NEW with one of {', '.join(glasses)}")
    return [(glass, new) for glass in named]


def _targets(prescription, options):
    """{file: prescription} of every object distance asked for; where there are several the focus stays."""
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
        raise InputError("options", "--object-distance", text, "expected mm, or inf") from None
    if len({f"{distance:g}" for distance in distances_mm}) < len(distances_mm):  # files are called by these
        raise InputError("options", "--object-distance", text, "expected each of them once")
    return distances_mm


def _summary(lens):
    """What came out, in one line."""
    wavelength, height = divmod(int(lens.enclosed_energy.argmin()), lens.heights_mm.size)
    return (f"f = {lens.efl_mm:.5g} mm, f/{lens.f_number_effective:.3g}, {lens.heights_mm.size} heights to "
            f"{lens.heights_mm[-1]:.4g} mm x {lens.wavelengths_nm.size} wavelengths; PSFs of {lens.psf.shape[-1]} x "
            f"{lens.psf.shape[-1]} samples of {lens.psf_pitch_um:g} um hold {lens.enclosed_energy.min():.2%} of the "
            f"light or more (the least at {lens.heights_mm[height]:.4g} mm, {lens.wavelengths_nm[wavelength]:g} nm)")
