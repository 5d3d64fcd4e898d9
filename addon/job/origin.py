"""The source of stored light: the .blend and the scene that it shows. No source replaces the files of another."""

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path

import bpy

from lensfield.engine.pictures.spectral_exr import read_attribute
from lensfield.engine.runtime.errors import ImageError, InputError
from lensfield.engine.runtime.files import file_status

from ..scene.fingerprint import comparable
from .job import blend_path

ATTRIBUTE = "lensfield:origin"  # of the first of a frame's radiance, irradiance and lens image


@dataclass(frozen=True)
class Origin:
    """The source of a radiance or film.

    Attributes
    ----------
    file : str
        Path of the .blend relative to the folder of the light, if possible; "" if it was not saved.
    scene : str
        Its name.
    key : str
        The scene's key, which renaming preserves; "" before its first render in a window.
    state : str
        The scene's fingerprint when it was rendered; "" if unknown.
    """

    file: str
    scene: str
    key: str = ""
    state: str = ""

    def __str__(self):
        return f"scene {self.scene!r} of {self.file or 'an unsaved file'}"

    def is_of(self, other):
        """Whether both are the same scene: of one file, by their key, or because nothing in them differs."""
        alike = comparable(self.state) and self.state == other.state
        return self._place == other._place or self._has_key_of(other) or alike

    def may_replace(self, stored):
        """Whether this scene's light may replace the stored one: not a copy's that is in another folder."""
        copied = self.file != stored.file and os.path.basename(self.file) == os.path.basename(stored.file)
        return self.is_of(stored) and not (copied and self.state != stored.state)

    @property
    def _place(self):
        return self.file, self.scene

    def _has_key_of(self, other):
        return bool(self.key) and self.key == other.key


def origin_of(scene, folder, state=""):
    """The Origin of a scene's light that is stored in a folder."""
    return Origin(_relative(blend_path(), folder), scene.name, scene.lensfield.compositor_key, state)


def is_light_of(scene, stored, folder):
    """Whether light of this Origin in a folder shows a scene: not one that it was copied from in the same file."""
    here = origin_of(scene, folder)
    copied_from = stored.file == here.file and stored.scene != here.scene and stored.scene in bpy.data.scenes
    return here.is_of(stored) and not copied_from


def _relative(path, folder):
    if path is None:
        return ""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # another drive
        return path.as_posix()


def attribute_of(origin):
    """The attribute that a file stores: dict of str."""
    return {ATTRIBUTE: json.dumps(asdict(origin))}


def stored_origin(path):
    """The Origin of a file's light; None if the file is missing or does not state it."""
    if not file_status(path):
        return None
    try:
        stored = json.loads(read_attribute(path, ATTRIBUTE) or "{}")
        return Origin(**{name: str(value) for name, value in stored.items()})
    except (ImageError, AttributeError, RecursionError, TypeError, ValueError):  # damaged, or not ours
        return None


def check_replaced(scene, result, state):
    """Raise an InputError if a frame's files show another scene, or one of another .blend.

    Parameters
    ----------
    scene : bpy.types.Scene
    result : Result
        Names the files.
    state : str
        The scene's fingerprint.
    """
    here = origin_of(scene, result.radiance.parent, state)
    for path in result.radiance, result.irradiance, result.lens_image:
        stored = stored_origin(path)
        if stored and not here.may_replace(stored):
            raise InputError(path, "file", f"rendered from {stored}",
                             "choose another output folder, remove the file, or overwrite it (--overwrite)")
