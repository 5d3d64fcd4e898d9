"""`lensfield render`: render a .blend multispectrally, and apply a lens."""

from pathlib import Path

from lensfield.engine import Options
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from lensfield.engine.stray.options import StrayOptions

from ..request import FOLLOWER_FIELDS, RenderRequest
from .arguments import (
    add_settings,
    check_limits,
    check_outputs,
    given_fields,
    given_settings,
    iris_option,
    output_given,
    resolution,
)
from .blend import open_scene
from .outcome import finish
from .prescription_file import given_reading, lens_source
from .progress import add_progress_options, messages, progress
from .render_options import add_farm_options, add_task_options, requested_frames
from .terminal import say

SAMPLE_LIMITS = 1, 1 << 24  # Blender's


def add_options(render):
    render.description = (
        "Render a .blend multispectrally and through a lens. Options that you leave out come from the scene's "
        "Lensfield settings; options that belong together (tier and errors; accuracy, method and advanced options) "
        "only if you leave out all of them.")
    add_task_options(render)
    render.add_argument("--wait", action="store_true",
                        help="end only when all frames are finished, including frames of other processes")
    add_followed(render.add_argument_group("for programs that run this command"))
    cluster = render.add_argument_group("on other machines",
                                        "which must find the .blend and all folders at the same paths")
    if not __package__.startswith("bl_ext."):  # Blender's extensions do not depend on other software
        cluster.add_argument("--scheduler", metavar="ADDRESS",
                             help="render on the workers of this Dask cluster, such as tcp://10.0.0.1:8786")
    add_farm_options(cluster)
    render.set_defaults(run=_render, confines=_folders, scheduler=None)


def add_followed(group):
    """Add options for programs that render a copy of their file and follow the render."""
    add_progress_options(group)
    add_settings(group, RenderRequest, FOLLOWER_FIELDS)
    add_copy_options(group)


def add_copy_options(group):
    """Add the arguments for a copy of a .blend."""
    group.add_argument("--blend-folder", type=Path, metavar="DIR",
                       help="folder of the original .blend, for the // paths of the scene's Lensfield settings, if "
                            "SCENE is a copy of it elsewhere")
    group.add_argument("--session", type=Path, metavar="FILE.npz",
                       help="state of the Blender window that the copied file lacks (addon/render/session.py)")


def _folders(options):
    """The scene and the output folder."""
    return options.scene, output_given(options)


def _render(options):
    check_outputs([(options.report, ".json"), (options.picture, ".png")],
                  [path for path in (options.scene, options.lens) if path])
    with messages(options) as write:
        if options.scheduler:
            from .cluster import render_on_cluster

            report, remarks = render_on_cluster(options, write)
        else:
            report, remarks = _render_here(options, write)
        finish(options, report, [])
        write(messages=remarks)


def _render_here(options, write):
    """Render in this process; returns the report and remarks."""
    if options.frames is not None:
        requested_frames(options.frames)
    scene, given = scene_and_fields(options)
    given["source"] = source_to_store(options, scene)
    restore_copied(options)
    _check_next_to_frames(options, scene)
    say(f"output: {_output_folder(options, scene)}")
    _print_camera_words(scene, given)
    return (_render_one if options.frames is None else _render_frames)(options, scene, given, write)


def restore_copied(options):
    """Restore what an open copy of a .blend lacks: the folder of its relative paths, and the window's state."""
    if options.blend_folder:
        from ..addon import set_blend_folder

        set_blend_folder(options.blend_folder.resolve())
    if options.session:
        from ..addon import take_session

        take_session(options.session)


def _check_next_to_frames(options, scene):
    from ..addon import check_next_to_frames

    check_next_to_frames(_output_folder(options, scene), options.report, options.picture)


def _print_camera_words(scene, given):
    from ..addon import camera_words

    for line in camera_words(scene.lensfield.to_request(**given)):
        say(f"camera: {line}")


