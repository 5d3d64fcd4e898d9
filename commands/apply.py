"""`lensfield apply`: another lens on a picture that is rendered already."""

from pathlib import Path

from ..engine.field.overscan import VIEWS
from ..engine.image.depth_range import AUTO, OFF
from .arguments import add_engine_options, add_iris, add_rings, asked_iris, asked_rings, check_outputs, engine_options
from .blend import import_addon
from .followed import add_followed, messages, progress
from .outcome import finish


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
    add_followed(apply.add_argument_group("for programs that start this one and follow it"))
    apply.set_defaults(run=_apply)


def _apply(options):
    check_outputs([(options.report, ".json")], [options.radiance, options.lens])
    with messages(options) as write:
        chosen = engine_options(options)
        addon = import_addon()
        addon.check_beside_frames(options.output or options.radiance.parent, options.report)
        with progress(options, write) as tell:
            result = addon.apply_lens(options.radiance, options.lens, options.output, options=chosen,
                                      view=options.view, rings=asked_rings(options), iris=asked_iris(options),
                                      lens_quality=options.lens_quality or "standard", depth=options.depth,
                                      progress=tell)
        print(f"plan: {result.report.lens_image.plan.text}")
        finish(options, result.report, result.files)
        write(lens_image=str(result.lens_image), told=result.told)
