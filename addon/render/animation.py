"""Several frames of a scene: finished frames stay, the others are rendered one after the other."""

import time
from contextlib import contextmanager
from dataclasses import replace

from lensfield.engine.depth.depth_range import TRACED
from lensfield.engine.pictures.frame_record import read_record
from lensfield.engine.runtime.build_identity import is_accepted, other_builds_line
from lensfield.engine.runtime.errors import InputError, one_line
from lensfield.engine.runtime.files import remove_half_written, stamp_of
from lensfield.engine.runtime.locks import Busy, only_writer
from lensfield.engine.simulation.report import together

from ..capture.finished_passes import remove_passes
from ..job.job import check_output_folder, folder_for
from ..job.origin import check_replaced
from ..job.recorded import recorded_fields
from ..job.result import Result
from ..scene.compositor import fingerprint_anew, lay_into_compositor
from ..scene.errors import SceneError
from ..scene.fingerprint import comparable
from ..scene.motion import moving, rings_animated
from ..scene.requirements import check_scene
from .one_capture import OneCapture
from .render import baking, job_of_frame, render_steps, run
from .shot_meter import shot_exposure, shot_of

WAIT_S = 0.5  # between checks of frames that other processes are rendering


class Animation:
    """Frames of a scene, rendered one by one unless they are finished.

    Parameters
    ----------
    scene : bpy.types.Scene
    frames : iterable of int, optional
        Ascending; the scene's own range and step by default.
    overwrite : bool
        Render finished frames again.
    any_build : bool
        Accept finished frames from other builds of Lensfield; otherwise they are rendered again.
    wait : bool
        Wait for a frame that another process is rendering, and render it if that process ends without it.
    given : by name
        Fields of a `RenderRequest`, as in `render_through_lens`.

    Attributes
    ----------
    frames : list of int
    pending : list of int
        Frames to be rendered.
    earlier : dict of int: (Result, dict)
        Files and record of the finished frames: complete, and rendered with the same settings.
    outdated : list of int
        Finished frames that were rendered before the scene changed.
    builds : dict of int: str
        The builds that rendered the finished frames.
    elsewhere : list of int
        Frames that another process was rendering at their turn.
    plan : str
        Whether all pending frames share one capture, or why not; "" if irrelevant.
    results : dict of int: Result
        The rendered frames.

    Raises
    ------
    InputError
        The request cannot be met; an error in a frame states the frame's number.
    """

    def __init__(self, scene, frames=None, *, overwrite=False, any_build=False, wait=False, state=None, **given):
        self._scene, self._any_build, self._wait = scene, any_build, wait
        self.frames = list(frames_of(scene) if frames is None else frames)
        check_scene(scene, frames=self.frames, **given)
        self._given = given | {"state": state or fingerprint_anew(scene)}
        if given.get("output_folder") is None:
            check_output_folder(scene)
        self._folder = folder_for(scene, given.get("output_folder"))
        self.pending, self.earlier, self.outdated, self.elsewhere, self.results = [], {}, [], [], {}
        self.builds = {}
        self._stamps, self._exposures, self._shared = {}, {}, None
        for frame in self.frames:
            self._stamps[frame] = stamp_of(self.result_of(frame).record)
            if not overwrite:
                check_replaced(scene, self.result_of(frame), self.state)
            if overwrite or not self._find(frame):
                self.pending.append(frame)
        if overwrite:
            self._forget_passes()
        self._apart = self._why_apart() if len(self.pending) > 1 else "one frame"
        self.plan, self._one = self._planned(), None

    def _find(self, frame):
        """Whether a frame is finished, with the current settings."""
        result = self.result_of(frame)
        if not result.record.is_file():  # checked first, because evaluating the frame may take long
            return False
        with named_frame(frame):
            job = self._job(frame)
        record = read_record(result.record, recorded_fields(job), result.written_by(job))
        if record is None:
            return False
        self.builds[frame] = record["build"]
        if not is_accepted(self.builds[frame], self._any_build):
            return False
        self.earlier[frame] = result, record
        state = str(record.get("state"))
        if comparable(state) and state != job.state:
            self.outdated.append(frame)
        return True

    @property
    def turns(self):
        """Frames in rendering order: the pending ones, then again those that another process was rendering, in case it
        was stopped; with `wait`, repeatedly until none is left."""
        yield from self.pending
        yield from list(self.elsewhere)
        while self._wait and self.elsewhere:
            time.sleep(WAIT_S)
            yield from list(self.elsewhere)
        self._one = None  # frees much memory
        self.finish()

    def finish(self):
        """Remove what unfinished frames need, if all frames are finished."""
        if all(self.result_of(frame).record.is_file() for frame in self.frames):
            self._forget_passes()
            remove_half_written(self._folder)  # of a process that was killed after this one's first file

    def share(self, capture):
        """Render the next frames from the OneCapture that `capture()` returns."""
        self._shared = capture

    def render(self, frame, progress=None):
        """Render a frame in its turn; its Result, or None if another process has rendered it or is rendering it."""
        number, count = self.pending.index(frame), len(self.pending)

        def on_progress(fraction, label):
            if progress:
                progress((number + fraction) / count, f"Frame {frame}, {number + 1} of {count}: {label}")

        result = self.result_of(frame)
        self.elsewhere = [other for other in self.elsewhere if other != frame]
        try:
            with named_frame(frame), only_writer(result.record):
                if stamp_of(result.record) != self._stamps[frame] and self._find(frame):
                    return None
                self.results[frame] = self._render_alone(frame, on_progress)
        except Busy:
            self.elsewhere.append(frame)
        return self.results.get(frame)

    def _render_alone(self, frame, on_progress):
        one = self._shared() if self._shared else self._capture_of_all(on_progress)
        job = self._metered(self._job(frame, baking=baking(on_progress)), on_progress)
        return run(render_steps(self._scene, job, one if one and one.holds(job) else None), on_progress)

    def _capture_of_all(self, on_progress):
        """The OneCapture of all frames; None if they are captured separately."""
        if not self._apart and self._one is None:
            on_progress(0.0, "Preparing the lens for all frames")
            self._one = OneCapture.of_frames(self._scene, self.frames, **self._given)
        return self._one

    def _job(self, frame, **baking):
        job = job_of_frame(self._scene, frame, **baking, **self._given)
        return replace(job, shot=shot_of(self._scene, job))

    def _metered(self, job, on_progress):
        """The job with the exposure of its shot."""
        if job.shot is None:
            return job
        if job.shot not in self._exposures:
            self._exposures[job.shot] = shot_exposure(self._scene, job.shot, on_progress, **self._given)
        return replace(job, shot_exposure=self._exposures[job.shot])

    def result_of(self, frame):
        """The Result that names a frame's files."""
        return Result.of(self._scene, self._folder, frame)

    def _forget_passes(self):
        """Remove the stored passes of all frames together, as some may come from a shared capture."""
        for frame in self.frames:
            remove_passes(self._scene, self._folder, frame)

    def _why_apart(self):
        """Why each frame needs its own capture, in words; "" if one capture serves all."""
        if (self._given.get("depth") or self._scene.lensfield.depth.lower()) == TRACED:
            return "the lens is traced"
        return moving(self._scene, self.frames)

    def _planned(self):
        if not self._apart:
            return f"{len(self.pending)} frames from one capture: only focus and f-stop change"
        if len(self.pending) > 1 and rings_animated(self._scene):
            return f"each frame is captured separately: {self._apart}"
        return ""

    @property
    def state(self):
        """The fingerprint of the scene."""
        return self._given["state"]

    @property
    def current(self):
        """Lens images of the finished frames that show the scene as it is now: dict of int: Path."""
        return {frame: result.lens_image for frame, (result, _) in self.earlier.items() if frame not in self.outdated}

    @property
    def report(self):
        """The report of all frames, by frame."""
        return together({frame: result.report for frame, result in self.results.items()},
                        {frame: record for frame, (_, record) in self.earlier.items()})

    @property
    def beforehand(self):
        """How many frames are finished and how many are pending, before the render: list of lines."""
        finished = f"{len(self.earlier)} of {len(self.frames)} frames are finished: {len(self.pending)} to render"
        return [*self.other_builds, *[finished] * bool(self.earlier), *filter(None, [self.plan])]

    @property
    def other_builds(self):
        """A line about the finished frames from other builds, if any: list."""
        return other_builds_line(map(self.builds.get, self.frames), self._any_build, "rendered")

    @property
    def summary(self):
        """Counts of rendered, finished, outdated and other processes' frames: list of lines."""
        seconds, frames = sum(self.report.stages.values()), len(self.results)
        rendered = f"{frames} frame{'s' * (frames != 1)} in {seconds:.1f} s" if frames else "nothing to render"
        earlier = f"; {len(self.earlier)} already finished" if self.earlier else ""
        lines = [f"{rendered}{earlier}, in {self._folder}", *filter(None, [self.plan]), *self.other_builds,
                 *self._unlike_depth]
        if self.elsewhere:
            lines.append(f"left to other processes: {len(self.elsewhere)} of the frames, from frame "
                         f"{self.elsewhere[0]} on")
        return [*lines, *self.outdated_line]

    @property
    def outdated_line(self):
        """A line about the outdated frames, if any."""
        if self.outdated:
            yield (f"the scene has changed since {len(self.outdated)} of the finished frames, from frame "
                   f"{self.outdated[0]} on: Overwrite (--overwrite) renders them again")

    @property
    def _unlike_depth(self):
        """A line if only some of the rendered frames have layers of depth."""
        in_layers = [frame for frame, result in self.results.items() if result.report.scene.layers]
        if in_layers and len(in_layers) < len(self.results):
            yield (f"{len(in_layers)} of {len(self.results)} frames are in layers of depth, from frame {in_layers[0]} "
                   "on; in the others, the light out of focus is within the accuracy")

    @property
    def messages(self):
        """The summary, the plans and the remarks: list of lines."""
        plans = dict.fromkeys(result.report.scene.scene_plan for result in self.results.values())
        return [*self.summary, *plans, *self.report.remarks()]


