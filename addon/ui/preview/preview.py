"""The preview: a small, fast picture of the camera's view through the lens, updated when the scene changes.

While it is on, a child process (`lensfield serve`) stays loaded and renders copies of the file, one at a time: first a
coarse picture, then finer ones. Changes of values, such as an object's place, are sent to the scene that it has loaded
(`addon/scene/changes.py`), and another lens is applied to the light of the last scene. Handlers only record which
data-blocks have changed, and when; a timer stops the child's work if its pictures are out of date, and sends the next
request once changes have stopped. Of the file, only names and session_uids are stored.
"""

import tempfile
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ....engine.runtime.child import Child
from ....engine.runtime.errors import InputError
from ...capture.growing_capture import FINER
from ...job.named_files import check_named_files, named_files
from ...job.photo import ShownExposure
from ...job.result import Result
from ...render.child import CONTINUE, lensfield_command, preview_arguments, save_copy, work_folder
from ...scene.active_camera import camera_settings
from ...scene.camera import check_camera, frame_px, view_tangents
from ...scene.changes import DIFFERENT, MAYBE, changed_blocks, render_switches, structure_digest, write_changes
from ...scene.compositor import show_file
from ...scene.errors import SceneError
from ...scene.look import save_as_shown
from ...scene.moves import still_digests, write_moves
from ...scene.requirements import check_scene
from ...scene.rings import rings_for, scene_iris
from ..common.areas import areas, image_editors, tool_in_use
from ..common.plain_words import plain
from ..common.properties import lens_title
from ..common.session import session
from . import focus_overlay, preview_overlay

NAME = "Lensfield Preview"  # image name
TICK_S = 0.1
STILL_S = 0.5  # time without a change before the scene is rendered again
SWITCHES_S = 1.0  # between looks at the modifiers of all objects
LONG_SIDE_PX = 480  # the finest picture's longer side without a viewport in the camera's view
VIEWPORT_SIDES_PX = 240, 960  # and its limits in one
SAMPLES = 64  # of the finest picture
LEAST_SIDE_PX = 12
SAME_VIEW = 0.005
LONGEST_COPY_S = 1.0  # longest automatic copy, as copying blocks the window
CHANGES, MOVES = "changes.json", "moves.json"  # next to the copy
QUIET = {"WINDOWMANAGER", "SCREEN", "WORKSPACE", "BRUSH", "IMAGE"}  # ID types that do not affect the render


@dataclass
class Preview:
    """The state of a running preview."""

    child: Child
    folder: tempfile.TemporaryDirectory
    scene_uid: int
    changed_s: float | None = 0.0  # time.monotonic() of the last change of the scene; None if unchanged since rendered
    other_s: float | None = None  # the same, without changes of the lens or of its focus and f-stop
    structure: str = ""  # of the scene that the child has loaded
    changes: dict | None = None  # data-blocks that have changed since; None if the file must be copied
    prepared: tuple = ()  # the lens's key and the size that the child has prepared the scene for
    still: dict = field(default_factory=dict)  # the `still_digests` of that scene that are known
    switches: dict = field(default_factory=dict)  # the last `render_switches`
    looked_s: float = 0.0  # time.monotonic() of that
    by_hand: bool = False  # the user has requested a refresh
    job: tuple = ()  # the child's current job: a name, and the lens's key
    stopping: bool = False  # the job has been stopped, and its next pictures are not wanted
    paused: str = ""  # name of the last job, if it has been stopped
    shown: int = 0  # number of the job's last picture that is shown; 0 for none
    columns_px: int = 0  # of the picture, as captured
    grown: bool = False  # whether only the frame in the viewport has changed since the picture: it has grown
    started_s: float = 0.0
    copies_s: tuple = ()  # seconds for each of the last two copies
    tangents: tuple = ()  # the `view_tangents` of the captured view
    lens: tuple = ()  # the key of the last lens that was applied or tried
    depth: Path | None = None  # of the picture
    facts: list = field(default_factory=list)
    exposure: ShownExposure | None = None  # of the picture
    error: str = ""
    announced: str = ""  # the last `waiting_for` that the windows show

    @property
    def picture(self):
        """The path of a PNG of the preview as Blender shows it, which exists after the first render."""
        return Path(self.folder.name) / "shown.png"

    @property
    def slow(self):
        """Whether copying the file takes so long that only the user may start it."""
        return len(self.copies_s) == 2 and min(self.copies_s) > LONGEST_COPY_S  # a single slow copy may be chance

    @property
    def fresh(self):
        return self.changed_s is None

    @property
    def same_scene(self):
        """Whether only the lens, or its focus and f-stop, has changed since the last render."""
        return self.other_s is None

    @property
    def up_to_date(self):
        """Whether the picture shows the scene, if there is one."""
        return self.same_scene and not self.error

    def shows_exposure_of(self, scene):
        """Whether the picture has the exposure of a scene's camera as it is set."""
        try:
            return self.scene_uid == scene.session_uid and self.same_scene and lens_key(scene) == self.lens
        except InputError:
            return False

    @property
    def waiting_for(self):
        """What the first picture waits for, as text; "" once it exists."""
        if self.picture.is_file() or self.error:
            return ""
        label, fraction = (self.child.status.get(name) for name in ("label", "fraction"))
        return f"Lensfield Preview: {label} {fraction:.0%}" if label else "Lensfield Preview: starting"


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
    if preview.job:
        _take_in(preview, scene)
    if not preview.job and (shown := _shown_scene(scene)) != scene:
        _turn_to(preview, shown)
    elif not preview.job and _may_work():
        _ask_next(preview, scene)
    if preview.announced != (waiting_for := preview.waiting_for):
        preview.announced = waiting_for
        redraw()
    return TICK_S


