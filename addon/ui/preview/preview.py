"""The preview: a small, fast picture of the camera's view through the lens, updated when the scene changes.

While it is on, a child process (`lensfield serve`) stays loaded and renders copies of the file, one at a time: first a
coarse picture, then finer ones. Changes of values, such as an object's place, are sent to the scene that it has loaded
(`addon/scene/changes.py`), and another lens is applied to the light of the last scene. Handlers only record which
data-blocks have changed, and when; a timer stops the child's work if its pictures are out of date, and sends the next
request once changes have stopped. Of the file, only names and session_uids are stored.
"""

import time
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np
from bpy.app.handlers import persistent

from lensfield.engine.runtime.child import Child
from lensfield.engine.runtime.errors import InputError

from ...capture.growing_capture import FINER
from ...job.named_files import check_named_files, named_files
from ...job.photo import ShownExposure
from ...job.result import Result
from ...render.child import CONTINUE, lensfield_command, preview_arguments, save_copy, work_folder
from ...scene.camera import check_camera, frame_px
from ...scene.changes import DIFFERENT, MAYBE, changed_blocks, render_switches, structure_digest, write_changes
from ...scene.compositor import show_file
from ...scene.errors import SceneError
from ...scene.look import save_as_shown
from ...scene.moves import still_digests, write_moves
from ...scene.requirements import check_scene
from ..common.areas import areas, image_editors, tool_in_use
from ..common.plain_words import plain
from ..common.properties import lens_title
from ..common.session import session
from . import focus_overlay, preview_overlay
from .state import Preview, Shown, State, Task, lens_key, shown_tangents

NAME = "Lensfield Preview"  # image name
TICK_S = 0.1
STILL_S = 0.5  # time without a change before the scene is rendered again
SWITCHES_S = 1.0  # between looks at the modifiers of all objects
LONG_SIDE_PX = 480  # the finest picture's longer side without a viewport in the camera's view
VIEWPORT_SIDES_PX = 240, 960  # and its limits in one
SAMPLES = 64  # of the finest picture
LEAST_SIDE_PX = 12
SAME_VIEW = 0.005
CHANGES, MOVES = "changes.json", "moves.json"  # next to the copy
QUIET = {"WINDOWMANAGER", "SCREEN", "WORKSPACE", "BRUSH", "IMAGE"}  # ID types that do not affect the render


def start(scene):
    """Switch the preview of a scene on.

    Raises
    ------
    SceneError
        The scene does not have a camera that a lens can replace.
    """
    end()
    check_named_files()
    check_scene(scene)
    shown_tangents(scene, lens_key(scene))
    folder = work_folder()
    child = Child(lensfield_command(["serve"]), folder.name)
    session.preview, session.preview_failure = Preview(child, folder, scene.session_uid), ""
    for name, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)
    preview_overlay.start()
    bpy.app.timers.register(tick, first_interval=0.0, persistent=True)


def end():
    """Switch the preview off, if it is on, but leave its image: Blender may be closing the file or quitting."""
    preview, session.preview = session.preview, None
    if preview is None:
        return
    preview_overlay.end()
    focus_overlay.forget()
    for name, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)
    preview.child.end()
    preview.folder.cleanup()


def switch_off(why=""):
    """Switch the preview off and remove its image; `why` is the reason, if the user did not request it."""
    end()
    session.preview_failure = why
    if image := bpy.data.images.get(NAME):
        for editor in image_editors():
            if editor.image == image:
                editor.image = bpy.data.images.get("Render Result")
        bpy.data.images.remove(image)
    redraw()


def tick():
    """Process the child's results and send its next request; returns seconds until the next call, or None."""
    preview = session.preview
    scene = _scene_of(preview)
    if scene is None:
        switch_off("its scene no longer exists")
        return None
    if preview.child.ended:
        preview.child.end()
        switch_off("its process ended unexpectedly ({}); log: {}".format(*preview.child.death()))
        return None
    _note_switches(preview, scene)
    _note_growth(preview, scene)
    if preview.at_work:
        _take_in(preview, scene)
    if not preview.at_work and (shown := _shown_scene(scene)) != scene:
        _turn_to(preview, shown)
    elif not preview.at_work and _may_work():
        _ask_next(preview, scene)
    if preview.announced != (waiting_for := preview.waiting_for):
        preview.announced = waiting_for
        redraw()
    return TICK_S


def _scene_of(preview):
    """The scene of a preview, or None if it no longer exists."""
    return next((scene for scene in bpy.data.scenes if scene.session_uid == preview.scene_uid), None)


