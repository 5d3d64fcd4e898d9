"""Passes that Cycles has rendered stay on disk until their frame is there: stopped, it goes on where it was.

They lie in the hidden folder beside the frame's files, each called by all that it follows from: the files that the
scene was read from, what is asked, the code, Blender's version, and which part of the light it is.
"""

import json
import shutil
import time
from contextlib import suppress
from hashlib import blake2b

import bpy

from ...engine.cache import code_version
from ...engine.errors import InputError
from ...engine.files import discard, hidden_folder, move, note_going_on, remove
from ...engine.locks import Busy, only_maker
from ...engine.values import plain
from .light import read_pass
from .record import asked_of
from .steps import Work

CODE = "../addon/job", "../addon/scene", "../addon/shading", "depth", "field", "image", "spectral"
LEFT_FREE = 3  # times the radiance: for the frame's own files
WAIT_S = 0.5


class KeptPasses:
    """The passes of one capture.

    Parameters
    ----------
    scene : bpy.types.Scene
    job : Job
        Without a `source` nothing is kept.
    radiance_bytes : int
        How large the capture is. Passes are kept as long as the disk has room for them and for what follows.
    """

    def __init__(self, scene, job, radiance_bytes):
        self._folder, self._left_free_bytes = None, LEFT_FREE * radiance_bytes
        self._found, self._made = 0, 0
        of_frame = passes_folder(scene, job.output_folder, job.frame)
        if job.source and not of_frame.is_symlink():  # as folders of strangers may have them
            self._folder = of_frame / _digest(_facts(job))
            for other in of_frame.glob("*"):
                if other != self._folder or other.is_symlink():  # of what was asked for then
                    remove(other)
            note_going_on(of_frame)

    def planes(self, step, path, needed, *facts):
        """Steps that render a pass, unless it is kept; returns its planes by name, those needed at least.

        Parameters
        ----------
        step : RenderPass
        path : Path
            That it renders to.
        needed : collection of str
        facts : values
            By which it differs from the capture's other passes.
        """
        kept = self._folder and self._folder / f"{_digest(facts)}.exr"
        if kept and kept.is_file():
            planes = yield Work(lambda tell: _read(kept, needed), f"{step.label}, kept", step.fraction)
            if planes:
                self._found += 1
                return planes
        for old in filter(None, (path, kept)):
            discard(old)
        yield step
        self._made += 1
        return (yield Work(lambda tell: self._keep(path, needed, kept), "Gathering light", step.fraction + step.share))

    def _keep(self, path, needed, kept):
        planes = read_pass(path, needed)
        with suppress(OSError, InputError):  # the render goes on without
            if kept and shutil.disk_usage(self._folder.parents[2]).free - path.stat().st_size > self._left_free_bytes:
                move(path, kept)
        return planes

    @property
    def remarks(self):
        """What to tell of them: list of lines."""
        count = self._found + self._made
        return [f"{self._found} of {count} passes were there from before the render was stopped"] * bool(self._found)


def _read(kept, needed):
    """The planes of a pass that is kept; None where it is damaged."""
    try:
        return read_pass(kept, needed)
    except (OSError, InputError):
        return None


def _facts(job):
    return (job.source, job.state, job.frame, asked_of(job), [lens.digest.hex() for lens in job.others],
            bpy.app.version_string, bpy.app.build_hash.decode(errors="replace"), code_version(*CODE))


def _digest(facts):
    return blake2b(json.dumps(plain(facts)).encode(), digest_size=10).hexdigest()


def alone_with_passes(scene, job, stack):
    """Steps that wait until no other process captures the frame, which would find its passes kept.

    Parameters
    ----------
    scene, job
    stack : ExitStack
        As long as it is open, others wait.
    """
    while job.source:
        try:
            stack.enter_context(only_maker(job.output_folder / _name(scene, job.frame)))
            return
        except Busy:
            yield Work(lambda tell: time.sleep(WAIT_S), "Waiting for another process, which captures the same", 0.0)


def passes_folder(scene, folder, frame):
    """Where a frame's passes are kept."""
    return hidden_folder(folder) / _name(scene, frame)


def _name(scene, frame):
    return f"{bpy.path.clean_name(scene.name)}_{frame:04d}_passes"


def forget_passes(scene, folder, frame):
    """Remove the passes of a frame whose files are there."""
    remove(passes_folder(scene, folder, frame))


def passes_left(scene, folder):
    """What is kept of frames that are not there: list of lines."""
    try:
        hidden = hidden_folder(folder)
    except InputError:  # a link, of which the render itself has told
        return []
    folders = sorted(hidden.glob(f"{bpy.path.clean_name(scene.name)}_*_passes"))
    counts = {kept: len(list(kept.glob("*/[!.]*.exr"))) for kept in folders}
    return [f"{count} finished pass{'es are' if count > 1 else ' is'} kept in {kept}: a render goes on from there, "
            "unless the file changes" for kept, count in counts.items() if count]