def _scene_of(preview):
    """The scene of a preview, or None if it no longer exists."""
    return next((scene for scene in bpy.data.scenes if scene.session_uid == preview.scene_uid), None)


def lens_key(scene):
    """Everything that changes the lens or the camera's exposure but not the scene: name or path, view, out-of-field
    treatment, focus and f-stop, blades, and the values of `EXPOSED_FIELDS`."""
    settings = camera_settings(scene)
    lens, out_of_field = settings.lens_name_or_path(), scene.lensfield.value_of("out_of_field")
    exposed = (settings.body_name_or_path(), settings.value_of("iso"), settings.value_of("shutter_s"),
               scene.lensfield.develop)
    return lens, settings.view_text(), out_of_field, rings_for(scene, lens), scene_iris(scene, lens), exposed


def shown_tangents(scene, key):
    """The `view_tangents` for a lens key."""
    lens, view, _, rings, *_ = key
    return view_tangents(scene, lens, view, rings)


def _shown_scene(scene):
    """The scene that the main window shows; without a window, the given one."""
    windows = bpy.context.window_manager.windows
    return windows[0].scene if windows else scene


def _turn_to(preview, scene):
    """Preview another scene of the file from now on."""
    preview.scene_uid, preview.depth, preview.lens, preview.facts = scene.session_uid, None, (), []
    preview.exposure = None
    preview.changed_s, preview.other_s, preview.paused, preview.shown, preview.changes = 0.0, 0.0, "", 0, None
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
    elif preview.same_scene and preview.depth and key != preview.lens:
        preview.changed_s = None  # choosing a lens does not count as a change of the scene
        preview.shown = 0
        _ask(preview, "lens", key, preview_arguments(scene, key))
    elif preview.fresh and preview.paused:
        _ask(preview, preview.paused, preview.lens, CONTINUE)  # shows the stopped job's lens
    elif preview.changed_s is not None and time.monotonic() - preview.changed_s > STILL_S:
        _ask_after_change(preview, scene, key)


def _ask_after_change(preview, scene, key):
    """Send the values that have changed; if these are not all, a copy, unless that takes long: the user requests it."""
    if preview.changes is not None and not _ask_moves_or_change(preview, scene, key):
        preview.changes = None
    if preview.changes is None and not preview.slow:
        _ask_render(preview, scene, key)


def _ask_moves_or_change(preview, scene, key):
    """Send the values that have changed since the copy, if these are all; returns whether they are."""
    try:
        if structure_digest(scene) != preview.structure:
            return False
        still = still_digests(scene, preview.changes)
        if _only_moved(preview, scene, key, still):
            _ask_moves(preview, key, still)
        elif not _ask_change(preview, scene, key):
            return False
    except InputError:  # the copy will report it
        return False
    _note_request(preview)
    preview.still |= still or {}
    return True


def _only_moved(preview, scene, key, still):
    """Whether objects have moved since the child prepared the scene, by their `still_digests`, and nothing else has
    changed."""
    return (still is not None and still.items() <= preview.still.items()
            and key == preview.lens and (key, size_px(scene)) == preview.prepared)


def _ask_moves(preview, key, still):
    """Send the places of the objects that have moved."""
    path = Path(preview.folder.name) / MOVES
    write_moves(path, still)
    preview.shown = 0
    _ask(preview, "change", key, [*CONTINUE, "--moves", str(path)])


def _ask_change(preview, scene, key):
    """Send the values that have changed, if these are all; returns whether they are."""
    path = Path(preview.folder.name) / CHANGES
    if not write_changes(path, scene, preview.changes, MAYBE if preview.same_scene else DIFFERENT):
        return False
    _ask_pictures(preview, scene, key, "change", changes=path)
    return True


def _ask_render(preview, scene, key):
    """Send a copy of the file."""
    _note_request(preview)
    begin_s = time.monotonic()
    try:
        preview.structure, preview.still = structure_digest(scene), {}
        copy = save_copy(preview.folder.name)
        preview.copies_s = (*preview.copies_s[-1:], time.monotonic() - begin_s)
        _ask_pictures(preview, scene, key, "render", copy=copy)
    except InputError as error:
        preview.changes = None
        _show_error(preview, error)
        return
    preview.started_s = begin_s


