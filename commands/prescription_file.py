"""Options for reading a prescription file: values that it does not state, or that replace its own."""

from contextlib import contextmanager

from lensfield.engine import InputError, LensError
from lensfield.engine.lens.formats import FORMATS, format_mm
from lensfield.engine.library import bundled_names, has_rings
from lensfield.engine.prescription.prescription import FOCUSES
from lensfield.engine.prescription.readers import AS_IT_IS, SEMI_DIAMETERS, ReadingOptions, read_prescription

NAMES = ("field_angle", "field_height", "which", "glass", "stop", "image_plane", "sensor", "semi_diameters",
         "allow_mismatch")


def add_reading(command):
    """Add the options for reading a prescription file."""
    group = command.add_argument_group(
        "prescription files", "what the file of the lens does not state, and values that replace its own; not for "
                              "bundled lenses and lens packages")
    field = group.add_mutually_exclusive_group()
    field.add_argument("--field-angle", type=float, metavar="DEG", help="half angle at the edge of the field")
    field.add_argument("--field-height", type=float, metavar="MM",
                       help="paraxial image height at the edge of the field")
    group.add_argument("--which", metavar="NUMBER",
                       help="selects one of several in a file: the position of zoom and focus (Optical Bench; "
                            "default: the first for infinity), or the lens (lentil)")
    group.add_argument("--glass", action="append", metavar="OLD=NEW",
                       help="another name, or n/V, for a glass of the file; can be repeated")
    group.add_argument("--stop", type=int, metavar="N",
                       help="number of the surface that is the aperture stop, from 1")
    group.add_argument("--image-plane", choices=FOCUSES, help="position of the image plane")
    group.add_argument("--sensor", metavar="WIDTHxHEIGHT", help=f"sensor size in mm, or one of {', '.join(FORMATS)}")
    group.add_argument("--semi-diameters", choices=SEMI_DIAMETERS,
                       help="whether fixed semi-diameters of Zemax surfaces without CLAP or FLAP are clear apertures "
                            f"or stop no light (default: {SEMI_DIAMETERS[0]})")
    group.add_argument("--allow-mismatch", action="store_true", default=None,
                       help="accept a file whose stated focal length or f-number differs from its surfaces'; the "
                            "lens's notes then give both")


def given_reading(options):
    """The names of the options for reading a prescription file that the command line gives."""
    return [name for name in NAMES if getattr(options, name, None) is not None]


def reading_options(options):
    """The ReadingOptions of the command line."""
    sensor_mm = None if options.sensor is None else format_mm(options.sensor)
    return ReadingOptions(_field(options), options.which, options.semi_diameters, tuple(options.glass or ()),
                          options.stop, options.image_plane, sensor_mm, bool(options.allow_mismatch))


def _field(options):
    """The end of the field, as `Prescription.field`, or None."""
    if options.field_angle is not None:
        return "angle_deg", options.field_angle
    return None if options.field_height is None else ("image_height_mm", options.field_height)


def lens_source(options, name_or_path):
    """A lens for `load_lens`: its name or path or, with options for reading its file, its prescription.

    Raises
    ------
    InputError
        As `reading_options_for`.
    LensError
        As `read_prescription`.
    """
    reading = reading_options_for(name_or_path, options)
    return name_or_path if reading == AS_IT_IS else read_prescription(name_or_path, reading)


def reading_options_for(name_or_path, options):
    """The ReadingOptions of the command line; raises an InputError if it gives any for a bundled lens or a package."""
    given = given_reading(options)
    if given and (str(name_or_path) in bundled_names() or not has_rings(name_or_path)):
        value = getattr(options, given[0])
        raise InputError(name_or_path, f"--{given[0].replace('_', '-')}", value[0] if given[0] == "glass" else value,
                         "applies to prescription files only: leave it out")
    return reading_options(options)


@contextmanager
def errors_of(path):
    """Make errors about a prescription name its file, not the lens."""
    try:
        yield
    except LensError as error:
        raise error.at(path) from None
