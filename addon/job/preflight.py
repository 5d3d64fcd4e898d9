"""Before a render: whether it would be refused, what of the scene would come out otherwise, and its plan."""

import os
from contextlib import contextmanager
from dataclasses import dataclass

from ...engine.depth.slabs import SlabPlan
from ...engine.errors import InputError
from ...engine.files import nearest_there
from ...engine.image.depth_range import AUTO
from ..scene.camera import check_camera
from ..scene.depth import seen_depth_mm
from ..scene.render_state import go_to_frame, turn_on_layer
from ..scene.undo import Journal
from ..shading.lint import lint
from .job import check_output_folder, job_from_settings
from .radiance import job_grid, room_for_capture
from .remarks import depth_remarks, scene_remarks, unlayered_remarks
from .render import Result
from .scene_plan import ScenePlan, check_job, plan_scene
from .slabs import looked_at, plan_by
from .targets import check_files


@dataclass(frozen=True, eq=False)
class Preflight:
    """What can be known of a render before it.

    Attributes
    ----------
    plan : ScenePlan or None
        None where there can be none.
    refusals : tuple of InputError
        Why the render would be refused; empty where it would not.
    remarks : tuple of Remark
    findings : tuple of Finding
        What becomes of the nodes, worst first.
    slabs : SlabPlan or None
        How depth is cut, as far as rays tell; None where it is not.
    """

    plan: ScenePlan | None = None
    refusals: tuple = ()
    remarks: tuple = ()
    findings: tuple = ()
    slabs: SlabPlan | None = None


def preflight(scene, output_folder=None, *, frame=None, **asked):
    """Look at a scene as `render_through_lens` would with these arguments; it is left as it is.

    Returns
    -------
    Preflight
    """
    refusals, job, plan, slabs, remarks = [], None, None, None, ()
    with Journal() as journal:
        go_to_frame(scene, scene.frame_current if frame is None else frame, journal)
        with _noted(refusals):
            if output_folder is None:
                check_output_folder(scene)
        with _noted(refusals):
            job = job_from_settings(scene, output_folder=output_folder, **asked)
            remarks = tuple(scene_remarks(scene, job))
        if job:
            with _noted(refusals):
                _check_files(scene, job)
            with _noted(refusals):
                check_job(scene, job)
                turn_on_layer(scene, job.view_layer, journal)
                check_camera(scene)
                grid = job_grid(scene, job)
                if not job.traced:
                    slabs = plan_by(seen_depth_mm(scene, job.lens, looked_at(grid)), scene, job, grid)[0]
                    remarks += (*depth_remarks(job, slabs), *unlayered_remarks(scene, job, grid))
                journal.stand_in(scene.camera.data)
                plan = plan_scene(scene, job, grid, journal)[0]
                room_for_capture(scene, job, grid, plan)
        findings = plan.findings if plan else lint(scene)
    return Preflight(plan, (*refusals, *(plan.refusals if plan else ())), remarks, findings,
                     slabs if slabs and slabs.needed and job.depth == AUTO else None)


@contextmanager
def _noted(refusals):
    try:
        yield
    except InputError as error:
        refusals.append(error)


def _check_files(scene, job):
    """What `check_files` does, without making the folder."""
    there = nearest_there(job.output_folder)
    if not there.is_dir() or not os.access(there, os.W_OK):
        raise InputError(job.output_folder, "folder", "not to be made", f"{there} is no folder that can be written to")
    if there == job.output_folder:
        check_files(scene, Result.of(scene, job.output_folder, job.frame).files)
