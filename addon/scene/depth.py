"""How far away what the lens sees is, before anything is rendered: by a few rays into the scene."""

from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ...engine.image.pixel_grid import PLANE
from .render_state import rendered_layer

M_TO_MM = 1e3  # a unit of Blender's is taken for a metre
RAYS_ACROSS = 24
MOST_UNSEEN = 16  # objects in a row that are in the way of a ray, but in no render
BEYOND_M = 1e-4


@dataclass(frozen=True, eq=False)
class Hit:
    """Where a ray meets a surface.

    Attributes
    ----------
    place, normal : Vector
        In the world; the normal is the face's own, whichever side is hit.
    face : int
        -1 where the surface is no mesh of the user's.
    obj : bpy.types.Object
        Evaluated.
    to_world : Matrix
        From the object's own frame.
    """

    place: Vector
    normal: Vector
    face: int
    obj: bpy.types.Object
    to_world: Matrix


class View:
    """The scene as the viewport shows it, seen from its camera by rays.

    Parameters
    ----------
    scene : bpy.types.Scene
    lens : Lens
    capture : PixelGrid

    Attributes
    ----------
    origin : Vector
    directions : list of (Vector, float)
        Unit vectors in the world that go evenly all over the frame, and the cosine of each to the optical axis.
    """

    def __init__(self, scene, lens, capture):
        self._scene, layer = scene, rendered_layer(scene)
        layer.update()
        self._depsgraph = layer.depsgraph
        to_world = scene.camera.matrix_world.normalized()
        self.origin, turn = to_world.translation, to_world.to_3x3()
        self.directions = [(turn @ Vector(axis), -axis[2])
                           for axis in _directions(*_places_mm(capture.frame()), lens, capture.projection)]

    def first(self, start, direction, seen_as="visible_camera"):
        """The Hit of what a ray meets first that a render shows to rays of its kind; None where that is nothing."""
        for _ in range(MOST_UNSEEN):
            hit, place, normal, face, obj, matrix = self._scene.ray_cast(self._depsgraph, start, direction)
            if not hit:
                return None
            if not obj.original.hide_render and getattr(obj.original, seen_as):
                return Hit(place, normal, face, obj, matrix)
            start = place + direction * BEYOND_M
        return None


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
    view = View(scene, lens, capture)
    hits = ((view.first(view.origin, direction), cosine) for direction, cosine in view.directions)
    return np.array([(hit.place - view.origin).length * cosine * M_TO_MM if hit else np.inf for hit, cosine in hits])


def _places_mm(frame):
    """x and y of points all over a frame, on the image plane."""
    rows, columns = frame.shape_px
    steps = max(rows, columns) / RAYS_ACROSS
    y_mm, x_mm = np.meshgrid(*(((np.arange(0.5, n / steps)) * steps - n / 2) * frame.pitch_um * 1e-3
                               for n in (rows, columns)), indexing="ij")
    return x_mm.ravel(), y_mm.ravel()


def _directions(x_mm, y_mm, lens, projection):
    """Unit vectors, in the camera's axes, of what a capture shows at these places."""
    radius_mm = np.hypot(x_mm, y_mm)
    angle = np.arctan(radius_mm / lens.capture_focal_length_mm) if projection == PLANE else np.minimum(
        radius_mm / lens.capture_focal_length_mm, np.pi / 2)
    sine = np.sin(angle) / np.maximum(radius_mm, np.finfo(float).tiny)
    return np.stack([sine * x_mm, sine * y_mm, -np.cos(angle)], axis=-1)
