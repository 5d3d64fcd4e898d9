"""A render in a child process: `lensfield render` on a copy of the file, which leaves this session untouched.

The child (`engine/runtime/child.py`) is Blender in the background or, with Blender's Python wheel, Python.
"""

import os
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from lensfield.engine import Options
from lensfield.engine.depth.depth_range import AUTO, TRACED
from lensfield.engine.plan.options import TIER_ACCURACY
from lensfield.engine.runtime.files import remove_left_work, work_prefix
from lensfield.engine.spectral.wavelength_choice import SpectralOptions

from ...request import CAMERA, EXPOSED_FIELDS, ON, argument, to_arguments
from ..job.job import folder_for, unsaved_folder
from ..job.result import UNSAVED
from ..scene.errors import SceneError, blenders_reason
from ..scene.rings import ring_fields
from .refilter import applied_fields
from .session import write_session

PREVIEW_WAVELENGTHS = 7
PREVIEW_ROOM = 0.12  # enough to switch from any bundled lens to any other
COMPARISON = "comparison"  # the folder of a contact sheet, in the folder of renders
EXTENSION = __package__.rsplit(".", 2)[0]
SESSION = "session.npz"  # next to the copy
CONTINUE = ["preview", "--progress", "lines"]
"""The arguments of `lensfield` that continue a stopped preview."""


def work_folder():
    """A temporary folder for a copy and its child; its name marks it as this process's."""
    return tempfile.TemporaryDirectory(prefix=work_prefix(), dir=_temporary_parent(), ignore_cleanup_errors=True)


def sweep():
    """Remove the work folders of processes that were killed."""
    remove_left_work(_temporary_parent())


def _temporary_parent():
    return Path(bpy.app.tempdir).parent  # Blender empties its own folder when it loads the factory settings


def save_copy(folder):
    """Save the file as it is, with unsaved edits, into a folder; returns the path of the copy.

    Session state that a .blend cannot contain is saved next to the copy (`session.py`).

    This session stays as it was: the file's path, its unsaved changes and the undo history. A link next to the copy
    leads to simulations that are cached on disk.

    Raises
    ------
    SceneError
        The copy cannot be saved, or the caches cannot be linked.
    """
    path = Path(folder) / (Path(bpy.data.filepath).name or f"{UNSAVED}.blend")
    try:
        with _without_thumbnail():
            bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True, relative_remap=True, compress=False)
    except RuntimeError as error:
        raise SceneError(path, "copy of the file", "not saved", blenders_reason(error)) from None
    write_session(path.with_name(SESSION))
    caches = Path(bpy.data.filepath).parent / f"blendcache_{path.stem}"  # Blender's name for it
    if bpy.data.filepath and caches.is_dir():
        _link(path.with_name(caches.name), caches)
    return path


@contextmanager
def _without_thumbnail():
    """Save files without a thumbnail, which a window draws in up to 0.7 s.

    The preferences are restored, including whether they have unsaved changes.
    """
    preferences = bpy.context.preferences
    kind, changed = preferences.filepaths.file_preview_type, preferences.is_dirty
    preferences.filepaths.file_preview_type = "NONE"
    try:
        yield
    finally:
        preferences.filepaths.file_preview_type, preferences.is_dirty = kind, changed


def _link(path, folder):
    try:
        path.symlink_to(folder, target_is_directory=True)
    except OSError as error:  # some systems require a privilege for links
        raise SceneError(folder, "folder of simulation caches", "not linkable",
                         f"bake the simulations into the file instead ({error.strerror})") from None


def render_command(scene, copy, *more, **given):
    """The command line that renders a scene in a copy by its settings, except for the given fields of a RenderRequest.

    Parameters
    ----------
    scene : bpy.types.Scene
    copy : path
    more : str
        Further arguments of `lensfield render`.
    given : by name
    """
    return lensfield_command([*_of_copy("render", scene, copy), "--end-with-stdin", *more,
                              *to_arguments(output_folder=folder_for(scene), **given)])


