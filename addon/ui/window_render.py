"""The render that a window has started: a child at work, followed by one of Blender's timers.

Nothing of the file is kept between two ticks but the name of the scene and its session_uid: meanwhile it may be edited,
undone, saved, or closed for another one.
"""

import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import bpy
from bpy.app.handlers import persistent

from ...commands.child import Child
from ...commands.messages import duration, time_left
from ...engine.errors import InputError
from ..job.child import apply_command, render_command, save_copy, work_folder
from ..job.job import check_output_folder, job_from_settings
from ..job.kept_passes import passes_left
from ..job.named_files import check_named_files
from ..job.refilter import kept_radiance
from ..job.scene_plan import check_job
from ..job.session import lost_images
from ..job.source import window_digest
from ..scene.compositor import (
    fingerprint_now,
    follow_frames,
    forget_fingerprints,
    laid_fingerprint,
    lay_into_compositor,
    lens_image,
)

TICK_S = 0.1
PICTURE = "so_far.png"


@dataclass(frozen=True, eq=False)
class WindowRender:
    """A render under way."""

    child: Child
    folder: tempfile.TemporaryDirectory
    scene_name: str
    scene_uid: int  # which no other scene has until Blender ends
    to_compositor: bool
    remarks: list
    output_folder: Path | None = None  # where passes of it are kept
    animation: bool = False
    fingerprint: str | None = None  # of the scene as it is rendered
    laid: list = field(default_factory=list)  # into the compositor: lens images
    started_s: float = field(default_factory=time.monotonic)

    @property
    def picture(self):
        """A PNG of the light so far, once there is any."""
        return Path(self.folder.name) / PICTURE

    @property
    def fraction(self):
        return self.child.told.get("fraction", 0.0)

    @property
    def label(self):
        """The scene, the stage, and the time: so far, and what is left as far as can be told."""
        now_s = time.monotonic()
        label = (f"{self.scene_name}: {self.child.told.get('label', 'Starting Blender in the background')}, "
                 f"{duration(now_s - self.started_s)}")
        left = time_left(self.fraction, self.child.told_s - self.started_s, now_s - self.child.told_s)
        return f"{label}, about {left}" if left else label


state = {"render": None, "icon": "INFO", "notice": (), "lens_image": None}
"""The WindowRender under way, or None; and what became of the last one: lines, the icon they go under, its file."""


def start(scene, *frames, lens_quality=None):
    """Start rendering a scene by its settings, in a process of its own.

    Parameters
    ----------
    scene : bpy.types.Scene
        The window's.
    frames : str
        Arguments of `lensfield render` that ask for others than the current frame.
    lens_quality : str, optional
        How finely the lens is baked to check what is asked; as the render's by default.

    Returns
    -------
    list of str
        What the picture will be without.

    Raises
    ------
    InputError
        What the settings ask for cannot be.
    """
    check_named_files()
    check_output_folder(scene)
    job = job_from_settings(scene, lens_quality=lens_quality)
    check_job(scene, job)
    bpy.context.view_layer.update()  # what has just been changed is known to be
    forget_fingerprints()
    remarks = [f"image {name!r} has unsaved pixels, which are not in the picture: save or pack it"
               for name in lost_images()]
    state_now, source = fingerprint_now(scene), window_digest(scene)
    _follow(scene, lambda folder: render_command(save_copy(folder), Path(folder) / PICTURE, "--scene-state", state_now,
                                                 "--scene-source", source, *frames),
            remarks, state_now, job.output_folder, bool(frames))
    return remarks


def start_again(scene):
    """Start putting the light of a scene's last render through the lens of its settings, in a process of its own.

    Raises
    ------
    InputError
        There is no such light, or none that fits the scene.
    """
    check_named_files()
    radiance = kept_radiance(scene)
    _follow(scene, lambda folder: apply_command(radiance, scene), [], laid_fingerprint(scene))


def _follow(scene, command_in, remarks, fingerprint, output_folder=None, animation=False):
    """Start a command, which may need a folder for a time, and follow it."""
    folder = work_folder()
    try:
        child = Child(command_in(folder.name), folder.name)
    except BaseException:
        folder.cleanup()
        raise
    state["render"] = WindowRender(child, folder, scene.name, scene.session_uid, scene.lensfield.to_compositor, remarks,
                                   output_folder, animation, fingerprint)
    forget_last()
    bpy.app.timers.register(tick, first_interval=TICK_S, persistent=True)  # it outlives the file


