"""Operators: render through the lens, match the camera to it, show its sheet."""

from dataclasses import replace

import bpy

from lensfield.engine.field.overscan import CAMERA_VIEW
from lensfield.engine.runtime.errors import InputError, one_line

from ..capture.remarks import ENOUGH_SAMPLES
from ..render.render import render_through_lens
from ..scene.active_camera import camera_data, camera_settings, settings_to_edit
from ..scene.camera import aim_camera, check_camera, frame_grid, match_camera_to_lens, pixel_aspect, size_for_view
from ..scene.compositor import show_file
from ..scene.linked import check_editable
from . import window_render
from .common.areas import fit_picture
from .common.lens_worker import facts_now, lens_now, requested_lens
from .common.plain_words import plain
from .common.previews import SHEET_MARK, load_sheet
from .common.properties import searched_lens_items
from .common.session import session
from .fit_lens import agreement_of, agreement_text
from .sheets import draw_sheet, drawn_sheet, stored_sheet


def nothing_renders():
    """Whether Blender itself is not rendering, so that the scene may be changed."""
    return not bpy.app.is_job_running("RENDER")


class LensRender:
    """Base of operators for long renders: a script waits for `render`; a window starts one at a time in the background
    with `start`."""

    @classmethod
    def poll(cls, context):
        if session.render:
            cls.poll_message_set("A lens render is in progress: wait for it, or cancel it")
            return False
        return nothing_renders()

    def execute(self, context):
        try:
            rendered = self.render(context.scene)
        except (InputError, OSError) as error:
            self.report({"ERROR"}, one_line(error))
            return {"CANCELLED"}
        self.report({"INFO"}, "; ".join(rendered.messages))
        return {"FINISHED"}

    def invoke(self, context, event):
        try:
            remarks = self.start(context.scene)
        except (InputError, OSError) as error:
            self.report({"ERROR"}, plain(error))
            return {"CANCELLED"}
        for remark in remarks:
            self.report({"WARNING"}, remark)
        return {"FINISHED"}


class LENSFIELD_OT_render(LensRender, bpy.types.Operator):
    """Render the scene in its current state, at all wavelengths, through the lens. In a window, this runs in the
    background and you can keep working"""

    bl_idname = "lensfield.render"
    bl_label = "Render through Lens"

    def render(self, scene):
        """Render the current frame, and return the result."""
        return render_through_lens(scene, to_compositor=scene.lensfield.to_compositor)

    def start(self, scene):
        """Start rendering the current frame, and return remarks on what the picture will lack."""
        return window_render.start(scene)


class LENSFIELD_OT_cancel(bpy.types.Operator):
    """Cancel the lens render in progress. Esc also cancels it with the mouse over the properties, the sidebar or an
    Image Editor, unless something else there uses Esc"""

    bl_idname = "lensfield.cancel"
    bl_label = "Cancel Lens Render"

    @classmethod
    def poll(cls, context):
        in_view = context.area and context.area.type == "VIEW_3D" and context.region.type != "UI"
        return session.render is not None and not in_view  # in the 3D view, Esc is too easily pressed

    def invoke(self, context, event):
        if event.type == "ESC" and not nothing_renders():
            return {"PASS_THROUGH"}  # Esc is for Blender's render
        return self.execute(context)

    def execute(self, context):
        window_render.cancel()
        self.report({"INFO"}, "Lens render cancelled")
        return {"FINISHED"}


class LENSFIELD_OT_match_camera(bpy.types.Operator):
    """Give the scene's camera the lens's field of view, so that you frame what you will render"""

    bl_idname = "lensfield.match_camera"
    bl_label = "Match Camera to Lens"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        try:
            _match(context.scene)
        except InputError as error:
            self.report({"ERROR"}, plain(error))
            return {"CANCELLED"}
        return {"FINISHED"}


def _match(scene):
    check_camera(scene)
    check_editable(scene.camera.data)
    facts, view = facts_now(scene), camera_settings(scene).view_text()
    if view != CAMERA_VIEW:
        facts = replace(facts, sensor_mm=size_for_view(scene, facts, view)[1])
    if facts.squeeze != 1:
        scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = max(1.0, facts.squeeze), max(1.0, 1 / facts.squeeze)
    match_camera_to_lens(scene.camera.data, facts, replace(frame_grid(scene, facts), squeeze=pixel_aspect(scene)))


class LENSFIELD_OT_add_camera(bpy.types.Operator):
    """Add a camera with the lens's field of view, placed to show the complete scene; in a 3D view, from your viewing
    direction"""

    bl_idname = "lensfield.add_camera"
    bl_label = "Add Camera"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        scene = context.scene
        try:
            check_editable(scene)
        except InputError as error:
            self.report({"ERROR"}, plain(error))
            return {"CANCELLED"}
        data = bpy.data.cameras.new("Camera")
        camera = scene.camera = bpy.data.objects.new("Camera", data)
        scene.collection.objects.link(camera)
        view = context.region_data if context.area and context.area.type == "VIEW_3D" else None
        aim_camera(scene, view.view_rotation if view else None)
        try:
            _match(scene)
        except InputError as error:
            self.report({"WARNING"}, plain(error))  # the camera is added all the same
        else:
            aim_camera(scene, view.view_rotation if view else None)
        return {"FINISHED"}


