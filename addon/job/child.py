"""A render in a process of its own: `lensfield render` on a copy of the file, so that nothing here is touched by it.

The child is Blender itself in the background (in Blender's Python wheel: Python). It tells how far it is on its
standard output (`commands/messages.py`) and ends when its standard input closes, which it does however this process
ends.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

import bpy
import numpy as np

from ...commands.messages import read_message
from ...engine.files import remove_left_work, work_prefix
from ...engine.image.depth_range import AUTO, TRACED
from ...engine.plan.options import TIER_ACCURACY
from ..scene.errors import SceneError
from ..scene.rings import iris_arguments, ring_arguments, rings_for, scene_iris
from .job import UNSAVED_FOLDER
from .refilter import applied_depth
from .session import write_session

GRACE_S = 0.7  # for a child to remove what is half-written
CRASH = "Writing: "  # Blender's last words, before the name of a file that comes to be in the log
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


class Child:
    """A command at work.

    Parameters
    ----------
    command : list of str
    folder : path
        For all that it needs for a time; its log comes to lie there too.

    Attributes
    ----------
    told : dict
        The latest that it has told: fraction and label, lens_image; at the end told, or error.
    lens_images : list of str
        Of the frames that are there, as it told of them.
    told_s : float
        When, by time.monotonic().
    log : Path
    """

    def __init__(self, command, folder):
        self.told, self.lens_images, self.told_s = {}, [], time.monotonic()
        self.log = Path(folder) / "render.log"
        self._log = open(self.log, "a", buffering=1, encoding="utf-8")
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log, encoding="utf-8",
            errors="replace", env=os.environ | dict.fromkeys(("TMPDIR", "TMP", "TEMP"), str(folder)),
            start_new_session=True, creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0))
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        for line in self._process.stdout:
            facts = read_message(line)
            if facts is None:
                with suppress(OSError):  # a full disk: the child is heard all the same
                    self._log.write(line)
            else:
                self.told, self.told_s = self.told | facts, time.monotonic()
                self.lens_images += [facts["lens_image"]] if "lens_image" in facts else []

    def ask(self, arguments):
        """Have `lensfield serve` run a command; it tells a status when it is done."""
        self.told = {}
        with suppress(OSError):  # it has ended: that is for its follower to see
            print(json.dumps(arguments), file=self._process.stdin, flush=True)

    @property
    def ended(self):
        """Whether it has ended by itself."""
        return self._process.poll() is not None

    def end(self):
        """End it within GRACE_S, if it has not ended; nothing of it runs on, and all is heard that it told."""
        with suppress(OSError):  # of what it can no longer be asked
            self._process.stdin.close()
        try:
            self._process.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._kill_workers()
        self._reader.join()
        self._process.stdout.close()
        with suppress(OSError):  # what there was no room for
            self._log.close()

    def _kill_workers(self):
        """A process that died leaves workers that wait for work for ever, its standard output open."""
        if hasattr(os, "killpg"):
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)

    def death(self):
        """Why it ended, where it told neither a picture nor an error; and a copy of its log, to be kept: two texts."""
        lines = [line.strip() for line in self.log.read_text(encoding="utf-8", errors="replace").split("\n")]
        last = next((line for line in reversed(lines) if line and not line.startswith(CRASH)), "it said nothing")
        code = self._process.returncode
        return f"{f'signal {-code}' if code < 0 else f'exit status {code}'}: {last}", self._kept_log()

    def _kept_log(self):
        """A copy of the log, with what Blender tells of a crash: its path, or why there is none."""
        kept = tempfile.NamedTemporaryFile(prefix="lensfield-", suffix=".log", delete=False)
        try:
            with kept:
                for path in (self.log, *self.log.parent.glob("*.crash.txt")):
                    kept.write(path.read_bytes())
        except OSError as error:
            os.unlink(kept.name)
            return f"lost ({error.strerror})"
        return kept.name
