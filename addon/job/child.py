"""A render in a process of its own: `lensfield render` on a copy of the file, so that nothing here is touched by it.

The child (`commands/child.py`) is Blender itself in the background; in Blender's Python wheel: Python.
"""

import os
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

import bpy
import numpy as np

from ...engine.files import remove_left_work, work_prefix
from ...engine.image.depth_range import AUTO, TRACED
from ...engine.plan.options import TIER_ACCURACY
from ..scene.errors import SceneError
from ..scene.rings import iris_arguments, ring_arguments, rings_for, scene_iris
from .job import UNSAVED_FOLDER
from .refilter import applied_depth
from .session import write_session

PREVIEW_WAVELENGTHS = 7
PREVIEW_ROOM = 0.12  # enough for each of the bundled lenses, after any other
EXTENSION = __package__.rsplit(".", 2)[0]
SESSION = "session.npz"  # beside the copy


def work_folder():
    """A temporary folder for a copy and its child, marked as this process's."""
    return tempfile.TemporaryDirectory(prefix=work_prefix(), dir=_beside_blenders_own(), ignore_cleanup_errors=True)


def sweep():
    """Remove the work folders of processes that were killed."""
    remove_left_work(_beside_blenders_own())


def _beside_blenders_own():
    return Path(bpy.app.tempdir).parent  # Blender empties its own as it loads the factory settings


def save_copy(folder):
    """Save the file as it is, unsaved edits included, into a folder; the path of the copy.

    What a .blend does not hold of this session lies beside it (`session.py`).

    Everything stays as it was: the file's own path, what is unsaved, and the steps that can be undone. Simulations that
    are cached on disk are found beside the copy too, by a link.

    Raises
    ------
    SceneError
        The copy cannot be saved, or the caches not be linked.
    """
    path = Path(folder) / (Path(bpy.data.filepath).name or "unsaved.blend")
    try:
        bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True, relative_remap=True, compress=False)
    except RuntimeError as error:
        raise SceneError(path, "copy of the file", "not to be saved", str(error).strip()) from None
    write_session(path.with_name(SESSION))
    caches = Path(bpy.data.filepath).parent / f"blendcache_{path.stem}"  # as Blender calls it
    if bpy.data.filepath and caches.is_dir():
        _link(path.with_name(caches.name), caches)
    return path


def _link(path, folder):
    try:
        path.symlink_to(folder, target_is_directory=True)
    except OSError as error:  # some systems do not let everyone
        raise SceneError(folder, "simulation caches", "not to be linked",
                         f"bake them into the file instead ({error.strerror})") from None


def render_command(copy, picture, *more):
    """The command line that renders a copy by its scene's own settings, and shows the light so far in a picture.

    Parameters
    ----------
    copy, picture : path
    more : str
        Arguments of `lensfield render`.
    """
    return lensfield_command([*_render_copy(copy), "--end-with-stdin", "--picture", str(picture), *more])


def _render_copy(copy):
    """The arguments of `lensfield` that render a copy as if it were the file, and tell how far that is."""
    return ["render", str(copy), "--session", str(Path(copy).with_name(SESSION)), "--beside",
            os.path.dirname(bpy.data.filepath) or str(UNSAVED_FOLDER), "--progress", "lines"]


def apply_command(radiance, scene):
    """The command line that puts kept radiance through the lens of a scene's settings, turned as its camera has it."""
    settings, lens = scene.lensfield, scene.lensfield.lens_name_or_path()
    options = (word for name, value in asdict(settings.to_options()).items() if value is not None
               for word in ("--" + name.replace("_", "-"), str(value)))
    return lensfield_command(["apply", str(radiance), "--lens", lens, "--view", settings.view.lower(),
                              "--lens-quality", settings.to_spectral_options().tier, "--progress", "lines",
                              "--depth", applied_depth(settings),
                              "--end-with-stdin", *ring_arguments(rings_for(scene, lens)),
                              *iris_arguments(scene_iris(scene, lens)), *options])


def preview_arguments(scene, key, *, radiance=None, copy=None, size=None, samples=None):
    """The arguments of `lensfield` for a preview: of a copy of the file, small, or of the light that one has kept.

    Parameters
    ----------
    scene : bpy.types.Scene
    key : (str, str, str, Rings, Iris or None)
        Lens, view, what is done out of field, what the lens is turned to, and its blades.
    radiance : path, optional
        The kept light.
    copy, size, samples : path, (width, height) and int, where there is none
    """
    lens, view, out_of_field, rings, iris = key
    asked = ["--lens", lens, "--view", view, "--out-of-field", out_of_field, "--accuracy",
             str(TIER_ACCURACY["preview"]), "--lens-quality", "preview", *ring_arguments(rings), *iris_arguments(iris)]
    if radiance:
        return ["apply", str(radiance), "--progress", "lines", *asked]
    asked += ["--depth", AUTO] * (scene.lensfield.depth == TRACED.upper())  # which keeps no light for other lenses
    nm = scene.lensfield.wavelengths_nm()
    few = ",".join(f"{one:g}" for one in np.linspace(nm[0], nm[-1], min(len(nm), PREVIEW_WAVELENGTHS)))
    return [*_render_copy(copy), *asked, "--resolution", "{}x{}".format(*size), "--samples", str(samples),
            "--wavelengths", few, "--tier", "preview", "--denoise", "--unfit", "render", "--room", str(PREVIEW_ROOM),
            "--output", str(Path(copy).parent)]


def lensfield_command(arguments):
    """The command line of `lensfield` with these arguments, in another Blender like this one."""
    if not bpy.app.binary_path:  # the wheel
        return [sys.executable, "-c", f"from {EXTENSION}.cli import console; console()", *arguments]
    scripts = "--disable-autoexec" if bpy.app.autoexec_fail else "--enable-autoexec"  # those that run here
    return [bpy.app.binary_path, "--background", "--addons", EXTENSION, scripts, "--command", "lensfield", *arguments]
