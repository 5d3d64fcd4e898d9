"""Operators: render through the lens, match the camera to it, show its sheet."""

import threading
from contextlib import ExitStack

import bpy

from ...engine.errors import InputError
from ...engine.lens.curves import reference_nm
from ...engine.plan.options import DEFAULT_ACCURACY
from ..job.job import check_output_folder, job_from_settings
from ..job.radiance import RenderPass
from ..job.render import render_steps, render_through_lens
from ..scene.camera import capture_grid, check_camera, match_camera_to_lens
from ..scene.compositor import lens_image
from ..scene.lens_cache import load_lens
from ..scene.watch import RenderWatch
from .previews import SHEET_MARK, load_sheet, sheet_path

TICK_S = 0.1
ACCURACIES = {"PREVIEW": 0.1, "STANDARD": DEFAULT_ACCURACY, "REFERENCE": 0.001}
NAVIGATION = {"MOUSEMOVE", "INBETWEEN_MOUSEMOVE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "MIDDLEMOUSE", "WINDOW_DEACTIVATE"}

progress = {"fraction": None, "label": ""}
"""How far the lens render under way is, for the panel; a fraction of None means that none is."""


class Cancelled(Exception):
    """Esc was pressed while the engine was at work."""


def nothing_renders():
    """Whether neither a lens render nor one of Blender's is under way, so that the scene may be worked on."""
    return progress["fraction"] is None and not bpy.app.is_job_running("RENDER")


class LENSFIELD_OT_render(bpy.types.Operator):
    """Render the scene at every wavelength and put it through the lens"""

    bl_idname = "lensfield.render"
    bl_label = "Render through Lens"

    @classmethod
    def poll(cls, context):
        return nothing_renders()

    def execute(self, context):
        try:
            result = render_through_lens(context.scene, to_compositor=context.scene.lensfield.to_compositor)
        except (InputError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, "; ".join(result.told))
        return {"FINISHED"}

    def invoke(self, context, event):
        try:
            check_output_folder(context.scene)
            self._steps = render_steps(context.scene, job_from_settings(context.scene))
        except (InputError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self._step = self._worker = None
        self._escape = threading.Event()
        manager = context.window_manager
        self._at_end = ExitStack()
        self._watch = self._at_end.enter_context(RenderWatch())
        self._at_end.callback(manager.event_timer_remove, manager.event_timer_add(TICK_S, window=context.window))
        manager.progress_begin(0, 1)
        self._at_end.callback(manager.progress_end)
        manager.modal_handler_add(self)
        self._tell(context, 0.0, "Starting")
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type == "ESC":
            self._escape.set()
            return {"PASS_THROUGH"}  # a render under way is cancelled by Blender itself
        if event.type != "TIMER":
            # Edits and undo would pull the scene from under the render; looking around is welcome.
            return {"PASS_THROUGH"} if event.type in NAVIGATION else {"RUNNING_MODAL"}
        try:
            return self._tick(context)
        except Cancelled:
            return self._end(context, "Cancelled")
        except StopIteration as end:
            self.report({"INFO"}, "; ".join(end.value.told))
            _show_lens_image(context)
            return self._end(context, None)
        except (InputError, OSError, RuntimeError) as error:
            return self._end(context, str(error))
        except BaseException:
            self._end(context, "Lensfield stopped on an error: see the console")
            raise

    def cancel(self, context):
        """Called by Blender when it closes a file or a window under the operator."""
        self._escape.set()
        if self._worker:
            self._worker.join()
        self._end(context, "Cancelled")

    def _tick(self, context):
        """Go on to the next step once the present one is done."""
        if isinstance(self._step, RenderPass):
            if self._watch.ended is None and self._escape.is_set() and not bpy.app.is_job_running("RENDER"):
                raise Cancelled
            if self._watch.ended is None or bpy.app.is_job_running("RENDER"):
                _redraw_panels(context)
                return {"RUNNING_MODAL"}
            if self._watch.ended == "cancelled":
                raise Cancelled
            answer = None
        elif self._worker is not None:
            if self._worker.is_alive():
                self._tell(context, self._step.fraction + self._step.share * self._worker.done, self._step.label)
                return {"RUNNING_MODAL"}
            answer = self._worker.result()
        else:
            answer = None
        if self._escape.is_set():
            raise Cancelled
        self._start(context, self._steps.send(answer))
        return {"RUNNING_MODAL"}

    def _start(self, context, step):
        self._step, self._worker = step, None
        self._tell(context, step.fraction, step.label)
        if isinstance(step, RenderPass):
            self._watch.ended = None
            started = bpy.ops.render.render("INVOKE_DEFAULT", write_still=True, scene=step.scene.name)
            if "CANCELLED" in started:  # another render is under way, and no handler will tell us
                raise Cancelled
        else:
            self._worker = _Worker(step.call, self._escape)
            self._worker.start()

    def _end(self, context, complaint):
        """Put everything back: the scene first, then the user interface."""
        try:
            self._steps.close()
        finally:
            self._at_end.close()
            self._tell(context, None, "")
        if complaint is None:
            return {"FINISHED"}
        self.report({"WARNING"} if complaint == "Cancelled" else {"ERROR"}, complaint)
        return {"CANCELLED"}

    def _tell(self, context, fraction, label):
        progress["fraction"], progress["label"] = fraction, label
        if context.workspace:  # none while Blender closes a file under us
            context.workspace.status_text_set(None if fraction is None else f"Lensfield: {label}   (Esc: cancel)")
        if fraction is not None:
            context.window_manager.progress_update(fraction)
        _redraw_panels(context)


def _redraw_panels(context):
    """Panels follow the progress only when they are told to."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in {"PROPERTIES", "VIEW_3D"}:
                area.tag_redraw()


def _show_lens_image(context):
    """Let image editors that followed the render show the lens image, where the scene's compositor holds it."""
    image = lens_image(context.scene)
    for window in context.window_manager.windows if image else ():
        for area in window.screen.areas:
            if area.type == "IMAGE_EDITOR" and area.spaces[0].image and area.spaces[0].image.type == "RENDER_RESULT":
                area.spaces[0].image = image


class _Worker(threading.Thread):
    """Runs one step's call off the main thread; numpy lets the user interface go on meanwhile."""

    def __init__(self, call, escape):
        super().__init__(daemon=True)
        self.done = 0.0
        self._call, self._escape = call, escape
        self._answer = self._error = None

    def run(self):
        try:
            self._answer = self._call(self._progress)
        except BaseException as error:  # handed over to the main thread by result()
            self._error = error

    def result(self):
        if self._error:
            raise self._error
        return self._answer

    def _progress(self, done):
        if self._escape.is_set():
            raise Cancelled
        self.done = done


class LENSFIELD_OT_match_camera(bpy.types.Operator):
    """Give the scene's camera the field of view of the lens, to frame the picture by"""

    bl_idname = "lensfield.match_camera"
    bl_label = "Match Camera to Lens"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        scene = context.scene
        try:
            check_camera(scene)
            lens = load_lens(scene.lensfield.lens_name_or_path())
            capture = capture_grid(scene, lens, [reference_nm(lens)])
        except InputError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        match_camera_to_lens(scene.camera.data, lens, capture.frame_px[1], capture.pitch_um, capture.projection)
        return {"FINISHED"}


class LENSFIELD_OT_set_accuracy(bpy.types.Operator):
    """Set the accuracy of the lens image"""

    bl_idname = "lensfield.set_accuracy"
    bl_label = "Set Accuracy"
    bl_options = {"UNDO", "INTERNAL"}

    preset: bpy.props.EnumProperty(
        name="Preset", default="STANDARD",
        items=[("PREVIEW", "Preview", "Up to 10 % of a point's light in the wrong place: for a quick look"),
               ("STANDARD", "Standard", "Up to 1 %: for pictures"),
               ("REFERENCE", "Reference", "Up to 0.1 %: for measuring")])

    def execute(self, context):
        context.scene.lensfield.accuracy = ACCURACIES[self.preset]
        return {"FINISHED"}


class LENSFIELD_OT_show_sheet(bpy.types.Operator):
    """Open the sheet of the lens at full size: point spread functions, distortion, sharpness, light and colour"""

    bl_idname = "lensfield.show_sheet"
    bl_label = "Show Lens Sheet"

    @classmethod
    def poll(cls, context):
        if sheet_path(context.scene.lensfield.lens_name_or_path()).is_file():
            return True
        cls.poll_message_set("This lens has no sheet: lensfield lens plot draws it")
        return False

    def execute(self, context):
        path = sheet_path(context.scene.lensfield.lens_name_or_path())
        try:
            image = load_sheet(path)
        except (InputError, RuntimeError) as error:
            self.report({"ERROR"}, str(error).strip())
            return {"CANCELLED"}
        if bpy.app.background:
            self.report({"INFO"}, f"{path} is loaded as the image {image.name!r}")
        else:
            _show_at_full_size(context, image)
        return {"FINISHED"}


def _show_at_full_size(context, image):
    """Show an image in an Image Editor that is empty or shows a sheet, or in a new window."""
    place = next(((window, area) for window in context.window_manager.windows for area in window.screen.areas
                  if area.type == "IMAGE_EDITOR" and _is_free(area.spaces.active)), None)
    if place is None:
        bpy.ops.wm.window_new()
        window = context.window_manager.windows[-1]
        place = window, max(window.screen.areas, key=lambda area: area.width * area.height)
        place[1].type = "IMAGE_EDITOR"
    window, area = place
    area.spaces.active.image = image
    region = next(region for region in area.regions if region.type == "WINDOW")
    with context.temp_override(window=window, area=area, region=region):
        bpy.ops.image.view_all(fit_view=True)


def _is_free(image_editor):
    return image_editor.image is None or SHEET_MARK in image_editor.image


classes = (LENSFIELD_OT_render, LENSFIELD_OT_match_camera, LENSFIELD_OT_set_accuracy, LENSFIELD_OT_show_sheet)
