"""The background render that a window starts: a child process, polled by one of Blender's timers.

Between two ticks only the scene's name and session_uid are stored, because the file may be edited, undone, saved, or
replaced by another one.
"""

import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import bpy
from bpy.app.handlers import persistent

from lensfield.engine.runtime.child import Child
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.runtime.messages import duration, time_left

from ..capture.finished_passes import passes_left
from ..capture.scene_plan import check_wavelengths
from ..job.job import check_output_folder, folder_for, requested
from ..job.named_files import check_named_files
from ..job.photo import chosen_camera
from ..job.source import check_sources, window_digest
from ..render.animation import frames_of
from ..render.child import apply_command, compare_command, render_command, save_copy, work_folder
from ..render.refilter import rendered_state, saved_radiance
from ..render.session import lost_images
from ..scene.blend_folder import moved_remarks
from ..scene.compositor import (
    fingerprint_now,
    follow_frames,
    forget_fingerprints,
    key_of,
    lay_into_compositor,
    lens_image,
    show_file,
)
from ..scene.errors import blenders_reason
from ..scene.requirements import check_scene
from .common.areas import fit_picture, image_areas, image_editors, redraw_panels, tool_in_use
from .common.lens_worker import requested_lens
from .common.previews import load_sheet
from .common.session import ComparedLens, LastRender, LastSheet, session
from .learned_time import learn_time
from .preview.preview import unaffected
from .render_display import open_as_render

TICK_S = 0.1
PICTURE = "so_far.png"


@dataclass(frozen=True, eq=False)
class WindowRender:
    """A running render."""

    child: Child
    folder: tempfile.TemporaryDirectory
    file_name: str
    scene_name: str
    scene_uid: int  # unique until Blender ends
    to_compositor: bool
    remarks: list
    output_folder: Path | None = None  # the folder that stores finished passes
    animation: bool = False
    fingerprint: str | None = None  # of the scene when the render started
    f_stops: bool = False  # of a comparison: whether its f-numbers were chosen
    laid: list = field(default_factory=list)  # lens images that are in the compositor
    started_s: float = field(default_factory=time.monotonic)

    @property
    def picture(self):
        """The path of a PNG of the light so far, which exists as soon as there is any."""
        return Path(self.folder.name) / PICTURE

    @property
    def fraction(self):
        return self.child.status.get("fraction", 0.0)

    @property
    def label(self):
        """The stage, the elapsed time, and the remaining time if it can be estimated; and the scene and the file, if
        the window shows another scene."""
        now_s = time.monotonic()
        label = f"{self.child.status.get('label', 'Starting Blender in the background')}, "
        label += duration(now_s - self.started_s)
        if bpy.context.scene.session_uid != self.scene_uid:
            label = f"{self.scene_name} of {self.file_name or 'an unsaved file'}: {label}"
        left = time_left(self.fraction, self.child.status_s - self.started_s, now_s - self.child.status_s)
        return f"{label}, about {left}" if left else label


def start(scene, *frames):
    """Start rendering a scene by its settings, in a separate process, which also bakes the lens and checks all that
    depends on it.

    Parameters
    ----------
    scene : bpy.types.Scene
        The window's scene.
    frames : str
        Arguments of `lensfield render` that select other frames than the current one.

    Returns
    -------
    list of str
        Remarks on what the picture will lack.

    Raises
    ------
    InputError
        The settings are invalid.
    """
    check_named_files()
    check_output_folder(scene)
    check_scene(scene, frames=frames_of(scene) if frames else ())
    chosen_camera(request := requested(scene))
    check_wavelengths(request.wavelengths_nm)
    check_sources(scene)
    requested_lens(scene)  # raises an error that is known already
    key_of(scene)
    bpy.context.view_layer.update()  # so that the fingerprint includes the latest changes
    forget_fingerprints()
    remarks, state_now, source = _lost_remarks(), fingerprint_now(scene), window_digest(scene)
    _follow(scene, lambda folder: render_command(scene, save_copy(folder), *frames,
                                                 picture=Path(folder) / PICTURE, state=state_now, source=source),
            remarks, state_now, folder_for(scene), bool(frames))
    return remarks


def start_again(scene):
    """Start applying the lens of a scene's settings to the radiance of its last render, in a separate process.

    Raises
    ------
    InputError
        The radiance does not exist, or does not fit the scene.
    """
    check_named_files()
    radiance = saved_radiance(scene)
    _follow(scene, lambda folder: apply_command(radiance, scene), [], rendered_state(scene, radiance))


def start_comparison(scene, lenses, f_numbers, size, samples):
    """Start comparing lenses in a scene, in a separate process; arguments as for `compare_command`.

    Returns
    -------
    list of str
        Remarks on what the pictures will lack.

    Raises
    ------
    InputError
        The scene cannot be rendered in the camera's view.
    """
    check_named_files()
    check_output_folder(scene)
    check_scene(scene, view="camera")
    remarks = _lost_remarks()
    _follow(scene, lambda folder: compare_command(scene, save_copy(folder), lenses, f_numbers, size, samples,
                                                  Path(folder) / PICTURE),
            remarks, None, f_stops=bool(f_numbers))
    return remarks


def _lost_remarks():
    return [f"Image {name!r} has unsaved pixels, which the render lacks: save or pack it"
            for name in lost_images()]


