"""Which files named by a .blend may be accessed: the ones that the user has chosen in this session, or trusts.

A .blend may be untrusted. Panels, timers and handlers access files without a command from the user, and even a check
that a file exists contacts another machine if the path leads to one. So all of them check here first, as for Blender's
own Auto Run.
"""

import os
from fnmatch import fnmatch

import bpy

from lensfield.engine.runtime.inputs import is_below, note_who_names

from .errors import SceneError

REMEDY = "the path comes from the .blend: check it, then press Trust in the Lensfield panel"

OUTSIDE = "outside the .blend's folder, directly or through a link: choose it with --output, or in the panel"

_trusted = set()  # files and folders; until Blender exits


def trust(path):
    """Trust a file, or a folder of pictures, until Blender exits."""
    if path:
        _trusted.add(_key(path))


def trusts_all():
    """Whether all paths in the .blend are trusted."""
    return _user_must_confirm() or _runs_scripts()


def is_trusted(path):
    """Whether a path was chosen in this session, or the .blend may run scripts; the path is not accessed."""
    return trusts_all() or _key(path) in _trusted


def check_trusted(path, where, field, expected):
    """Raise a SceneError for an untrusted path; later errors do not quote a file that only the .blend names.

    Parameters
    ----------
    path : str
    where, field : str
        The place and the setting that name it.
    expected : str
        The remedy for invalid contents.
    """
    if not is_trusted(path):
        raise SceneError(where, field, str(path), REMEDY)
    unquoted = f"the .blend names the file, so its content is not quoted: {expected}"
    note_who_names(path, None if _is_chosen(path) else unquoted)


def check_output(folder):
    """Raise a SceneError for an output folder that only the .blend names and that is not below the .blend's folder.

    It resolves links, and so accesses the disk.

    Parameters
    ----------
    folder : str
        From the settings, absolute.
    """
    if not (_is_chosen(folder) or (bpy.data.filepath and is_below(folder, os.path.dirname(bpy.data.filepath)))):
        raise SceneError("scene settings", "output folder", folder, OUTSIDE)


def is_near_blend(path):
    """Whether a path, as written, is in the folder of the .blend, or below it."""
    folder = os.path.dirname(bpy.data.filepath)
    if not folder:
        return not os.path.isabs(path) and not _key(path).startswith(os.pardir)
    return os.path.join(_key(path), "").startswith(os.path.join(_key(folder), ""))


def _is_chosen(path):
    """Whether the user named a path: in this session, or in a window by letting the .blend run scripts."""
    return _key(path) in _trusted or (_runs_scripts() and not _user_must_confirm())


def forget_trust():
    """Trust no path any more."""
    _trusted.clear()


def _user_must_confirm():
    """Whether the user named the .blend in a command: in the background, Blender draws no panels."""
    return bpy.app.background


def _runs_scripts():
    """Whether the preferences let this .blend run Python scripts automatically."""
    preferences, path = bpy.context.preferences, bpy.data.filepath
    excluded = any(fnmatch(path, each.path) if each.use_glob else path.startswith(each.path)
                   for each in preferences.autoexec_paths if each.path)
    return preferences.filepaths.use_scripts_auto_execute and not bpy.app.autoexec_fail and not excluded


def _key(path):
    return os.path.normcase(os.path.normpath(path))