def _output_folder(options, scene):
    """The folder of the command line, or the scene settings' folder if `check_output_folder` permits it."""
    from ..addon import check_output_folder, folder_for

    if options.output is None:
        check_output_folder(scene)
    return folder_for(scene, options.output and options.output.resolve())


def source_to_store(options, scene):
    """Digest of the scene's files; "" if they do not contain all of the open scene, or no passes are to be stored."""
    from ..addon import source_digest

    if options.overwrite and options.frames is None:
        return ""
    if options.scene_source is not None:
        return options.scene_source
    return "" if options.session else source_digest(scene)


def _render_one(options, scene, given, write):
    """Render the current frame; returns its report and remarks."""
    from .. import addon

    with progress(options, write) as on_progress:
        result = addon.render_through_lens(scene, overwrite=options.overwrite, progress=on_progress, **given)
    _report_frame(result, set(), write)
    return result.report, result.messages


def _render_frames(options, scene, given, write):
    """Render the missing frames in order; returns the report of all frames, and remarks."""
    from .. import addon

    frames = requested_frames(options.frames)
    with progress(options, write) as on_progress:
        on_progress(0.0, "Looking for finished frames")
        animation = addon.Animation(scene, frames, overwrite=options.overwrite, any_build=options.any_build,
                                    wait=options.wait, **given)
    for frame, path in animation.current.items():
        write(lens_image=str(path), frame=frame)
    for line in animation.beforehand:
        say(line)
    known = set()
    for frame in animation.turns:
        with progress(options, write) as on_progress:
            result = animation.render(frame, on_progress)
        if result:
            _report_frame(result, known, write, frame=frame)
        elif frame in animation.current:
            write(lens_image=str(animation.current[frame]), frame=frame)
    say(*animation.summary)
    return animation.report, animation.messages


def _report_frame(result, known, write, **facts):
    """Report a finished frame: print its plans and files, except for lines in `known`, and write a message."""
    scene, filtered = result.report.scene, result.report.lens_image
    for line in (f"scene: {scene.scene_plan}", *([f"samples: {scene.samples}"] if scene.samples else ()),
                 *([f"plan: {filtered.plan.text}"] if filtered else ()), *result.report.files.values()):
        if line not in known:
            say(line)
        known.add(line)
    write(lens_image=str(result.lens_image), seconds=round(sum(result.report.stages.values()), 1), **facts)


def _named_scene(options):
    return open_scene(options.scene, options.scene_name)


def scene_and_fields(options, scene_of=_named_scene):
    """The scene that `scene_of` returns for the options, by default as in the .blend; and the fields of a RenderRequest
    that the command line gives."""
    given = given_fields(options)
    spectral, engine = given_settings(options, SpectralOptions), given_settings(options, Options)
    scene = _scene_to_render(options, scene_of)
    if spectral:
        given["spectral"] = scene.lensfield.to_spectral_options(**spectral)
    if engine or options.tier:
        given["options"] = scene.lensfield.to_options(options.tier, **engine)
    if stray := given_settings(options, StrayOptions):
        given["stray"] = scene.lensfield.to_stray_options(**stray)
    if given_reading(options):
        given["lens"] = lens_source(options, options.lens or _lens_of(scene))
    return scene, given | {"iris": iris_option(options)}


def say_without_truth(scene):
    """State that the command leaves the scene's list of ground truth to renders."""
    if truth := scene.lensfield.to_request().truth:
        say(f"ground truth: {truth} only in renders")


def _lens_of(scene):
    from ..addon import camera_settings

    return camera_settings(scene).lens_name_or_path()


def _scene_to_render(options, scene_of):
    """The scene with the resolution and samples of the command line."""
    if options.samples is not None:
        check_limits("--samples", options.samples, SAMPLE_LIMITS)
    size = resolution(options.resolution) if options.resolution else None
    scene = scene_of(options)
    if options.samples is not None:
        scene.cycles.samples = options.samples
    if size:
        scene.render.resolution_x, scene.render.resolution_y = size
        scene.render.resolution_percentage = 100
    return scene
