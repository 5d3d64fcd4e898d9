"""A dataset: each frame of a scene is captured once, and put through several lenses at several f-numbers.

The pictures of a lens at an f-number are an `Animation` in a folder of their own, so they resume and are shared between
processes as animations are. A process captures a frame for all lenses, or leaves it to another.
"""

import time
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf
from pathlib import Path

import bpy

from lensfield.engine.calibration.formats import FORMATS
from lensfield.engine.depth.depth_range import TRACED
from lensfield.engine.field.overscan import CAMERA_VIEW
from lensfield.engine.image.spectral_image import IRRADIANCE, UNITS
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.runtime.files import check_target
from lensfield.engine.runtime.locks import Busy, only_writer

from ...request import BOKEH, FLARE
from ..capture.scene_plan import check_job
from ..job.job import job_of
from ..job.result import stem_of
from ..scene.camera import camera_pose, frame_grid
from ..scene.compositor import fingerprint_anew
from ..scene.lens_facts import lens_facts, squeeze_of
from ..scene.motion import moving
from ..scene.render_state import go_to_frame
from ..scene.requirements import check_scene
from ..scene.rings import scene_rings
from ..scene.undo import Journal
from .animation import WAIT_S, Animation, frames_of, named_frame
from .cameras import FrameCamera, camera_at, frame_camera
from .comparison import capture_name, lens_stem, squeezed_frame
from .dataset_index import (
    INDEX,
    calibrations,
    fisheye_models,
    forget_line,
    forget_pairs,
    has_line,
    kept_lines,
    shared_models,
    write_index,
    write_line,
)
from .dataset_pairs import check_pairs, write_bokeh, write_flare
from .one_capture import OneCapture, end_jobs, shared_job
from .render import baking, job_of_frame

CLOSE = 1e-3  # relative: f-numbers that differ less are the same
INDEX_S = 5.0  # least time between two states of the index, which reads the lines of all pictures
OF_LENS = {"lens": "give lenses", "f_number": "give f_numbers",
           "view": "leave it out: every lens is scaled to the view of the scene's camera"}
"""Fields of a RenderRequest that a dataset sets itself, and what to do instead."""


@dataclass(frozen=True, eq=False)
class Series:
    """The pictures of a dataset through a lens at an f-number.

    Attributes
    ----------
    lens : str
        Name or path.
    f_number : float or None
        None: as the scene's camera has it in each frame.
    squeeze : float
        Of the lens.
    given : dict
        Fields of its RenderRequest.
    animation : Animation
    models : dict of str: str or None
        Of calibrations in files with several cameras, by format.
    """

    lens: str
    f_number: float | None
    squeeze: float
    given: dict
    animation: Animation
    models: dict = field(default_factory=dict)

    @property
    def name(self):
        """Of its folder."""
        return self.given["output_folder"].name

    def result_of(self, frame):
        """The Result that names a frame's files."""
        return self.animation.result_of(frame)

    def has_finished(self, frame):
        """Whether a frame's picture exists."""
        return frame in self.animation.results or frame in self.animation.earlier

    def is_current(self, frame):
        """Whether a frame's picture exists, and shows the scene as it is now. A render removes the record first."""
        return (self.has_finished(frame) and frame not in self.animation.outdated
                and self.result_of(frame).record.is_file())


