"""Files that a .blend names and the user has not chosen in this session: their paths are shown before any access."""

import bpy

from ..scene.compositor import picture_folder
from ..scene.errors import SceneError
from ..scene.linked import stated_path
from ..scene.trust import REMEDY, is_near_blend, is_trusted, trust, trusts_all
from ..shading.assigned import named_spectra

FROM_FILE = "FILE"  # the setting for a lens or camera that is not from the library


def named_files():
    """Untrusted paths that the .blend names: dict of path to kind. No path is accessed.

    Lens data, cameras and spectra are read from any path. Pictures are written to folders and looked up there, which is
    safe in the .blend's own folder.
    """
    if trusts_all():
        return {}
    named = {}
    for camera in bpy.data.cameras:
        for field, kind in ("lens", "lens"), ("body", "camera"):
            if getattr(camera.lensfield, field) == FROM_FILE and (path := stated_path(camera, f"{field}_file")):
                named[path] = kind
    for scene in bpy.data.scenes:
        for folder in filter(None, (bpy.path.abspath(scene.lensfield.output_folder), picture_folder(scene))):
            if not is_near_blend(folder):
                named[folder] = "output"
    named |= dict.fromkeys(named_spectra(), "spectrum")
    return {path: kind for path, kind in named.items() if not is_trusted(path)}


def check_named_files():
    """Raise a SceneError if the .blend names an untrusted file."""
    for path, kind in named_files().items():
        raise SceneError("this file", kind, path, REMEDY)


def trust_named_files():
    """Trust all paths that the .blend names now."""
    for path in named_files():
        trust(path)