def _note_request(preview):
    preview.changed_s, preview.other_s, preview.by_hand, preview.changes = None, None, False, {}


def _ask_pictures(preview, scene, key, what, **files):
    preview.tangents = shown_tangents(scene, key)
    preview.shown, preview.prepared = 0, (key, size_px(scene))
    size = tuple(-(-side // FINER) for side in size_px(scene))
    _ask(preview, what, key, preview_arguments(scene, key, **files, size=size, samples=SAMPLES))


def _show_error(preview, error):
    if preview.error != plain(error):
        preview.error = plain(error)
        redraw()


def _ask(preview, what, key, arguments):
    preview.job, preview.lens, preview.started_s = (what, key), key, time.monotonic()
    preview.stopping, preview.paused = False, ""
    preview.child.ask(arguments)


def size_px(scene):
    """Width and height of the finest picture: as the camera's frame in the largest viewport that shows it, or of
    LONG_SIDE_PX; at most the scene's resolution."""
    rows, columns = frame_px(scene)
    sides = preview_overlay.frame_sides_px(scene, session.preview.tangents)
    longest = np.clip(max(sides), *VIEWPORT_SIDES_PX) if sides else LONG_SIDE_PX
    scale = min(1.0, longest / max(rows, columns))
    return max(LEAST_SIDE_PX, round(columns * scale)), max(LEAST_SIDE_PX, round(rows * scale))


def _take_in(preview, scene):
    """Show the job's newest picture, stop the job if it is out of date, and note its end."""
    outcome, current = preview.child.status, preview.same_scene and _shown_scene(scene) == scene
    if current and outcome.get("number", 0) > preview.shown and not preview.stopping:
        if not preview.grown or outcome["size_px"][0] >= preview.columns_px:
            _show(preview, scene, outcome)
        preview.shown = outcome["number"]
        redraw()
    if "status" in outcome:
        _note_end(preview, scene, outcome)
        redraw()
    elif not preview.stopping and (not current or preview.by_hand or _is_too_small(preview)
                                   or _lens_is_outdated(preview, scene) or not _may_work()):
        preview.stopping = True
        preview.child.stop()


def _is_too_small(preview):
    """Whether the frame has grown since the job began, and a picture is shown."""
    return preview.grown and not preview.fresh and preview.shown > 0


def _lens_is_outdated(preview, scene):
    """Whether the lens has changed, or shows more than was captured, since the picture that is shown. Without one, a
    ring that turns steadily would never show anything."""
    what, key = preview.job
    try:
        return preview.shown > 0 and (lens_key(scene) != key or (what == "lens" and not _in_view(preview, scene)))
    except InputError:
        return False  # the next request reports it


def _note_end(preview, scene, outcome):
    (what, _), preview.job, preview.error = preview.job, (), ""
    if outcome["status"]:
        preview.prepared = ()
    preview.paused = what if preview.stopping and not outcome["status"] else ""
    if what == "lens" and (outcome["status"] or (preview.shown and not _in_view(preview, scene))):
        preview.changed_s, preview.paused = 0.0, ""  # parts of the scene were not captured: render again
    elif what == "change" and outcome["status"]:  # it needs a copy
        preview.changes, preview.changed_s, preview.other_s = None, preview.changed_s or 0.0, preview.other_s or 0.0
    elif outcome["status"]:
        preview.error = outcome.get("error", "Failed: see the console")


def _in_view(preview, scene):
    """Whether the captured radiance has the view of the current lens."""
    try:
        return np.allclose(shown_tangents(scene, lens_key(scene)), preview.tangents, rtol=SAME_VIEW)
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
    for editor in () if preview.depth else image_editors():
        if editor.image is None or editor.image.type == "RENDER_RESULT":
            editor.image = image
    preview.columns_px, preview.error = outcome["size_px"][0], ""
    preview.depth = Result.from_file(path, "lens_image").depth
    seconds = time.monotonic() - preview.started_s
    preview.facts = _facts(outcome["size_px"], outcome["samples"], seconds, preview.job[1][0])
    preview.exposure = ShownExposure(**outcome["exposure"]) if "exposure" in outcome else None


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
    if preview and preview.changes is not None:
        preview.changes = changed_blocks(depsgraph, preview.changes)
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
        session.preview.prepared = ()


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
        if preview.changes is not None:
            preview.changes = switched | preview.changes
    preview.looked_s = time.monotonic()


def _note_growth(preview, scene):
    """Record that the frame has grown in a viewport beyond the size that the child has prepared."""
    if preview.fresh and preview.prepared and _has_view(scene) and size_px(scene) > preview.prepared[1]:
        _note(of_lens=True)
        preview.grown = True


def _note(of_lens=False):
    preview = session.preview
    if preview:
        preview.changed_s, preview.grown = time.monotonic(), False
        preview.other_s = preview.other_s if of_lens else preview.changed_s


_HANDLERS = {"depsgraph_update_post": on_update, "frame_change_post": on_frame, "undo_post": on_frame,
             "redo_post": on_frame, "load_pre": on_load}
