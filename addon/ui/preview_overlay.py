"""The preview in the camera's view of the 3D viewport: drawn over it, where the lens's frame is; the scene is not
touched. It steps back while what it shows is out of date, so that work is seen, and with all other overlays."""

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Vector

_overlay = {"handle": None, "preview": None, "texture": None}


def start(preview):
    """Draw a preview from now on."""
    _overlay["preview"] = preview
    if not bpy.app.background:
        _overlay["handle"] = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_PIXEL")


def end():
    """Draw it no more."""
    if _overlay["handle"]:
        bpy.types.SpaceView3D.draw_handler_remove(_overlay["handle"], "WINDOW")
    _overlay.update(handle=None, preview=None, texture=None)


def forget_picture():
    """The picture is another one now."""
    _overlay["texture"] = None


def _draw():
    preview, space, view = _overlay["preview"], bpy.context.space_data, bpy.context.region_data
    if (view.view_perspective != "CAMERA" or bpy.context.scene.session_uid != preview.scene_uid
            or space.camera != bpy.context.scene.camera or not space.overlay.show_overlays or not preview.fresh
            or not preview.picture.is_file()):
        return
    corners = [location_3d_to_region_2d(bpy.context.region, view, corner)
               for corner in frame_corners(space.camera, preview.tangents)]
    if None in corners:
        return
    from gpu_extras.presets import draw_texture_2d  # neither is there in the background

    if _overlay["texture"] is None:
        _overlay["texture"] = _texture(preview.picture)
    (left, bottom), (right, top) = corners
    draw_texture_2d(_overlay["texture"], (left, bottom), right - left, top - bottom)


def frame_corners(camera, tangents):
    """The lower left and the upper right corner, in the world, of a frame that a camera sees under these tangents."""
    matrix = camera.matrix_world.normalized()
    return [matrix @ Vector((sign * tangents[0], sign * tangents[1], -1.0)) for sign in (-1, 1)]


def _texture(path):
    import gpu
    from PIL import Image

    with Image.open(path) as picture:
        pixels = np.asarray(picture.convert("RGBA"), dtype=np.float32)[::-1] / 255
    height, width, _ = pixels.shape
    buffer = gpu.types.Buffer("FLOAT", pixels.size, np.ascontiguousarray(pixels).ravel())
    return gpu.types.GPUTexture((width, height), format="RGBA8", data=buffer)
