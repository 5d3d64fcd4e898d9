"""Rings: what a scene's camera turns its lens to, by its own Depth of Field settings."""

from functools import lru_cache
from math import degrees, inf

from mathutils import Vector

from ...engine import Lens
from ...engine.bake.rings import AT_REST, Rings, resized_rings
from ...engine.depth.pencils import Iris
from ...engine.errors import InputError
from ...engine.files import stamp_of
from ...engine.library import cannot_be, has_rings, iris_shows, prescription_of
from .camera import lens_for_view
from .depth import M_TO_MM
from .lens_cache import load_lens

CAMERA = "camera"
FEWEST_BLADES = 3
MOST_ANSWERS = 64
FIXED = "the lens is a package, which holds for one focus and one f-number: those of the camera are left out"


def scene_rings(scene, focus=None, f_number=None, focused_wide_open=None) -> Rings:
    """What the scene's camera, where its depth of field is on, turns a lens to, but for what is given.

    Parameters
    ----------
    scene : bpy.types.Scene
    focus : float or "camera", optional
        Distance in mm; or the camera's, even where its depth of field is off.
    f_number : float, optional
    focused_wide_open : bool, optional
        As the settings have it, by default.
    """
    camera = scene.camera.data if scene.camera and scene.camera.type == "CAMERA" else None
    turns = camera is not None and camera.dof.use_dof
    if camera and (focus == CAMERA or (focus is None and turns)):
        focus = _as_set(_focus_mm(scene.camera))
    if f_number is None and turns:
        f_number = _as_set(camera.dof.aperture_fstop)
    if focused_wide_open is None:
        focused_wide_open = scene.lensfield.focused_wide_open
    return Rings(None if focus == CAMERA else focus, f_number, focused_wide_open)


def scene_iris(scene, lens, iris=None, **asked) -> Iris | None:
    """The blades that a scene's lens is stopped down by: of its camera, where its depth of field is on, unless they are
    given.

    Parameters
    ----------
    scene : bpy.types.Scene
    lens : Lens, or a name or path that `engine.library.load` takes
        A Lens is stopped down already, by blades that are given alone.
    iris : Iris, optional
    asked : by name
        What `scene_rings` takes.

    Returns
    -------
    Iris or None
        None for a round stop, which that of a lens wide open is, too.
    """
    if isinstance(lens, Lens):
        return iris if iris and iris.blades else None
    iris = _camera_iris(scene) if iris is None else iris
    if not iris or not iris.blades:
        return None
    shows = _iris_shows(str(lens), stamp_of(lens), scene_rings(scene, **asked))
    if isinstance(shows, InputError):
        raise shows.with_traceback(None)  # which would grow each time
    return iris if shows else None


@lru_cache(maxsize=MOST_ANSWERS)
def _iris_shows(lens, changed, rings):
    """What `iris_shows` tells, or its error, once as long as the lens's file is the same: a preview asks many times a
    second."""
    try:
        return iris_shows(lens, rings)
    except InputError as error:
        return error


def _camera_iris(scene):
    """Blender takes two blades for none."""
    camera = scene.camera.data if scene.camera and scene.camera.type == "CAMERA" else None
    if camera is None or not camera.dof.use_dof or camera.dof.aperture_blades < FEWEST_BLADES:
        return None
    return Iris(camera.dof.aperture_blades, _as_set(degrees(camera.dof.aperture_rotation)),
                _as_set(scene.lensfield.iris_roundness))


def scene_lens(scene, lens, view, quality, **asked):
    """The lens to see a scene through: turned as its camera has it, and as its own view or the camera's asks for.

    Parameters
    ----------
    scene : bpy.types.Scene
    lens : Lens, or a name or path that `engine.library.load` takes
    view : "lens" or "camera"
    quality : str
        How finely a prescription is baked.
    asked : by name
        What `scene_rings` takes.

    Returns
    -------
    Lens
    warning : str
        What another size means; "" for none.
    words : tuple of str
        What its rings cannot do, a line each.

    Raises
    ------
    LensError, SceneError
    """
    if isinstance(lens, Lens):
        return *lens_for_view(scene, lens, view), ()
    rings = scene_rings(scene, **asked)
    if not has_rings(lens):
        return *lens_for_view(scene, load_lens(lens), view), (FIXED,) * (rings != AT_REST)
    if view == CAMERA and scene.camera and scene.camera.type == "CAMERA":
        rings = resized_rings(prescription_of(lens), rings, scene.camera.data.lens)
    return *lens_for_view(scene, load_lens(lens, rings, quality), view), cannot_be(lens, rings)


def _as_set(number):
    """Blender's floats are single: f/2.8 is 2.79999995."""
    return float(f"{number:.6g}")


def _focus_mm(camera):
    """The camera's focus distance, along its axis, as Blender has it."""
    dof = camera.data.dof
    if dof.focus_object is None:
        return max(dof.focus_distance * M_TO_MM, 1e-3)
    target = dof.focus_object.matrix_world
    if dof.focus_object.type == "ARMATURE" and (bone := dof.focus_object.pose.bones.get(dof.focus_subtarget)):
        target = target @ bone.matrix
    own = camera.matrix_world.normalized()
    away = own.translation - target.translation
    return max(abs(Vector(own.col[2][:3]).dot(away)) * M_TO_MM, 1e-3)


def rings_for(scene, lens):
    """What the scene's camera turns a lens to, by name or path; at rest where that is a package."""
    return scene_rings(scene) if has_rings(lens) else AT_REST


def ring_arguments(rings):
    """The rings as `lensfield` takes them."""
    asked = [] if rings.focus_mm is None else ["--focus", "inf" if rings.focus_mm == inf else f"{rings.focus_mm!r}mm"]
    asked += [] if rings.f_number is None else ["--f-number", repr(rings.f_number)]
    return asked + ["--focused-wide-open"] * rings.focused_wide_open


def iris_arguments(iris):
    """The blades as `lensfield` takes them."""
    if iris is None:
        return ["--iris-blades", "0"]
    return ["--iris-blades", str(iris.blades), f"--iris-rotation={iris.rotation_deg!r}", "--iris-roundness",
            repr(iris.roundness)]
