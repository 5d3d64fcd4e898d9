"""The preview in the panel: its buttons, its status, and the operators behind them."""

import bpy

from lensfield.engine.runtime.errors import InputError

from ..common.panel_pictures import draw_picture
from ..common.plain_words import plain
from ..common.preferences import IN_CAMERA, IN_PANEL, preview_place
from ..common.previews import small_picture
from ..common.session import session
from ..common.text_wrap import draw_wrapped
from . import focus_overlay
from .preview import is_visible, look_through_camera, redraw, start, switch_off
from .state import Task


def draw_preview(layout):
    """Draw the preview's button and, while it is on, the buttons of its options."""
    preview = session.preview
    row = layout.row(align=True)
    row.operator("lensfield.preview", icon="HIDE_OFF" if preview else "HIDE_ON", depress=preview is not None)
    if preview:
        if preview.slow:
            row.operator("lensfield.refresh_preview", text="", icon="FILE_REFRESH")
        row.operator("lensfield.focus_overlay", text="", icon="OVERLAY", depress=session.focus_overlay)


def draw_preview_status(layout, refusal=None):
    """Draw the status of the preview: in the panel its picture, its facts, and why it is off, if it failed. While the
    panel shows a refusal of the scene, only that counts."""
    preview = session.preview
    if preview is None:
        if session.preview_failure:
            draw_wrapped(layout, f"Preview switched off: {session.preview_failure}", "ERROR")
        return
    if session.focus_overlay:
        draw_wrapped(layout, focus_overlay.LEGEND, "OVERLAY")
    if preview_place() == IN_PANEL and not preview.error and preview.picture.is_file():
        draw_picture(layout, small_picture, preview.picture)
    for line in () if refusal else _status(preview):
        draw_wrapped(layout, line)


def _status(preview):
    """Lines about the current picture and the running job."""
    if preview_place() == IN_CAMERA and not is_visible():
        yield "Not visible: view the scene through its camera (Numpad 0), with Viewport Overlays on"
    if preview.error:
        yield preview.error  # alone: the facts are about a picture that is hidden
        return
    yield from preview.shown.facts if preview.shown else ()
    if preview.at_work:
        yield "Refining" if preview.number else "Applying the lens" if preview.task is Task.LENS else "Rendering"
    elif preview.slow and preview.loaded.changes is None and not preview.fresh:
        yield f"Out of date: click Refresh Preview, which copies this file in {preview.copies_s[-1]:.1f} s"


class LENSFIELD_OT_preview(bpy.types.Operator):
    """Look through the camera, and show a small version of the lens image there and in Image Editors, rendered in the
    background from a copy of the file and updated when the scene or the lens changes"""

    bl_idname = "lensfield.preview"
    bl_label = "Preview"

    def execute(self, context):
        if session.preview:
            switch_off()
            return {"FINISHED"}
        try:
            start(context.scene)
        except (InputError, OSError) as error:
            self.report({"ERROR"}, plain(error))
            return {"CANCELLED"}
        if context.window and preview_place() == IN_CAMERA:
            look_through_camera(context)
        return {"FINISHED"}


class LENSFIELD_OT_refresh_preview(bpy.types.Operator):
    """Copy the file and render the preview again"""

    bl_idname = "lensfield.refresh_preview"
    bl_label = "Refresh Preview"

    @classmethod
    def poll(cls, context):
        return session.preview is not None

    def execute(self, context):
        session.preview.by_hand = True
        return {"FINISHED"}


class LENSFIELD_OT_focus_overlay(bpy.types.Operator):
    """Tint out-of-focus parts of the camera's view: orange if nearer, blue if farther. The tint uses the preview's
    depth and follows Focus Distance and F-Stop while you drag them"""

    bl_idname = "lensfield.focus_overlay"
    bl_label = "Focus Overlay"

    @classmethod
    def poll(cls, context):
        return session.preview is not None

    def execute(self, context):
        focus_overlay.switch(context.scene)
        redraw()
        return {"FINISHED"}


classes = (LENSFIELD_OT_preview, LENSFIELD_OT_refresh_preview, LENSFIELD_OT_focus_overlay)
