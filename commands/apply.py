"""`lensfield apply`: another lens on a finished render."""

from pathlib import Path

from ..engine.depth.depth_range import AUTO, OFF
from ..engine.field.overscan import VIEWS
from .arguments import (
    add_engine_options,
    add_iris,
    add_rings,
    add_untrusted,
    check_outputs,
    engine_options,
    given_fields,
    iris_option,
    output_given,
)
from .blend import import_addon
from .outcome import finish
from .progress import add_progress_options, messages, progress


def add(commands):
    apply = commands.add_parser(
        "apply", help="put the light that a render has kept through another lens",
        description="Put the light that lensfield render has kept through another lens, or by other options, without "
                    "rendering again. The picture keeps its field of view, and you are told what that is through the "
                    "lens. All files that follow from the light are made anew.")
    apply.add_argument("radiance", type=Path, metavar="SCENE_0001_radiance.exr")
    apply.add_argument("--view", choices=VIEWS, default=VIEWS[0],
                       help="how the lens takes the kept field of view: as large as it is, on another sensor; or made "
                            "as large as that takes on the sensor that was rendered for. The picture is the same")
    apply.add_argument("--depth", choices=(AUTO, OFF), default=AUTO,
                       help="whether what is out of focus is blurred, where the light was kept in layers of depth: "
                            "then any focus and f-stop is as if it had been rendered so (default: auto)")
    apply.add_argument("--output", type=Path, metavar="DIR", help="(default: beside the radiance)")
    add_engine_options(apply)
    add_rings(apply)
    add_iris(apply)
    add_progress_options(apply.add_argument_group("for programs that start this one and follow it"))
    add_untrusted(apply)
    apply.set_defaults(run=_apply, confines=_folders)


def _folders(options):
    """The picture and the output folder."""
    return options.radiance, output_given(options)


def _apply(options):
    check_outputs([(options.report, ".json")], [options.radiance, options.lens])
    with messages(options) as write:
        given = given_fields(options) | {"options": engine_options(options), "iris": iris_option(options)}
        addon = import_addon()
        addon.check_next_to_frames(options.output or options.radiance.parent, options.report)
        with progress(options, write) as tell:
            result = addon.apply_lens(options.radiance, progress=tell, **given)
        print(f"plan: {result.report.lens_image.plan.text}")
        finish(options, result.report, result.files)
        write(lens_image=str(result.lens_image), messages=result.messages)
