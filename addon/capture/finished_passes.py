"""Finished Cycles passes stay on disk until their frame is complete: a stopped render resumes with them. A pass that
consists of several renders, by samples or by depth, is stored in as many parts.

They are in the hidden folder next to the frame's files. Each name is a digest of everything that the pass depends on:
the scene's source files, the request, the code, Blender's version, and the part of the light that it contains.
"""

import json
import shutil
import time
from contextlib import suppress
from hashlib import blake2b

import bpy

from lensfield.engine.runtime.build_identity import build_identity
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.runtime.files import discard, hidden_folder, matching, move, note_resumable, remove, uninterrupted
from lensfield.engine.runtime.locks import Busy, only_writer
from lensfield.engine.runtime.values import json_value

from ..job.recorded import recorded_fields
from ..job.result import stem_of
from ..job.steps import Work
from .light import read_pass

LEFT_FREE = 3  # in units of the radiance's size: disk space for the frame's own files
WAIT_S = 0.5


class FinishedPasses:
    """The passes of one capture.

    Parameters
    ----------
    scene : bpy.types.Scene
    job : Job
        Without a `source`, no passes are stored.
    radiance_bytes : int
        Size of the capture. A pass is stored only if enough disk space remains for the frame's files.
    """

    def __init__(self, scene, job, radiance_bytes):
        self._folder, self._left_free_bytes = None, LEFT_FREE * radiance_bytes
        self._reused, self._rendered = 0, 0
        of_frame = passes_folder(scene, job.output_folder, job.frame)
        if job.source and not of_frame.is_symlink():  # an untrusted folder may contain links
            self._folder = of_frame / _digest(_facts(job))
            for other in matching(of_frame, "*"):
                if other != self._folder or other.is_symlink():  # passes of another request
                    remove(other)
            note_resumable(of_frame)

    def planes(self, step, path, needed, *facts):
        """Steps that render a pass, unless it is on disk; returns its planes by name.

        Parameters
        ----------
        step : RenderPass
        path : Path
            The file that the step writes.
        needed : collection of str
            Names of planes that the pass must have.
        facts : values
            The values that distinguish it from the capture's other passes.
        """
        stored = self._folder and self._folder / f"{_digest(facts)}.exr"
        if stored and stored.is_file():
            planes = yield Work(lambda _: _read(stored, needed), f"{step.label}, reused", step.fraction)
            if planes:
                self._reused += 1
                return planes
        for old in filter(None, (path, stored)):
            discard(old)
        yield step
        self._rendered += 1
        return (yield Work(lambda _: self._keep(path, needed, stored), "Reading the pass", step.fraction + step.share))

    def _keep(self, path, needed, stored):
        planes = read_pass(path, needed)
        with suppress(OSError, InputError):  # the render does not depend on the stored pass
            if stored and shutil.disk_usage(self._folder.parents[2]).free - path.stat().st_size > self._left_free_bytes:
                move(path, stored)
        return planes

    @property
    def remarks(self):
        """Remarks for the report: list of lines."""
        count = self._reused + self._rendered
        return [f"reused {self._reused} of {count} parts of passes from an interrupted render"] * bool(self._reused)


def _read(stored, needed):
    """The planes of a stored pass; None if the file is damaged."""
    try:
        return read_pass(stored, needed)
    except (OSError, InputError):
        return None


def _facts(job):
    return (job.source, job.state, job.frame, recorded_fields(job), [lens.digest.hex() for lens in job.others],
            bpy.app.version_string, bpy.app.build_hash.decode(errors="replace"), build_identity())


def _digest(facts):
    return blake2b(json.dumps(json_value(facts)).encode(), digest_size=10).hexdigest()


def alone_with_passes(scene, job, stack):
    """Steps that wait until no other process captures the frame; its passes can then be reused.

    Parameters
    ----------
    scene, job
    stack : ExitStack
        Other processes wait until it closes.
    """
    while job.source:
        try:
            stack.enter_context(only_writer(job.output_folder / _name(scene, job.frame)))
            return
        except Busy:
            yield Work(lambda _: time.sleep(WAIT_S), "Waiting for another process to capture the frame", 0.0)


def passes_folder(scene, folder, frame):
    """The folder for a frame's passes."""
    return hidden_folder(folder) / _name(scene, frame)


def _name(scene, frame):
    return f"{stem_of(scene)}_{frame:04d}_passes"


def remove_passes(scene, folder, frame):
    """Remove the passes of a frame whose files are complete."""
    with uninterrupted():  # a process that is being stopped may just state where the passes are
        remove(passes_folder(scene, folder, frame))


def passes_left(scene, folder):
    """Stored parts of unfinished frames' passes, such as ranges of samples and slabs of depth: list of lines."""
    try:
        hidden = hidden_folder(folder)
    except InputError:  # a link, which the render itself has reported
        return []
    folders = matching(hidden, f"{stem_of(scene)}_*_passes")
    counts = {stored: len(matching(stored, "*/[!.]*.exr")) for stored in folders}
    return [f"{count} finished part{'s' * (count > 1)} of passes stored in {stored}: the next render continues "
            "from there unless the file changes" for stored, count in counts.items() if count]