def _shown_scene(scene):
    """The scene that the main window shows; without a window, the given one."""
    windows = bpy.context.window_manager.windows
    return windows[0].scene if windows else scene


def _turn_to(preview, scene):
    """Preview another scene of the file from now on."""
    preview.scene_uid, preview.shown, preview.lens = scene.session_uid, None, ()
    preview.state, preview.number = State.IDLE, 0
    preview.changed_s, preview.other_s, preview.loaded.changes = 0.0, 0.0, None
    preview.picture.unlink(missing_ok=True)
    preview_overlay.forget_picture()


def _may_work():
    """Whether no render or tool is running (Blender does not save while a tool runs), the file names only trusted
    files (appended data may name others), and a viewport that has been turned to the camera shows the frame's size."""
    return (session.render is None and not bpy.app.is_job_running("RENDER")
            and not tool_in_use() and not named_files() and not session.overlay.turned)


def _ask_next(preview, scene):
    try:
        key = lens_key(scene)
    except InputError as error:
        preview.lens = ()  # so that the next valid lens is applied
        _show_error(preview, error)
        return
    if preview.by_hand:
        _ask_render(preview, scene, key)
    elif preview.same_scene and preview.shown and key != preview.lens:
        preview.changed_s = None  # choosing a lens does not count as a change of the scene
        preview.number = 0
        _ask(preview, Task.LENS, key, preview_arguments(scene, key))
    elif preview.fresh and preview.state is State.PAUSED:
        _ask(preview, preview.task, preview.lens, CONTINUE)  # shows the stopped task's lens
    elif preview.changed_s is not None and time.monotonic() - preview.changed_s > STILL_S:
        _ask_after_change(preview, scene, key)


def _ask_after_change(preview, scene, key):
    """Send the values that have changed; if these are not all, a copy, unless that takes long: the user requests it."""
    loaded = preview.loaded
    if loaded.changes is not None and not _ask_moves_or_change(preview, scene, key):
        loaded.changes = None
    if loaded.changes is None and not preview.slow:
        _ask_render(preview, scene, key)


def _ask_moves_or_change(preview, scene, key):
    """Send the values that have changed since the copy, if these are all; returns whether they are."""
    try:
        if structure_digest(scene) != preview.loaded.structure:
            return False
        still = still_digests(scene, preview.loaded.changes)
        if _only_moved(preview, scene, key, still):
            _ask_moves(preview, key, still)
        elif not _ask_change(preview, scene, key):
            return False
    except InputError:  # the copy will report it
        return False
    _note_request(preview)
    preview.loaded.still |= still or {}
    return True


def _only_moved(preview, scene, key, still):
    """Whether objects have moved since the child prepared the scene, by their `still_digests`, and nothing else has
    changed."""
    return (still is not None and still.items() <= preview.loaded.still.items()
            and key == preview.lens and (key, size_px(scene)) == preview.loaded.prepared)


def _ask_moves(preview, key, still):
    """Send the places of the objects that have moved."""
    path = Path(preview.folder.name) / MOVES
    write_moves(path, still)
    preview.number = 0
    _ask(preview, Task.CHANGE, key, [*CONTINUE, "--moves", str(path)])


def _ask_change(preview, scene, key):
    """Send the values that have changed, if these are all; returns whether they are."""
    path = Path(preview.folder.name) / CHANGES
    if not write_changes(path, scene, preview.loaded.changes, MAYBE if preview.same_scene else DIFFERENT):
        return False
    _ask_pictures(preview, scene, key, Task.CHANGE, changes=path)
    return True


def _ask_render(preview, scene, key):
    """Send a copy of the file."""
    _note_request(preview)
    begin_s = time.monotonic()
    try:
        preview.loaded.structure, preview.loaded.still = structure_digest(scene), {}
        copy = save_copy(preview.folder.name)
        preview.copies_s = (*preview.copies_s[-1:], time.monotonic() - begin_s)
        _ask_pictures(preview, scene, key, Task.RENDER, copy=copy)
    except InputError as error:
        preview.loaded.changes = None
        _show_error(preview, error)
        return
    preview.started_s = begin_s


def _note_request(preview):
    preview.changed_s, preview.other_s, preview.by_hand, preview.loaded.changes = None, None, False, {}


