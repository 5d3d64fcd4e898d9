"""`lensfield render`: a .blend, rendered multispectrally and put through a lens; the one command that needs bpy."""

from pathlib import Path

from ..engine import InputError, Lens
from ..engine.errors import absence
from ..engine.spectra import parse_wavelengths
from .arguments import add_engine_options, check_targets, engine_options, resolution
from .outcome import finish, plan_text
from .terminal import progress_bar, quiet

LIMITS = {"frame": (-1048574, 1048574), "samples": (1, 1 << 24)}  # Blender's own


def add(commands):
    render = commands.add_parser("render", help="render a .blend multispectrally and put it through a lens")
    render.add_argument("scene", type=Path, metavar="SCENE.blend")
    render.add_argument("--wavelengths", default="400:700:9", metavar="SPEC",
                        help="nm: first:last:number, or a list such as 450,550,650 (default %(default)s)")
    render.add_argument("--frame", type=int, help="frame to render (default: the scene's current one)")
    render.add_argument("--samples", type=int, help="Cycles samples per pixel (default: the scene's)")
    render.add_argument("--resolution", metavar="WIDTHxHEIGHT", help="size in pixels (default: the scene's)")
    render.add_argument("--denoise", action="store_true", help="let Cycles denoise its passes")
    render.add_argument("--output", type=Path, required=True, metavar="DIR")
    add_engine_options(render)
    render.set_defaults(run=_render)


def _render(options):
    try:
        import bpy
    except ImportError as error:
        raise InputError("bpy", "module", "not there", f"install Blender's Python wheel ({error})") from None
    from .. import addon

    lens = Lens.load(options.lens)
    wavelengths_nm = parse_wavelengths(options.wavelengths)
    chosen = engine_options(options)
    check_targets(options.report)
    if not hasattr(bpy.types.Scene, "lensfield"):  # in the wheel nobody has registered the add-on yet
        addon.register()
    scene = _open_scene(bpy, options)
    with progress_bar() as tell, quiet(1):
        result = addon.render_through_lens(
            scene, lens, wavelengths_nm, options.output.resolve(), options=chosen, frame=options.frame,
            denoise=options.denoise, progress=tell)
    print(f"plan: {plan_text(result.report.facts['plan'])}")  # it could not be made before the capture
    finish(options, result.report, result.files)


def _open_scene(bpy, options):
    """The scene of the .blend, with what the command line asks of it."""
    if not options.scene.is_file():
        raise InputError(options.scene, "scene", absence(options.scene), "expected a .blend file")
    for name, limits in LIMITS.items():
        value = getattr(options, name)
        if value is not None and not limits[0] <= value <= limits[1]:
            raise InputError("options", f"--{name}", value, "expected {} to {}".format(*limits))
    size = resolution(options.resolution) if options.resolution else None
    try:
        with quiet(1):
            bpy.ops.wm.open_mainfile(filepath=str(options.scene.resolve()))
    except RuntimeError as error:
        raise InputError(options.scene, "scene", "not readable", str(error).strip()) from None
    scene = bpy.context.scene
    if options.samples is not None:
        scene.cycles.samples = options.samples
    if size:
        scene.render.resolution_x, scene.render.resolution_y = size
        scene.render.resolution_percentage = 100
    return scene
