"""Several frames of a scene: those that are there already stay, the others are rendered one after the other."""

import time
from contextlib import contextmanager

from ...engine.errors import InputError
from ...engine.files import stamp_of
from ...engine.image.depth_range import TRACED
from ...engine.locks import Busy, only_maker
from ...engine.report import together
from ..scene.compositor import fingerprint_anew, lay_into_compositor
from ..scene.errors import SceneError
from ..scene.fingerprint import comparable
from ..scene.still import moving, rings_animated
from .job import folder_for
from .kept_passes import forget_passes
from .one_capture import OneCapture
from .record import read_record
from .render import Result, job_of_frame, render_steps, run

WAIT_S = 0.5  # between two looks for frames that other processes are at


class Animation:
    """Frames of a scene, to be rendered one by one where they are not there yet.

    Parameters
    ----------
    scene : bpy.types.Scene
    frames : iterable of int, optional
        Ascending; those of the scene's own range and step by default.
    overwrite : bool
        Render frames anew that are there already.
    wait : bool
        Take a frame that another process is at as due until it is there, and render it if that process ends before.
    asked : by name
        What `render_through_lens` takes, but for the frame and the progress.

    Attributes
    ----------
    pending : list of int
        Frames to be rendered.
    earlier : dict of int: (Result, dict)
        Files and record of those that are there, whole, and made by the same settings.
    outdated : list of int
        Those of them that are of the scene as it was before it was changed.
    elsewhere : list of int
        Frames that another process was at when it was their turn.
    plan : str
        Whether all that are pending are seen in one capture, or why not; "" where that does not matter.
    results : dict of int: Result
        What has been rendered.

    Raises
    ------
    InputError
        What is asked for cannot be; of a frame, its number is told.
    """

    def __init__(self, scene, frames=None, *, overwrite=False, wait=False, state=None, **asked):
        self._scene, self._wait = scene, wait
        self._asked = {"to_compositor": False} | asked | {"state": state or fingerprint_anew(scene)}
        self._folder = folder_for(scene, asked.get("output_folder"))
        self.pending, self.earlier, self.outdated, self.elsewhere, self.results = [], {}, [], [], {}
        self._frames = list(own_frames(scene) if frames is None else frames)
        self._stamps = {}
        for frame in self._frames:
            self._stamps[frame] = stamp_of(self._result(frame).record)
            if overwrite or not self._find(frame):
                self.pending.append(frame)
        if overwrite:
            self._forget_passes()
        self._apart = self._why_apart() if len(self.pending) > 1 else "one frame"
        self.plan, self._one = self._planned(), None

    def _find(self, frame):
        """Whether a frame is there, as it would be rendered now."""
        result = self._result(frame)
        if not result.record.is_file():  # without going to the frame, which may take long
            return False
        with _named(frame):
            job = job_of_frame(self._scene, frame, **self._asked)
        record = read_record(job, result)
        if record is None:
            return False
        self.earlier[frame] = result, record
        if comparable(record["state"]) and record["state"] != job.state:
            self.outdated.append(frame)
        return True

    @property
    def turns(self):
        """Frames as they are to be rendered: those that are pending, and at the end once more those that another
        process was at, which may have been stopped; where they are waited for, until there are none."""
        yield from self.pending
        yield from list(self.elsewhere)
        while self._wait and self.elsewhere:
            time.sleep(WAIT_S)
            yield from list(self.elsewhere)
        self._one = None  # it is large
        if all(self._result(frame).record.is_file() for frame in self._frames):
            self._forget_passes()

    def render(self, frame, progress=None):
        """Render a frame in its turn; its Result, or None where another process has rendered it, or is at it."""
        number, count = self.pending.index(frame), len(self.pending)

        def tell(fraction, label):
            if progress:
                progress((number + fraction) / count, f"Frame {frame}, {number + 1} of {count}: {label}")

        result = self._result(frame)
        self.elsewhere = [other for other in self.elsewhere if other != frame]
        try:
            with _named(frame), only_maker(result.record):
                if stamp_of(result.record) != self._stamps[frame] and self._find(frame):
                    return None
                self.results[frame] = self._render_alone(frame, tell)
        except Busy:
            self.elsewhere.append(frame)
        return self.results.get(frame)

    def _render_alone(self, frame, tell):
        if not self._apart and self._one is None:
            tell(0.0, "Turning the lens as in all frames")
            self._one = OneCapture(self._scene, self._frames, **self._asked)
        job = job_of_frame(self._scene, frame, **self._asked)
        return run(render_steps(self._scene, job, self._one if self._one and self._one.holds(job) else None), tell)

    def _result(self, frame):
        return Result.of(self._scene, self._folder, frame)

    def _forget_passes(self):
        """Remove passes that are kept: of all frames at once, as some may be of one capture for all of them."""
        for frame in self._frames:
            forget_passes(self._scene, self._folder, frame)

    def _why_apart(self):
        """Why each frame is to be captured by itself, in words; "" where one capture does."""
        if (self._asked.get("depth") or self._scene.lensfield.depth.lower()) == TRACED:
            return "the lens is traced"
        return moving(self._scene, self._frames)

    def _planned(self):
        if not self._apart:
            return f"{len(self.pending)} frames from one capture: nothing but focus and f-stop changes"
        if len(self.pending) > 1 and rings_animated(self._scene):
            return f"each frame is captured by itself: {self._apart}"
        return ""

    @property
    def state(self):
        """The fingerprint of the scene."""
        return self._asked["state"]

    @property
    def current(self):
        """Lens images of the frames that are there already and of the scene as it is: dict of int: Path."""
        return {frame: result.lens_image for frame, (result, _) in self.earlier.items() if frame not in self.outdated}

    @property
    def report(self):
        """The report of all frames, by frame."""
        return together({frame: result.report for frame, result in self.results.items()},
                        {frame: record for frame, (_, record) in self.earlier.items()})

    @property
    def beforehand(self):
        """What is there and what is to be done, before it is: list of lines."""
        there = f"{len(self.earlier)} of {len(self._frames)} frames are there already: {len(self.pending)} to render"
        return [*[there] * bool(self.earlier), *filter(None, [self.plan])]

    @property
    def summary(self):
        """How many frames there are of what kind: list of lines."""
        seconds, frames = sum(self.report.stages.values()), len(self.results)
        rendered = f"{frames} frame{'s' * (frames != 1)} in {seconds:.1f} s" if frames else "nothing to render"
        earlier = f"; {len(self.earlier)} there already" if self.earlier else ""
        lines = [f"{rendered}{earlier}, in {self._folder}", *filter(None, [self.plan])]
        if self.elsewhere:
            lines.append(f"left to other processes: {len(self.elsewhere)} of the frames, from {self.elsewhere[0]} on")
        if self.outdated:
            lines.append(f"{len(self.outdated)} of the frames there already, from {self.outdated[0]} on, are of the "
                         "scene before it was changed: Overwrite (--overwrite) renders them anew")
        return lines

    @property
    def told(self):
        """What to tell of it: list of lines."""
        plans = dict.fromkeys(result.report.scene.scene_plan for result in self.results.values())
        return [*self.summary, *plans, *self.report.remarks()]


def render_animation(scene, frames=None, *, overwrite=False, progress=None, **asked):
    """Render frames of a scene multispectrally and put them through a lens, one after the other.

    Frames that are there already, whole and by the same settings, stay as they are, and those that another process
    renders into the same folder are left to it. What the frames share is kept from
    each to the next. An error leaves the frames before it.

    Parameters
    ----------
    As of `Animation`; progress : callable (fraction, label), optional

    Returns
    -------
    Animation
    """
    animation = Animation(scene, frames, overwrite=overwrite, **asked)
    if asked.get("to_compositor") and animation.current:
        lay_into_compositor(scene, *animation.current.values(), fingerprint=animation.state)
    for frame in animation.turns:
        animation.render(frame, progress)
    return animation


def own_frames(scene):
    """The frames of a scene's own range, by its step."""
    return range(scene.frame_start, scene.frame_end + 1, scene.frame_step)


@contextmanager
def _named(frame):
    """Let errors tell the frame."""
    try:
        yield
    except InputError as error:
        raise error.at(f"frame {frame}: {error.where}") from None
    except (OSError, MemoryError) as error:
        raise SceneError(f"frame {frame}", "render", "stopped", str(error) or "no memory left") from None
