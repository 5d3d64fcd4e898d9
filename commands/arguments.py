"""Arguments that several commands share: what the engine is asked for, sizes, and files to write."""

import os
from dataclasses import fields
from pathlib import Path

from ..engine import InputError, Options
from ..engine.bake.quality import QUALITIES
from ..engine.bake.rings import Rings
from ..engine.blur import METHODS
from ..engine.depth.pencils import Iris
from ..engine.files import check_ours, check_target, identity
from ..engine.library import ALL_LENSES, cannot_be, has_rings, iris_shows, load
from ..engine.plan.options import AUTO, DEFAULT_ACCURACY, FIREFLIES, MOST_SUPERSAMPLING, OUT_OF_FIELD, PRECISIONS
from .terminal import progress_bar

RESOLUTION_LIMITS = (4, 65536)
LENSES = "a bundled lens, a lens package, or a prescription"
CAMERA = "camera"
MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}


def add_engine_options(command, lens_required=True):
    """The lens, what is done out of field, the report, and every knob of `Options`."""
    command.add_argument("--lens", required=lens_required, metavar="NAME|FILE", help=f"{LENSES} ({ALL_LENSES})")
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
    group.add_argument("--method", choices=(AUTO, *METHODS),
                       help="PSFs from a table, interpolated in sections or pixel by pixel; one a section, as in the "
                            f"paper; or every pixel's own, exactly (default {Options.method})")
    group.add_argument("--supersampling", type=int, metavar="N",
                       help="filter the picture in N x N pixels for each one, where PSFs are finer than it; takes as "
                            f"long as a picture so much larger (1 to {MOST_SUPERSAMPLING}; "
                            f"default {Options.supersampling})")


def _add_knobs(group):
    """Each is None where it is not set: what it is then is the engine's business."""
    group.add_argument("--section-size", type=int, metavar="PX",
                       help="side of a section; by the paper's method smaller is more accurate and slower")
    group.add_argument("--azimuths", type=int, metavar="N", help="steps of the table of PSFs from 0 to 45 degrees")
    group.add_argument("--psf-energy", type=float, metavar="FRACTION", help="what is kept of each PSF, in a circle")
    group.add_argument("--flat-tolerance", type=float, metavar="FRACTION",
                       help="relative error up to which sections in even light are not filtered")
    group.add_argument("--precision", choices=PRECISIONS, help="auto: double where the light's range needs it")


def add_rings(command, camera=False):
    """What a lens is turned to; `camera` where there is one whose rings can be taken."""
    group = command.add_argument_group("rings", "of a lens of which there is a prescription; it is baked and kept in "
                                                "your cache folder (lensfield lens cache)")
    group.add_argument("--focus", metavar="DISTANCE",
                       help="1.2m, 80cm, 500mm or inf, from the camera, which stands at the entrance pupil; "
                            + ("or camera, for its own even where its depth of field is off" if camera else
                               "default: what the prescription is given for, mostly infinity"))
    group.add_argument("--f-number", type=float, metavar="N", help="default: " + (
        "the camera's F-Stop where its depth of field is on, else the widest" if camera else "the widest"))
    group.add_argument("--focused-wide-open", action="store_true",
                       help="focus at the widest aperture, and stop down after that: the focus shift shows")
    group.add_argument("--lens-quality", choices=QUALITIES,
                       help="how finely the lens is baked (default: " + ("as the tier" if camera else "standard") + ")")


def add_iris(command, camera=False):
    """The blades of the lens."""
    group = command.add_argument_group("iris", "of a lens that is stopped down below its widest, for what is out of "
                                               "focus")
    group.add_argument("--iris-blades", type=int, metavar="N", help="0 for a round stop (default: " + (
        "the camera's Aperture, where its depth of field is on)" if camera else "0)"))
    group.add_argument("--iris-rotation", type=float, metavar="DEG", help="of them, anticlockwise (default: 0)")
    group.add_argument("--iris-roundness", type=float, metavar="0..1",
                       help="from straight blades to a circle (default: 0)")