def render_animation(scene, frames=None, *, overwrite=False, any_build=False, progress=None, **given):
    """Render frames of a scene multispectrally and put them through a lens, one after the other.

    Frames that are complete and have the same settings stay as they are, and frames that another process is rendering
    into the same folder are left to it. Data that the frames share are cached from each to the next. After an error,
    the frames before it remain.

    Parameters
    ----------
    As in `Animation`; progress : callable (fraction, label), optional

    Returns
    -------
    Animation
    """
    animation = Animation(scene, frames, overwrite=overwrite, any_build=any_build, **given)
    if given.get("to_compositor") and animation.current:
        lay_into_compositor(scene, *animation.current.values(), fingerprint=animation.state)
    for frame in animation.turns:
        animation.render(frame, progress)
    return animation


def frames_of(scene):
    """The frames of a scene's own range and step."""
    return range(scene.frame_start, scene.frame_end + 1, scene.frame_step)


@contextmanager
def named_frame(frame):
    """Add the frame's number to errors."""
    try:
        yield
    except InputError as error:
        raise error.at(f"frame {frame}: {error.where}") from None
    except OSError as error:
        raise SceneError(f"frame {frame}", "render", "stopped", one_line(error)) from None
    except MemoryError as error:
        raise SceneError(f"frame {frame}", "render", "stopped", str(error) or "out of memory") from None
