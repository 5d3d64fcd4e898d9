"""`lensfield render`: a .blend, rendered multispectrally and put through a lens."""

from argparse import BooleanOptionalAction
from pathlib import Path

from ..engine import InputError
from ..engine.field.overscan import VIEWS
from ..engine.image.depth_range import DEPTHS
from ..engine.spectral.spectra import parse_wavelengths
from ..engine.spectral.wavelength_choice import STANDARD_COLOUR_ERROR, TIERS, UNFIT
from .arguments import (
    CAMERA,
    add_engine_options,
    add_iris,
    add_rings,
    asked_iris,
    check_outputs,
    distance_mm,
    given_options,
    resolution,
)
from .blend import open_scene
from .followed import add_followed, messages, progress
from .outcome import finish
from .sequence import parse_frames

FRAME_LIMITS, SAMPLE_LIMITS = (-1048574, 1048574), (1, 1 << 24)  # Blender's own
OWN_FRAMES = "scene"
SPECTRAL = "tier", "colour_error", "sensor_error"


def add(commands):
    render = commands.add_parser(
        "render", help="render a .blend multispectrally and put it through a lens",
        description="Render a .blend multispectrally and put it through a lens. What is not said here is as the "
                    "scene's own Lensfield settings have it; so are all that stand together (tier and errors; "
                    "accuracy, method and knobs) where none of them is said.")
    add_scene_options(render)
    add_frame_options(render)
    render.add_argument("--wait", action="store_true",
                        help="end only when all frames are there, those that other processes are at, too")
    _add_followed(render.add_argument_group("for programs that start this one and follow it"))
    cluster = render.add_argument_group("on other machines", "which find the .blend and all folders by the same paths")
    cluster.add_argument("--scheduler", metavar="ADDRESS",
                         help="have the workers of a Dask cluster render the frames, such as tcp://10.0.0.1:8786")
    add_farm_options(cluster)
    render.set_defaults(run=_render)


def add_frame_options(render):
    """Which frames are rendered, whatever is there, and with how much around them."""
    render.add_argument("--frames", metavar="SPEC",
                        help="frames to render: 7, 1-250, 1-250:2, 1,5,10-20, or scene for its own range (default: the "
                             "current one). Those that are there already, whole and by the same settings, are not "
                             "rendered again, and processes that render into one folder share them; --report tells "
                             "of each")
    render.add_argument("--overwrite", action="store_true",
                        help="render all of them anew, and nothing of what is left of a render that was stopped")
    render.add_argument("--room", type=float, metavar="FRACTION",
                        help="capture at least this part of the picture's longer side beyond each of its edges, for "
                             "lenses with more distortion to draw on (lensfield apply)")


def add_farm_options(group):
    """How frames become tasks of a farm."""
    group.add_argument("--frames-per-task", type=int, default=1, metavar="N",
                       help="so many frames share the start of Blender, and what the lens needs (default: 1)")
    group.add_argument("--blender", metavar="EXE",
                       help="the Blender of those machines, which has the extension (default: the lensfield command "
                            "that is installed there)")


def add_scene_options(render):
    """The .blend, and what is asked of it."""
    render.add_argument("scene", type=Path, metavar="SCENE.blend")
    render.add_argument("--wavelengths", metavar="SPEC",
                        help="nm: first:last:number, or a list such as 450,550,650")
    render.add_argument("--tier", choices=TIERS,
                        help="how true colours and blur are to be: Cycles renders three wavelengths, as many as keep "
                             "colours true, or all, and the others follow from these; up to 10, 1 or 0.1 %% of a "
                             "point's light may land in the wrong place")
    render.add_argument("--colour-error", type=float, metavar="DELTA_E",
                        help="CIEDE2000 that 95 %% of the scene's possible colours are to stay within "
                             f"(standard: {STANDARD_COLOUR_ERROR:g})")
    render.add_argument("--sensor-error", type=float, metavar="FRACTION",
                        help="relative RMS error that three broad sensor bands are to stay within")
    render.add_argument("--view", choices=VIEWS,
                        help="what is seen: what the lens sees on its own sensor; or what the scene's camera sees, the "
                             "lens being made as large as that takes, blur and all")
    render.add_argument("--depth", choices=DEPTHS,
                        help="how what is out of focus is blurred: in layers of depth, where the scene is deeper than "
                             "what is in focus; not at all; or by rays that Cycles traces through the lens: slow, and "
                             "without diffraction, but true for glass, mirrors and volumes, too")
    render.add_argument("--unfit", choices=UNFIT,
                        help="nodes that cannot be rendered by wavelengths (lensfield lint lists them): an error, or "
                             "what Cycles makes of them")
    render.add_argument("--view-layer", metavar="NAME",
                        help="the view layer to render (default: the scene's; else the one that is on for rendering)")
    render.add_argument("--samples", type=int, help="Cycles samples per pixel (default: the scene's)")
    render.add_argument("--resolution", metavar="WIDTHxHEIGHT", help="size in pixels (default: the scene's)")
    render.add_argument("--denoise", action=BooleanOptionalAction, help="let Cycles denoise its passes, or not")
    render.add_argument("--output", type=Path, metavar="DIR")
    add_engine_options(render, lens_required=False)
    add_rings(render, camera=True)
    add_iris(render, camera=True)


