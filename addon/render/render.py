"""The main job, as a generator of steps: scene -> spectral radiance -> lens -> spectral irradiance."""

from dataclasses import replace
from functools import cache

import bpy

from lensfield.engine import ChannelCache
from lensfield.engine.pictures.frame_record import write_record
from lensfield.engine.pictures.spectral_exr import write_exr
from lensfield.engine.runtime.ahead import Ahead
from lensfield.engine.runtime.files import discard
from lensfield.engine.runtime.locks import only_writer
from lensfield.engine.simulation.lens_image import lens_image
from lensfield.engine.simulation.prepare import preparation

from ...request import IRRADIANCE, RADIANCE
from ..capture.finished_passes import remove_passes
from ..capture.radiance import capture
from ..capture.scene_plan import check_job
from ..job.job import check_output_folder, job_of
from ..job.origin import attribute_of, check_replaced, origin_of
from ..job.photo import shown_picture, take_photo
from ..job.recorded import recorded_fields
from ..job.result import PINHOLE_FILES, Result
from ..job.shown import LOOK, look_for
from ..job.steps import RenderPass, Work
from ..scene.compositor import fingerprint_anew, key_of, lay_into_compositor
from ..scene.errors import SceneError, blenders_reason
from ..scene.lens_cache import unwatched
from ..scene.render_state import go_to_frame
from ..scene.requirements import check_scene
from ..scene.undo import Journal
from ..scene.watch import samples_watched
from .pictures import write_film_pictures, write_pictures, write_radiance, write_stray, write_truth

RENDER_SHARE = 0.85  # of the progress bar; the rest is for the engine and the files
WRITING = 0.96  # of the progress bar, when the files are about to be written


@cache
def shared_cache():
    """The cache that a session's lens renders share. The next frame, or the same one with other light, reuses the point
    spread functions of the same lens on the same grid."""
    return ChannelCache()


def render_through_lens(scene, *, frame=None, overwrite=False, progress=None, **given):
    """Render a scene multispectrally and put it through a lens: the complete main job in one call.

    Data that depend only on the lens and the pixel grid are cached for the next call, up to a memory limit, until the
    add-on is unregistered: later frames take less time and have the same pixels.

    Parameters
    ----------
    scene : bpy.types.Scene
    frame : int, optional
        By default the scene's current frame, or its place between two.
    overwrite : bool
        Whether the files of another .blend or scene may be replaced.
    progress : callable (fraction, label), optional
    given : by name
        Fields of a `RenderRequest`. All others are as in the scene's Lensfield settings at that frame, except
        `to_compositor`, which is False.

    Returns
    -------
    Result

    Raises
    ------
    Busy
        Another process is rendering this frame into this folder.
    LensError, SceneError, InputError
        The scene is restored exactly.
    """
    given["state"] = given.get("state") or fingerprint_anew(scene)
    job = job_of_frame(scene, scene.frame_float if frame is None else frame, baking=baking(progress), **given)
    result = Result.of(scene, job.output_folder, job.frame)
    if not overwrite:
        check_replaced(scene, result, job.state)
    with only_writer(result.record):
        return run(render_steps(scene, job), progress)


def job_of_frame(scene, frame, quality=None, baking=unwatched, **given):
    """The `job_of` a frame, by the scene's camera and settings at that frame, except for the given fields."""
    if given.get("output_folder") is None:
        check_output_folder(scene)
    with Journal() as journal:
        go_to_frame(scene, frame, journal)
        check_scene(scene, **given)
        return job_of(scene, quality, baking, **{"to_compositor": False} | given)


def baking(progress):
    """The progress function of a bake before a job with this one, which may be None: the job itself has not begun."""
    return lambda fraction, label: progress and progress(0.0, f"Baking the lens, {fraction:.0%}")


def run(steps, progress=None):
    """Run the steps one after the other; returns the generator's result."""
    on_progress = progress or (lambda fraction, label: None)

    def within_step(fraction, label=None):
        on_progress(step.fraction + step.share * fraction, label or step.label)

    try:
        step = next(steps)
        while True:
            on_progress(step.fraction, step.label)
            if isinstance(step, RenderPass):
                answer = None
                with samples_watched(within_step, step.scene.cycles.device == "GPU"):
                    _render(step.scene)
            else:
                answer = step.call(within_step)
            step = steps.send(answer)
    except StopIteration as end:
        on_progress(1.0, "done")
        return end.value
    finally:
        steps.close()


def _render(scene):
    try:
        bpy.ops.render.render(write_still=True, scene=scene.name)
    except RuntimeError as error:
        raise SceneError(f"scene {scene.name!r}", "render", "refused by Blender", blenders_reason(error)) from None


