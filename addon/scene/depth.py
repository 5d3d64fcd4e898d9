"""Depths of the visible scene before a render, by a few rays."""

import time
from dataclasses import dataclass, replace

import bpy
import numpy as np
from mathutils import Matrix, Vector

from .render_state import rendered_layer
from .units import M_TO_MM, metres_per_unit

RAYS_ACROSS = 24
MOST_UNSEEN = 16  # consecutive objects on a ray that the render does not show
BEYOND_M = 1e-4
LONGEST_S = 1.0  # limit for casting rays: the first ray at a mesh is slow, because Blender sorts its faces then


@dataclass(frozen=True, eq=False)
class Hit:
    """The intersection of a ray with a surface.

    Attributes
    ----------
    place, normal : Vector
        In the world; the normal is the face's own, whichever side is hit.
    face : int
        -1 if the surface is not a mesh of the user.
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
    """The viewport's scene, sampled by rays from its camera.

    Parameters
    ----------
    scene : bpy.types.Scene
    lens : Lens
    capture : PixelGrid

    Attributes
    ----------
    origin : Vector
    directions : array (ray, 3)
        Unit vectors in the world that cover the frame evenly, in random order, so that the first few cover it, too.
    cosines : array (ray,)
        Of each ray's angle to the optical axis.
    shape : (int, int)
        Rows and columns of the rays' grid on the frame.
    places : array (ray,)
        Index of each ray in this grid, row by row.
    unit_m : float
        Length of a Blender unit in metres: the origin, and the places of a Hit, are in Blender units.
    beyond_units : float
        How far behind a surface the next ray starts.
    """

    def __init__(self, scene, lens, capture):
        self._scene, layer = scene, rendered_layer(scene)
        self.unit_m = metres_per_unit(scene)
        self.beyond_units = beyond_units(scene)
        layer.update()
        self._depsgraph = layer.depsgraph
        to_world = scene.camera.matrix_world.normalized()
        self.origin, turn = to_world.translation, np.array(to_world.to_3x3())
        x_mm, y_mm = _places_mm(capture.frame())
        self.shape, self.places = x_mm.shape, np.random.default_rng(0).permutation(x_mm.size)
        axes = _directions(x_mm.ravel(), y_mm.ravel(), lens, capture)[self.places]
        self.directions, self.cosines = axes @ turn.T, -axes[:, 2]

    def look(self, answer, rays=None):
        """The values of `answer`, a function of a ray's number and direction, for all rays or the given ones: a list,
        shorter if it would take longer than `LONGEST_S`."""
        answers, until_s = [], time.monotonic() + LONGEST_S
        for ray in range(len(self.directions)) if rays is None else rays:
            if answers and time.monotonic() > until_s:
                break
            answers.append(answer(ray, Vector(self.directions[ray])))
        return answers

    def first(self, start, direction, visibility="visible_camera"):
        """The first Hit of a ray on an object that a render shows to rays of this kind; None without one."""
        return first_hit(self._scene, self._depsgraph, start, direction,
                         lambda hit: is_rendered(hit.obj.original, visibility))


def first_hit(scene, depsgraph, start, direction, shows):
    """The first Hit of a ray that `shows` accepts; None without one.

    Parameters
    ----------
    scene : bpy.types.Scene
    depsgraph : bpy.types.Depsgraph
    start, direction : Vector
        In the world, in Blender units.
    shows : callable
        Whether a Hit counts. The ray passes through others.
    """
    for _ in range(MOST_UNSEEN):
        is_hit, *values = scene.ray_cast(depsgraph, start, direction)
        if not is_hit:
            return None
        hit = Hit(*values)
        if shows(hit):
            return hit
        start = hit.place + direction * beyond_units(scene)
    return None


def is_rendered(obj, visibility="visible_camera"):
    """Whether a render shows an object to rays of this kind."""
    return not obj.hide_render and getattr(obj, visibility)


def beyond_units(scene):
    """How far behind a surface the next ray starts."""
    return BEYOND_M / metres_per_unit(scene)


def visible_depth_mm(scene, lens, capture):
    """Depths along the optical axis, in mm, of points all over a capture.

    Objects are as the viewport shows them; rays pass through objects that the render does not show.

    Parameters
    ----------
    scene : bpy.types.Scene
    lens : Lens
    capture : PixelGrid

    Returns
    -------
    array (row, column)
        inf for the background, NaN for rays that were left out for lack of time.
    """
    view = View(scene, lens, replace(capture, overscan_px=(0, 0)))

    def distance_m(ray, direction):
        hit = view.first(view.origin, direction)
        return (hit.place - view.origin).length * view.unit_m if hit else np.inf

    distances_m, depth_mm = np.array(view.look(distance_m)), np.full(view.shape, np.nan)
    depth_mm.flat[view.places[:len(distances_m)]] = distances_m * view.cosines[:len(distances_m)] * M_TO_MM
    return depth_mm


def _places_mm(frame):
    """x and y of points all over a frame, on the image plane: arrays (row, column), row 0 at the top."""
    steps = max(frame.shape_px) / RAYS_ACROSS
    return frame.position_mm(*np.meshgrid(*(np.arange(0.5, n / steps) * steps - 0.5 for n in frame.shape_px),
                                          indexing="ij"))


def _directions(x_mm, y_mm, lens, capture):
    """Unit vectors, in the camera's axes, of the directions that a capture shows at these points."""
    x_mm = capture.squeeze * x_mm
    radius_mm = np.hypot(x_mm, y_mm)
    angle = np.minimum(capture.projection.angle_rad(radius_mm / lens.capture_focal_length_mm), np.pi / 2)
    sine = np.sin(angle) / np.maximum(radius_mm, np.finfo(float).tiny)
    return np.stack([sine * x_mm, sine * y_mm, -np.cos(angle)], axis=-1)
