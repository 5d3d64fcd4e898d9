"""`lensfield apply`: another lens on a finished render."""

from pathlib import Path

from lensfield.engine.depth.depth_range import AUTO, OFF
from lensfield.engine.field.overscan import LENS_VIEW

from ..request import CAMERA_FIELDS, RenderRequest
from .arguments import (
    add_engine_options,
    add_iris,
    add_lens_settings,
    add_settings,
    add_stray,
    add_untrusted,
    check_outputs,
    engine_options,
    given_fields,
    iris_option,
    output_given,
    stray_option,
)
from .blend import import_addon
from .outcome import finish
from .prescription_file import lens_source
from .progress import add_progress_options, messages, progress
from .terminal import say


def add_options(apply):
    apply.description = (
        "Apply another lens, or other options, to the stored light of a render, without rendering again. The picture "
        "keeps its field of view, and the output states the lens's sensor size or scale. All files that depend on the "
        "lens are written again.")
    apply.add_argument("radiance", type=Path, metavar="SHOT_SCENE_0001_radiance.exr",
                       help="radiance file of the render")
    apply.add_argument("--view", metavar="VIEW", default=LENS_VIEW,
                       help="how the lens covers the picture's field of view: in its own size, on another sensor size "
                            "(lens), or scaled to the render's sensor (camera). The picture is the same. A sensor, as "
                            "for lensfield render, means lens, but the report compares with this sensor (default: "
                            f"{LENS_VIEW})")
    apply.add_argument("--depth", choices=(AUTO, OFF), default=AUTO,
                       help="auto: blur out-of-focus light if the file has layers of depth; any focus and f-stop then "
                            "looks as if rendered with it. off: everything is as sharp as in focus (default: auto)")
    apply.add_argument("--output", type=Path, metavar="DIR", help="output folder (default: the folder of the radiance)")
    add_engine_options(apply)
    add_lens_settings(apply)
    add_iris(apply)
    add_stray(apply)
    add_settings(apply.add_argument_group("camera", "that takes a picture of the lens image"), RenderRequest,
                 CAMERA_FIELDS)
    add_settings(apply, RenderRequest, ["files", "look"])
    followed = apply.add_argument_group("for programs that run this command")
    add_progress_options(followed)
    add_settings(followed, RenderRequest, ["view_settings"])
    add_untrusted(apply)
    apply.set_defaults(run=_apply, confines=_folders)


def _folders(options):
    """The picture and the output folder."""
    return options.radiance, output_given(options)


def _apply(options):
    check_outputs([(options.report, ".json")], [options.radiance, options.lens])
    with messages(options) as write:
        given = given_fields(options) | {"lens": lens_source(options, options.lens),
                                         "options": engine_options(options), "iris": iris_option(options),
                                         "stray": stray_option(options)}
        addon = import_addon()
        addon.check_next_to_frames(options.output or options.radiance.parent, options.report)
        with progress(options, write) as on_progress:
            result = addon.apply_lens(options.radiance, progress=on_progress, **given)
        say(f"plan: {result.report.lens_image.plan.text}")
        finish(options, result.report, result.files)
        write(lens_image=str(result.lens_image), messages=result.messages)