def _add_followed(group):
    add_followed(group)
    group.add_argument("--picture", type=Path, metavar="FILE.png",
                       help="after each pass, write the light so far, as a perfect pinhole sees it")
    group.add_argument("--beside", type=Path, metavar="DIR",
                       help="where paths in the scene's Lensfield settings start from, if SCENE is a copy of a .blend "
                            "that lies there")
    group.add_argument("--scene-state", metavar="TEXT",
                       help="what the records of frames are to tell of the scene's state, in place of its fingerprint")
    group.add_argument("--scene-source", metavar="TEXT",
                       help="what tells the files of the scene apart, if SCENE is a copy: for passes to be kept")
    group.add_argument("--session", type=Path, metavar="FILE.npz",
                       help="what the window has that a copy of its file has not (addon/job/session.py)")


def _render(options):
    check_outputs([(options.report, ".json"), (options.picture, ".png")],
                  [path for path in (options.scene, options.lens) if path])
    with messages(options) as write:
        if options.scheduler:
            from .cluster import render_on_cluster

            report, told = render_on_cluster(options, write)
        else:
            report, told = _render_here(options, write)
        finish(options, report, [])
        write(told=told)


def _render_here(options, write):
    """Render in this process; the report, and what to tell."""
    if options.frames is not None:
        asked_frames(options.frames)
    scene, asked = scene_and_arguments(options)
    asked |= {"picture": options.picture, "room": options.room, "state": options.scene_state,
              "source": _source(options, scene)}
    if options.beside:
        from ..addon import look_beside

        look_beside(options.beside.resolve())
    if options.session:
        from ..addon import take_session

        take_session(options.session)
    _check_beside_frames(options, scene)
    return (_render_one if options.frames is None else _render_frames)(options, scene, asked, write)


def asked_frames(text):
    """The frames of --frames, ascending; None for the scene's own."""
    if text == OWN_FRAMES:
        return None
    frames = parse_frames(text)
    for frame in frames:
        check_limits("--frames", frame, FRAME_LIMITS)
    return frames


def _check_beside_frames(options, scene):
    from ..addon import check_beside_frames, folder_for

    check_beside_frames(folder_for(scene, options.output), options.report, options.picture)


def _source(options, scene):
    """What tells the files of the scene apart; "" where what is open is not all in them, or nothing is to be kept."""
    from ..addon import source_digest

    if options.overwrite and options.frames is None:
        return ""
    if options.scene_source is not None:
        return options.scene_source
    return "" if options.session else source_digest(scene)


def _render_one(options, scene, asked, write):
    """Render the current frame; its report, and what to tell of it."""
    from .. import addon

    with progress(options, write) as tell:
        result = addon.render_through_lens(scene, progress=tell, **asked)
    _tell_frame(result, set(), write)
    return result.report, result.told


def _render_frames(options, scene, asked, write):
    """Render the frames that are not there yet, one after the other; the report of all, and what to tell of them."""
    from .. import addon

    frames = asked_frames(options.frames)
    with progress(options, write) as tell:
        tell(0.0, "Looking for frames that are there already")
        animation = addon.Animation(scene, frames, overwrite=options.overwrite, wait=options.wait, **asked)
    for frame, path in animation.current.items():
        write(lens_image=str(path), frame=frame)
    for line in animation.beforehand:
        print(line, flush=True)
    known = set()
    for frame in animation.turns:
        with progress(options, write) as tell:
            result = animation.render(frame, tell)
        if result:
            _tell_frame(result, known, write, frame=frame)
        elif frame in animation.current:
            write(lens_image=str(animation.current[frame]), frame=frame)
    print(*animation.summary, sep="\n")
    return animation.report, animation.told


def _tell_frame(result, known, write, **facts):
    """Tell of a frame that is done: its plans and its files, but for the lines that are known."""
    filtered = result.report.lens_image
    for line in (f"scene: {result.report.scene.scene_plan}", *([f"plan: {filtered.plan.text}"] if filtered else ()),
                 *result.report.files.values()):
        if line not in known:
            print(line, flush=True)
        known.add(line)
    write(lens_image=str(result.lens_image), seconds=round(sum(result.report.stages.values()), 1), **facts)


def scene_and_arguments(options):
    """The scene of the .blend, and what the command line asks of a render of it: arguments by name."""
    wavelengths_nm = parse_wavelengths(options.wavelengths) if options.wavelengths else None
    spectral = {name: value for name in SPECTRAL if (value := getattr(options, name)) is not None}
    scene, engine = _open_scene(options), given_options(options)
    return scene, {
        "lens": options.lens, "wavelengths_nm": wavelengths_nm,
        "output_folder": options.output and options.output.resolve(), "view": options.view, "unfit": options.unfit,
        "options": scene.lensfield.to_options(options.tier, **engine) if engine or options.tier else None,
        "spectral": scene.lensfield.to_spectral_options(**spectral) if spectral else None,
        "view_layer": options.view_layer, "denoise": options.denoise, "focus": _focus(options.focus),
        "f_number": options.f_number, "focused_wide_open": options.focused_wide_open or None,
        "lens_quality": options.lens_quality, "depth": options.depth,
        "iris": asked_iris(options)}


def _focus(text):
    """What `render_through_lens` takes for --focus."""
    if text is None:
        return None
    return CAMERA if text.lower() == CAMERA else distance_mm(text)


def _open_scene(options):
    """The scene of the .blend, with its resolution and samples as asked for."""
    if options.samples is not None:
        check_limits("--samples", options.samples, SAMPLE_LIMITS)
    size = resolution(options.resolution) if options.resolution else None
    scene = open_scene(options.scene)
    if options.samples is not None:
        scene.cycles.samples = options.samples
    if size:
        scene.render.resolution_x, scene.render.resolution_y = size
        scene.render.resolution_percentage = 100
    return scene


def check_limits(option, value, limits):
    """Raise an InputError for a number that Blender would not take."""
    if not limits[0] <= value <= limits[1]:
        raise InputError("options", option, value, "expected {} to {}".format(*limits))