def render_steps(scene, job, one=None):
    """Generator of RenderPass and Work steps; send it the return value of each step's call. Returns a Result.

    Closing it at any step restores the scene and leaves no half-written file. `one` is the OneCapture that serves the
    frame, if any.
    """
    check_job(scene, job)
    capture_by, write_by = (one.capture, one.write_radiance) if one else (capture, write_radiance)
    result = Result.of(scene, job.output_folder, job.frame)
    report = result.report
    with Ahead() as ahead:
        with report.stage("multispectral render"):
            captured = yield from capture_by(scene, job, result, RENDER_SHARE, lambda expected: ahead.begin(
                preparation(expected, job.lens, job.options, job.stray, shared_cache(), job.iris)))
        discard(result.record)  # the files that it describes are about to change
        attributes = attributes_of(scene, job)
        if job.traced:
            yield from _film_steps(captured, job, result, attributes)
        else:
            if job.writes(RADIANCE):
                yield Work(_timed(report, "write radiance", lambda _: write_by(captured, result.radiance, attributes)),
                           "Writing radiance", RENDER_SHARE)
                attributes = None
            else:
                result.leave_out(RADIANCE)
            yield Work(_timed(report, "lens data", lambda _: ahead.wait()), "Preparing the lens", RENDER_SHARE + 0.02)
            yield from lens_steps(captured, job.lens, job, job.iris, result, RENDER_SHARE + 0.02, attributes)
    write_record(result.record, recorded_fields(job), result.written_by(job),
                 result.report.as_dict() | {"state": job.state})
    if one is None:
        remove_passes(scene, job.output_folder, job.frame)
    if job.to_compositor:
        lay_into_compositor(scene, result.lens_image, fingerprint=job.state)
    return result


def attributes_of(scene, job):
    """What a file of the scene's light states about it: dict of str."""
    if job.to_compositor:
        key_of(scene)
    return attribute_of(origin_of(scene, job.output_folder, job.state)) | {LOOK: job.view_settings}


def lens_steps(captured, lens, request, iris, result, fraction, attributes=None):
    """Steps that put a Captured through a lens and write the resulting files; `fraction` of the job is finished.

    The RenderRequest gives the options, the stray light, the camera and the files. `attributes` (dict of str) are those
    of light that no radiance file states.
    """
    report = result.report
    discard(result.record)  # the files that it describes are about to change
    images = yield Work(lambda on_progress: lens_image(captured.radiance, lens, request.options, request.stray,
                                                       layers=captured.layers, outside=captured.outside, iris=iris,
                                                       progress=on_progress, report=report, cache=shared_cache()),
                        f"Through {lens.name}", fraction, WRITING - fraction)
    irradiance, stray = (image and replace(image, cube=captured.cut(image.cube)) for image in images)
    if captured.truth:
        yield Work(_timed(report, "ground truth", lambda on_progress: write_truth(
            captured, lens, irradiance.grid, request.options, iris, result, on_progress)),
                   "Writing ground truth", WRITING)
    else:
        result.remove("truth")
    yield from _file_steps(irradiance, stray, lens, request, result,
                           lambda *shown: write_pictures(captured, irradiance, *shown, lens, request.options, iris,
                                                         result), attributes)


def _film_steps(film, job, result, attributes):
    """Steps that write the files of a film Captured through the lens itself."""
    lens = job.lens
    irradiance = replace(film.radiance, cube=film.cut(film.radiance.cube), quantity=IRRADIANCE, lens_name=lens.name,
                         f_number_effective=lens.f_number_effective, focal_mm=None)
    result.remove(*PINHOLE_FILES, "truth")
    yield from _file_steps(irradiance, None, lens, job, result,
                           lambda *shown: write_film_pictures(film, irradiance, *shown, lens, result), attributes)


def _file_steps(irradiance, stray, lens, request, result, write_its_pictures, attributes=None):
    """Steps that write an irradiance, take a picture with the request's camera, and write what pictures show.

    The first file states the `attributes`.
    """
    report = result.report
    if request.writes(IRRADIANCE):
        yield Work(_timed(report, "write irradiance", lambda _: write_exr(irradiance, result.irradiance, stray=stray,
                                                                          attributes=attributes)),
                   "Writing irradiance", WRITING)
        attributes = None
    else:
        result.leave_out(IRRADIANCE)
    raw = None
    if request.camera:
        raw = yield Work(_timed(report, "camera", lambda _: take_photo(request, irradiance, lens, result)),
                         "Taking the picture", 0.97)
    if raw is None or not request.dng:
        result.remove("raw")

    def write(_):
        write_stray(stray, irradiance.frame_px, result)
        write_its_pictures(*shown_picture(request, irradiance, raw), look_for(request), attributes)

    yield Work(_timed(report, "write pictures", write), "Writing pictures", 0.98)


def _timed(report, stage, call):
    def timed(on_progress):
        with report.stage(stage):
            return call(on_progress)

    return timed

