"""`lensfield dataset`: frames of a scene through several lenses, with calibrations, ground truth and an index."""

from pathlib import Path

from lensfield.engine import InputError
from lensfield.engine.calibration.formats import FORMATS

from ..request import PAIRS
from .arguments import add_accuracy, add_iris, add_rings, add_stray, add_untrusted, check_outputs
from .blend import import_addon
from .compare import RINGS, add_lenses, given_f_numbers, given_lenses
from .progress import messages, progress
from .render import add_followed, restore_copied, scene_and_fields, source_to_store
from .render_options import add_capture_options, add_frame_options, requested_frames
from .terminal import say

OF_LENSES = "view", "output_folder"
"""Fields that the user does not set: every lens has the view of the scene's camera, and its own folder."""
DEFAULT_FORMAT = "opencv"


def add_options(dataset):
    dataset.description = (
        "Render frames of a .blend through several lenses at several f-numbers. Each frame is captured once for all of "
        "them. Pictures, ground truth (--truth) and calibrations go to a folder for each lens and f-number, and "
        "index.jsonl has a line of JSON for each picture (docs/datasets.md). Every lens is scaled to the camera's "
        "view. Other options that you leave out come from the scene's Lensfield settings.")
    dataset.add_argument("scene", type=Path, metavar="SCENE.blend", help="file to render")
    add_lenses(dataset)
    dataset.add_argument("--output", type=Path, required=True, metavar="DIR",
                         help="folder for the index and, in folders, the pictures")
    dataset.add_argument("--calibration", metavar="PROGRAM,...", default=DEFAULT_FORMAT,
                         help="calibration files, as of lensfield lens calibration --for, or none: "
                              f"{', '.join(FORMATS)} (default: {DEFAULT_FORMAT})")
    dataset.add_argument("--pairs", choices=PAIRS, default="",
                         help="also write pairs of pictures, in the folders that public loaders read: "
                              + "; ".join(f"{name}: {text}" for name, text in PAIRS.items()))
    add_frame_options(dataset)
    dataset.add_argument("--wait", action="store_true",
                         help="end only when all pictures are finished, including pictures of other processes")
    add_capture_options(dataset, OF_LENSES)
    add_accuracy(dataset, of_scene=True)
    add_rings(dataset, camera=True, fields=RINGS)
    add_iris(dataset, camera=True)
    add_stray(dataset, of_scene=True)
    add_followed(dataset.add_argument_group("for programs that run this command"))
    add_untrusted(dataset)
    dataset.set_defaults(run=_write, confines=_folders)


def _folders(options):
    """The scene and the output folder."""
    return options.scene, options.output


def _write(options):
    lenses, f_numbers, formats = given_lenses(options), given_f_numbers(options), _formats(options.calibration)
    check_outputs([(options.picture, ".png")], [options.scene, *lenses])
    with messages(options) as write:
        frames = None if options.frames is None else requested_frames(options.frames)
        scene, given = scene_and_fields(options)
        given["source"] = source_to_store(options, scene)
        restore_copied(options)
        addon, folder = import_addon(), options.output.resolve()
        say(f"output: {folder}")
        with progress(options, write) as on_progress:
            dataset = addon.Dataset(
                scene, lenses, f_numbers, [scene.frame_current] if options.frames is None else frames,
                formats=formats, pairs=options.pairs, overwrite=options.overwrite, any_build=options.any_build,
                wait=options.wait, progress=on_progress, **given | {"output_folder": folder})
        say(*dataset.beforehand)
        for turn in dataset.turns:
            with progress(options, write) as on_progress:
                results = dataset.render(turn, on_progress)
            for result in results:
                say(result.lens_image)
                write(lens_image=str(result.lens_image), frame=result.frame)
        say(*dataset.messages)
        write(messages=dataset.messages)


def _formats(text):
    """The formats of --calibration."""
    formats = [] if text == "none" else [word.strip() for word in text.split(",")]
    for name in formats:
        if name not in FORMATS:
            raise InputError("options", "--calibration", name or text,
                             f"expected none, or some of {', '.join(FORMATS)}")
    return formats
