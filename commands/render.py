"""`lensfield render`: a .blend, rendered multispectrally and put through a lens."""

from pathlib import Path

from ..engine import InputError, Lens
from ..engine.field.overscan import VIEWS
from ..engine.spectral.spectra import parse_wavelengths
from ..engine.spectral.wavelength_choice import IMAGE_WAVELENGTHS, STANDARD_COLOUR_ERROR, TIERS, UNFIT, SpectralOptions
from .arguments import add_engine_options, check_outputs, engine_options, resolution
from .blend import open_scene
from .outcome import finish
from .terminal import progress_bar, quiet

LIMITS = {"frame": (-1048574, 1048574), "samples": (1, 1 << 24)}  # Blender's own


def add(commands):
    render = commands.add_parser("render", help="render a .blend multispectrally and put it through a lens")
    render.add_argument("scene", type=Path, metavar="SCENE.blend")
    render.add_argument("--wavelengths", default=IMAGE_WAVELENGTHS, metavar="SPEC",
                        help="nm: first:last:number, or a list such as 450,550,650 (default %(default)s)")
    render.add_argument("--tier", choices=TIERS, default=SpectralOptions.tier,
                        help="how many of the wavelengths Cycles renders: three, as many as keep colours true, or all; "
                             "the others follow from these (default %(default)s)")
    render.add_argument("--colour-error", type=float, metavar="DELTA_E",
                        help="CIEDE2000 that 95 %% of the scene's possible colours are to stay within "
                             f"(default {STANDARD_COLOUR_ERROR:g})")
    render.add_argument("--sensor-error", type=float, metavar="FRACTION",
                        help="relative RMS error that three broad sensor bands are to stay within")
    render.add_argument("--view", choices=VIEWS, default=VIEWS[0],
                        help="what is seen: what the lens sees on its own sensor; or what the scene's camera sees, the "
                             "lens being made as large as that takes, blur and all (default %(default)s)")
    render.add_argument("--unfit", choices=UNFIT, default=UNFIT[0],
                        help="nodes that cannot be rendered by wavelengths (lensfield lint lists them): an error, or "
                             "what Cycles makes of them (default %(default)s)")
    render.add_argument("--frame", type=int, help="frame to render (default: the scene's current one)")
    render.add_argument("--samples", type=int, help="Cycles samples per pixel (default: the scene's)")
    render.add_argument("--resolution", metavar="WIDTHxHEIGHT", help="size in pixels (default: the scene's)")
    render.add_argument("--denoise", action="store_true", help="let Cycles denoise its passes")
    render.add_argument("--output", type=Path, required=True, metavar="DIR")
    add_engine_options(render)
    render.set_defaults(run=_render)


def _render(options):
    lens = Lens.load(options.lens)
    wavelengths_nm = parse_wavelengths(options.wavelengths)
    chosen = engine_options(options)
    spectral = SpectralOptions(options.tier, options.colour_error, options.sensor_error)
    check_outputs([(options.report, ".json")], [options.scene, options.lens])
    scene = _open_scene(options)
    from .. import addon

    with progress_bar() as tell, quiet(1):
        result = addon.render_through_lens(
            scene, lens, wavelengths_nm, options.output.resolve(), options=chosen, spectral=spectral,
            view=options.view, unfit=options.unfit, frame=options.frame, denoise=options.denoise, progress=tell)
    print(f"scene: {result.report.scene.scene_plan}")
    print(f"plan: {result.report.lens_image.plan.text}")  # it could not be made before the capture
    finish(options, result.report, result.files)


def _open_scene(options):
    """The scene of the .blend, with what the command line asks of it."""
    for name, limits in LIMITS.items():
        value = getattr(options, name)
        if value is not None and not limits[0] <= value <= limits[1]:
            raise InputError("options", f"--{name}", value, "expected {} to {}".format(*limits))
    size = resolution(options.resolution) if options.resolution else None
    scene = open_scene(options.scene)
    if options.samples is not None:
        scene.cycles.samples = options.samples
    if size:
        scene.render.resolution_x, scene.render.resolution_y = size
        scene.render.resolution_percentage = 100
    return scene
