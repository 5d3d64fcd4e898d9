"""The user's favourite lenses, in all files: a file in Blender's folder of settings.

They are not among the add-on's preferences, which Blender deletes when the add-on is disabled or removed.
"""

from functools import lru_cache
from pathlib import Path

import bpy

from lensfield.engine.runtime.files import atomic_path, stamp_of

NAME = "favourite_lenses.txt"


def favourite_lenses():
    """The names of the user's favourite lenses: frozenset of str."""
    path = Path(bpy.utils.user_resource("CONFIG"), "lensfield", NAME)
    return _names(path, stamp_of(path))


def toggle_favourite(lens):
    """Make a lens a favourite, or no longer one.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    path = Path(bpy.utils.user_resource("CONFIG", path="lensfield", create=True), NAME)
    names = sorted(favourite_lenses() ^ {lens})
    with atomic_path(path, overwrite=True) as temporary:
        temporary.write_text("".join(f"{name}\n" for name in names), encoding="utf-8")


@lru_cache(maxsize=1)
def _names(path, stamp):
    """The names in a file, which is read again if its stamp changes."""
    try:
        return frozenset(path.read_text(encoding="utf-8", errors="replace").split())
    except OSError:  # the panel lists the lenses without marks
        return frozenset()
