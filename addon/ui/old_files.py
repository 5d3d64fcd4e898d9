"""Files from before the lens belonged to the camera: their scenes' lenses are given to the scenes' cameras on loading.

Blender keeps the values of properties that are no longer registered; groups of properties list them by name.
"""

import sys

import bpy
from bpy.app.handlers import persistent

from ..scene.motion import curves_of, owned_curves
from .common.properties import CAMERA_SETTINGS, body_items, lens_items

NEW_NAMES = {name: name for name in ("lens", "lens_file", "iris_roundness", "sensor_mm", *CAMERA_SETTINGS)} | {
    "camera": "body", "camera_file": "body_file"}
"""Settings of cameras by their names in scenes."""
NUMBERED = {"lens": lens_items, "body": body_items}
OLD_BITS = 7  # that the numbers of lenses and bodies had in addition
POINT_FIELDS = ("co", "interpolation", "easing", "back", "amplitude", "period", "handle_left_type",
                "handle_right_type", "handle_left", "handle_right")


@persistent
def give_lenses_to_cameras(*_):
    """Give the lenses of all scenes to their cameras, and report each scene in a line."""
    taken = {}
    for scene in bpy.data.scenes:
        if old := _old_values(scene):
            print(f"lensfield: {_converted(scene, old, taken)}", file=sys.stderr, flush=True)


def _old_values(scene):
    """A scene's values of settings that cameras have now: dict by their names in cameras."""
    group = scene.lensfield
    return {NEW_NAMES[name]: _number_now(NEW_NAMES[name], group[name]) for name in group.keys() if name in NEW_NAMES}


def _number_now(name, value):
    """The number of a lens or a body, which may be longer in the file; other values as they are."""
    if name not in NUMBERED or value in (number for *_, number in NUMBERED[name](None, None)):
        return value
    return value >> OLD_BITS


def _converted(scene, old, taken):
    """Give a scene's old values to its cameras, except those with a lens already; returns what happened, in words.

    `taken` has the scenes whose lenses cameras have taken, and gets this scene.
    """
    where = f"scene {scene.name!r}"
    if not scene.is_editable:
        return f"{where} is linked, with a lens of an older Lensfield: open {scene.library.filepath}, and save it"
    cameras = _cameras(scene)
    if not any(camera.is_editable for camera in cameras):
        return f"{where} lacks a camera to take its lens: add one, or make a library override"
    fresh = [camera for camera in cameras if camera.is_editable and not camera.lensfield.keys()]
    for camera in fresh:
        for name, value in old.items():
            camera.lensfield[name] = value
        _give_animation(scene, camera)
    left = [f"{camera.name!r} is linked" if not camera.is_editable else
            f"{camera.name!r} has the lens of scene {taken[camera].name!r}" if camera in taken else
            f"{camera.name!r} has a lens already" for camera in cameras if camera not in fresh]
    taken |= dict.fromkeys(fresh, scene)
    _forget(scene)
    given = ", ".join(repr(each.name) for each in fresh) or "none"
    return "; ".join([f"{where}: lenses now belong to cameras: this one was given to {given}", *left])


def _cameras(scene):
    """The data of all cameras of a scene and its markers: list, the active one first."""
    objects = [scene.camera, *(marker.camera for marker in scene.timeline_markers), *scene.objects]
    return list(dict.fromkeys(each.data for each in objects if each and each.type == "CAMERA"))


def _give_animation(scene, camera):
    """Copy keyframes and drivers of a scene's old settings to a camera."""
    animation = scene.animation_data
    for curve in curves_of(animation) if animation else ():
        if name := _new_name(curve.data_path):
            _give_keyframes(curve, camera, name)
    for driver in animation.drivers if animation else ():
        if name := _new_name(driver.data_path):
            (camera.animation_data or camera.animation_data_create()).drivers.from_existing(
                src_driver=driver).data_path = f"lensfield.{name}"


def _new_name(path):
    """The name in cameras of the setting that an animation's path names; None for other paths."""
    group, _, name = path.partition(".")
    return NEW_NAMES.get(name) if group == "lensfield" else None


def _give_keyframes(curve, camera, name):
    path, prop = f"lensfield.{name}", camera.lensfield.bl_rna.properties[name]
    index = curve.array_index if getattr(prop, "is_array", False) else -1
    for point in curve.keyframe_points:
        camera.keyframe_insert(path, index=index, frame=point.co[0])
    given = next(each for each in curves_of(camera.animation_data)
                 if (each.data_path, each.array_index) == (path, curve.array_index))
    given.extrapolation = curve.extrapolation
    for point, new in zip(curve.keyframe_points, given.keyframe_points, strict=True):
        for field in POINT_FIELDS:
            setattr(new, field, getattr(point, field))


def _forget(scene):
    """Remove a scene's old values, and their animation."""
    for name in [name for name in scene.lensfield.keys() if name in NEW_NAMES]:
        del scene.lensfield[name]
    for driver in list(scene.animation_data.drivers) if scene.animation_data else ():
        if _new_name(driver.data_path):
            scene.animation_data.drivers.remove(driver)
    for owner, curve in [*owned_curves(scene.animation_data)] if scene.animation_data else ():
        if _new_name(curve.data_path) and not owner.id_data.library:
            owner.fcurves.remove(curve)


_HANDLERS = "load_post", "blend_import_post"


def start():
    """Convert files and appended scenes as they are loaded, until `stop`; and the open file, unless Blender is still
    starting."""
    for name in _HANDLERS:
        getattr(bpy.app.handlers, name).append(give_lenses_to_cameras)
    if hasattr(bpy.data, "scenes"):
        give_lenses_to_cameras()


def stop():
    """Do not convert files any more."""
    for name in _HANDLERS:
        getattr(bpy.app.handlers, name).remove(give_lenses_to_cameras)
