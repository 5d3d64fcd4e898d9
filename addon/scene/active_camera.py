"""The camera that a scene renders from, and Lensfield's settings of it: its lens and its body."""

from itertools import chain

from .errors import SceneError
from .linked import check_editable


def camera_data(scene):
    """The data of a scene's active camera: bpy.types.Camera; None without one. Any object can be active."""
    return _data(scene.camera)


def camera_in(context):
    """The data of the camera in an editor's properties, or else of the active camera; None without one."""
    return getattr(context, "camera", None) or camera_data(context.scene)


def camera_object_in(context):
    """The camera that an editor is about, as bpy.types.Object: of several with the same data, the active one or the
    selected one; None without."""
    data, scene = camera_in(context), context.scene
    objects = chain((scene.camera, context.object), scene.objects) if data else ()
    return next((each for each in objects if each and each.data == data), None)


def settings_to_edit(context):
    """The Lensfield settings of the camera that an editor is about.

    Raises
    ------
    SceneError
        The camera is missing, or linked from another file.
    """
    camera = camera_in(context)
    if camera:
        check_editable(camera)
    return camera.lensfield if camera else camera_settings(context.scene)


def camera_settings(scene, camera=None):
    """The Lensfield settings of a scene's camera.

    Parameters
    ----------
    scene : bpy.types.Scene
    camera : bpy.types.Object, optional
        One of the scene's cameras; the active one by default, which is, at each frame, the one that markers bind there.

    Raises
    ------
    SceneError
        The camera is missing.
    """
    data = _data(camera or scene.camera)
    if data is None:
        raise SceneError(f"scene {scene.name!r}", "camera", "missing", "add a camera to render from")
    return data.lensfield


def _data(camera):
    return camera.data if camera and camera.type == "CAMERA" else None
