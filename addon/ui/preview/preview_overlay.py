"""Draws the preview over the camera's view in the 3D viewport, inside the lens's frame, without changing the scene.

The preview is hidden while the scene is newer than it, so that edits are visible, and when overlays are off. While only
the lens, its focus or its f-stop change, it stays until the next picture arrives. The tints of the focus overlay are
drawn on top of it.
"""

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Vector

from lensfield.engine.spectral.colour import decode_srgb

from ..common.areas import areas
from ..common.preferences import IN_CAMERA, preview_place
from ..common.previews import open_png
from ..common.session import CameraOverlay, session
from . import focus_overlay

ENCODED_SINCE = 5, 0, 0  # in earlier versions, viewports encode what add-ons draw, as if it were linear
FONT, TEXT_PX = 0, 13


def start():
    """Add the draw handler, except in background mode."""
    if not bpy.app.background:
        session.overlay.handle = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_PIXEL")


def end():
    """Remove the draw handler."""
    if session.overlay.handle:
        bpy.types.SpaceView3D.draw_handler_remove(session.overlay.handle, "WINDOW")
    session.overlay = CameraOverlay()


def await_drawing():
    """Note that a viewport has been turned, whose frame is known once it is drawn."""
    session.overlay.turned = session.overlay.handle is not None


def forget_picture():
    """Discard the texture, because the picture has changed."""
    session.overlay.texture = None


def _draw():
    preview, space, view = session.preview, bpy.context.space_data, bpy.context.region_data
    session.overlay.turned = False
    if not _has_place(preview, bpy.context.scene, space, view):
        return
    corners = _corners_px(bpy.context.region, view, bpy.context.scene, preview.loaded.tangents)
    if None in corners:
        return
    if preview_place() == IN_CAMERA:
        _draw_preview(corners, preview)
    if session.focus_overlay and preview.up_to_date:
        _draw_tints(corners, focus_overlay.focus_tints(bpy.context.scene, preview.depth))


def _has_place(preview, scene, space, view):
    """Whether a 3D view has a place for the preview."""
    return (view.view_perspective == "CAMERA" and scene.session_uid == preview.scene_uid
            and space.camera == scene.camera and space.overlay.show_overlays and bool(preview.loaded.tangents))


def shows_preview(scene, space, view):
    """Whether the preview's picture covers the camera's frame in a 3D view."""
    preview = session.preview
    return (preview is not None and preview_place() == IN_CAMERA and _has_place(preview, scene, space, view)
            and _has_picture(preview))


def _has_picture(preview):
    """Whether there is a picture of the scene as it is."""
    return preview.up_to_date and preview.picture.is_file()


def _draw_preview(corners, preview):
    """Draw the preview's picture, unless the scene has changed, and what the first one waits for."""
    if _has_picture(preview):
        if session.overlay.texture is None:
            session.overlay.texture = _texture(_pixels(preview.picture))
        _draw_between(corners, session.overlay.texture)
    if text := preview.waiting_for:
        _draw_text(corners, text)


def _draw_text(corners, text):
    """Draw a line at the upper left of the frame, with a shadow that makes it legible on any background."""
    import blf

    scale = bpy.context.preferences.system.ui_scale
    (left, _), (_, top) = corners
    blf.size(FONT, TEXT_PX * scale)
    blf.color(FONT, 1, 1, 1, 1)
    blf.enable(FONT, blf.SHADOW)
    blf.shadow(FONT, 5, 0, 0, 0, 1)
    blf.position(FONT, left + TEXT_PX * scale, top - 2 * TEXT_PX * scale, 0)
    blf.draw(FONT, text)
    blf.disable(FONT, blf.SHADOW)


def _draw_tints(corners, tints):
    if tints is None:
        return
    if session.overlay.tints[0] is not tints:
        session.overlay.tints = tints, _texture(tints[::-1])
    import gpu

    gpu.state.blend_set("ALPHA")
    _draw_between(corners, session.overlay.tints[1])
    gpu.state.blend_set("NONE")


def _draw_between(corners, texture):
    from gpu_extras.presets import draw_texture_2d  # not available in background mode

    (left, bottom), (right, top) = corners
    draw_texture_2d(texture, (left, bottom), right - left, top - bottom)


def frame_corners(scene, tangents):
    """The lower left and the upper right corner of the frame of a scene's camera with these `view_tangents`, in world
    space. Viewports show panoramic cameras in perspective, in Blender's frame."""
    camera = scene.camera
    if camera.data.type == "PANO":
        frame = camera.data.view_frame(scene=scene)
        corners = [Vector(map(choose, zip(*frame, strict=True))) for choose in (min, max)]
    else:
        left, lower, right, upper = tangents
        corners = Vector((left, lower, -1.0)), Vector((right, upper, -1.0))
    return [camera.matrix_world.normalized() @ corner for corner in corners]


def _corners_px(region, view, scene, tangents):
    """The `frame_corners` in a region of a 3D viewport: vectors, or None for a corner behind the view."""
    return [location_3d_to_region_2d(region, view, corner) for corner in frame_corners(scene, tangents)]


def frame_sides_px(scene, tangents):
    """The longer side of the camera's frame with these tangents in each viewport that shows it, in pixels: list."""
    sides = []
    for area in areas("VIEW_3D"):
        space, region = area.spaces.active, next(each for each in area.regions if each.type == "WINDOW")
        if space.region_3d.view_perspective == "CAMERA":
            corners = _corners_px(region, space.region_3d, scene, tangents)
            if None not in corners:
                sides.append(round(max(corners[1] - corners[0])))
    return sides


def _pixels(path):
    with open_png(path) as picture:
        return np.asarray(picture.convert("RGBA"), dtype=np.float32)[::-1] / 255


def _texture(pixels):
    """A GPU texture of an array (row, column, 4) of displayed colours, bottom row first."""
    import gpu

    if bpy.app.version < ENCODED_SINCE:
        pixels = np.concatenate([decode_srgb(pixels[..., :3]), pixels[..., 3:]], axis=-1, dtype=np.float32)
    height, width, _ = pixels.shape
    buffer = gpu.types.Buffer("FLOAT", pixels.size, np.ascontiguousarray(pixels).ravel())
    return gpu.types.GPUTexture((width, height), format="RGBA16F", data=buffer)