class Dataset:
    """Frames of a scene through several lenses, rendered frame by frame unless they are finished.

    Parameters
    ----------
    scene : bpy.types.Scene
    lenses : sequence of str
        Names or paths.
    f_numbers : sequence of float
        For each lens; by default the f-number of a render, which may change from frame to frame: the camera's F-Stop if
        its depth of field is on, otherwise the lens's widest.
    frames : iterable of int, optional
        Ascending; the scene's own range and step by default.
    output_folder : path
        For the index and, in a folder for each lens and f-number, the pictures.
    formats : sequence of str
        Of calibrations, as `lensfield lens calibration` writes them.
    pairs : str
        Of pictures: one of PAIRS, or "".
    overwrite, any_build, wait : bool
        As for `Animation`.
    progress : callable (fraction, label), optional
        While the lenses are baked.
    given : by name
        Fields of a `RenderRequest`, as in `render_through_lens`, except `lens`, `f_number` and `view`: each lens is
        scaled to the view of the scene's camera.

    Attributes
    ----------
    series : list of Series
    elsewhere : list of (float, int)
        Turns whose frame another process was capturing.

    Raises
    ------
    InputError
        Among others, a lens does not exist, does not have an f-number, or a format cannot describe it.
    """

    def __init__(self, scene, lenses, f_numbers=(), frames=None, *, output_folder, formats=(), pairs="",
                 overwrite=False, any_build=False, wait=False, progress=None, **given):
        self._scene, self._folder, self._wait = scene, Path(output_folder), wait
        self._formats, self._pairs = tuple(formats), pairs
        self._frames = list(frames_of(scene) if frames is None else frames)
        self._one, self._captured, self._fractions, self.elsewhere = None, None, {}, []
        self._indexed_s = -inf
        _check_given(lenses, self._frames, given)
        if (given.get("depth") or scene.lensfield.value_of("depth")) == TRACED:
            raise InputError("options", "depth", TRACED,
                             "expected auto or off: a traced lens captures no light for other lenses")
        requested, self._f_numbers = _requested(lenses, f_numbers), tuple(f_numbers)
        with squeezed_frame(scene, 1.0):
            check_scene(scene, frames=self._frames, output_folder=self._folder, view=CAMERA_VIEW)
        check_target(self._folder / INDEX)
        given = given | {"view": CAMERA_VIEW, "state": given.get("state") or fingerprint_anew(scene)}
        self._one_for_all = not moving(scene, self._frames)
        series = []
        for number, (name, (lens, f_number)) in enumerate(requested.items(), 1):
            if progress:
                progress(0.0, f"Preparing lens {number} of {len(requested)}: {name}")
            of_lens = given | {"lens": lens, "output_folder": self._folder / name} | (
                {} if f_number is None else {"f_number": f_number})
            series.append(self._begun(lens, f_number, of_lens, progress, overwrite, any_build))
        self.series = self._with_models(series)

    def _begun(self, lens, f_number, given, progress, overwrite, any_build):
        """The Series of a lens at an f-number, whose first frame can be rendered and calibrated."""
        squeeze = squeeze_of(lens)
        with squeezed_frame(self._scene, squeeze):
            with named_frame(self._frames[0]):
                job = job_of_frame(self._scene, self._frames[0], baking=baking(progress), **given)
                check_pairs(self._pairs, job, self._f_numbers)
                check_job(self._scene, job)
                calibrations(frame_camera(self._scene, self._frames[0], **given), self._formats, {})
            animation = Animation(self._scene, self._frames, overwrite=overwrite, any_build=any_build, **given)
        return Series(lens, f_number, squeeze, given, animation)

    def _with_models(self, series):
        """Series with the models of calibrations in files with the cameras of several frames; visits each frame once,
        for all of them."""
        formats, scene = [name for name in self._formats if FORMATS[name].poses], self._scene
        models = {each.name: dict.fromkeys(formats) for each in series}
        for frame in self._frames if formats else ():
            with named_frame(frame), Journal() as journal:
                go_to_frame(scene, frame, journal)
                for each in series:
                    with squeezed_frame(scene, each.squeeze):
                        of_frame = fisheye_models(camera_at(scene, frame, **each.given), formats)
                    models[each.name] = {name: model or of_frame[name] for name, model in models[each.name].items()}
        return [replace(each, models=shared_models(models[each.name], self._kept_lines(each))) for each in series]

    def _kept_lines(self, series):
        """The lines of a Series' pictures that this run does not describe: list of dict."""
        described = set(self._frames) - set(series.animation.outdated)
        return kept_lines(series.given["output_folder"], stem_of(self._scene), described)

    @property
    def turns(self):
        """(squeeze, frame) in rendering order: those with pending pictures, then again those that another process was
        capturing, in case it was stopped; with `wait`, repeatedly until none is left."""
        turns = [(squeeze, frame) for squeeze in sorted({each.squeeze for each in self.series})
                 for frame in self._frames]
        for turn in turns:
            self._describe_earlier(turn)
        yield from filter(self._pending, turns)
        yield from list(self.elsewhere)
        while self._wait and self.elsewhere:
            time.sleep(WAIT_S)
            yield from list(self.elsewhere)
        self._one = None  # frees much memory
        for each in self.series:
            each.animation.finish()
        self._write_index()

    def render(self, turn, progress=None):
        """Render the missing pictures of a turn: list of Result, without those that another process has rendered or is
        rendering."""
        squeeze, _ = turn
        self.elsewhere = [other for other in self.elsewhere if other != turn]
        try:
            with squeezed_frame(self._scene, squeeze), only_writer(self._lock(turn)):
                results = self._pictures(turn, progress)
        except Busy:
            self.elsewhere.append(turn)
            return []
        if time.monotonic() - self._indexed_s > INDEX_S:
            self._write_index()
        return results

    def _write_index(self):
        write_index(self._folder)
        self._indexed_s = time.monotonic()

    def _pictures(self, turn, progress):
        _, frame = turn
        series, results = self._pending(turn), []
        for each in series:
            each.animation.share(partial(self._begin, each, turn))
            results.append(each.animation.render(frame, self._progress(each, progress)))
        self._describe(turn)
        if any(frame in each.animation.elsewhere for each in series):  # a render of this picture alone
            self.elsewhere.append(turn)
        if self._one and not self._one_for_all and all(results):
            self._one.remove_passes(self._scene)
        return list(filter(None, results))

    def _begin(self, series, turn):
        """The OneCapture for a picture that is about to be rendered: its line goes, under its own lock."""
        _, frame = turn
        one = self._capture(turn)
        forget_line(series.result_of(frame))
        return one

    def _progress(self, series, progress):
        """The progress function of a Series, as a part of the progress of all."""
        def on_progress(fraction, label):
            self._fractions[series.name] = fraction
            if progress:
                count = sum(bool(each.animation.pending) for each in self.series)
                progress(sum(self._fractions.values()) / count, f"{series.name}: {label}")

        return on_progress

    def _pending(self, turn):
        """The Series with pending pictures in a turn."""
        squeeze, frame = turn
        return [each for each in self.series if each.squeeze == squeeze and frame in each.animation.pending]

    def _lock(self, turn):
        """The path that the lock of a turn's capture is named after."""
        squeeze, frame = turn
        return self._folder / f"{stem_of(self._scene)}_{frame:04d}_{capture_name(squeeze)}"

    def _capture(self, turn):
        """The OneCapture for the lenses of a turn's squeeze: of its frame, or of all frames if only focus and f-stop
        change."""
        squeeze, frame = turn
        frames = self._frames if self._one_for_all else [frame]
        if self._captured != (squeeze, frames):
            jobs = [job for each in self.series if each.squeeze == squeeze
                    for job in end_jobs(self._scene, frames, **each.given)]
            with Journal() as journal:
                go_to_frame(self._scene, frame, journal)
                self._one, self._captured = OneCapture(shared_job(self._scene, jobs)), (squeeze, frames)
        return self._one

    def _describe_earlier(self, turn):
        """Describe the pictures of a turn that were finished before this run, unless another process renders them."""
        if self._lacking(turn):
            with suppress(Busy), only_writer(self._lock(turn)):
                self._describe(turn)

    def _lacking(self, turn):
        """The Series whose pictures of a turn lack a line, a calibration or a pair, without pictures of another
        state of the scene, whose camera may have been elsewhere."""
        squeeze, frame = turn
        return [each for each in self.series if each.squeeze == squeeze and each.is_current(frame)
                and not has_line(each.result_of(frame), self._formats, self._pairs, each.models)]

    def _describe(self, turn):
        """Write the pairs and the lines that finished pictures of a turn lack."""
        squeeze, frame = turn
        lacking = self._lacking(turn)
        if not lacking:
            return
        scene = self._scene
        with squeezed_frame(scene, squeeze), Journal() as journal:
            go_to_frame(scene, frame, journal)
            pairs = self._written_pairs(lacking, frame)
            for each in dict.fromkeys((*lacking, *(each for each in self.series if each.name in pairs))):
                job, result = self._job(each), each.result_of(frame)
                camera = FrameCamera(job.lens, frame_grid(scene, job.lens), camera_pose(scene), result.after.name)
                write_line(result, camera, _facts(scene, each, job), self._formats, pairs.get(each.name, {}),
                           each.models)

    def _written_pairs(self, series, frame):
        """Write the pairs of finished pictures of a frame: {name of a Series: {kind: {name of a file: its path}}}."""
        if self._pairs == FLARE:
            return {each.name: {FLARE: write_flare(each.result_of(frame), self._folder, self._job(each))}
                    for each in series}
        written = {}
        for lens in dict.fromkeys(each.lens for each in series) if self._pairs == BOKEH else ():
            of_lens = sorted((each for each in self.series if each.lens == lens), key=lambda each: -each.f_number)
            if all(each.is_current(frame) for each in of_lens):
                results = {each.f_number: each.result_of(frame) for each in of_lens}
                files = write_bokeh(lens_stem(lens), results, self._folder, self._job(of_lens[0]))
                forget_pairs(BOKEH, lens, results.values())
                written |= {each.name: {BOKEH: files} for each in of_lens}
        return written

    def _job(self, series):
        """The Job of a Series at the current frame."""
        return job_of(self._scene, **series.given)

    @property
    def beforehand(self):
        """How many pictures are finished and how many are pending, before the render: list of lines."""
        count, pending = (sum(map(len, each)) for each in zip(*(
            (each.animation.frames, each.animation.pending) for each in self.series), strict=True))
        finished = f"{count - pending} of {count} pictures are finished: {pending} to render"
        squeezes = len({each.squeeze for each in self.series})
        captured = "one capture serves all frames and lenses" if self._one_for_all else "each frame is captured once"
        return [*(f"{each.name}: {line}" for each in self.series for line in each.animation.other_builds),
                finished, captured + (f" for each of {squeezes} squeezes" if squeezes > 1 else "")]

    @property
    def summary(self):
        """Counts of rendered and other processes' pictures, and the index: list of lines."""
        results = [result for each in self.series for result in each.animation.results.values()]
        seconds = sum(sum(result.report.stages.values()) for result in results)
        rendered = f"{len(results)} picture{'s' * (len(results) != 1)} in {seconds:.1f} s"
        lines = [rendered if results else "nothing to render", str(self._folder / INDEX)]
        if self.elsewhere:
            lines.append(f"left to other processes: {len(self.elsewhere)} of the captures, from frame "
                         f"{self.elsewhere[0][1]} on")
        return [*lines, *self._left_out]

    @property
    def _left_out(self):
        """A line about the pictures that cannot be described, because the scene has changed since, if any."""
        outdated = {(each.lens, frame) for each in self.series for frame in each.animation.outdated}
        frames = [frame for each in self.series for frame in self._frames
                  if (each.lens, frame) in outdated and each.has_finished(frame)
                  and not has_line(each.result_of(frame), self._formats, self._pairs, each.models)]
        if frames:
            yield (f"without a line in the index, a calibration or a pair: {len(frames)} of the pictures, from frame "
                   f"{min(frames)} on, because the scene has changed: Overwrite (--overwrite) renders them again")

    @property
    def messages(self):
        """The summary, the plans and the remarks on each Series: list of lines."""
        animations = {each.name: each.animation for each in self.series}
        plans = dict.fromkeys(result.report.scene.scene_plan for each in animations.values()
                              for result in each.results.values())
        return [*self.summary, *plans, *(f"{name}: {line}" for name, each in animations.items()
                                         for line in (*each.outdated_line, *each.report.remarks()))]


