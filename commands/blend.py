"""Opening a .blend with the add-on registered."""

import sys
from pathlib import Path

from lensfield.engine import InputError
from lensfield.engine.runtime.files import mark_as_own, remove_left_work, uninterrupted
from lensfield.engine.runtime.inputs import is_confined

from .blend_paths import check_blend
from .terminal import quiet

PYTHONS = (3, 11), (3, 13)  # for which Blender's wheel is built
LIBRARIES = "libx11-6 libxrender1 libxfixes3 libxi6 libxkbcommon0 libsm6 libgl1"  # Debian packages that it requires


def import_addon():
    """The add-on; raises an InputError without bpy, or without a system library that it needs."""
    try:
        with quiet(1):  # Blender prints a message if $OCIO is set
            with uninterrupted():  # a process stopped during this import could not remove Blender's temporary folder
                import bpy
                mark_as_own(bpy.app.tempdir)
            from .. import addon
    except ModuleNotFoundError as error:
        raise InputError("bpy", "module", "not installed", _remedy(error)) from None
    except ImportError as error:
        raise InputError("bpy", "system library", str(error),
                         f"install it; on Debian or Ubuntu: sudo apt-get install {LIBRARIES}") from None
    remove_left_work(Path(bpy.app.tempdir).parent)
    return addon


def _remedy(error):
    if error.name != "bpy":
        return f"install Blender's wheel again ({error})"
    if sys.version_info[:2] in PYTHONS:
        return 'pip install "lensfield[blender]"'
    exist, here = (" and ".join(".".join(map(str, each)) for each in versions) for versions in
                   (PYTHONS, [sys.version_info[:2]]))
    return f"Blender's wheel is for Python {exist}, and this is {here}: use one of those, or Blender itself"


def open_scene(path, name=None):
    """A scene of a .blend, opened with the add-on registered.

    Parameters
    ----------
    path : pathlib.Path
    name : str, optional
        Its name; by default the scene that was open when the file was saved. Becomes the open scene.

    Returns
    -------
    bpy.types.Scene

    Raises
    ------
    InputError
        bpy or the .blend is missing; the .blend names a file that Blender should not open, such as a pipe; or it has no
        scene of this name.
    """
    check_blend(path)
    addon = import_addon()
    import bpy

    if not hasattr(bpy.types.Scene, "lensfield"):  # with the wheel, the add-on is not registered yet
        addon.register()
    try:
        with quiet(1):
            bpy.ops.wm.open_mainfile(filepath=str(path.resolve()), **{"use_scripts": False} if is_confined() else {})
    except RuntimeError as error:
        raise InputError(path, "scene", "not readable", str(error).strip()) from None
    if name is not None:
        bpy.context.window.scene = _scene(path, name)
    return bpy.context.scene


def _scene(path, name):
    """The scene of this name in the open file, not one linked from another file if both have it."""
    import bpy

    scenes = {scene.name: scene for scene in sorted(bpy.data.scenes, key=lambda scene: scene.library is None)}
    if name not in scenes:
        raise InputError(path, "scene", name, f"not in the file; its scenes: {', '.join(sorted(scenes))}")
    return scenes[name]
