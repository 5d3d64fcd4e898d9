"""One capture for several pictures: the scene is rendered once, and each picture puts that radiance through its own
lens. The pictures are frames between which only focus and f-stop change, or one frame through several lenses."""

from dataclasses import replace

import numpy as np

from lensfield.engine.field.field_map import field_map
from lensfield.engine.runtime.files import link_or_copy

from ...request import RING_FIELDS
from ..capture.finished_passes import remove_passes
from ..capture.radiance import capture
from ..capture.remarks import scene_remarks
from ..job.recorded import recorded_fields
from ..scene.camera import frame_grid
from ..scene.render_state import go_to_frame, turn_on_layer
from ..scene.rings import scene_rings
from ..scene.undo import Journal
from .pictures import write_radiance
from .render import job_of_frame

OF_LENS = "lens", "lens_digest", "iris"  # the recorded fields that differ between lenses, focus and f-stop


class OneCapture:
    """The capture that several pictures share: planned for all of them, and rendered with the first.

    Parameters
    ----------
    job : Job
        That captures the scene, with the lenses of the other pictures.
    """

    def __init__(self, job):
        self._job = job
        self._captured, self._facts, self._file = None, None, None

    @classmethod
    def of_frames(cls, scene, frames, **given):
        """The OneCapture of frames that differ only in the lens's focus and f-stop.

        Parameters
        ----------
        scene : bpy.types.Scene
        frames : ascending sequence of int
        given : by name
            Fields of a `RenderRequest`, as in `render_through_lens`.
        """
        first, *others = sorted(end_jobs(scene, frames, **given),
                                key=lambda job: -job.lens.capture_focal_length_mm)  # finest view first
        return cls(replace(first, others=tuple(job.lens for job in others)))

    def holds(self, job):
        """Whether this capture serves a job: only the lens differs, and the overscan is large enough."""
        if job.traced or _but_for_lens(job) != _but_for_lens(self._job):
            return False
        grid = self._captured and self._captured.radiance.grid
        return grid is None or all(least <= available for least, available in zip(
            field_map(job.lens).overscan_px(grid, job.wavelengths_nm, 0), grid.overscan_px, strict=True))

    def capture(self, scene, job, result, share, _):
        """Steps like those from `radiance.capture`, for a frame that this capture serves. Nothing is prepared, because
        the frames have different lenses."""
        if self._captured is None:
            captured = yield from capture(scene, replace(self._job, picture=job.picture), result, share)
            radiance = captured.radiance
            shared = replace(radiance, grid=replace(radiance.grid, focal_mm=radiance.focal_mm))  # for all lenses
            self._captured, self._facts = replace(captured, radiance=shared), result.report.scene
        check, layers = self._captured.depth_check(job.lens), self._facts.layers
        if layers and self._job.others:
            layers = f"{check.text}: {layers}"
        result.report.add(replace(
            self._facts, depth=check, layers=layers, lens_warning=job.lens_warning,
            scene_remarks=(*_remarks(scene, job), *self._captured.remarks, *self._captured.scale_remarks(job.lens))))
        return self._captured

    def write_radiance(self, captured, path, attributes):
        """Write the radiance once, by `pictures.write_radiance`; later frames link to that file, or copy it."""
        if self._file and self._file.is_file():
            link_or_copy(self._file, path)
        else:
            write_radiance(captured, path, attributes)
            self._file = path

    def remove_passes(self, scene):
        """Remove the stored passes of the capture, whose pictures are complete."""
        remove_passes(scene, self._job.output_folder, self._job.frame)


def shared_job(scene, jobs):
    """The job that captures the scene for the lenses of all jobs, which show the camera's view.

    The lens that sees farthest beyond the frame chooses the projection: the others need less overscan in its panorama
    than on a plane.
    """
    def reach_px(job):
        return field_map(job.lens).overscan_px(frame_grid(scene, job.lens), job.wavelengths_nm, 0)

    first, *others = sorted(jobs, key=reach_px, reverse=True)
    return replace(first, iris=next((job.iris for job in jobs if job.iris), None), lens_warning="", ring_words=(),
                   others=tuple(job.lens for job in others))


def end_jobs(scene, frames, **given):
    """The jobs of the frames with the extremes of focus distance and f-stop: list."""
    return [job_of_frame(scene, frame, **given) for frame in _ends(scene, frames, given)]


def _ends(scene, frames, given):
    """The frames with the extremes of focus distance and f-stop: sorted list."""
    given = {name: given.get(name) for name in RING_FIELDS}
    with Journal() as journal:
        go_to_frame(scene, frames[0], journal)
        rings = {}
        for frame in frames:
            scene.frame_set(frame)
            rings[frame] = scene_rings(scene, **given)
    focus = {frame: np.inf if each.focus_mm is None else each.focus_mm for frame, each in rings.items()}
    f_number = {frame: each.f_number or 0.0 for frame, each in rings.items()}
    return sorted({end(frames, key=of.get) for of in (focus, f_number) for end in (min, max)})


def _but_for_lens(job):
    return {name: value for name, value in recorded_fields(job).items() if name not in OF_LENS}


def _remarks(scene, job):
    with Journal() as journal:
        go_to_frame(scene, job.frame + job.subframe, journal)
        turn_on_layer(scene, job.view_layer, journal)
        return tuple(map(str, scene_remarks(scene, job)))
