"""`lensfield compare`: one capture of a scene through several lenses, as pictures and as a contact sheet."""

import os
from pathlib import Path

from lensfield.engine import InputError, Options
from lensfield.engine.library import ALL_LENSES
from lensfield.engine.plan.options import KNOBS, TIER_ACCURACY
from lensfield.engine.runtime.setting import option_of, settings_of
from lensfield.engine.spectral.wavelength_choice import SpectralOptions

from ..request import CAMERA_FIELDS, RING_FIELDS, RenderRequest
from .arguments import (
    LENSES,
    add_filter_options,
    add_iris,
    add_rings,
    add_stray,
    add_untrusted,
    check_outputs,
    given_fields,
    given_settings,
    iris_option,
    stray_option,
)
from .blend import import_addon
from .progress import messages, progress
from .render import add_followed, restore_copied, say_without_truth, scene_and_fields
from .render_options import add_capture_options
from .terminal import say

TIER = "preview"
OF_LENSES = "view", "output_folder", "truth", *CAMERA_FIELDS
"""Fields that the user does not set: every lens has the view of the scene's camera, and its own folder; the sheet shows
the light, and no ground truth."""
RINGS = tuple(name for name in RING_FIELDS if name != "f_number")
"""The fields of rings that all lenses share."""
OF_FILES = "tier", "depth", *RINGS, "lens_quality", "files", "look", "view_settings"
"""Fields that a radiance file can obey."""


def add_options(compare):
    compare.description = (
        "Render a .blend once, put the light through several lenses at several f-numbers, and write the pictures and "
        "a labelled sheet: a row for each lens, a column for each f-number. Every lens is scaled to the camera's view. "
        "Other options that you leave out come from the scene's Lensfield settings. The radiance file of an earlier "
        "render can replace the .blend.")
    compare.add_argument("scene", type=Path, metavar="SCENE.blend|RADIANCE.exr", help="file to render, or stored light")
    add_lenses(compare)
    compare.add_argument("--output", type=Path, required=True, metavar="DIR",
                         help="folder for the sheet and, in folders, the capture and the pictures")
    add_capture_options(compare, OF_LENSES, {"tier": TIER})
    add_filter_options(compare, of_scene=True)
    add_rings(compare, camera=True, fields=RINGS)
    add_iris(compare, camera=True)
    add_stray(compare, of_scene=True)
    add_followed(compare.add_argument_group("for programs that run this command"))
    add_untrusted(compare)
    compare.set_defaults(run=_compare, confines=_folders)


def add_lenses(command):
    """Add options for several lenses and f-numbers."""
    command.add_argument("--lens", dest="lenses", action="append", required=True, metavar="NAME|FILE,...",
                         help=f"lenses, each {LENSES} ({ALL_LENSES}); can be repeated")
    command.add_argument("--f-number", dest="f_numbers", metavar="N,...",
                         help="f-numbers for all lenses (default: the camera's F-Stop if its Depth of Field is on, "
                              "otherwise the widest of each lens)")


def _folders(options):
    """The scene or the radiance file, and the output folder."""
    return options.scene, options.output


def _compare(options):
    lenses = given_lenses(options)
    check_outputs([(options.report, ".json"), (options.picture, ".png")], [options.scene, *lenses])
    with messages(options) as write:
        f_numbers, of_file = given_f_numbers(options), options.scene.suffix.lower() == ".exr"
        source, given = (_from_file if of_file else _from_scene)(options)
        addon, folder = import_addon(), options.output.resolve()
        addon.check_next_to_frames(folder, options.report, options.picture)
        say(f"output: {folder}")
        if not of_file:
            say_without_truth(source)
        with progress(options, write) as on_progress:
            comparison = addon.plan_comparison(source, lenses, f_numbers, output_folder=folder, progress=on_progress,
                                               **given)
        for line in comparison.words:
            say(line)
        with progress(options, write) as on_progress:
            sheet = addon.render_comparison(comparison, on_progress)
        if options.report:
            sheet.report.write(options.report)
        say(*(line for line in sheet.messages if line not in comparison.words))
        write(sheet=str(sheet.path), messages=sheet.messages, cells=[
            {"lens": cell.lens, "f_number": cell.f_number, "label": cell.label, "box": box}
            for cell, box in sheet.cells])


def given_lenses(options):
    """The lenses of all --lens options: names and paths."""
    return [lens for text in options.lenses for lens in _lenses(text)]


def _lenses(text):
    """The lenses of one --lens: a file, whose name may contain commas, or names and files between commas."""
    lenses = [text] if os.path.exists(text) else [lens.strip() for lens in text.split(",")]
    if not all(lenses):
        raise InputError("options", "--lens", text, "expected names or files between commas, as in tessar-50mm,my.zmx")
    return lenses


def given_f_numbers(options):
    """The numbers of --f-number: list of float."""
    text = options.f_numbers
    try:
        return [float(word) for word in (text or "").split(",") if text]
    except ValueError:
        raise InputError("options", "--f-number", text, "expected numbers such as 2,5.6") from None


def _from_scene(options):
    """The scene, and the fields of a RenderRequest that the command line gives."""
    if not given_settings(options, SpectralOptions):
        options.tier = TIER
    scene, given = scene_and_fields(options)
    restore_copied(options)
    del given["output_folder"]
    return scene, given


def _from_file(options):
    """The radiance file, and the fields of a RenderRequest that the command line gives; raises an InputError for an
    option that only a render obeys."""
    named = {option_of(name, each): name for owner in (SpectralOptions, RenderRequest)
             for name, each in settings_of(owner).items()
             if each.option is not None and name not in (*OF_FILES, *OF_LENSES)}
    for option in (*named, "samples", "resolution", "scene-name"):
        if (value := getattr(options, option.replace("-", "_"), None)) is not None:
            raise InputError("options", f"--{option}", value, "leave it out: the file's light is rendered already")
    tier, engine = options.tier or TIER, given_settings(options, Options)
    if not engine.keys() & {"accuracy", "method", *KNOBS}:
        engine["accuracy"] = TIER_ACCURACY[tier]
    given = given_fields(options) | {"options": Options(**engine), "iris": iris_option(options),
                                     "stray": stray_option(options)}
    del given["output_folder"]
    return options.scene, {"lens_quality": tier} | given