def _follow(scene, command_in, remarks, fingerprint, output_folder=None, animation=False, f_stops=False):
    """Start the command that `command_in` returns for a temporary folder, and register the timer that follows it."""
    folder = work_folder()
    try:
        child = Child(command_in(folder.name), folder.name)
    except BaseException:
        folder.cleanup()
        raise
    session.render = WindowRender(child, folder, Path(bpy.data.filepath).name, scene.name, scene.session_uid,
                                  scene.lensfield.to_compositor, remarks,
                                  output_folder, animation, fingerprint, f_stops)
    forget_last()
    bpy.app.timers.register(tick, first_interval=TICK_S, persistent=True)  # also after another file is opened


def tick():
    """Poll the child and add its newest frame to the compositor; returns seconds until the next call, or None."""
    render = session.render
    if render and not bpy.app.is_job_running("RENDER"):  # Blender's render uses the compositor
        if render.child.ended:
            _finish(render)
        else:
            _lay(render)
    redraw_panels()
    return TICK_S if session.render else None


def cancel():
    """Cancel the running render; finished frames and passes remain."""
    render = session.render
    end()
    _notify("CANCEL", ["Cancelled", *_left(render)])
    redraw_panels()


def end():
    """End the running render, if any, without a message, as when Blender quits or the add-on is disabled."""
    render, session.render = session.render, None
    if render:
        render.child.end()
        render.folder.cleanup()
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)


@persistent
def forget_last(*_):
    """Discard the result of the last render when another file is opened or the next render starts."""
    session.last_render = LastRender()


def _finish(render):
    """Process the output of a render whose process has ended, and report the result."""
    session.render = None
    render.child.end()
    outcome = render.child.status
    _lay(render)
    newest = next(map(Path, reversed(render.child.lens_images)), None)
    if newest and not render.to_compositor and _scene(render):  # otherwise another file is open
        open_as_render(lambda: show_file(bpy.data.images.get(newest.name), str(newest), newest.name), _show)
    if render.to_compositor and render.child.lens_images and _scene(render) is None:
        render.remarks.append(f"Scene {render.scene_name!r} is no longer open: its compositor is unchanged")
    if _scene(render):
        render.remarks.extend(moved_remarks())
    sheet = _take_sheet(render, outcome) if "sheet" in outcome else None
    with render.folder:
        if "messages" in outcome:
            if newest and not sheet:
                learn_time(render.scene_uid, newest)
            _notify("INFO", outcome["messages"] + render.remarks, newest, sheet)
        elif "error" in outcome:
            _notify("ERROR", [outcome["error"], *_left(render)], newest)
        else:
            died = "The render process ended unexpectedly ({}); log: {}".format(*render.child.death())
            _notify("ERROR", [died, *_left(render)], newest)


def _left(render):
    """Lines about the finished frames and passes of an incomplete render."""
    scene = _scene(render)
    passes = passes_left(scene, render.output_folder) if scene and render.output_folder else []
    count = len(render.child.lens_images) if render.animation else 0
    frames = "1 frame is" if count == 1 else f"{count} frames are"
    return [f"{frames} finished; Render Animation renders the rest"] * bool(count) + passes


def _scene(render):
    """The rendered scene, or None if it is gone."""
    return next((scene for scene in bpy.data.scenes if scene.session_uid == render.scene_uid), None)


def _take_sheet(render, outcome):
    """Keep a contact sheet for the choice of a lens, and open it as a finished picture; returns its path."""
    path = Path(outcome["sheet"])
    lenses = tuple(ComparedLens(**cell | {"box": tuple(cell["box"])}) for cell in outcome["cells"])
    session.last_sheet = LastSheet(path, render.scene_uid, render.f_stops, lenses)
    if _scene(render):
        open_as_render(lambda: load_sheet(path), _show_sheet)
    return path


def _show_sheet(image):
    """Show a contact sheet in image editors that showed Blender's render."""
    for window, area in image_areas():
        if (shown := area.spaces.active.image) and shown.type == "RENDER_RESULT":
            area.spaces.active.image = image
            fit_picture(window, area)
    _remember_for_undo("Contact Sheet")  # undoing the choice of a lens must not remove the sheet


def _notify(icon, lines, lens_image=None, sheet=None):
    session.last_render = LastRender(icon, tuple(lines), lens_image, sheet)
    print("Lensfield:", *lines, sep="\n  ")


def _lay(render):
    """Add new lens images, if any, to the compositor of the rendered scene, if it still exists."""
    new, scene = render.child.lens_images[len(render.laid):], _scene(render)
    if not render.to_compositor or not new or scene is None:
        return
    first = not render.laid
    render.laid.extend(new)  # before it can fail, so that the next tick does not try again
    try:
        with unaffected():
            lay_into_compositor(scene, *map(Path, new), fingerprint=render.fingerprint)
    except (InputError, RuntimeError) as error:  # Blender raises RuntimeError if, for example, the tree is linked
        remark = f"The lens image was not added to the compositor: {blenders_reason(error)}"
        if remark not in render.remarks:
            render.remarks.append(remark)
        return
    if first:  # one undo step for the first of many frames: a step for each would use up the undo history
        _remember_for_undo("Lens Image to Compositor")
    _show(lens_image(scene))
    if first:
        open_as_render(lambda: lens_image(scene) if (scene := _scene(render)) else None, _show)


def _remember_for_undo(change):
    """Push an undo step for a change; not during a transform or a stroke, where Blender pushes the steps."""
    if not bpy.app.background and not tool_in_use():
        with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
            bpy.ops.ed.undo_push(message=change)


def _show(image):
    """Show a lens image in image editors that showed Blender's render; one in a compositor follows the frames."""
    scene = next((scene for scene in bpy.data.scenes if lens_image(scene) == image), None)
    for editor in image_editors():
        if editor.image and editor.image.type == "RENDER_RESULT":
            editor.image = image
        if scene and editor.image == image:
            follow_frames(scene, editor.image_user)
