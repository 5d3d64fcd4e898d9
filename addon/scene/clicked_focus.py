"""Focus by a click in a 3D view: the visible surface at the click, and the camera's focus on it."""

import numpy as np
from mathutils import Vector

from .depth import first_hit, is_rendered
from .errors import SceneError
from .linked import check_editable
from .rings import distance_on_axis


def surface_at(scene, depsgraph, perspective, place, space=None):
    """The Hit at a place of a 3D view: on the first surface that the view and renders show; None without one.

    Parameters
    ----------
    scene : bpy.types.Scene
    depsgraph : bpy.types.Depsgraph
    perspective : array (4, 4)
        The view's `RegionView3D.perspective_matrix`.
    place : (float, float)
        From (-1, -1) at the view's lower left to (1, 1) at its upper right.
    space : bpy.types.SpaceView3D, optional
        Whose local view and object types limit what is visible.
    """
    def shows(hit):
        return is_rendered(hit.obj.original) and (
            space is None or _is_instance(hit) or hit.obj.original.visible_in_viewport_get(space))

    return first_hit(scene, depsgraph, *_ray(perspective, place), shows)


def _ray(perspective, place):
    """Start, at the view's near limit, and direction of the ray at a place of a view: two Vectors."""
    to_world = np.linalg.inv(np.array(perspective, dtype=float))  # in double precision: clipping ranges are large
    near, farther = (to_world @ (*place, depth, 1.0) for depth in (-1.0, 0.0))
    start = near[:3] / near[3]
    return Vector(start), Vector(farther[:3] / farther[3] - start).normalized()


def _is_instance(hit):
    """Whether a surface belongs to an instance of an object, which is elsewhere."""
    return hit.to_world != hit.obj.matrix_world


def focus_on(camera, hit, follow=False):
    """Focus a camera on a surface, and turn its depth of field on.

    Parameters
    ----------
    camera : bpy.types.Object
    hit : Hit
    follow : bool
        Focus on the object's origin instead, wherever it moves.

    Raises
    ------
    SceneError
        The camera is linked, the surface is not in front of it, or an instance should be followed.
    """
    check_editable(camera.data)
    distance, dof = distance_on_axis(camera, hit.place), camera.data.dof
    if distance <= 0:
        raise SceneError(f"camera {camera.name!r}", "focus", "behind the camera", "click on something in front of it")
    if follow and _is_instance(hit):
        raise SceneError(f"object {hit.obj.name!r}", "focus object", "an instance", "click without Ctrl")
    dof.use_dof = True
    dof.focus_object = hit.obj.original if follow else None
    if not follow:
        dof.focus_distance = distance
