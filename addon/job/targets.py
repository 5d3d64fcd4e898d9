"""Checks of a frame's output files: they must overwrite neither the user's own files nor the scene's sources."""

import os

import bpy

from lensfield.engine.runtime.errors import InputError
from lensfield.engine.runtime.files import check_target, identity
from lensfield.engine.runtime.inputs import is_below

from ..scene.errors import SceneError
from ..scene.fingerprint import blocks_of
from ..shading.assigned import named_spectra


def check_files(scene, files):
    """Raise an InputError for a file of a frame that must not be written.

    Parameters
    ----------
    scene : bpy.types.Scene
    files : iterable of Path
    """
    sources = {identity(path) for path in _sources(scene) if os.path.isfile(path)}
    for path in files:
        if not is_below(path, path.parent):
            raise InputError(path, "file", "a link that leaves its folder", "remove it")
        check_target(path)
        if identity(path) in sources:
            raise SceneError(path, "file", "an input of the scene", "choose another output folder")


def _sources(scene):
    """Paths of the images in a scene's objects and world, and of its spectra."""
    for block in blocks_of(scene):
        if isinstance(block, bpy.types.Image) and not block.packed_file:
            yield bpy.path.abspath(block.filepath, library=block.library)
    yield from named_spectra()
