"""Arguments that several commands share: options of the engine, sizes, and output files."""

import os
import sys
from argparse import BooleanOptionalAction
from math import inf, isfinite
from pathlib import Path

from lensfield.engine import InputError, Options
from lensfield.engine.lens.iris import Iris
from lensfield.engine.library import (
    ALL_LENSES,
    clamped_rings,
    fits_all_frames,
    has_rings,
    iris_is_visible,
    load_lens,
    pinhole_of,
)
from lensfield.engine.plan.options import KNOBS
from lensfield.engine.prescription.coatings import coating_of
from lensfield.engine.prescription.tolerances import copy_of
from lensfield.engine.rays.rings import Rings
from lensfield.engine.runtime.files import check_target, check_written_by_lensfield, identity
from lensfield.engine.runtime.setting import option_of, settings_of
from lensfield.engine.spectral.spectra import parse_wavelengths
from lensfield.engine.stray.options import StrayOptions

from ..request import CAMERA, RING_FIELDS, RenderRequest
from .prescription_file import add_reading, errors_of, lens_source
from .terminal import progress_bar, say

RESOLUTION_LIMITS = (4, 65536)
LENSES = "a bundled lens, a lens package, or a prescription"
NO_CAMERA = "none"
TIME_LIMIT_S = 3600.0
WITHOUT_CAMERA = {"focus": "from the prescription, usually infinity", "f_number": "the widest",
                  "tilt_deg": "0,0", "copy": "0", "copy_grade": "vintage", "coating": "lens",
                  "lens_quality": "standard"}
"""Default rings in commands without a scene, as text."""
MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}


def add_settings(group, owner, names, unset=None):
    """Add options for settings of a dataclass, as their fields define them; options that are not given are None.

    Parameters
    ----------
    group : argparse parser or group
    owner : type
    names : iterable of str
    unset : dict of str: str, optional
        Replaces `Setting.unset`.
    """
    for name in names:
        each = settings_of(owner)[name]
        applies = (unset or {}).get(name, each.unset) or (each.default if each.choices else "")
        text = ". ".join(filter(None, (each.text, each.choices_text))) + (f" (default: {applies})" if applies else "")
        kind = {"action": BooleanOptionalAction} if each.kind is bool else {
            "type": None if each.kind is float and name in PARSERS else each.kind, "metavar": each.metavar,
            "choices": (not each.metavar and tuple(each.choices)) or None}
        group.add_argument(f"--{option_of(name, each)}", default=None, help=text.replace("%", "%%"), **kind)


def given_settings(options, owner):
    """The settings of a dataclass that the command line gives, by field name."""
    values = {name: getattr(options, option_of(name, each).replace("-", "_"), None)
              for name, each in settings_of(owner).items() if each.option is not None}
    return {name: value for name, value in values.items() if value is not None}


def given_fields(options):
    """The fields of a RenderRequest that the command line gives, parsed; except `iris`, `options`, `spectral` and
    `stray`."""
    return {name: PARSERS[name](value) if name in PARSERS else value
            for name, value in given_settings(options, RenderRequest).items()}


def scene_defaults(owner):
    """Help texts of defaults in commands on a scene: from the scene or its camera, for each setting that is a Blender
    property."""
    return {name: f"from the {each.owner}" for name, each in settings_of(owner).items() if each.panel is not None}


def add_engine_options(command, of_scene=False):
    """Add options for the lens, the report, and every field of `Options`."""
    command.add_argument("--lens", required=not of_scene, metavar="NAME|FILE", help=f"{LENSES} ({ALL_LENSES})")
    add_filter_options(command, of_scene)


def add_filter_options(command, of_scene=False):
    """Add options for the report, and for every field of `Options`."""
    command.add_argument("--report", type=Path, metavar="FILE.json",
                         help="write a report: the seconds of each stage, the plan, and the light in and out")
    add_accuracy(command, of_scene)


def add_accuracy(command, of_scene=False):
    """Add options for every field of `Options`."""
    unset = scene_defaults(Options) if of_scene else None
    add_settings(command, Options, ["out_of_field", "fireflies", "detail"], unset)
    add_settings(command.add_argument_group("accuracy"), Options, ["accuracy", "method", "supersampling"], unset)
    advanced = command.add_argument_group("advanced options", "giving any of them disables the choice by accuracy")
    add_settings(advanced, Options, KNOBS)


