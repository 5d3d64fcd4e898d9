"""Data-blocks linked from another .blend. Python may change them, but Blender drops such changes when it saves."""

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