def tick():
    """Look how far it is, and lay its newest frame into the compositor; seconds to the next look."""
    render = state["render"]
    if render and not bpy.app.is_job_running("RENDER"):  # Blender's own uses the compositor
        if render.child.ended:
            _finish(render)
        else:
            _lay(render)
    redraw_panels()
    return TICK_S if state["render"] else None


def cancel():
    """End the render under way, and leave nothing of it but the frames and passes that are done."""
    render = state["render"]
    end()
    _notify("CANCEL", ["Cancelled", *_left(render)])
    redraw_panels()


def end():
    """End what is under way, if anything is: Blender, or the add-on, is about to end."""
    render, state["render"] = state["render"], None
    if render:
        render.child.end()
        render.folder.cleanup()
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)


@persistent
def forget_last(*_):
    """What was told of the last render is no business of another file, nor of the next render."""
    state.update(notice=(), lens_image=None)


def _finish(render):
    """Take in what a render that has ended by itself leaves, and tell what became of it."""
    state["render"] = None
    render.child.end()
    told = render.child.told
    _lay(render)
    state["lens_image"] = next(map(Path, reversed(render.child.lens_images)), None)
    if render.to_compositor and render.child.lens_images and _scene(render) is None:
        render.remarks.append(f"scene {render.scene_name!r} is no longer open: its compositor is as it was")
    with render.folder:
        if "told" in told:
            _notify("INFO", told["told"] + render.remarks)
        elif "error" in told:
            _notify("ERROR", [told["error"], *_left(render)])
        else:
            died = "the process of the render died, of {}; its log is {}".format(*render.child.death())
            _notify("ERROR", [died, *_left(render)])


def _left(render):
    """What is left of a render that did not come to its end: list of lines."""
    scene = _scene(render)
    passes = passes_left(scene, render.output_folder) if scene and render.output_folder else []
    count = len(render.child.lens_images) if render.animation else 0
    frames = "1 frame is" if count == 1 else f"{count} frames are"
    return [f"{frames} there; the next animation goes on from there"] * bool(count) + passes


def _scene(render):
    """The scene that a render is of, if it is still there."""
    return next((scene for scene in bpy.data.scenes if scene.session_uid == render.scene_uid), None)


def _notify(icon, lines):
    state["icon"], state["notice"] = icon, tuple(lines)
    print("Lensfield:", *lines, sep="\n  ")


def _lay(render):
    """Lay new lens images into the compositor of the scene that they are of, if there are any, and the scene too."""
    new, scene = render.child.lens_images[len(render.laid):], _scene(render)
    if not render.to_compositor or not new or scene is None:
        return
    first = not render.laid
    render.laid.extend(new)  # before it can fail: it is not for the next tick to try again
    try:
        lay_into_compositor(scene, *map(Path, new), fingerprint=render.fingerprint)
    except (InputError, RuntimeError) as error:  # Blender's own, where the tree is linked, say
        remark = f"not laid into the compositor: {str(error).strip()}"
        if remark not in render.remarks:
            render.remarks.append(remark)
        return
    if first:  # of many frames only the first is a step of its own, or none would be left for others
        _remember_for_undo()
    _show(scene)


def _remember_for_undo():
    """Let the next undo take back this alone; amid a transform or a stroke, it is for Blender to say what is a step."""
    windows = bpy.context.window_manager.windows
    if not bpy.app.background and not any(len(window.modal_operators) for window in windows):
        with bpy.context.temp_override(window=windows[0]):
            bpy.ops.ed.undo_push(message="Lens Image to Compositor")


def _show(scene):
    """Let image editors that followed Blender's own render show the lens image, frame by frame."""
    for editor in (area.spaces.active for area in areas("IMAGE_EDITOR")):
        if editor.image and editor.image.type == "RENDER_RESULT":
            editor.image = lens_image(scene)
        if editor.image == lens_image(scene):
            follow_frames(scene, editor.image_user)


def redraw_panels():
    """Panels follow the progress only when they are told to."""
    for area in areas("PROPERTIES", "VIEW_3D"):
        for region in area.regions:
            if area.type == "PROPERTIES" or region.type == "UI":
                region.tag_redraw()


def areas(*types):
    """The areas of these types, in all windows."""
    return [area for window in bpy.context.window_manager.windows for area in window.screen.areas if area.type in types]
