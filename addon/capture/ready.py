"""A scene made ready for its passes: planned, substituted, and cut into slabs if its depth requires it."""

import math
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from lensfield.engine.depth.depth_range import AUTO
from lensfield.engine.field.overscan import columns_for_blur
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.runtime.memory import taken_bytes

from ..job.job import Job
from ..job.targets import check_files
from ..scene.camera import capture_grid, captured_region, frame_grid, render_region
from ..scene.devices import device_of, device_text, use_device
from ..scene.render_state import (
    clamps_of,
    divide_samples,
    go_to_frame,
    guard_render_state,
    rendered_layer,
    stand_in_camera,
    turn_on_layer,
)
from ..shading.substitution import Substitution
from .emitters import Emitters, emitters_of
from .empty_frame import EmptyReasons, empty_reasons
from .finished_passes import FinishedPasses, alone_with_passes
from .remarks import scene_remarks, unlayered_remarks
from .room import check_room_for_light, room_for_capture
from .sampled_passes import MOST_FINE_PX
from .scene_plan import ScenePlan, plan_scene
from .sky import map_steps
from .slabs import Cut, Slab, cut_steps, finer_region, looked_at, single_slab

LOOK_SHARE = 0.01  # of the capture's time, for the depth pre-pass
MEGABYTE = 1e6


@dataclass(frozen=True, eq=False)
class Planned:
    """A scene whose passes are planned and whose materials are substituted.

    Attributes
    ----------
    scene, job, plan, substitution, passes
    grid : PixelGrid
        The picture's capture.
    group_names : list of str
        Of the light groups.
    clamps : dict
    path : Path
        The file that a render writes.
    region, rendered : (slice, slice)
        Blender's render region in the frame, or None; and the rows and columns of the capture that it takes.
    empty : EmptyReasons
    exposure : float
    film : bool
        Whether the film is transparent.
    remarks, of_capture : list
    device : str
        That renders, in words.
    """

    scene: bpy.types.Scene
    job: Job
    plan: ScenePlan
    substitution: Substitution
    passes: FinishedPasses
    grid: PixelGrid
    group_names: list
    clamps: dict
    path: Path
    region: tuple[slice, slice] | None
    rendered: tuple[slice, slice]
    empty: EmptyReasons
    exposure: float
    film: bool
    remarks: list
    of_capture: list
    device: str

    @property
    def sky(self):
        """Whether the film shows light from the world."""
        return self.empty.sky and not self.film


@dataclass(frozen=True, eq=False)
class Ready(Planned):
    """A planned scene that is cut into slabs, and guarded by a journal.

    Attributes
    ----------
    cut : Cut or None
        None if one slab shows all.
    capture_px : PixelGrid
        With a cut, the larger capture that the blur of near objects needs, for a lens with a squeeze in finer columns.
    complete : Slab
        All that the camera sees of the picture's capture.
    slabs : tuple of Slab
    emitters : Emitters or None
        None for a traced lens.
    scratch : Path or None
        The folder for the light's scratch files.
    needed_bytes : float
        Memory for the light and its passes.
    peak_mb : float
    """

    cut: Cut | None
    capture_px: PixelGrid
    complete: Slab
    slabs: tuple[Slab, ...]
    emitters: Emitters | None
    scratch: Path | None
    needed_bytes: float
    peak_mb: float


def job_grid(scene, job):
    """The pixels that Cycles renders of the scene's current frame: of a capture or, for a traced lens, of the film."""
    if job.traced:
        return frame_grid(scene, job.lens)
    return capture_grid(scene, job.lens, job.wavelengths_nm, job.options, job.room, job.others)


def layer_columns(job, capture):
    """Columns of layers in a column of the sensor, for a capture in the sensor's pixels: 1 in Preview, and fewer for
    large pictures."""
    columns = 1 if job.spectral.tier == "preview" else columns_for_blur(job.lens)
    while columns > 1 and columns * math.prod(capture.shape_px) > MOST_FINE_PX:
        columns //= 2
    return columns