class LENSFIELD_OT_sensible_samples(bpy.types.Operator):
    """Set the scene's samples to a number that suits most pictures, and enable Cycles' Denoise"""

    bl_idname = "lensfield.sensible_samples"
    bl_label = f"Use {ENOUGH_SAMPLES}, Denoised"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        context.scene.cycles.samples, context.scene.cycles.use_denoising = ENOUGH_SAMPLES, True
        return {"FINISHED"}


class LENSFIELD_OT_search_lens(bpy.types.Operator):
    """Find a lens by name, maker, year, focal length (50mm), or words such as swirl and soft"""

    bl_idname = "lensfield.search_lens"
    bl_label = "Search Lens"
    bl_options = {"REGISTER", "UNDO"}
    bl_property = "lens"

    lens: bpy.props.EnumProperty(name="Lens", items=searched_lens_items)

    def execute(self, context):
        try:
            settings_to_edit(context).lens = self.lens
        except InputError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}

    def invoke(self, context, event):
        context.window_manager.invoke_search_popup(self)
        return {"RUNNING_MODAL"}


class LENSFIELD_OT_show_picture(bpy.types.Operator):
    """Show the lens image or the contact sheet of the last render in a free Image Editor, or in a new window"""

    bl_idname = "lensfield.show_picture"
    bl_label = "Show Picture"

    @classmethod
    def poll(cls, context):
        path = session.last_render.picture
        return path is not None and path.is_file()

    def execute(self, context):
        path = session.last_render.picture
        try:
            image = load_sheet(path) if session.last_render.sheet else show_file(
                bpy.data.images.get(path.name), str(path), path.name)
        except InputError as error:
            self.report({"ERROR"}, one_line(error))
            return {"CANCELLED"}
        return _present(self, context, path, image)


class LENSFIELD_OT_show_sheet(bpy.types.Operator):
    """Show the lens sheet at the current focus and f-stop, at full size: point spread functions, distortion, sharpness,
    light and colour"""

    bl_idname = "lensfield.show_sheet"
    bl_label = "Show Lens Sheet"

    @classmethod
    def description(cls, context, properties):
        return ".\n".join(filter(None, (agreement_text(context.scene), cls.bl_description)))

    @classmethod
    def poll(cls, context):
        return camera_data(context.scene) is not None and bool(camera_settings(context.scene).lens_text())

    def execute(self, context):
        try:
            stored = stored_sheet(camera_settings(context.scene).lens_name_or_path())
            path = stored or _drawn_sheet(context.scene)
            if path is None:
                self.report({"INFO"}, "The lens is being baked: the panel shows its sheet as soon as it is drawn")
                return {"CANCELLED"}
            image = load_sheet(path)
        except (InputError, OSError, RuntimeError) as error:
            self.report({"ERROR"}, one_line(error))
            return {"CANCELLED"}
        if not stored:
            image.pack()  # its file is temporary
        return _present(self, context, path, image)


def _drawn_sheet(scene):
    """The file of the lens sheet; in a window, None until it is drawn."""
    if bpy.app.background:
        return draw_sheet(lens_now(scene), facts_now(scene).photographs)
    lens = requested_lens(scene)
    return lens and drawn_sheet(lens, agreement_of(scene))


def _present(operator, context, path, image):
    """Show an image of this file; in background mode, report its name."""
    if bpy.app.background:
        operator.report({"INFO"}, f"{path} loaded as image {image.name!r}")
    else:
        _show_at_full_size(context, image)
    return {"FINISHED"}


def _show_at_full_size(context, image):
    """Show an image in an Image Editor that is empty or shows a render or a sheet, or otherwise in a new window."""
    place = next(((window, area) for window in context.window_manager.windows for area in window.screen.areas
                  if area.type == "IMAGE_EDITOR" and _is_free(area.spaces.active)), None)
    if place is None:
        bpy.ops.wm.window_new()
        window = context.window_manager.windows[-1]
        place = window, max(window.screen.areas, key=lambda area: area.width * area.height)
        place[1].type = "IMAGE_EDITOR"
    window, area = place
    area.spaces.active.image = image
    fit_picture(window, area)


def _is_free(image_editor):
    image = image_editor.image
    return image is None or SHEET_MARK in image or image.type == "RENDER_RESULT"


classes = (LENSFIELD_OT_render, LENSFIELD_OT_cancel, LENSFIELD_OT_match_camera, LENSFIELD_OT_add_camera,
           LENSFIELD_OT_sensible_samples, LENSFIELD_OT_search_lens, LENSFIELD_OT_show_picture,
           LENSFIELD_OT_show_sheet)
