"""Which of the files that a .blend names may be looked at: those that the user has chosen in this session, or trusts.

A .blend may come from anybody. Panels, timers and handlers look at files by themselves, and even to look whether one is
there reaches another machine where its path leads to one. So all of them ask here first, as for Blender's own Auto Run.
"""

import os
from fnmatch import fnmatch

import bpy

from .errors import SceneError

REMEDY = "it came with the .blend: look at its path, and press Trust in the Lensfield panel"

_trusted = set()  # files and folders; until Blender ends


def trust(path):
    """Trust a file, or a folder of pictures, as long as Blender runs."""
    if path:
        _trusted.add(_key(path))


def trusts_all():
    """Whether all that the .blend names is trusted."""
    return _is_asked_for() or _runs_scripts()


def is_trusted(path):
    """Whether a path was chosen in this session, or its file may run scripts; nothing is looked at."""
    return trusts_all() or _key(path) in _trusted


def check_trusted(path, where, field):
    """Raise a SceneError for a path that is not trusted; `where` and `field` tell what names it."""
    if not is_trusted(path):
        raise SceneError(where, field, str(path), REMEDY)


def lies_beside(path):
    """Whether a path, as it is written, leads nowhere but into the folder of the .blend, or below."""
    folder = os.path.dirname(bpy.data.filepath)
    if not folder:
        return not os.path.isabs(path) and not _key(path).startswith(os.pardir)
    return os.path.join(_key(path), "").startswith(os.path.join(_key(folder), ""))


def forget_trust():
    """Trust nothing any more."""
    _trusted.clear()


def _is_asked_for():
    """In the background nothing is drawn: it is a command that names the .blend."""
    return bpy.app.background


def _runs_scripts():
    """Whether Blender lets this .blend run Python scripts by itself, as the preferences have it."""
    preferences, path = bpy.context.preferences, bpy.data.filepath
    excluded = any(fnmatch(path, each.path) if each.use_glob else path.startswith(each.path)
                   for each in preferences.autoexec_paths if each.path)
    return preferences.filepaths.use_scripts_auto_execute and not bpy.app.autoexec_fail and not excluded


def _key(path):
    return os.path.normcase(os.path.normpath(path))