def planned_steps(scene, job, files, folder, journal, alone, times=1):
    """Steps that plan a scene's passes and substitute its materials; returns a Planned.

    Parameters
    ----------
    scene, job
    files : sequence of Path
        To be written later.
    folder : Path
        For the files of renders.
    journal : Journal
    alone : ExitStack
        As for `alone_with_passes`.
    times : int
        Parts of a pixel, down and across, in the finest pixels to be captured.
    """
    go_to_frame(scene, job.frame + job.subframe, journal)
    grid = job_grid(scene, job)
    turn_on_layer(scene, job.view_layer, journal)
    remarks = [*scene_remarks(scene, job)]
    of_capture, empty = [*unlayered_remarks(scene, job, grid)], empty_reasons(scene, job.lens, grid)
    exposure, film = scene.cycles.film_exposure, scene.render.film_transparent
    kind = device_of(scene, job.device, job.traced)
    use_device(scene, kind, journal)  # the remarks compare it with the scene's own
    stand_in_camera(scene, journal)
    plan, substitution, groups = plan_scene(scene, job, grid, journal)
    plan.check()
    room_for_capture(scene, job, grid.finer(times), plan)
    check_room_for_light(scene, job, grid)
    check_files(scene, files)
    yield from alone_with_passes(scene, job, alone)
    passes = FinishedPasses(scene, job, 4 * job.wavelengths_nm.size * math.prod(grid.shape_px))
    names = groups.part(rendered_layer(scene), journal)
    region = render_region(scene)
    rendered = region or tuple(slice(0, n) for n in grid.shape_px)
    if region and not job.traced:
        rendered = captured_region(region, job.lens, job.wavelengths_nm, grid, job.options, job.room, job.others)
    journal.set(scene.render, "use_persistent_data", True)  # from the depth pre-pass on
    planned = Planned(scene, job, plan, substitution, passes, grid, names, clamps_of(scene), folder / "pass.exr",
                      region, rendered, empty, exposure, film, remarks, of_capture, device_text(kind))
    yield from map_steps(planned, journal)
    return planned


def sliced_steps(planned, share, journal, times=1, emitters=None):
    """Steps that cut a planned scene into slabs, if its depth requires it, and guard its render state; returns a Ready.

    Parameters
    ----------
    planned : Planned
    share : float
        The capture's part of the complete job.
    journal : Journal
    times : int
        Parts of a pixel, down and across, in the finest pixels to be captured: the scene is cut for these.
    emitters : Emitters, optional
        By default those that the scene is known to have.
    """
    scene, job, plan, grid, cut = planned.scene, planned.job, planned.plan, planned.grid, None
    emitters = emitters or (None if job.traced else _emitters(planned))
    if job.depth == AUTO:
        planned.substitution.set_wavelengths(plan.bands[0], plan.dispersive)
        planned.substitution.place_window(looked_at(grid))
        cut = yield from cut_steps(scene, job, grid.finer(times), finer_region(planned.rendered, times), plan.tinting,
                                   planned.sky, emitters, planned.passes,
                                   planned.path.with_name("look.exr"), 0.0, LOOK_SHARE * share)
    cut = cut and cut.coarser(times)
    columns = layer_columns(job, cut.capture) if cut and times == 1 else 1
    if cut and columns > 1:
        cut = cut.finer_across(columns)
        divide_samples(scene, columns, journal)
    capture_px = cut.capture if cut else grid
    complete = single_slab(scene, _in_capture(planned.rendered, grid, capture_px))
    slabs = cut.slabs if cut else (complete,)
    guard_render_state(scene, job, capture_px, planned.path, journal)
    planned.substitution.place_window(capture_px)
    needed_bytes, scratch = room_for_capture(scene, job, capture_px.finer(times), plan,
                                             [slab.finer(times) for slab in slabs])
    return Ready(**vars(planned), cut=cut, capture_px=capture_px, complete=complete, slabs=slabs, emitters=emitters,
                 scratch=scratch, needed_bytes=needed_bytes, peak_mb=(taken_bytes() + needed_bytes) / MEGABYTE)


def _in_capture(region, grid, capture_px):
    """A region of the picture's capture, given as slices of rows and columns, in the larger capture for slabs."""
    margin = np.subtract(capture_px.on_sensor().overscan_px, grid.overscan_px).tolist()
    return finer_region(tuple(slice(side.start + more, side.stop + more)
                              for side, more in zip(region, margin, strict=True)), 1, capture_px.across)


def _emitters(planned):
    """The Emitters of a planned scene."""
    job, substitution = planned.job, planned.substitution
    return emitters_of(planned.scene, lambda block: substitution.emission_at(block, job.wavelengths_nm))
