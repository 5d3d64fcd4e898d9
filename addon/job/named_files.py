"""The files that a .blend names and nobody has chosen in this session: they are shown before any is looked at."""

import bpy

from ..scene.compositor import picture_folder
from ..scene.errors import SceneError
from ..scene.trust import REMEDY, is_trusted, lies_beside, trust, trusts_all
from ..shading.assigned import named_spectra

FROM_FILE = "FILE"  # the lens of the settings that is none of the library's


def named_files():
    """What the .blend names that is not trusted: dict of path: what it is. No path is looked at.

    Lens data and spectra are read, wherever they are; pictures are written and looked for in folders, which is no risk
    in the .blend's own.
    """
    if trusts_all():
        return {}
    named = {}
    for scene in bpy.data.scenes:
        settings = scene.lensfield
        if settings.lens == FROM_FILE and settings.lens_file:
            named[bpy.path.abspath(settings.lens_file)] = "lens"
        for folder in filter(None, (bpy.path.abspath(settings.output_folder), picture_folder(scene))):
            if not lies_beside(folder):
                named[folder] = "output"
    named |= dict.fromkeys(named_spectra(), "spectrum")
    return {path: kind for path, kind in named.items() if not is_trusted(path)}


def check_named_files():
    """Raise a SceneError where the .blend names a file that is not trusted."""
    for path, kind in named_files().items():
        raise SceneError("this file", kind, path, REMEDY)


def trust_named_files():
    """Trust all that the .blend names now."""
    for path in named_files():
        trust(path)
