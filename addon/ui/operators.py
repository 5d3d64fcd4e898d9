"""Operators: render through the lens, match the camera to it, show its sheet."""

import bpy

from ...engine.errors import InputError
from ...engine.lens.curves import reference_nm
from ...engine.plan.options import DEFAULT_ACCURACY
from ..job.render import render_through_lens
from ..scene.camera import capture_grid, check_camera, match_camera_to_lens
from ..scene.lens_cache import load_lens
from . import window_render
from .previews import SHEET_MARK, load_sheet, sheet_path

ACCURACIES = {"PREVIEW": 0.1, "STANDARD": DEFAULT_ACCURACY, "REFERENCE": 0.001}

def nothing_renders():
    """Whether no render of Blender's own is under way, so that the scene may be worked on."""
    return not bpy.app.is_job_running("RENDER")


class LensRender:
    """What renders through the lens: a script waits for it; a window starts it in the background, one at a time."""

    @classmethod
    def poll(cls, context):
        if window_render.state["render"]:
            cls.poll_message_set("A lens render is under way: wait for it, or cancel it")
            return False
        return nothing_renders()

    def execute(self, context):
        try:
            rendered = self.render(context.scene)
        except (InputError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, "; ".join(rendered.told))
        return {"FINISHED"}

    def invoke(self, context, event):
        try:
            remarks = window_render.start(context.scene, *self.frames())
        except (InputError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for remark in remarks:
            self.report({"WARNING"}, remark)
        return {"FINISHED"}


class LENSFIELD_OT_render(LensRender, bpy.types.Operator):
    """Render the scene as it is now at every wavelength, and put it through the lens. In a window this goes on in the
    background, and you can go on working"""

    bl_idname = "lensfield.render"
    bl_label = "Render through Lens"

    def render(self, scene):
        """Render the current frame; what there is to tell of it."""
        return render_through_lens(scene, to_compositor=scene.lensfield.to_compositor)

    def frames(self):
        """Arguments of the command that say which frames are asked for."""
        return ()


class LENSFIELD_OT_cancel(bpy.types.Operator):
    """Stop the lens render under way. Esc does so too while the mouse is over the properties, the sidebar or an image
    editor, and nothing else there waits for Esc"""

    bl_idname = "lensfield.cancel"
    bl_label = "Cancel Lens Render"

    @classmethod
    def poll(cls, context):
        in_view = context.area and context.area.type == "VIEW_3D" and context.region.type != "UI"
        return window_render.state["render"] is not None and not in_view  # where Esc is too easily pressed

    def invoke(self, context, event):
        if event.type == "ESC" and not nothing_renders():
            return {"PASS_THROUGH"}  # it is meant for Blender's own render
        return self.execute(context)

    def execute(self, context):
        window_render.cancel()
        self.report({"INFO"}, "The lens render is cancelled")
        return {"FINISHED"}


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


classes = (LENSFIELD_OT_render, LENSFIELD_OT_cancel, LENSFIELD_OT_match_camera, LENSFIELD_OT_set_accuracy,
           LENSFIELD_OT_show_sheet)
