"""The folder of the .blend, which relative paths start from. It may be moved or renamed during the session."""

import os

import bpy

from lensfield.engine.runtime.errors import absence

from .errors import SceneError

REMEDY = "open the .blend where it is now, or use Save As"


def check_blend_folder():
    """Raise a SceneError if the saved .blend's folder is gone, because a file written into it would create it anew, and
    Blender would then save the .blend there.
    """
    folder = os.path.dirname(bpy.data.filepath)
    if not os.path.isdir(folder):
        raise SceneError(bpy.data.filepath, "folder", absence(folder), REMEDY)


def moved_remarks():
    """A line if the .blend has been moved since it was opened or saved: list."""
    path = bpy.data.filepath
    return [f"{path} is {absence(path)}: {REMEDY}"] * bool(path and not os.path.isfile(path))
