"""Slabs: what is near and what is far, rendered apart by the camera's clipping, so that none hides what is behind it.

One look at the scene's depth, small and of one sample, tells where to cut, and whether at all.
"""

from dataclasses import dataclass, replace

import numpy as np

from ...engine.depth.slabs import MOST_SLABS, SlabPlan, plan_slabs
from ...engine.image.depth_range import BACKGROUND_MM, blur_per_nearness_px, planar_depth_mm
from ...engine.image.pixel_grid import PixelGrid
from ..scene.bodies import whole_depths_mm
from ..scene.depth import M_TO_MM
from ..scene.render_state import guard_render_state, rendered_layer
from ..scene.undo import Journal
from .light import depth_pass
from .steps import RenderPass

PREVIEW_SLABS = 4
OVERLAP_PX = 0.5  # of blur, by which slabs overlap in a body that they cut
EVERY_PX = 4  # of the capture, that the look goes by
MOST_MARGIN = 0.5  # of the frame's longer side, that slabs may reach beyond its edges
LOOK = {"samples": 1, "max_bounces": 0, "use_adaptive_sampling": False, "use_denoising": False, "time_limit": 0.0}
BEYOND_ALL_M = 1e9, 2e9  # where a camera that clips there sees the world alone


@dataclass(frozen=True)
class Slab:
    """What one render of a pass shows.

    Attributes
    ----------
    near_m, far_m : float
        Where the camera clips.
    region : (slice, slice)
        Rows and columns of the capture.
    transparent : bool
        Whether the film is.
    narrows : bool
        Whether later passes may be of that part of the region alone which holds something in the first.
    """

    near_m: float
    far_m: float
    region: tuple[slice, slice]
    transparent: bool
    narrows: bool

    @property
    def facts(self):
        """What tells it from others, as JSON can hold it."""
        return [self.near_m, self.far_m, [(side.start, side.stop) for side in self.region], self.transparent]

    def within(self, part):
        """The slab, of this part of its region alone."""
        return replace(self, region=tuple(slice(whole.start + kept.start, whole.start + kept.stop)
                                          for whole, kept in zip(self.region, part, strict=True)))


@dataclass(frozen=True)
class Cut:
    """How a capture is cut.

    Attributes
    ----------
    plan : SlabPlan
    capture : PixelGrid
        With so much around the frame as near things blur in from.
    slabs : tuple of Slab
        From near to far, and at last the world, where it can be seen apart and the film is not transparent.
    """

    plan: SlabPlan
    capture: PixelGrid
    slabs: tuple[Slab, ...]


def cut_steps(scene, job, grid, region, passes, path, done, share):
    """Steps that look at the scene's depth; returns the Cut by it, or None where the lens's data hold for all of it.

    Parameters
    ----------
    scene, job
    grid : PixelGrid
        Of the capture, as it is without slabs.
    region : (slice, slice)
        What of that is rendered.
    passes : KeptPasses
    path : Path
        A file to render to.
    done, share : float
        How much of the whole job is done before, and is done by this.
    """
    widest = looked_at(grid)
    look = PixelGrid(tuple(-(-n // EVERY_PX) for n in widest.shape_px), EVERY_PX * grid.pitch_um,
                     projection=grid.projection)
    with Journal() as journal:
        guard_render_state(scene, job, look, path, journal)
        for name, value in LOOK.items():
            journal.set(scene.cycles, name, value)
        layer = rendered_layer(scene)
        journal.set(layer, "samples", 0)  # none of its own
        name, colours = depth_pass(layer.name), [f"{layer.name}.Combined.{channel}" for channel in "RGB"]
        planes = yield from passes.planes(RenderPass(scene, "Looking at depth", done, share), path, {name, *colours},
                                          "look")
    plan, *whole_mm = plan_by(planar_depth_mm(planes[name] * M_TO_MM, job.lens, look), scene, job, grid,
                              np.mean([planes[colour] for colour in colours], axis=0))
    return _cut(scene, job.lens, plan, grid, region, *whole_mm) if plan.needed else None


def looked_at(grid):
    """What a look at depth shows: a capture with as much around the frame as slabs are ever given."""
    most_px = [max(margin, round(MOST_MARGIN * max(grid.frame_px))) for margin in grid.overscan_px]
    return PixelGrid.around_frame(grid.frame_px, grid.pitch_um, most_px, grid.projection)


def plan_by(depth_mm, scene, job, grid, light=None):
    """The SlabPlan by a look at depth, and (near_mm, far_mm) of each volume and of each closed body.

    Parameters
    ----------
    depth_mm : array (row, column)
        Of `looked_at(grid)`, by any resolution.
    scene, job
    grid : PixelGrid
        Of the capture, as it is without slabs.
    light : array (row, column), optional
        Of the same pixels: edges of lamps count more.
    """
    volumes_mm, bodies_mm = whole_depths_mm(scene, job.lens, looked_at(grid))
    plan = plan_slabs(depth_mm, looked_at(grid), job.lens, overscan_px=grid.overscan_px, others=job.others, light=light,
                      most_slabs=PREVIEW_SLABS if job.spectral.tier == "preview" else MOST_SLABS,
                      accuracy=job.options.depth_accuracy, whole_mm=volumes_mm, bodies_mm=bodies_mm)
    return plan, volumes_mm, bodies_mm


def _cut(scene, lens, plan, grid, region, volumes_mm, bodies_mm):
    world_apart = all(np.isfinite(far_mm) for _, far_mm in volumes_mm)
    capture = PixelGrid.around_frame(grid.frame_px, grid.pitch_um, plan.margin_px, grid.projection)
    camera, film = scene.camera.data, scene.render.film_transparent
    regions = [tuple(slice(part.start + most - margin, part.stop + most - 2 * overscan + margin)
                     for part, most, margin, overscan in zip(region, capture.overscan_px, margins, grid.overscan_px,
                                                             strict=True)) for margins in plan.margins_px]
    overlap_per_mm = OVERLAP_PX / blur_per_nearness_px(lens, grid.pitch_um)
    nears_mm = [camera.clip_start * M_TO_MM, *plan.borders_mm]
    fars_mm = [*(_far_mm(border_mm, volumes_mm, bodies_mm, overlap_per_mm) for border_mm in plan.borders_mm), np.inf]
    slabs = [Slab(near_mm / M_TO_MM, far_m, part, film or world_apart or far_m < camera.clip_end, True)
             for near_mm, far_mm, part in zip(nears_mm, fars_mm, regions, strict=True)
             if near_mm / M_TO_MM < (far_m := min(far_mm / M_TO_MM, camera.clip_end))]
    if world_apart and not film:
        slabs.append(Slab(*BEYOND_ALL_M, regions[-1], False, False))
    return Cut(plan, capture, tuple(slabs))


def _far_mm(border_mm, volumes_mm, bodies_mm, overlap_per_mm):
    """Where the slab before a border ends: a little behind it, where that cuts a closed body. The next slab shows the
    dark inside of the body there, and the outside covers it."""
    behind_mm = 1 / max(1 / border_mm - overlap_per_mm, 1 / BACKGROUND_MM)
    ends_mm = [min(far_mm, behind_mm) for near_mm, far_mm in bodies_mm if near_mm < border_mm < far_mm]
    volumes_begin_mm = [near_mm for near_mm, _ in volumes_mm if near_mm >= border_mm]
    return min([max(ends_mm, default=border_mm), *volumes_begin_mm])


def whole_slab(scene, region):
    """All that the scene's camera sees, in this region of the capture."""
    camera = scene.camera.data
    return Slab(camera.clip_start, camera.clip_end, region, scene.render.film_transparent, False)