def _of_copy(command, scene, copy):
    """The arguments of `lensfield` that render a scene in a copy as if it were the file, and report progress."""
    return [command, str(copy), f"--scene-name={scene.name}", "--session", str(Path(copy).with_name(SESSION)),
            "--blend-folder", os.path.dirname(bpy.data.filepath) or str(unsaved_folder()), "--progress", "lines"]


def compare_command(scene, copy, lenses, f_numbers, size, samples, picture):
    """The command line that compares lenses in a copy of a scene, at the quality of a preview.

    Parameters
    ----------
    scene : bpy.types.Scene
    copy : path
    lenses : sequence of str
        Names or paths.
    f_numbers : sequence of float
        Without any, as in a render. With some, the camera sets the focus, as it does once an f-number is chosen.
    size : (int, int)
        Width and height of each picture.
    samples : int
    picture : path
        A PNG of the light so far.
    """
    given = {"spectral": SpectralOptions("preview"), "depth": _storing_depth(scene), "denoise": ON, "unfit": "render",
             "focus": CAMERA if f_numbers else None, "picture": picture,
             "output_folder": folder_for(scene) / COMPARISON}
    chosen = [argument("lens", lens) for lens in lenses]
    if f_numbers:
        chosen.append(argument("f-number", ",".join(map(repr, f_numbers))))
    return lensfield_command([*_of_copy("compare", scene, copy), "--end-with-stdin", *chosen,
                              "--resolution", "{}x{}".format(*size), "--samples", str(samples), *to_arguments(**given)])


def _storing_depth(scene):
    """Instead of a traced lens, which stores no light for other lenses, layers of depth; None for the scene's value."""
    return AUTO if scene.lensfield.value_of("depth") == TRACED else None


def apply_command(radiance, scene):
    """The command line that puts stored radiance through a scene's lens, with its camera's focus and f-stop."""
    return lensfield_command(["apply", str(radiance), "--progress", "lines", "--end-with-stdin",
                              *to_arguments(**applied_fields(scene, scene.lensfield.to_request()))])


def preview_arguments(scene, key, *, copy=None, changes=None, size=None, samples=None):
    """The arguments of `lensfield` for a preview: of a copy of the file, or of the scene that its child has loaded.

    Parameters
    ----------
    scene : bpy.types.Scene
    key : (str, str, str, Rings, Iris or None, tuple)
        Lens, view, treatment of the area outside the field, focus and f-stop, blades, and values of `EXPOSED_FIELDS`.
    copy, changes : path, optional
        For another scene, or for changes of the loaded one.
    size, samples : (width, height) and int, optional
        With either: the size of the coarse picture, and the samples of the last.
    """
    lens, view, out_of_field, rings, iris, exposed = key
    given = {"lens": lens, "view": view, "lens_quality": "preview", "iris": iris, **ring_fields(rings),
             "options": Options(accuracy=TIER_ACCURACY["preview"], out_of_field=out_of_field),
             **dict(zip(EXPOSED_FIELDS, exposed, strict=True))}
    if size is None:
        return [*CONTINUE, *to_arguments(**given)]
    nm = scene.lensfield.wavelengths_nm()
    few = np.linspace(nm[0], nm[-1], min(len(nm), PREVIEW_WAVELENGTHS)).tolist()
    begun = [*CONTINUE, "--changes", str(changes)] if changes else _of_copy("preview", scene, copy)
    return [*begun, "--resolution", "{}x{}".format(*size), "--samples", str(samples),
            *to_arguments(**given, wavelengths_nm=tuple(few), spectral=SpectralOptions("preview"), denoise=ON,
                          unfit="render", depth=_storing_depth(scene), room=PREVIEW_ROOM,
                          output_folder=Path(changes or copy).parent)]


def lensfield_command(arguments):
    """The command line of `lensfield` with these arguments, in another process of this Blender."""
    if not bpy.app.binary_path:  # the wheel
        return [sys.executable, "-c", f"from {EXTENSION}.cli import console; console()", *arguments]
    scripts = "--disable-autoexec" if bpy.app.autoexec_fail else "--enable-autoexec"  # as in this session
    return [bpy.app.binary_path, "--background", "--addons", EXTENSION, scripts, "--command", "lensfield", *arguments]
