"""Checks before a render: reasons to refuse it, differences from Blender's own render, and its plan."""

import os
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from lensfield.engine.depth.depth_range import AUTO
from lensfield.engine.depth.slabs import SlabPlan
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.runtime.files import nearest_existing

from ..capture.emitters import emitters_of
from ..capture.empty_frame import empty_reasons
from ..capture.ready import job_grid
from ..capture.remarks import Remark, colour_remarks, depth_remarks, scale_remarks, scene_remarks, unlayered_remarks
from ..capture.room import check_room_for_light, room_for_capture
from ..capture.scene_plan import ScenePlan, check_job, plan_scene
from ..capture.slabs import looked_at, plan_by
from ..job.job import check_output_folder, job_of
from ..job.origin import check_replaced
from ..job.photo import camera_words
from ..job.result import Result
from ..job.targets import check_files
from ..scene.compositor import fingerprint_now
from ..scene.depth import visible_depth_mm
from ..scene.render_state import go_to_frame, stand_in_camera, turn_on_layer
from ..scene.requirements import check_scene
from ..scene.undo import Journal
from ..shading.lint import lint
from ..shading.lobes import shines
from ..shading.repeated import tinting_objects


@dataclass(frozen=True, eq=False)
class Preflight:
    """Results of the checks before a render.

    Attributes
    ----------
    plan : ScenePlan or None
        None if the scene cannot be planned.
    refusals : tuple of InputError
        Why the render would be refused; empty if it would not be.
    remarks : tuple of Remark
    findings : tuple of Finding
        The treatment of the nodes, worst first.
    slabs : SlabPlan or None
        How depth is cut, estimated by rays; None if it is not cut.
    """

    plan: ScenePlan | None = None
    refusals: tuple = ()
    remarks: tuple = ()
    findings: tuple = ()
    slabs: SlabPlan | None = None


def preflight(scene, *, frame=None, **given):
    """Check a scene as `render_through_lens` would with these arguments; the scene stays as it is.

    Returns
    -------
    Preflight
    """
    refusals, fits, job, plan, slabs, remarks = [], False, None, None, None, ()
    with Journal() as journal:
        go_to_frame(scene, scene.frame_float if frame is None else frame, journal)
        with _noted(refusals):
            if given.get("output_folder") is None:
                check_output_folder(scene)
        with _noted(refusals):
            check_scene(scene, **given)
            fits = True
        with _noted(refusals):
            job = job_of(scene, **given)
            remarks = (*scene_remarks(scene, job), *(Remark("Camera", job.camera.title, line)
                                                     for line in camera_words(job)))
        if job:
            with _noted(refusals):
                _check_files(scene, job)
            with _noted(refusals):
                check_job(scene, job)
        if job and fits:
            with _noted(refusals):
                turn_on_layer(scene, job.view_layer, journal)
                grid = job_grid(scene, job)
                empty, film = empty_reasons(scene, job.lens, grid), scene.render.film_transparent
                remarks += tuple(empty.before_render(film))
                if not job.traced:
                    depth_mm = visible_depth_mm(scene, job.lens, looked_at(grid))
                    emitters = emitters_of(scene, lambda block: None if shines(block) else np.zeros(1))
                    slabs, *_ = plan_by(depth_mm, scene, job, grid, tinting_objects(scene), empty.sky and not film,
                                        emitters)
                    remarks += (*depth_remarks(job, slabs), *scale_remarks(depth_mm, [job.lens], grid.pitch_um),
                                *unlayered_remarks(scene, job, grid))
                stand_in_camera(scene, journal)
                plan = plan_scene(scene, job, grid, journal)[0]
                remarks += tuple(colour_remarks(plan))
                check_room_for_light(scene, job, grid)
                room_for_capture(scene, job, grid, plan)
        findings = plan.findings if plan else lint(scene)
    return Preflight(plan, (*refusals, *(plan.refusals if plan else ())), remarks, findings,
                     slabs if slabs and slabs.needed and job.depth == AUTO else None)


@contextmanager
def _noted(refusals):
    try:
        yield
    except InputError as error:
        if str(error) not in map(str, refusals):
            refusals.append(error)


def _check_files(scene, job):
    """Do the work of `check_files`, without creating the folder."""
    folder = nearest_existing(job.output_folder)
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        raise InputError(job.output_folder, "folder", "not writable", f"{folder} is not a folder with write permission")
    if folder == job.output_folder:
        result = Result.of(scene, job.output_folder, job.frame)
        check_files(scene, result.files)
        check_replaced(scene, result, fingerprint_now(scene))
