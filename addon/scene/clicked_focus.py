"""Focus by a click in a 3D view: the visible surface at the click, and the camera's focus on it."""

import numpy as np
from mathutils import Vector

from .active_camera import camera_settings
from .camera import scene_frame
from .depth import first_hit, is_rendered
from .errors import SceneError
from .linked import check_editable
from .rings import distance_on_axis


def surface_at(scene, depsgraph, ray, space=None):
    """The Hit of a ray on the first surface that the view and renders show; None without one.

    Parameters
    ----------
    scene : bpy.types.Scene
    depsgraph : bpy.types.Depsgraph
    ray : (Vector, Vector)
        Start and direction.
    space : bpy.types.SpaceView3D, optional
        Local view and hidden object types of this view count as hidden.
    """
    def shows(hit):
        return is_rendered(hit.obj.original) and (
            space is None or _is_instance(hit) or hit.obj.original.visible_in_viewport_get(space))

    return first_hit(scene, depsgraph, *ray, shows)


def view_ray(perspective, place):
    """The ray at a place of a 3D view: its start, at the view's near limit, and its direction, two Vectors.

    Parameters
    ----------
    perspective : array (4, 4)
        The view's `RegionView3D.perspective_matrix`.
    place : (float, float)
        From (-1, -1) at the view's lower left to (1, 1) at its upper right.
    """
    to_world = np.linalg.inv(np.array(perspective, dtype=float))  # in double precision: clipping ranges are large
    near, farther = (to_world @ (*place, depth, 1.0) for depth in (-1.0, 0.0))
    start = near[:3] / near[3]
    return Vector(start), Vector(farther[:3] / farther[3] - start).normalized()


def lens_ray(scene, facts, tangents, ray):
    """The ray that a lens's picture shows where the camera's view, without the picture, shows another.

    Parameters
    ----------
    scene : bpy.types.Scene
    facts : LensFacts
        Of its lens. A lens without rotational symmetry counts as free from distortion.
    tangents : (float, float, float, float)
        Of the angles from the axis to the picture's left, lower, right and upper edge in the view.
    ray : (Vector, Vector)
        Start and direction in the view.
    """
    axes, (left, lower, right, upper) = scene.camera.matrix_world.normalized(), tangents
    x, y, z = axes.to_3x3().transposed() @ ray[1]
    shares = np.array([(x / -z - left) / (right - left), (y / -z - lower) / (upper - lower)])
    if not facts.radial or np.any(np.abs(shares - 0.5) > 0.5):
        return ray
    first_mm, last_mm = np.reshape(scene_frame(scene, camera_settings(scene).view_text()).edges_mm(facts), (2, 2))
    place_mm = first_mm + shares * (last_mm - first_mm)
    radius_mm = max(np.hypot(*place_mm), np.finfo(float).tiny)
    angle = facts.angle_rad(radius_mm)
    direction = axes.to_3x3() @ Vector((*np.sin(angle) * place_mm / radius_mm, -np.cos(angle)))
    return axes.translation + direction * scene.camera.data.clip_start, direction


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
