"""How far away what the lens sees is, before anything is rendered: by a few rays into the scene."""

import numpy as np
from mathutils import Vector

from ...engine.image.pixel_grid import PLANE
from .render_state import rendered_layer

M_TO_MM = 1e3  # a unit of Blender's is taken for a metre
RAYS_ACROSS = 24
MOST_UNSEEN = 16  # objects in a row that are in the way of a ray, but in no render
BEYOND_M = 1e-4


def seen_depth_mm(scene, lens, capture):
    """Depths along the optical axis, of a frame's middle and of points all over it.

    Objects are found as the viewport shows them, and those that no render shows are looked through.

    Parameters
    ----------
    scene : bpy.types.Scene
    lens : Lens
    capture : PixelGrid

    Returns
    -------
    array (point,)
        inf where nothing is.
    """
    layer = rendered_layer(scene)
    layer.update()
    to_world = scene.camera.matrix_world.normalized()
    origin, turn = to_world.translation, to_world.to_3x3()
    frame = capture.frame()
    rows, columns = frame.shape_px
    steps = max(rows, columns) / RAYS_ACROSS
    y_mm, x_mm = np.meshgrid(*(((np.arange(0.5, n / steps)) * steps - n / 2) * frame.pitch_um * 1e-3
                               for n in (rows, columns)), indexing="ij")
    return np.array([_depth_mm(scene, layer.depsgraph, origin, turn @ Vector(axis))
                     * -axis[2] for axis in _directions(x_mm.ravel(), y_mm.ravel(), lens, capture.projection)])


def _directions(x_mm, y_mm, lens, projection):
    """Unit vectors, in the camera's axes, of what a capture shows at these places."""
    radius_mm = np.hypot(x_mm, y_mm)
    angle = np.arctan(radius_mm / lens.capture_focal_length_mm) if projection == PLANE else np.minimum(
        radius_mm / lens.capture_focal_length_mm, np.pi / 2)
    sine = np.sin(angle) / np.maximum(radius_mm, np.finfo(float).tiny)
    return np.stack([sine * x_mm, sine * y_mm, -np.cos(angle)], axis=-1)


def _depth_mm(scene, depsgraph, origin, direction):
    """The distance to the first object in a direction that a render shows."""
    start = origin
    for _ in range(MOST_UNSEEN):
        hit, place, _, _, obj, _ = scene.ray_cast(depsgraph, start, direction)
        if not hit:
            return np.inf
        if not obj.original.hide_render:
            return (place - origin).length * M_TO_MM
        start = place + direction * BEYOND_M
    return np.inf
