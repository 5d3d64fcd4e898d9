"""Which files a frame may be written to: none that is somebody's own, nor one that the scene itself is made from."""

import os

import bpy

from ...engine.files import check_target, identity
from ..scene.errors import SceneError
from ..scene.fingerprint import blocks_of
from ..shading.assigned import named_spectra


def check_files(scene, files):
    """Raise an InputError for a file of a frame that is not to be written.

    Parameters
    ----------
    scene : bpy.types.Scene
    files : iterable of Path
    """
    sources = {identity(path) for path in _sources(scene) if os.path.isfile(path)}
    for path in files:
        check_target(path)
        if identity(path) in sources:
            raise SceneError(path, "file", "what the scene itself is made from", "choose another output folder")


def _sources(scene):
    """Paths of the images that a scene's objects and world show, and of the spectra."""
    for block in blocks_of(scene):
        if isinstance(block, bpy.types.Image) and not block.packed_file:
            yield bpy.path.abspath(block.filepath, library=block.library)
    yield from named_spectra()
