"""Data-blocks linked from another .blend. Python may change them, but Blender drops such changes when it saves."""

import bpy

from .errors import SceneError


def check_editable(block, remedy="change it in that file, or make a library override of it"):
    """Raise a SceneError for a data-block that the user cannot edit in this file.

    Parameters
    ----------
    block : bpy.types.ID
    remedy : str

    Raises
    ------
    SceneError
        The data-block is linked.
    """
    if not block.is_editable:
        origin = f"linked from {block.library.filepath}" if block.library else "not editable"
        raise SceneError(f"{block.bl_rna.name.lower()} {block.name!r}", "data-block", origin, remedy)


def stated_path(block, field, start=None):
    """The absolute path of a file that a data-block's Lensfield settings name.

    Parameters
    ----------
    block : bpy.types.ID
    field : str
        Of the settings.
    start : str, optional
        The folder that // means, unless the path comes from a linked .blend; by default the folder of this .blend.
    """
    text, reference = getattr(block.lensfield, field), getattr(block.override_library, "reference", None)
    inherited = reference and getattr(reference.lensfield, field) == text  # by the library override
    library = reference.library if inherited else block.library
    return bpy.path.abspath(text, library=library) if library else bpy.path.abspath(text, start=start)
