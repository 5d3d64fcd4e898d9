"""Click to Focus: a click in a 3D view focuses the camera on the surface there."""

from contextlib import suppress

import bpy

from lensfield.engine.runtime.errors import InputError

from ...scene.active_camera import camera_object_in
from ...scene.clicked_focus import focus_on, lens_ray, surface_at, view_ray
from ...scene.linked import check_editable
from ..common.lens_worker import lens_request
from ..common.plain_words import plain
from ..common.session import session
from .preview_overlay import frame_corners, shows_preview

STATUS = "Click: focus there  \u00b7  Ctrl+click: focus on the object  \u00b7  Esc, right click: cancel"
FOCUSABLE = "PERSP", "PANO"
NAVIGATION = "MIDDLE", "WHEEL", "TRACKPAD", "MOUSEROTATE", "MOUSESMARTZOOM", "NDOF", "NUMPAD", "TIMER"
"""Starts of the types of events that stay with the views and with operators that wait for a timer."""


class LENSFIELD_OT_click_focus(bpy.types.Operator):
    """Click in a 3D view to set the camera's focus distance. With Ctrl, the focus follows the object that you click"""

    bl_idname = "lensfield.click_focus"
    bl_label = "Click to Focus"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context):
        camera = camera_object_in(context)
        if camera is None or camera.data.type not in FOCUSABLE:
            cls.poll_message_set("Only perspective and panoramic cameras focus" if camera else "Add a camera first")
            return False
        return True

    def invoke(self, context, event):
        self.camera = camera_object_in(context)
        try:
            check_editable(self.camera.data)
        except InputError as error:
            self.report({"ERROR"}, plain(error))
            return {"CANCELLED"}
        context.window.cursor_modal_set("EYEDROPPER")
        context.workspace.status_text_set(STATUS)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        clicked = event.type == "LEFTMOUSE"
        if event.type.startswith(NAVIGATION) or (clicked and event.alt):  # Alt and click: an emulated middle button
            return {"PASS_THROUGH"}
        if event.value != "PRESS" or not (clicked or event.type in ("ESC", "RIGHTMOUSE")):
            return {"RUNNING_MODAL"}
        self.cancel(context)
        return self._focus(context, event) if clicked else {"CANCELLED"}

    def cancel(self, context):
        """Restore cursor and status bar. Blender also calls it when a window closes."""
        context.window.cursor_modal_restore()
        context.workspace.status_text_set(None)

    def _focus(self, context, event):
        view = view_at(context.screen, event.mouse_x, event.mouse_y)
        hit = view and _surface_in(context, *view)
        if not hit:
            self.report({"INFO"}, "Nothing there to focus on" if view else "Click in a 3D view to focus")
            return {"CANCELLED"}
        try:
            focus_on(self.camera, hit, follow=event.ctrl)
        except InputError as error:
            self.report({"ERROR"}, plain(error))
            return {"CANCELLED"}
        return {"FINISHED"}


def view_at(screen, x_px, y_px):
    """The 3D view at a place of a window: its SpaceView3D and RegionView3D, and the place in it as for `view_ray`; None
    elsewhere, and over its sidebar."""
    for area in screen.areas:
        regions = [each for each in area.regions
                   if each.x <= x_px < each.x + each.width and each.y <= y_px < each.y + each.height]
        if area.type == "VIEW_3D" and {each.type for each in regions} == {"WINDOW"}:
            region, = regions
            place = 2 * (x_px - region.x) / region.width - 1, 2 * (y_px - region.y) / region.height - 1
            return area.spaces.active, region.data, place
    return None


def _surface_in(context, space, view, place):
    """The Hit at a place of a 3D view; None without one."""
    ray = clicked_ray(context.scene, space, view, place)
    return surface_at(context.scene, context.evaluated_depsgraph_get(), ray, space)


def clicked_ray(scene, space, view, place):
    """The ray at a place of a 3D view: through the lens where the view shows its picture."""
    ray = view_ray(view.perspective_matrix, place)
    with suppress(InputError):  # no picture without a lens
        if (tangents := picture_tangents(scene, space, view)) and (facts := lens_request(scene).facts):
            ray = lens_ray(scene, facts, tangents, ray)
    return ray


def picture_tangents(scene, space, view):
    """The tangents of the edges of the lens's picture in a 3D view, by Preview or Live; None without a picture."""
    if shows_preview(scene, space, view):
        to_camera = scene.camera.matrix_world.normalized().inverted()
        corners = [to_camera @ corner for corner in frame_corners(scene, session.preview.loaded.tangents)]
        return [each / -corner.z for corner in corners for each in corner.xy]
    live = session.live
    if live and live.shown and view.view_perspective == "CAMERA" and space.camera == scene.camera:
        return live.shown[0].tangents
    return None


classes = (LENSFIELD_OT_click_focus,)
