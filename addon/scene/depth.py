"""How far away what the lens sees is, before anything is rendered: by a few rays into the scene."""

import time
from dataclasses import dataclass, replace

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ...engine.image.pixel_grid import PLANE
from .render_state import rendered_layer

M_TO_MM = 1e3  # a unit of Blender's is taken for a metre
RAYS_ACROSS = 24
MOST_UNSEEN = 16  # objects in a row that are in the way of a ray, but in no render
BEYOND_M = 1e-4
LONGEST_S = 1.0  # that a look takes: the first ray at a mesh takes long, as Blender sorts its faces then


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
    directions : array (ray, 3)
        Unit vectors in the world that go evenly all over the frame, in no order, so that the first few do, too.
    cosines : array (ray,)
        Of each to the optical axis.
    shape : (int, int)
        Rows and columns of the places that they go to.
    places : array (ray,)
        Which of these, row by row.
    """

    def __init__(self, scene, lens, capture):
        self._scene, layer = scene, rendered_layer(scene)
        layer.update()
        self._depsgraph = layer.depsgraph
        to_world = scene.camera.matrix_world.normalized()
        self.origin, turn = to_world.translation, np.array(to_world.to_3x3())
        x_mm, y_mm = _places_mm(capture.frame())
        self.shape, self.places = x_mm.shape, np.random.default_rng(0).permutation(x_mm.size)
        axes = _directions(x_mm.ravel(), y_mm.ravel(), lens, capture.projection)[self.places]
        self.directions, self.cosines = axes @ turn.T, -axes[:, 2]

    def look(self, answer, rays=None):
        """What a function answers of each ray, or of these, by its number and direction: a list, shorter where it would
        take too long."""
        answers, until_s = [], time.monotonic() + LONGEST_S
        for ray in range(len(self.directions)) if rays is None else rays:
            if answers and time.monotonic() > until_s:
                break
            answers.append(answer(ray, Vector(self.directions[ray])))
        return answers

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
    """Depths along the optical axis, of points all over a capture.

    Objects are found as the viewport shows them, and those that no render shows are looked through.

    Parameters
    ----------
    scene : bpy.types.Scene
    lens : Lens
    capture : PixelGrid

    Returns
    -------
    array (row, column)
        inf where nothing is, NaN where there was no time to look.
    """
    view = View(scene, lens, replace(capture, overscan_px=(0, 0)))

    def distance_m(ray, direction):
        hit = view.first(view.origin, direction)
        return (hit.place - view.origin).length if hit else np.inf

    distances_m, depth_mm = np.array(view.look(distance_m)), np.full(view.shape, np.nan)
    depth_mm.flat[view.places[:len(distances_m)]] = distances_m * view.cosines[:len(distances_m)] * M_TO_MM
    return depth_mm


def _places_mm(frame):
    """x and y of points all over a frame, on the image plane: arrays (row, column)."""
    rows, columns = frame.shape_px
    steps = max(rows, columns) / RAYS_ACROSS
    y_mm, x_mm = np.meshgrid(*(((np.arange(0.5, n / steps)) * steps - n / 2) * frame.pitch_um * 1e-3
                               for n in (rows, columns)), indexing="ij")
    return x_mm, y_mm


def _directions(x_mm, y_mm, lens, projection):
    """Unit vectors, in the camera's axes, of what a capture shows at these places."""
    radius_mm = np.hypot(x_mm, y_mm)
    angle = np.arctan(radius_mm / lens.capture_focal_length_mm) if projection == PLANE else np.minimum(
        radius_mm / lens.capture_focal_length_mm, np.pi / 2)
    sine = np.sin(angle) / np.maximum(radius_mm, np.finfo(float).tiny)
    return np.stack([sine * x_mm, sine * y_mm, -np.cos(angle)], axis=-1)