def add_lens_settings(command, camera=False):
    """Add options for the lens's file, focus, f-stop and quality; with `camera`, the scene's camera sets the defaults
    of focus and f-stop."""
    add_reading(command)
    add_rings(command, camera)


def add_rings(command, camera=False, fields=RING_FIELDS):
    """Add options for focus, f-stop, tilt, copy, coating and lens quality; with `camera`, the scene sets the
    defaults."""
    group = command.add_argument_group("rings", "for lenses with a prescription; the lens is baked and cached "
                                                "(lensfield lens cache)")
    add_settings(group, RenderRequest, [*fields, "lens_quality"], None if camera else WITHOUT_CAMERA)


def add_iris(command, camera=False):
    """Add options for the blades of the lens's iris."""
    group = command.add_argument_group("iris", "for out-of-focus light through a lens that is stopped down; the "
                                               "opening has the round stop's area")
    unset = {"blades": "the camera's Aperture if its Depth of Field is on"} if camera else None
    add_settings(group, Iris, settings_of(Iris), unset)


def add_stray(command, of_scene=False):
    """Add options for stray light."""
    group = command.add_argument_group("stray light", "that is added to the lens image, and a layer in its file "
                                                      "(docs/stray_light.md)")
    add_settings(group, StrayOptions, settings_of(StrayOptions), scene_defaults(StrayOptions) if of_scene else None)


def stray_option(options):
    """The StrayOptions of the command line."""
    return StrayOptions(**given_settings(options, StrayOptions))


def iris_option(options):
    """The Iris of the command line, or None if it is not given."""
    given = given_settings(options, Iris)
    for name, value in given.items() if "blades" not in given else ():
        raise InputError("options", f"--{option_of(name, settings_of(Iris)[name])}", value, "also give --iris-blades")
    return Iris(**given) if given else None


def shown_iris(options):
    """The Iris of the command line if the lens is stopped down; None for a round stop."""
    iris = iris_option(options)
    return iris if iris and iris_is_visible(lens_source(options, options.lens), rings_option(options)) else None


def distance_mm(text, option="--focus"):
    """Parse a distance such as 1.2m; returns millimetres."""
    word = text.strip().lower()
    unit = next((unit for unit in MM if word.endswith(unit)), "")
    try:
        if not unit and word not in ("inf", "infinity"):
            raise ValueError
        length_mm = float(word.removesuffix(unit)) * MM.get(unit, 1.0)
        if not length_mm > 0:
            raise ValueError
    except ValueError:
        raise InputError("options", option, text,
                         "expected a distance with its unit, such as 1.2m, or inf") from None
    return length_mm


def _focus(text):
    """The RenderRequest's value for --focus."""
    return CAMERA if text.lower() == CAMERA else distance_mm(text)


def _number_or_auto(option, expected):
    """A parser of a positive number, a fraction such as 1/60, or "auto", which is 0."""
    def parsed(text):
        try:
            over, _, under = str(text).lower().removesuffix("s").partition("/")
            value = 0.0 if str(text).lower() == "auto" else float(over) / float(under or 1)
            if not 0 <= value < inf:
                raise ValueError
        except (ValueError, ZeroDivisionError):
            raise InputError("options", option, text, expected) from None
        return value

    return parsed


def _camera(text):
    """The RenderRequest's value for --camera."""
    return "" if text.lower() == NO_CAMERA else text


def _tilt(text):
    """The RenderRequest's value for --tilt."""
    return number_pair(text, "--tilt")


PARSERS = {"focus": _focus, "camera": _camera, "tilt_deg": _tilt,
           "iso": _number_or_auto("--iso", "expected a positive number such as 800, or auto"),
           "shutter_s": _number_or_auto("--shutter", "expected seconds such as 1/60 or 0.5, or auto"),
           "wavelengths_nm": parse_wavelengths, "output_folder": Path.resolve}
"""Functions that parse option texts into values of fields; they raise InputError for invalid texts."""


