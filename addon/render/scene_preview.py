"""The preview of a loaded scene: its growing capture, cast through any lens as soon as there is more of it.

It runs in the child of a window (`child.py`), which stops it between two steps for another lens; the capture then
continues to grow. Another scene begins a new one.
"""

from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from time import monotonic, sleep

import bpy
import numpy as np
from bpy.app.handlers import persistent

from lensfield.engine import ChannelCache
from lensfield.engine.library import has_rings, iris_is_visible
from lensfield.engine.library.rays import lens_rays, sketched_rays
from lensfield.engine.pictures.spectral_exr import write_planes_exr
from lensfield.engine.rays.rings import AT_REST
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.simulation.lens_image import lens_image
from lensfield.engine.spectral.colour import metamer_weights

from ...request import RING_FIELDS, RenderRequest
from ..capture.captured import ALPHA, DEPTH
from ..capture.growing_capture import FINER, Grown, Moved, growing_capture
from ..job.photo import exposed
from ..job.result import Result
from ..job.steps import Work
from ..scene.changes import take_changes
from ..scene.lens_cache import SKETCHED, load_lens
from ..scene.moves import take_moves
from ..scene.rings import ring_fields, scene_rings
from .pictures import planes_through_lens
from .refilter import edges_on_lens_mm, fitted, rings_in_view
from .render import job_of_frame, run

CACHE_MB = 256  # for the lens at each size
REST_S, POLL_S = 0.25, 0.02
COARSE_NM = 450.0, 550.0, 610.0  # mixtures of these have nearly all colours
_open = []


class ScenePreview:
    """The preview of a scene at its current frame.

    Parameters
    ----------
    scene : bpy.types.Scene
        Its resolution is as in the coarse picture.
    given : by name
        Fields of a `RenderRequest`, as in `render_through_lens`.

    Attributes
    ----------
    scene

    Raises
    ------
    InputError
        The fields include ground truth, which only renders write.
    """

    def __init__(self, scene, **given):
        if given.get("truth"):
            raise InputError("options", "truth", given["truth"], "a preview writes none: render the scene")
        self.scene = scene
        self._job = job_of_frame(scene, scene.frame_float, SKETCHED, **given, state="preview")
        self._folder = Path(self._job.output_folder)
        self._folder.mkdir(parents=True, exist_ok=True)  # for scratch files, too
        self._result = Result.of(scene, self._folder, self._job.frame)
        self._request = _lens_request(scene, self._job, **given)  # by the camera, before a stand-in takes its place
        self._capture = growing_capture(scene, self._job)
        self._step = next(self._capture)  # not executed yet; None once the capture is complete
        self._grown, self._waiting, self._number = {}, [], 0  # newest stages; those to be shown; of the last picture

    def look_through(self, **given):
        """Use another lens, or other settings of it, from now on.

        Parameters
        ----------
        given : by name
            Fields of a `RenderRequest`, as for `apply_lens`.
        """
        self._request, self._waiting = RenderRequest(**given), list(self._grown.values())

    def run(self, show, progress):
        """Show the captured light through the lens, and then each stage of the capture until it is complete.

        Parameters
        ----------
        show : callable (dict)
            Called with each picture: `picture`, the path of a lens image, an EXR of the fine size; `size_px`, width and
            height as captured; `samples`; `number`; and, with a camera, `exposure`, a dict of `ShownExposure`.
        progress : callable (fraction, label)
            May raise an exception to stop; another `run` continues.
        """
        run(self._steps(show), progress)

    def begin_again(self):
        """Capture the scene anew, after objects have moved."""
        self._step, self._grown, self._waiting = self._capture.throw(Moved()), {}, []

    def close(self):
        """Restore the scene."""
        self._capture.close()
        self._step = None

    def _steps(self, show):
        for grown in list(self._waiting):
            yield from self._picture_steps(grown, show)
            yield Work(_rest, "Resting", 0.0)
        while True:
            yield from self._growing_steps()
            if self._step is None:
                return
            grown = self._step
            if grown.times == 1:
                grown = replace(grown, captured=metameric(grown.captured))
            self._grown[grown.times] = grown
            self._waiting.append(grown)
            self._step = self._capture.send(None)
            yield from self._picture_steps(grown, show)

    def _growing_steps(self):
        """Steps of the capture up to its next stage, or its end. If they are stopped, the same step comes again."""
        while not (self._step is None or isinstance(self._step, Grown)):
            self._step = self._capture.send((yield self._step))

    def _picture_steps(self, grown, show):
        """Steps that show a stage through the lens."""
        lens, iris, captured = yield Work(lambda on_progress: self._lens_for(grown, on_progress), "Preparing the lens",
                                          0.5)
        *planes, exposure = yield Work(lambda on_progress: self._cast(grown.times, captured, lens, iris, on_progress),
                                       f"Through {lens.name}", 0.5, 0.5)
        path = self._written(*planes)
        self._waiting.remove(grown)
        rows, columns = captured.radiance.frame_px
        show({"picture": str(path), "size_px": (columns, rows), "samples": grown.samples, "number": self._number}
             | ({"exposure": asdict(exposure)} if exposure else {}))

    def _lens_for(self, grown, progress):
        """The lens, its iris, and the Captured that suits it; for coarse pixels, the lens is baked coarsely."""
        request = self._request
        rings = rings_in_view(request, grown.captured.radiance)
        lens = load_lens(request.lens, rings, SKETCHED if grown.times == 1 else request.lens_quality,
                         lambda fraction, _: progress(fraction), self._job.wavelengths_nm,
                         edges_on_lens_mm(request.lens, rings, grown.captured.radiance))
        lens, captured = fitted(lens, grown.captured, request, self._result.radiance)
        return lens, request.iris if request.iris and iris_is_visible(request.lens, rings) else None, captured

    def _cast(self, times, captured, lens, iris, progress):
        """The lens image: Rec. 709, as the camera exposes it, and alpha; the depth; and the ShownExposure."""
        options = self._request.options
        irradiance, _ = lens_image(captured.radiance, lens, options, self._request.stray, layers=captured.layers,
                                   outside=captured.outside, iris=iris, progress=progress, cache=_channels(times),
                                   rays=sketched_rays if times == 1 else lens_rays)
        irradiance = replace(irradiance, cube=captured.cut(irradiance.cube))
        picture, exposure = exposed(self._request, irradiance)
        planes = planes_through_lens(captured, lens, options, iris)
        alpha = captured.cut(planes[ALPHA]) if ALPHA in planes else np.ones(picture.shape[:2])
        if times == 1:
            picture, alpha = enlarged(picture, FINER), enlarged(alpha, FINER)
        return picture, alpha, planes[DEPTH], exposure

    def _written(self, picture, alpha, depth_m):
        """The path of the lens image. Two folders alternate, so that a file is not replaced while it is read."""
        self._number += 1
        folder = self._folder / f"picture-{self._number % 2}"
        folder.mkdir(parents=True, exist_ok=True)
        result = Result.from_file(self._result.lens_image, "lens_image", folder)
        planes = dict(zip("RGB", np.moveaxis(picture, -1, 0), strict=True)) | {"A": alpha}
        write_planes_exr({"Y": depth_m}, result.depth, {})  # uncompressed: they are read only once
        write_planes_exr(planes, result.lens_image, {})
        return result.lens_image