def _ask_pictures(preview, scene, key, task, **files):
    preview.loaded.tangents = shown_tangents(scene, key)
    preview.number, preview.loaded.prepared = 0, (key, size_px(scene))
    size = tuple(-(-side // FINER) for side in size_px(scene))
    _ask(preview, task, key, preview_arguments(scene, key, **files, size=size, samples=SAMPLES))


def _show_error(preview, error):
    if preview.error != plain(error):
        preview.error = plain(error)
        redraw()


def _ask(preview, task, key, arguments):
    preview.state, preview.task, preview.lens, preview.started_s = State.WORKING, task, key, time.monotonic()
    preview.child.ask(arguments)


def size_px(scene):
    """Width and height of the finest picture: as the camera's frame in the largest viewport that shows it, or of
    LONG_SIDE_PX; at most the scene's resolution."""
    rows, columns = frame_px(scene)
    sides = preview_overlay.frame_sides_px(scene, session.preview.loaded.tangents)
    longest = np.clip(max(sides), *VIEWPORT_SIDES_PX) if sides else LONG_SIDE_PX
    scale = min(1.0, longest / max(rows, columns))
    return max(LEAST_SIDE_PX, round(columns * scale)), max(LEAST_SIDE_PX, round(rows * scale))


def _take_in(preview, scene):
    """Show the task's newest picture, stop the task if it is out of date, and note its end."""
    outcome, current = preview.child.status, preview.same_scene and _shown_scene(scene) == scene
    if current and outcome.get("number", 0) > preview.number and preview.state is State.WORKING:
        if not (preview.grown and preview.shown) or outcome["size_px"][0] >= preview.shown.columns_px:
            _show(preview, scene, outcome)
        preview.number = outcome["number"]
        redraw()
    if "status" in outcome:
        _note_end(preview, scene, outcome)
        redraw()
    elif preview.state is State.WORKING and (not current or preview.by_hand or _is_too_small(preview)
                                             or _lens_is_outdated(preview, scene) or not _may_work()):
        preview.state = State.STOPPING
        preview.child.stop()


def _is_too_small(preview):
    """Whether the frame has grown since the task began, and one of its pictures is shown."""
    return preview.grown and not preview.fresh and preview.number > 0


def _lens_is_outdated(preview, scene):
    """Whether the lens has changed, or shows more than was captured, since the picture that is shown. Without one, a
    ring that turns steadily would never show anything."""
    try:
        return preview.number > 0 and (lens_key(scene) != preview.lens
                                       or (preview.task is Task.LENS and not _in_view(preview, scene)))
    except InputError:
        return False  # the next request reports it


def _note_end(preview, scene, outcome):
    failed, task, preview.error = outcome["status"], preview.task, ""
    preview.state = State.PAUSED if preview.state is State.STOPPING and not failed else State.IDLE
    if failed:
        preview.loaded.prepared = ()
    if task is Task.LENS and (failed or (preview.number and not _in_view(preview, scene))):
        preview.changed_s, preview.state = 0.0, State.IDLE  # parts of the scene were not captured: render again
    elif task is Task.CHANGE and failed:  # it needs a copy
        preview.loaded.changes = None
        preview.changed_s, preview.other_s = preview.changed_s or 0.0, preview.other_s or 0.0
    elif failed:
        preview.error = outcome.get("error", "Failed: see the console")


def _in_view(preview, scene):
    """Whether the captured radiance has the view of the current lens."""
    try:
        return np.allclose(shown_tangents(scene, lens_key(scene)), preview.loaded.tangents, rtol=SAME_VIEW)
    except InputError:
        return False  # the render will report it


def _facts(size_px, samples, seconds, lens):
    """Size, samples, time and lens of the preview: list of lines."""
    return ["{} \u00d7 {} px, {} samples, {:.1f} s".format(*size_px, samples, seconds), lens_title(lens)]


def _show(preview, scene, outcome):
    """Show a picture in the camera's view; show the first one also in image editors with Blender's render."""
    path = Path(outcome["picture"])
    image = show_file(bpy.data.images.get(NAME), str(path), NAME)
    save_as_shown(image, preview.picture, scene)
    preview_overlay.forget_picture()
    for editor in () if preview.shown else image_editors():
        if editor.image is None or editor.image.type == "RENDER_RESULT":
            editor.image = image
    facts = _facts(outcome["size_px"], outcome["samples"], time.monotonic() - preview.started_s, preview.lens[0])
    exposure = ShownExposure(**outcome["exposure"]) if "exposure" in outcome else None
    preview.shown = Shown(outcome["size_px"][0], Result.from_file(path, "lens_image").depth, facts, exposure)
    preview.error = ""


def is_visible():
    """Whether a window has a place for the preview."""
    return any(map(shows_camera, areas("VIEW_3D"))) or any(
        editor.image and editor.image.name == NAME for editor in image_editors())


def shows_camera(viewport):
    """Whether a 3D viewport, an area, shows what overlays the camera's view."""
    space = viewport.spaces.active
    return space.region_3d.view_perspective == "CAMERA" and space.overlay.show_overlays


def look_through_camera(context):
    """Turn a 3D viewport of the window to the camera's view, unless one shows it already: the operator's own viewport,
    or the largest."""
    viewports = [area for area in context.window.screen.areas if area.type == "VIEW_3D"]
    if viewports and not any(map(shows_camera, viewports)):
        chosen = context.area if context.area in viewports else max(
            viewports, key=lambda area: area.width * area.height)
        chosen.spaces.active.region_3d.view_perspective = "CAMERA"
        chosen.spaces.active.overlay.show_overlays = True
        preview_overlay.await_drawing()


def redraw():
    """Draw the editors with the preview, and its panel, again."""
    for area in areas("PROPERTIES", "VIEW_3D", "IMAGE_EDITOR"):
        area.tag_redraw()


@contextmanager
def unaffected():
    """Changes within do not affect the preview, though Blender may report all objects as changed: a scene's first
    compositor does that."""
    bpy.context.view_layer.update()  # reports the user's changes
    session.preview_unaffected = True
    try:
        yield
        bpy.context.view_layer.update()
    finally:
        session.preview_unaffected = False


@persistent
def on_update(scene, depsgraph):
    """Record the time of a change that affects the render."""
    if session.preview_unaffected:
        return
    updates = [update for update in depsgraph.updates if update.id.id_type not in QUIET and _counts(update)]
    preview = session.preview
    if preview and preview.loaded.changes is not None:
        preview.loaded.changes = changed_blocks(depsgraph, preview.loaded.changes)
    if updates:
        _note(of_lens=all(map(_may_be_of_lens, updates)) and _lens_has_changed(preview))


def _lens_has_changed(preview):
    """Whether the lens of the preview's scene, its focus or its f-stop differ from the picture, in front of a camera
    that a lens can replace."""
    scene = preview and _scene_of(preview)
    try:
        return scene is not None and _has_view(scene) and lens_key(scene) != preview.lens
    except InputError:
        return True


def _has_view(scene):
    """Whether a lens can replace the scene's camera."""
    try:
        check_camera(scene)
    except SceneError:
        return False
    return True


def _counts(update):
    """Whether an update affects the render: not a mere selection, and not the compositor, which the preview ignores."""
    if update.id.id_type == "NODETREE":
        return update.id.type != "COMPOSITING"
    named = update.id.id_type in ("SCENE", "OBJECT", "COLLECTION")
    return not named or update.is_updated_geometry or update.is_updated_transform or update.is_updated_shading


def _may_be_of_lens(update):
    """Whether an update may come only from the choice of a lens, or from the camera's focus and f-stop."""
    if update.id.id_type == "OBJECT":
        return update.id.type == "CAMERA" and not update.is_updated_transform
    return update.id.id_type == "SCENE" or (update.id.id_type == "CAMERA" and not update.is_updated_shading)


@persistent
def on_frame(scene, *_):
    """Record a change of frame, or an undo or redo: more than values may have changed."""
    _note()
    if session.preview:
        session.preview.loaded.prepared = ()


@persistent
def on_load(*_):
    """Switch the preview off before another file is loaded."""
    end()


def _note_switches(preview, scene):
    """Record the objects whose modifiers have been turned on or off for renders."""
    if time.monotonic() - preview.looked_s < SWITCHES_S:
        return
    before, preview.switches = preview.switches, render_switches(scene)
    switched = {name: MAYBE for name, switches in preview.switches.items() if before.get(name, switches) != switches}
    if switched:
        _note()
        if preview.loaded.changes is not None:
            preview.loaded.changes = switched | preview.loaded.changes
    preview.looked_s = time.monotonic()


def _note_growth(preview, scene):
    """Record that the frame has grown in a viewport beyond the size that the child has prepared."""
    loaded = preview.loaded
    if preview.fresh and loaded.prepared and _has_view(scene) and size_px(scene) > loaded.prepared[1]:
        _note(of_lens=True)
        preview.grown = True


def _note(of_lens=False):
    preview = session.preview
    if preview:
        preview.changed_s, preview.grown = time.monotonic(), False
        preview.other_s = preview.other_s if of_lens else preview.changed_s


_HANDLERS = {"depsgraph_update_post": on_update, "frame_change_post": on_frame, "undo_post": on_frame,
             "redo_post": on_frame, "load_pre": on_load}