def rings_option(options):
    """The Rings of the command line: focus, f-stop, tilt, copy and coating."""
    return Rings(None if options.focus is None else distance_mm(options.focus), options.f_number,
                 bool(options.focused_wide_open), tilt_deg=_tilt(options.tilt or "0,0"),
                 copy=copy_of(options.copy or 0, options.copy_grade or RenderRequest.copy_grade),
                 coating=coating_of(options.coating or RenderRequest.coating))


def chosen_lens(options, frame_of=None, wavelengths_nm=None):
    """The lens of the command line, at its focus and f-stop; first prints notes on values that the lens cannot reach.

    Parameters
    ----------
    options : Namespace
    frame_of : function (Pinhole), optional
        The frame of the pictures on the sensor of a lens: a PixelGrid.
    wavelengths_nm : sequence of float, optional
        As for `load_lens`.
    """
    source, rings = lens_source(options, options.lens), rings_option(options)
    with errors_of(options.lens):
        words = clamped_rings(source, rings) if has_rings(source) else ()
    say_clamped(words)
    with errors_of(options.lens), progress_bar() as on_progress:
        edges_mm = None
        if frame_of and not fits_all_frames(source, rings):
            edges_mm = frame_of(pinhole_of(source, rings)).edges_mm
        return load_lens(source, rings, options.lens_quality or "standard", on_progress, wavelengths_nm, edges_mm)


def say_clamped(words):
    """Print notes on values that a lens cannot reach, apart from the output of a command."""
    say(*(f"lens: {line}" for line in dict.fromkeys(words)), file=sys.stderr)


def engine_options(options):
    """The Options of the command line; the engine chooses the rest."""
    return Options(**given_settings(options, Options))


def number_pair(text, option):
    """Parse two numbers such as 1.5,-0.2."""
    try:
        first, second = map(float, text.split(","))
        if not (isfinite(first) and isfinite(second)):
            raise ValueError
    except ValueError:
        raise InputError("options", option, text, "expected two numbers, such as 1.5,-0.2") from None
    return first, second


def resolution(text, option="--resolution"):
    """Parse a size such as 768x576; returns (width, height)."""
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
    """Raise an InputError for a file that cannot or should not be written, before the work starts.

    Parameters
    ----------
    outputs : iterable of (path or None, suffix)
        Files to write, and the suffix that their contents require. An output may not be an input or another output,
        also if the names differ by links, relative paths or letter case.
    inputs : iterable of (path or str)
        Files to read; anything that is not a file, such as the name of a bundled lens, is ignored.
    """
    taken = {identity(path): "one of the inputs" for path in inputs if os.path.isfile(path)}
    for path, suffix in outputs:
        if path is None:
            continue
        if path.suffix.lower() != suffix:
            raise InputError(path, "suffix", path.suffix or "missing", f"expected {suffix}")
        check_target(path, overwrite=True)
        if (file := identity(path)) in taken:
            raise InputError(path, "file", taken[file], "use a different name for each output")
        taken[file] = "named twice"
        check_written_by_lensfield(path)


def check_limits(option, value, limits):
    """Raise an InputError for a number outside the limits."""
    if not limits[0] <= value <= limits[1]:
        raise InputError("options", option, value, "expected {} to {}".format(*limits))


def add_untrusted(command):
    """Add arguments for commands that read untrusted .blend files or pictures."""
    group = command.add_argument_group("untrusted files", "for farms and services (docs/farm.md)")
    group.add_argument("--untrusted", action="store_true",
                       help="read only below the folder of the scene or picture and below --root, write only below "
                            "--output, run no scripts of the .blend, and stop at the limits")
    group.add_argument("--root", type=Path, action="append", metavar="DIR",
                       help="with --untrusted: another folder to read from; can be repeated")
    group.add_argument("--time-limit", type=float, metavar="SECONDS",
                       help=f"with --untrusted: stop after this time (default: {TIME_LIMIT_S:g})")
    group.add_argument("--memory-limit", type=float, metavar="GB",
                       help="with --untrusted: limit on address space; not on Windows (default: the free memory)")


def output_given(options):
    """The folder of --output; raises an InputError without it."""
    if options.output is None:
        raise InputError("options", "--output", "not given", "required, because --untrusted writes only below it")
    return options.output