def _lens_request(scene, job, **given):
    """The RenderRequest of a job's lens, with the scene's focus and f-stop."""
    request = scene.lensfield.to_request(**given)
    rings = AT_REST
    if has_rings(request.lens):
        rings = scene_rings(scene, **{name: getattr(request, name) for name in RING_FIELDS})
    return replace(request, view=request.view_on_sensor, lens_quality=request.lens_quality or request.spectral.tier,
                   iris=job.iris, **ring_fields(rings))


@cache
def _channels(times):
    """The ChannelCache for pixels of a size, which successive previews share."""
    return ChannelCache(limit_mb=CACHE_MB)


def _rest(progress):
    """Wait for REST_S, so that a ring that is still turning can stop the work on finer pictures before it begins."""
    end_s = monotonic() + REST_S
    while monotonic() < end_s:
        sleep(POLL_S)
        progress(0.0)


def coarse_nm(wavelengths_nm):
    """The wavelengths of coarse pictures: three, or all if these are as few, or do not enclose the three."""
    enclosed = wavelengths_nm[0] <= COARSE_NM[0] and COARSE_NM[-1] <= wavelengths_nm[-1]
    return COARSE_NM if enclosed and len(wavelengths_nm) > len(COARSE_NM) else wavelengths_nm


def metameric(captured):
    """A Captured of the same colours, at the `coarse_nm` alone."""
    radiance, layers = captured.radiance, captured.layers
    nm, few_nm = radiance.wavelengths_nm, coarse_nm(radiance.wavelengths_nm)
    if len(few_nm) == len(nm):
        return captured
    weights = metamer_weights(nm, few_nm).T.astype(np.float32)

    def mixed(light):
        return np.tensordot(weights, light.cube, axes=1)

    if layers:
        layers = replace(layers, wavelengths_nm=few_nm,
                         layers=tuple(replace(layer, cube=mixed(layer)) for layer in layers.layers))
    return replace(captured, radiance=replace(radiance, wavelengths_nm=few_nm, cube=mixed(radiance)), layers=layers)


def enlarged(plane, times):
    """A plane (row, column, ...) with `times` x `times` pixels for each of its own, interpolated linearly."""
    for axis, count in enumerate(plane.shape[:2]):
        place = np.clip((np.arange(times * count) + 0.5) / times - 0.5, 0, count - 1)
        before, after = np.floor(place).astype(int), np.ceil(place).astype(int)
        share = np.float32(place - before).reshape(-1, *[1] * (plane.ndim - 1 - axis))
        before, after = plane.take(before, axis), plane.take(after, axis)
        plane = before + share * (after - before)
    return plane


def open_preview(scene, **given):
    """Begin the ScenePreview of a scene; another file's ends it."""
    close_preview()
    preview = ScenePreview(scene, **given)
    _open.append(preview)
    if close_preview not in bpy.app.handlers.load_pre:
        bpy.app.handlers.load_pre.append(close_preview)
    return preview


def opened_preview():
    """The ScenePreview of `open_preview`.

    Raises
    ------
    InputError
        No scene has been opened.
    """
    if not _open:
        raise InputError("preview", "scene", "not open", "give the .blend first")
    return _open[0]


def changed_scene(path):
    """The scene of the opened preview, which ends, with the changes of a file from `write_changes`.

    Raises
    ------
    InputError
        No scene has been opened, or the changes cannot be applied.
    """
    scene = opened_preview().scene
    close_preview()
    take_changes(scene, path)
    return scene


def moved_preview(path):
    """The opened preview, which begins anew with the moved objects of a file from `write_moves`.

    Raises
    ------
    InputError
        No scene has been opened, or the file does not fit it.
    """
    preview = opened_preview()
    take_moves(preview.scene, path)
    preview.begin_again()
    return preview


@persistent
def close_preview(*_):
    """End the preview, if there is one, while its scene is still open."""
    while _open:
        _open.pop().close()
