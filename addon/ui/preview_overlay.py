"""The preview in the camera's view of the 3D viewport: drawn over it, where the lens's frame is; the scene is not
touched. It steps back while what it shows is out of date, so that work is seen, and with all other overlays. The tints
of the focus overlay lie over it, and stay while focus and f-stop alone are turned."""

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Vector

from . import focus_overlay
from .previews import open_png

_overlay = {"handle": None, "preview": None, "texture": None, "tints": (None, None)}
"""The last: the array of tints, and its texture."""


def start(preview):
    """Draw a preview from now on."""
    _overlay["preview"] = preview
    if not bpy.app.background:
        _overlay["handle"] = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_PIXEL")


def end():
    """Draw it no more."""
    if _overlay["handle"]:
        bpy.types.SpaceView3D.draw_handler_remove(_overlay["handle"], "WINDOW")
    _overlay.update(handle=None, preview=None, texture=None, tints=(None, None))


def forget_picture():
    """The picture is another one now."""
    _overlay["texture"] = None


def _draw():
    preview, space, view = _overlay["preview"], bpy.context.space_data, bpy.context.region_data
    if (view.view_perspective != "CAMERA" or bpy.context.scene.session_uid != preview.scene_uid
            or space.camera != bpy.context.scene.camera or not space.overlay.show_overlays or not preview.tangents):
        return
    corners = [location_3d_to_region_2d(bpy.context.region, view, corner)
               for corner in frame_corners(space.camera, preview.tangents)]
    if None in corners:
        return
    if preview.fresh and preview.picture.is_file():
        if _overlay["texture"] is None:
            _overlay["texture"] = _texture(_pixels(preview.picture))
        _draw_between(corners, _overlay["texture"])
    if focus_overlay.state["on"] and preview.same_scene:
        _draw_tints(corners, focus_overlay.focus_tints(bpy.context.scene, preview.depth))


def _draw_tints(corners, tints):
    if tints is None:
        return
    if _overlay["tints"][0] is not tints:
        _overlay["tints"] = tints, _texture(tints[::-1])
    import gpu

    gpu.state.blend_set("ALPHA")
    _draw_between(corners, _overlay["tints"][1])
    gpu.state.blend_set("NONE")


def _draw_between(corners, texture):
    from gpu_extras.presets import draw_texture_2d  # there is none in the background

    (left, bottom), (right, top) = corners
    draw_texture_2d(texture, (left, bottom), right - left, top - bottom)


def frame_corners(camera, tangents):
    """The lower left and the upper right corner, in the world, of a frame that a camera sees under these tangents."""
    matrix = camera.matrix_world.normalized()
    return [matrix @ Vector((sign * tangents[0], sign * tangents[1], -1.0)) for sign in (-1, 1)]


def _pixels(path):
    with open_png(path) as picture:
        return np.asarray(picture.convert("RGBA"), dtype=np.float32)[::-1] / 255


def _texture(pixels):
    """Of an array (row, column, 4), from the bottom upwards."""
    import gpu

    height, width, _ = pixels.shape
    buffer = gpu.types.Buffer("FLOAT", pixels.size, np.ascontiguousarray(pixels).ravel())
    return gpu.types.GPUTexture((width, height), format="RGBA8", data=buffer)
