"""One capture for several frames: where nothing but focus and f-stop changes, the scene is rendered once. Each frame
sees that through the lens as it is turned there."""

from dataclasses import replace

import numpy as np

from ...engine.field.overscan import overscan_px
from ...engine.files import link_or_copy
from ..scene.render_state import go_to_frame, turn_on_layer
from ..scene.rings import scene_rings
from ..scene.undo import Journal
from .pictures import write_radiance
from .radiance import capture
from .record import asked_of
from .remarks import scene_remarks
from .render import job_of_frame

RINGS = "focus", "f_number", "focused_wide_open"
OF_LENS = "lens", "lens_digest", "iris"  # in what is asked of a picture


class OneCapture:
    """What several frames are seen in, planned for all of them and rendered for the first that asks.

    Parameters
    ----------
    scene : bpy.types.Scene
    frames : ascending sequence of int
        That differ in nothing but what the lens is turned to.
    asked : by name
        What `render_through_lens` takes, but for the frame and the progress.
    """

    def __init__(self, scene, frames, **asked):
        jobs = [job_of_frame(scene, frame, **asked) for frame in _ends(scene, frames, asked)]
        first, *others = sorted(jobs, key=lambda job: -job.lens.capture_focal_length_mm)  # of the finest view
        self._job = replace(first, others=tuple(job.lens for job in others))
        self._captured, self._facts, self._file = None, None, None

    def holds(self, job):
        """Whether a frame can be seen in it: another picture is not asked for, nor more than is captured."""
        if job.traced or _but_for_lens(job) != _but_for_lens(self._job):
            return False
        grid = self._captured and self._captured.radiance.grid
        return grid is None or all(least <= there for least, there in zip(
            overscan_px(job.lens, grid, job.wavelengths_nm, 0), grid.overscan_px, strict=True))

    def capture(self, scene, job, result, share):
        """Steps that do what `radiance.capture` does, for a frame that it holds."""
        if self._captured is None:
            captured = yield from capture(scene, replace(self._job, picture=job.picture), result, share)
            radiance = captured.radiance
            seen = replace(radiance, grid=replace(radiance.grid, focal_mm=radiance.focal_mm))  # by all of the lenses
            self._captured, self._facts = replace(captured, radiance=seen), result.report.scene
        result.report.scene = replace(
            self._facts, depth=self._captured.depth_check(job.lens), lens_warning=job.lens_warning,
            scene_remarks=_remarks(scene, job) + self._captured.unlayered)
        return self._captured

    def write_radiance(self, captured, path):
        """Write what `pictures.write_radiance` does, once: for later frames the same file has another name."""
        if self._file and self._file.is_file():
            link_or_copy(self._file, path)
        else:
            write_radiance(captured, path)
            self._file = path


def _ends(scene, frames, asked):
    """Frames between whose focus distances and f-stops those of all others are: a sorted list."""
    asked = {name: asked.get(name) for name in RINGS}
    with Journal() as journal:
        go_to_frame(scene, frames[0], journal)
        rings = {}
        for frame in frames:
            scene.frame_set(frame)
            rings[frame] = scene_rings(scene, **asked)
    focus = {frame: np.inf if each.focus_mm is None else each.focus_mm for frame, each in rings.items()}
    f_number = {frame: each.f_number or 0.0 for frame, each in rings.items()}
    return sorted({end(frames, key=of.get) for of in (focus, f_number) for end in (min, max)})


def _but_for_lens(job):
    return {name: value for name, value in asked_of(job).items() if name not in OF_LENS}


def _remarks(scene, job):
    with Journal() as journal:
        go_to_frame(scene, job.frame, journal)
        turn_on_layer(scene, job.view_layer, journal)
        return tuple(map(str, scene_remarks(scene, job)))
