"""`lensfield preview`: a small picture of a .blend through a lens that grows finer; for the window's preview.

`serve` keeps the scene loaded: without a .blend, the command shows the same scene with changes or through another lens,
or continues.
"""

from pathlib import Path

from lensfield.engine.runtime.errors import InputError, Stopped

from ..request import EXPOSED_FIELDS, RING_FIELDS
from .arguments import engine_options, given_fields, iris_option, output_given
from .blend import import_addon
from .prescription_file import lens_source
from .progress import add_progress_options, messages, progress
from .render import add_copy_options, restore_copied, say_without_truth, scene_and_fields
from .render_options import add_scene_options
from .stopping import stopped

FIELDS_OF_LENS = "lens", "view", *RING_FIELDS, "lens_quality", *EXPOSED_FIELDS


def add_options(preview):
    preview.description = (
        "Show a .blend through a lens: a coarse picture first, then finer ones with more and more samples, each as a "
        "message with the path of its EXR. Without a .blend: the scene of the last preview in this process, with "
        "changes or through another lens; or, without either, the rest of the pictures after a stop.")
    add_scene_options(preview, required=False)
    group = preview.add_argument_group("for programs that run this command")
    add_progress_options(group)
    add_copy_options(group)
    group.add_argument("--changes", type=Path, metavar="FILE.json",
                       help="properties that have changed since the last preview (addon/scene/changes.py)")
    group.add_argument("--moves", type=Path, metavar="FILE.json",
                       help="places of objects that have moved since the last preview, if nothing else has changed")
    preview.set_defaults(run=_preview, confines=_folders)


def _folders(options):
    """The scene and the output folder."""
    if options.scene is None:
        raise InputError("options", "--untrusted", "given without a .blend", "each confined process starts anew")
    return options.scene, output_given(options)


def _preview(options):
    with messages(options) as write:
        addon = import_addon()
        if options.scene:
            scene, given = scene_and_fields(options)
            restore_copied(options)
            say_without_truth(scene)
            preview = addon.open_preview(scene, **given)
        elif options.changes:
            scene, given = scene_and_fields(options, lambda options: addon.changed_scene(options.changes))
            preview = addon.open_preview(scene, **given)
        elif options.moves:
            preview = addon.moved_preview(options.moves)
        else:
            preview = addon.opened_preview()
        if options.lens and not (options.scene or options.changes):
            given = {name: value for name, value in given_fields(options).items() if name in FIELDS_OF_LENS}
            preview.look_through(**given | {"lens": lens_source(options, options.lens)}, iris=iris_option(options),
                                 options=engine_options(options))
        with progress(options, write) as on_progress:
            try:
                preview.run(lambda picture: write(**picture), _until_stopped(on_progress))
            except Stopped:
                pass


def _until_stopped(on_progress):
    """The progress function, which raises Stopped once the command is to stop."""
    def checked(fraction, label):
        if stopped():
            raise Stopped
        on_progress(fraction, label)

    return checked
