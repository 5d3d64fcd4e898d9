"""`lensfield render`: a .blend, rendered multispectrally and put through a lens."""

from contextlib import contextmanager
from pathlib import Path

from ..engine import InputError
from ..engine.field.overscan import VIEWS
from ..engine.spectral.spectra import parse_wavelengths
from ..engine.spectral.wavelength_choice import STANDARD_COLOUR_ERROR, TIERS, UNFIT
from .arguments import add_engine_options, check_outputs, given_options, resolution
from .blend import open_scene
from .messages import message_lines, paced
from .outcome import FAILURES, finish
from .terminal import progress_bar, quiet

LIMITS = {"frame": (-1048574, 1048574), "samples": (1, 1 << 24)}  # Blender's own
SPECTRAL = "tier", "colour_error", "sensor_error"


def add(commands):
    render = commands.add_parser(
        "render", help="render a .blend multispectrally and put it through a lens",
        description="Render a .blend multispectrally and put it through a lens. What is not said here is as the "
                    "scene's own Lensfield settings have it; so are all that stand together (tier and errors; "
                    "accuracy, method and knobs) where none of them is said.")
    render.add_argument("scene", type=Path, metavar="SCENE.blend")
    render.add_argument("--wavelengths", metavar="SPEC",
                        help="nm: first:last:number, or a list such as 450,550,650")
    render.add_argument("--tier", choices=TIERS,
                        help="how many of the wavelengths Cycles renders: three, as many as keep colours true, or all; "
                             "the others follow from these")
    render.add_argument("--colour-error", type=float, metavar="DELTA_E",
                        help="CIEDE2000 that 95 %% of the scene's possible colours are to stay within "
                             f"(standard: {STANDARD_COLOUR_ERROR:g})")
    render.add_argument("--sensor-error", type=float, metavar="FRACTION",
                        help="relative RMS error that three broad sensor bands are to stay within")
    render.add_argument("--view", choices=VIEWS,
                        help="what is seen: what the lens sees on its own sensor; or what the scene's camera sees, the "
                             "lens being made as large as that takes, blur and all")
    render.add_argument("--unfit", choices=UNFIT,
                        help="nodes that cannot be rendered by wavelengths (lensfield lint lists them): an error, or "
                             "what Cycles makes of them")
    render.add_argument("--frame", type=int, help="frame to render (default: the scene's current one)")
    render.add_argument("--samples", type=int, help="Cycles samples per pixel (default: the scene's)")
    render.add_argument("--resolution", metavar="WIDTHxHEIGHT", help="size in pixels (default: the scene's)")
    render.add_argument("--denoise", action="store_true", default=None, help="let Cycles denoise its passes")
    render.add_argument("--output", type=Path, metavar="DIR")
    add_engine_options(render, lens_required=False)
    _add_followed(render.add_argument_group("for programs that start this one and follow it"))
    render.set_defaults(run=_render)


def _add_followed(group):
    group.add_argument("--progress", choices=("bar", "lines"), default="bar",
                       help="a bar, on a terminal; or lines on standard output (commands/messages.py says which)")
    group.add_argument("--picture", type=Path, metavar="FILE.png",
                       help="after each pass, write the light so far, as a perfect pinhole sees it")
    group.add_argument("--end-with-stdin", action="store_true",
                       help="end as soon as standard input closes, as it does when its writer ends, and leave nothing "
                            "half-written")
    group.add_argument("--beside", type=Path, metavar="DIR",
                       help="where paths in the scene's Lensfield settings start from, if SCENE is a copy of a .blend "
                            "that lies there")


def _render(options):
    with _progress(options) as (tell, end):
        result = _result(options, tell)
        end(result)
    print(f"scene: {result.report.scene.scene_plan}")
    print(f"plan: {result.report.lens_image.plan.text}")  # it could not be made before the capture
    finish(options, result.report, result.files)


@contextmanager
def _progress(options):
    """How to tell the progress (fraction, label), and the Result at the end."""
    if options.progress == "bar":
        with progress_bar() as tell, quiet(1):
            yield tell, lambda result: None
        return
    with message_lines() as write:
        try:
            yield paced(write), lambda result: write(lens_image=str(result.lens_image), told=result.told)
        except FAILURES as error:
            write(error=str(error))
            raise


def _result(options, tell):
    check_outputs([(options.report, ".json"), (options.picture, ".png")],
                  [path for path in (options.scene, options.lens) if path])
    wavelengths_nm = parse_wavelengths(options.wavelengths) if options.wavelengths else None
    scene = _open_scene(options)
    from .. import addon

    spectral = {name: value for name in SPECTRAL if (value := getattr(options, name)) is not None}
    return addon.render_through_lens(
        scene, options.lens, wavelengths_nm, options.output and options.output.resolve(),
        options=scene.lensfield.to_options(**given_options(options)),
        spectral=scene.lensfield.to_spectral_options(**spectral), view=options.view, unfit=options.unfit,
        frame=options.frame, denoise=options.denoise, picture=options.picture, progress=tell)


def _open_scene(options):
    """The scene of the .blend, with what the command line asks of it."""
    for name, limits in LIMITS.items():
        value = getattr(options, name)
        if value is not None and not limits[0] <= value <= limits[1]:
            raise InputError("options", f"--{name}", value, "expected {} to {}".format(*limits))
    size = resolution(options.resolution) if options.resolution else None
    scene = open_scene(options.scene)
    if options.beside:
        from ..addon import look_beside

        look_beside(options.beside.resolve())
    if options.samples is not None:
        scene.cycles.samples = options.samples
    if size:
        scene.render.resolution_x, scene.render.resolution_y = size
        scene.render.resolution_percentage = 100
    return scene
