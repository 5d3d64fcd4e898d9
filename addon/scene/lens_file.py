"""A lens file of the user's for a scene: the file itself or, with values that it does not state, a converted copy.

The copy is one file that states everything, so the scene renders the same on every machine that has it.
"""

import os
from itertools import count
from pathlib import Path

import bpy

from lensfield.engine import Lens, LensError
from lensfield.engine.lens_files.package import package_bytes
from lensfield.engine.prescription.prescription import Prescription
from lensfield.engine.prescription.readers import AS_IT_IS, ReadingOptions, read_prescription
from lensfield.engine.prescription.readers.toml import write_prescription
from lensfield.engine.runtime.files import atomic_path

from .blend_folder import check_blend_folder
from .lens_facts import lens_facts
from .trust import is_near_blend

FOLDER = "lenses"


def lens_file_for_scene(path: str | os.PathLike, options: ReadingOptions = AS_IT_IS) -> str:
    """The lens in a file, read by these options, as a path for the scene's settings.

    Parameters
    ----------
    path : path
        A prescription, or a lens package.
    options : ReadingOptions
        With any, the prescription is written as a Lensfield .toml into the folder `lenses` next to the .blend or, until
        the .blend is saved, in the user's configuration folder. Existing files are never overwritten.

    Raises
    ------
    InputError
        The lens cannot be read or traced, or the file cannot be written.
    """
    source = path if options == AS_IT_IS else read_prescription(path, options)
    try:
        lens_facts(source)
    except LensError as error:
        raise error.at(path) from None
    which = f"-{bpy.path.clean_name(options.which)}" if options.which else ""
    return _setting(path) if source is path else stored_lens(source, Path(path).stem + which)


def stored_lens(prescription: Prescription, name: str) -> str:
    """A prescription in a file with this name, as a path for the scene's settings.

    The folder is as for `lens_file_for_scene`. Existing files are never overwritten.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    return _setting(_written(write_prescription(prescription).encode(), name, ".toml"))


def stored_package(lens: Lens, name: str) -> str:
    """As `stored_lens`, for a lens package."""
    return _setting(_written(package_bytes(lens), name, ".npz"))


def _written(contents, name, suffix):
    """A file with these contents: an existing one, or a new one."""
    paths = (_folder() / f"{name}{f'-{number}' * (number > 1)}{suffix}" for number in count(1))
    path = next(path for path in paths
                if not os.path.lexists(path) or (path.is_file() and path.read_bytes() == contents))
    if not path.exists():
        with atomic_path(path) as temporary:
            temporary.write_bytes(contents)
    return path


def _folder():
    if bpy.data.filepath:
        check_blend_folder()
        return Path(bpy.data.filepath).parent / FOLDER
    return Path(bpy.utils.user_resource("CONFIG"), "lensfield", FOLDER)


def _setting(path):
    """A path as the settings store it: relative in the .blend's folder, so that both can move together."""
    path = os.path.abspath(path)
    return bpy.path.relpath(path) if bpy.data.filepath and is_near_blend(path) else path