def asked_iris(options):
    """The blades of the command line; None where it says nothing of them."""
    if options.iris_blades is None:
        for option, value in (("--iris-rotation", options.iris_rotation), ("--iris-roundness", options.iris_roundness)):
            if value is not None:
                raise InputError("options", option, value, "give --iris-blades, too")
        return None
    return Iris(options.iris_blades, options.iris_rotation or 0.0, options.iris_roundness or 0.0)


def shown_iris(options):
    """The blades of the command line, where its lens is stopped down; None for a round stop."""
    iris = asked_iris(options)
    return iris if iris and iris_shows(options.lens, asked_rings(options)) else None


def distance_mm(text, option="--focus"):
    """A distance in mm from a text such as 1.2m."""
    word = text.strip().lower()
    unit = next((unit for unit in MM if word.endswith(unit)), "")
    try:
        if not unit and word not in ("inf", "infinity"):
            raise ValueError
        asked_mm = float(word.removesuffix(unit)) * MM.get(unit, 1.0)
        if not asked_mm > 0:
            raise ValueError
    except ValueError:
        raise InputError("options", option, text,
                         "expected a distance with its unit, such as 1.2m, or inf") from None
    return asked_mm


def asked_rings(options):
    """What the command line turns a lens to."""
    return Rings(None if options.focus is None else distance_mm(options.focus), options.f_number,
                 options.focused_wide_open)


def chosen_lens(options):
    """The lens of the command line, turned as it says; what cannot be is printed."""
    rings = asked_rings(options)
    with progress_bar() as tell:
        lens = load(options.lens, rings, options.lens_quality or "standard", tell)
    for line in cannot_be(options.lens, rings) if has_rings(options.lens) else ():
        print(f"lens: {line}")
    return lens


def given_options(options):
    """What the command line says of the engine's Options, by name."""
    named = {field.name: getattr(options, field.name, None) for field in fields(Options)}
    return {name: value for name, value in named.items() if value is not None}


def engine_options(options):
    """What the command line asks for; what it leaves open is the engine's to choose."""
    return Options(**given_options(options))


def resolution(text, option="--resolution"):
    """(width, height) from a text such as 768x576."""
    least, most = RESOLUTION_LIMITS
    try:
        width, height = (int(side) for side in text.lower().split("x"))
        if not least <= min(width, height) <= max(width, height) <= most:
            raise ValueError
    except ValueError:
        raise InputError("options", option, text,
                         f"expected WIDTHxHEIGHT such as 768x576, each {least} to {most}") from None
    return width, height


def check_outputs(outputs, inputs=()):
    """Raise an InputError for a file that could not or should not be written, before the work is done.

    Parameters
    ----------
    outputs : iterable of (path or None, suffix)
        Files to write, and what they have to be called by what goes into them. None of them may be an input or another
        output, whatever links, relative paths or letter case they are named by.
    inputs : iterable of (path or str)
        Files that are read; what is no file, such as the name of a bundled lens, does not count.
    """
    taken = {identity(path): "one of the inputs" for path in inputs if os.path.isfile(path)}
    for path, suffix in outputs:
        if path is None:
            continue
        if path.suffix.lower() != suffix:
            raise InputError(path, "kind of file", path.suffix or "without a suffix", f"expected a {suffix}")
        check_target(path, own=True)
        if (file := identity(path)) in taken:
            raise InputError(path, "file", taken[file], "give every output a name of its own")
        taken[file] = "named twice"
        check_ours(path)


def sides_mm(text):
    """Width and height of a sensor from a text such as 36x24."""
    try:
        width, height = (float(side) for side in text.lower().split("x"))
    except ValueError:
        raise InputError("options", "--sensor", text, "expected WIDTHxHEIGHT in mm, such as 36x24") from None
    return width, height
