"""Rings: the lens's focus and f-stop, from the Depth of Field settings of a scene's camera."""

from functools import lru_cache
from math import degrees

from mathutils import Vector

from lensfield.engine import Lens
from lensfield.engine.lens.iris import Iris
from lensfield.engine.library import clamped_rings, has_rings, iris_is_visible, pinhole_of, prescription_of
from lensfield.engine.prescription.coatings import AS_LENS, coating_of
from lensfield.engine.prescription.tolerances import copy_of
from lensfield.engine.rays.rings import AT_REST, Rings, resized_rings
from lensfield.engine.runtime.errors import InputError

from .active_camera import camera_data, camera_settings
from .camera import lens_for_view, scene_frame
from .lens_cache import identity_of, load_lens, unwatched
from .units import mm_per_unit

CAMERA = "camera"
FEWEST_BLADES = 3
MOST_ANSWERS = 64
LEAST = 1e-3  # distance in mm, and f-number: Blender allows 0, and lenses are then clamped to their own range
FIXED = ("the lens is a package, valid for one focus and one f-number: the camera's Depth of Field, tilt, copy and "
         "coating are ignored")


def scene_rings(scene, focus=None, f_number=None, focused_wide_open=None, tilt_deg=None, copy=None,
                copy_grade=None, coating=None) -> Rings:
    """The rings of the scene's camera, except for the given values: focus and f-stop if its depth of field is on; tilt,
    copy and coating.

    Parameters
    ----------
    scene : bpy.types.Scene
    focus : float or "camera", optional
        Distance in mm; "camera": the camera's focus distance, even if its depth of field is off.
    f_number : float, optional
    focused_wide_open, tilt_deg, copy, copy_grade, coating : optional
        As in a RenderRequest.

    Raises
    ------
    SceneError
        The camera is missing.
    """
    settings, dof = camera_settings(scene), scene.camera.data.dof
    if focus == CAMERA or (focus is None and dof.use_dof):
        focus = _as_set(_focus_mm(scene))
    if f_number is None and dof.use_dof:
        f_number = max(_as_set(dof.aperture_fstop), LEAST)
    focused_wide_open, tilt_deg, copy, copy_grade, coating = (
        settings.value_of(name) if given is None else given for name, given in (
            ("focused_wide_open", focused_wide_open), ("tilt_deg", tilt_deg), ("copy", copy),
            ("copy_grade", copy_grade), ("coating", coating)))
    return Rings(focus, f_number, focused_wide_open, tilt_deg=tilt_deg,
                 copy=copy_of(copy, copy_grade), coating=coating_of(coating))


def scene_iris(scene, lens, iris=None, **overrides) -> Iris | None:
    """The blades of a scene's lens: as given, otherwise from the camera if its depth of field is on.

    Parameters
    ----------
    scene : bpy.types.Scene
    lens : Lens, or a source for `load_lens`
        A Lens is already stopped down: only given blades apply.
    iris : Iris, optional
    overrides : by name
        Arguments of `scene_rings`.

    Returns
    -------
    Iris or None
        None for a round stop, such as wide open.
    """
    if isinstance(lens, Lens):
        return iris if iris and iris.blades else None
    iris = _camera_iris(scene) if iris is None else iris
    if not iris or not iris.blades:
        return None
    shows = _iris_shows(*identity_of(lens), scene_rings(scene, **overrides))
    if isinstance(shows, InputError):
        raise shows.with_traceback(None)  # the traceback would grow each time
    return iris if shows else None


@lru_cache(maxsize=MOST_ANSWERS)
def _iris_shows(lens, changed, rings):
    """The value of `iris_is_visible`, or its error, cached while the lens's file is unchanged: a preview needs it many
    times a second."""
    try:
        return iris_is_visible(lens, rings)
    except InputError as error:
        return error


def _camera_iris(scene):
    """The Iris of the scene's camera, or None. Blender treats fewer than three blades as a round stop."""
    camera = camera_data(scene)
    if camera is None or not camera.dof.use_dof or camera.dof.aperture_blades < FEWEST_BLADES:
        return None
    return Iris(camera.dof.aperture_blades, _as_set(degrees(camera.dof.aperture_rotation)),
                _as_set(camera.lensfield.iris_roundness))


def scene_lens(scene, lens, view, quality, wavelengths_nm=None, baking=unwatched, **overrides):
    """The lens for a scene: with its camera's focus and f-stop, and with its own view or the view of the camera.

    Parameters
    ----------
    scene : bpy.types.Scene
    lens : Lens, or a source for `load_lens`
    view : "lens" or "camera"
    quality : str
        How finely a prescription is baked.
    wavelengths_nm : sequence of float, optional
        Of the picture, as for `load_lens`.
    baking : callable (fraction, label)
        Progress of a bake.
    overrides : by name
        Arguments of `scene_rings`.

    Returns
    -------
    Lens
    warning : str
        The consequences of scaling; "" without scaling.
    words : tuple of str
        A line for each setting that its rings do not have.

    Raises
    ------
    LensError, SceneError
    """
    if isinstance(lens, Lens):
        return *lens_for_view(scene, lens, view), ()
    rings = scene_rings(scene, **overrides)
    if not has_rings(lens):
        return *lens_for_view(scene, load_lens(lens), view), (FIXED,) * (rings != AT_REST)
    if view == CAMERA and camera_data(scene):
        rings = resized_rings(prescription_of(lens), rings, scene.camera.data.lens)
    edges_mm = scene_frame(scene, view).edges_mm(pinhole_of(lens, rings)) if scene.camera else None
    baked = load_lens(lens, rings, quality, baking, wavelengths_nm, edges_mm)
    return *lens_for_view(scene, baked, view), clamped_rings(lens, rings)


def _as_set(number):
    """A number as the user entered it. Blender's floats are single precision: f/2.8 is 2.79999995."""
    return float(f"{number:.6g}")


def _focus_mm(scene):
    """The focus distance of the scene's camera along its axis, as Blender computes it, in mm."""
    camera, unit_mm = scene.camera, mm_per_unit(scene)
    dof = camera.data.dof
    if dof.focus_object is None:
        return max(dof.focus_distance * unit_mm, LEAST)
    target = dof.focus_object.matrix_world
    if dof.focus_object.type == "ARMATURE" and (bone := dof.focus_object.pose.bones.get(dof.focus_subtarget)):
        target = target @ bone.matrix
    return max(abs(distance_on_axis(camera, target.translation)) * unit_mm, LEAST)


def distance_on_axis(camera, place):
    """How far a place is in front of a camera, along its axis as Blender's focus distance, in Blender units.

    Parameters
    ----------
    camera : bpy.types.Object
    place : Vector
        In the world.
    """
    to_world = camera.matrix_world.normalized()
    return Vector(to_world.col[2][:3]).dot(to_world.translation - place)


def rings_for(scene, lens):
    """The `scene_rings` for a lens by name or path; at rest for a package."""
    return scene_rings(scene) if has_rings(lens) else AT_REST


def ring_fields(rings):
    """The fields of a RenderRequest for these rings; the lens's size follows from the view."""
    copy = {"copy": rings.copy.seed, "copy_grade": rings.copy.grade} if rings.copy else {"copy": 0}
    return {"focus": rings.focus_mm, "f_number": rings.f_number, "focused_wide_open": rings.focused_wide_open,
            "tilt_deg": rings.tilt_deg, **copy, "coating": rings.coating or AS_LENS}
