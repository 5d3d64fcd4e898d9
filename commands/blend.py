"""A .blend as a command opens it, in a Blender that has the add-on."""

from ..engine import InputError
from ..engine.errors import absence
from .terminal import quiet


def import_addon():
    """The add-on; an InputError where there is no bpy."""
    try:
        with quiet(1):  # where $OCIO is set, Blender says so
            from .. import addon
    except ImportError as error:
        raise InputError("bpy", "module", "not there", f"install Blender's Python wheel ({error})") from None
    return addon


def open_scene(path):
    """The scene of a .blend, opened with the add-on registered.

    Parameters
    ----------
    path : pathlib.Path

    Returns
    -------
    bpy.types.Scene

    Raises
    ------
    InputError
        There is no bpy, or no such .blend.
    """
    addon = import_addon()
    import bpy

    if not path.is_file():
        raise InputError(path, "scene", absence(path), "expected a .blend file")
    if not hasattr(bpy.types.Scene, "lensfield"):  # in the wheel nobody has registered the add-on yet
        addon.register()
    try:
        with quiet(1):
            bpy.ops.wm.open_mainfile(filepath=str(path.resolve()))
    except RuntimeError as error:
        raise InputError(path, "scene", "not readable", str(error).strip()) from None
    return bpy.context.scene