def _facts(scene, series, job):
    """What the line of a picture states of its job."""
    lens, settings = job.lens, job.settings
    f_number = series.f_number or lens_facts(series.lens, scene_rings(scene), scene.camera.data.lens).f_number
    return {"blender": bpy.app.version_string, "scene": scene.name, "samples": settings["samples"],
            "seed": settings["seed"], "lens": series.lens, "squeeze": lens.squeeze, "f_number": f_number,
            "working_f_number": lens.f_number_effective,
            "focus_mm": lens.object_distance_mm + lens.entrance_pupil_mm, "wavelengths_nm": job.wavelengths_nm,
            "unit": UNITS[IRRADIANCE], "truth": job.truth.split(",") if job.truth else []}


def _check_given(lenses, frames, given):
    """Raise an InputError without lenses or frames, or for fields of a RenderRequest that each lens has its own of."""
    if not lenses:
        raise InputError("options", "lenses", "", "give one or more names or files")
    if not frames:
        raise InputError("options", "frames", "", "give one or more frames")
    for name, remedy in OF_LENS.items():
        if given.get(name) is not None:
            raise InputError("options", name, given[name], remedy)


def _requested(lenses, f_numbers):
    """The lens and the f-number of each folder of pictures: dict of str: (str, float or None)."""
    requested = {}
    for lens in lenses:
        for f_number in f_numbers or (None,):
            name = lens_stem(lens) if f_number is None else f"{lens_stem(lens)}_f{f_number:.3g}"
            if name.casefold() in map(str.casefold, requested):
                raise InputError("options", "lens", lens, f"a second folder {name}: leave the lens or f-number out, or "
                                                          "rename its file")
            _check_f_number(lens, f_number)
            requested[name] = lens, f_number
    return requested


def _check_f_number(lens, f_number):
    """Raise an InputError unless a lens exists and has this f-number, if any."""
    reach = lens_facts(lens).reach
    if f_number is None:
        return
    if reach is None:
        raise InputError("options", "f-number", f_number, f"{lens} is a package for one f-number: leave it out")
    widest, highest, _ = reach
    if not widest * (1 - CLOSE) <= f_number <= highest * (1 + CLOSE):
        raise InputError("options", "f-number", f_number, f"{lens} has f/{widest:.3g} to f/{highest:.3g}")


def render_dataset(scene, lenses, f_numbers=(), frames=None, *, progress=None, **given):
    """Render frames of a scene through several lenses, with their calibrations, ground truth and an index.

    Finished pictures with the same settings stay as they are, and frames that another process is capturing into the
    same folder are left to it. Each frame is captured once for all lenses of a squeeze.

    Parameters
    ----------
    As in `Dataset`

    Returns
    -------
    Dataset
    """
    dataset = Dataset(scene, lenses, f_numbers, frames, progress=progress, **given)
    for turn in dataset.turns:
        dataset.render(turn, progress)
    return dataset
