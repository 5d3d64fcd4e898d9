"""Opens a finished picture as Blender opens its own renders: by *Preferences > Interface > Render In*."""

import bpy

from .common.areas import image_editors, tool_in_use

TICK_S = 0.2
KEEP_USER_INTERFACE = "NONE"


def open_as_render(image_now, show):
    """Show an image where Blender would show a render, unless an Image Editor shows it already.

    Blender's window changes as soon as no tool is in use and Blender does not render; never in background mode.

    Parameters
    ----------
    image_now : callable () -> bpy.types.Image or None
        Called when the window can change: the image may not exist any more.
    show : callable (image)
        Shows the image in the Image Editors that show Blender's render.
    """
    if not bpy.app.background:
        bpy.app.timers.register(lambda: _open(image_now, show), first_interval=0.0, persistent=True)


def _open(image_now, show):
    """Open the image if Blender is idle; returns seconds until the next attempt, or None."""
    if bpy.context.preferences.view.render_display_type == KEEP_USER_INTERFACE:
        return None
    if tool_in_use() or bpy.app.is_job_running("RENDER"):
        return TICK_S
    image = image_now()
    if image and not any(editor.image == image for editor in image_editors()):
        with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
            bpy.ops.render.view_show("INVOKE_DEFAULT")
        show(image)
    return None
