"""Slabs: ranges of depth that the camera's clipping renders separately, so that near objects do not hide far ones.

A depth pre-pass, small and with one sample, decides where to cut, and whether to cut at all, together with the scene's
emitters, which may be smaller than its pixels.
"""

from dataclasses import dataclass, replace

import numpy as np

from lensfield.engine.depth.depth_range import blur_per_nearness_px, planar_depth_mm
from lensfield.engine.depth.slabs import MOST_SLABS, SlabPlan, plan_slabs
from lensfield.engine.image.layers import BACKGROUND_MM
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens.iris import opening

from ..job.steps import RenderPass
from ..scene.bodies import uncut_depths_mm
from ..scene.render_state import guard_render_state, rendered_layer
from ..scene.undo import Journal
from ..scene.units import M_TO_MM, depth_pass_m, metres_per_unit
from ..scene.volumes import hide_volumes
from .light import depth_pass

PREVIEW_SLABS = 4
OVERLAP_PX = 0.5  # blur difference by which slabs overlap in a body that they cut
EVERY_PX = 4  # of the capture, for one pixel of the depth pre-pass
MOST_MARGIN = 0.5  # largest margin of slabs around the frame, in units of its longer side
LOOK = {"samples": 1, "max_bounces": 0, "use_adaptive_sampling": False, "use_denoising": False, "time_limit": 0.0}
BEYOND_ALL_UNITS = 1e9, 2e9  # clip distances at which the camera sees only the world


@dataclass(frozen=True)
class Slab:
    """The part of the scene that one render of a pass shows.

    Attributes
    ----------
    near_m, far_m : float
        Clip distances of the camera.
    region : (slice, slice)
        Rows and columns of the capture.
    transparent : bool
        Whether the film is transparent.
    narrows : bool
        Whether later passes may be limited to the part of the region that has content in the first.
    """

    near_m: float
    far_m: float
    region: tuple[slice, slice]
    transparent: bool
    narrows: bool

    @property
    def facts(self):
        """The values that identify the slab, in types that JSON supports."""
        return [self.near_m, self.far_m, [(side.start, side.stop) for side in self.region], self.transparent]

    def finer(self, times):
        """The slab for a capture with each pixel divided into `times` x `times`."""
        return replace(self, region=finer_region(self.region, times))

    def finer_across(self, columns):
        """The slab for a capture with each pixel divided into this many columns."""
        return replace(self, region=finer_region(self.region, 1, columns))

    def within(self, part):
        """The slab, limited to this part of its region."""
        return replace(self, region=tuple(slice(outer.start + inner.start, outer.start + inner.stop)
                                          for outer, inner in zip(self.region, part, strict=True)))


@dataclass(frozen=True)
class Cut:
    """The division of a capture into slabs.

    Attributes
    ----------
    plan : SlabPlan
    capture : PixelGrid
        With the margin around the frame that the blur of near objects needs.
    slabs : tuple of Slab
        From near to far; last the world, if it can be rendered separately and the film is not transparent.
    """

    plan: SlabPlan
    capture: PixelGrid
    slabs: tuple[Slab, ...]

    def coarser(self, times):
        """The cut for a capture with blocks of `times` x `times` pixels merged, which covers at least the same area."""
        fine, margin_px = self.capture, [-(-margin // times) for margin in self.capture.overscan_px]
        capture = fine.frame().coarser(times).with_overscan(margin_px)
        slabs = [replace(slab, region=tuple(
            slice((side.start - fine_margin) // times + margin, -(-(side.stop - fine_margin) // times) + margin)
            for side, fine_margin, margin in zip(slab.region, fine.overscan_px, margin_px, strict=True)))
            for slab in self.slabs]
        return Cut(self.plan, capture, tuple(slabs))

    def finer_across(self, columns):
        """The cut for a capture with each pixel divided into this many columns."""
        slabs = (slab.finer_across(columns) for slab in self.slabs)
        return Cut(self.plan, self.capture.finer_across(columns), tuple(slabs))


def cut_steps(scene, job, grid, region, tinting, sky, emitters, passes, path, fraction, share):
    """Steps of the depth pre-pass; returns the Cut, or None if the lens data hold at every depth in the scene.

    Parameters
    ----------
    scene, job
    grid : PixelGrid
        The capture without slabs.
    region : (slice, slice)
        The rendered part of `grid`.
    tinting, sky, emitters
        As in `plan_by`.
    passes : FinishedPasses
    path : Path
        A file to render to.
    fraction, share : float
        Fractions of the complete job: before this, and of this.
    """
    widest = looked_at(grid)
    shape_px = tuple(-(-n // EVERY_PX) for n in widest.shape_px)
    centre_px = [(centre + 0.5) * few / n - 0.5
                 for centre, few, n in zip(widest.centre_px, shape_px, widest.shape_px, strict=True)]
    look = PixelGrid(shape_px, EVERY_PX * grid.pitch_um, centre_px, projection=grid.projection, squeeze=grid.squeeze)
    with Journal() as journal:
        guard_render_state(scene, job, look, path, journal)
        for name, value in LOOK.items():
            journal.set(scene.cycles, name, value)
        layer = rendered_layer(scene)
        journal.set(layer, "samples", 0)  # no override of the scene's samples
        hide_volumes(scene, journal)
        name, colours = depth_pass(layer.name), [f"{layer.name}.Combined.{channel}" for channel in "RGB"]
        planes = yield from passes.planes(RenderPass(scene, "Rendering depth", fraction, share), path,
                                          {name, *colours}, "look")
    depth_mm = depth_pass_m(planes[name], metres_per_unit(scene)) * np.float32(M_TO_MM)
    plan, *uncut_mm = plan_by(planar_depth_mm(depth_mm, job.lens, look), scene, job, grid, tinting, sky, emitters,
                              np.mean([planes[colour] for colour in colours], axis=0))
    return _cut(scene, job.lens, plan, grid, region, *uncut_mm) if plan.needed else None


def looked_at(grid):
    """The area of the depth pre-pass: a capture with the largest margin around the frame that slabs can have."""
    most_px = [max(margin, round(MOST_MARGIN * max(grid.frame_px))) for margin in grid.overscan_px]
    return grid.with_overscan(most_px)


def plan_by(depth_mm, scene, job, grid, tinting, sky, emitters, light=None):
    """The SlabPlan for given depths, and (near_mm, far_mm) of each volume and of each closed body.

    Parameters
    ----------
    depth_mm : array (row, column)
        Over `looked_at(grid)`, at any resolution.
    scene, job
    grid : PixelGrid
        The capture without slabs.
    tinting : collection of str
        Names of the objects that tint light passing straight through them, from `tinting_objects`.
    sky : bool
        Whether the film shows light from the world. Otherwise nothing is visible, or hidden, at infinity.
    emitters : Emitters
        Lamps and the like, which the depths may miss.
    light : array (row, column), optional
        At the same pixels: edges of lamps have more weight.
    """
    widest = looked_at(grid)
    volumes_mm, bodies_mm = uncut_depths_mm(scene, job.lens, widest, tinting)
    if light is None:
        light = np.where(np.isinf(depth_mm) & (not sky), 0.0, 1.0)
    sighted = emitters.seen(replace(widest, focal_mm=job.lens.capture_focal_length_mm)).at_shape(
        widest.shape_px, depth_mm.shape)
    depth_mm, light = sighted.laid_over(depth_mm, light)
    empty = np.isinf(depth_mm) & (light <= 0) & (not sky and not volumes_mm)
    plan = plan_slabs(depth_mm, widest, job.lens, overscan_px=grid.overscan_px, others=job.others, light=light,
                      empty=empty, reach=max(opening(job.iris, lens).reach for lens in job.lenses),
                      most_slabs=PREVIEW_SLABS if job.spectral.tier == "preview" else MOST_SLABS,
                      accuracy=job.options.depth_accuracy, uncut_mm=volumes_mm, bodies_mm=bodies_mm)
    return plan, volumes_mm, bodies_mm


def _cut(scene, lens, plan, grid, region, volumes_mm, bodies_mm):
    """The Cut by a SlabPlan.

    grid            PixelGrid of the capture without slabs
    region          slices of its rows and columns that are captured
    capture         PixelGrid of the capture with slabs
    world_apart     whether the world can be rendered separately: no volume is endless
    start_m, end_m  clip distances of the scene's camera
    regions         for each slab, slices of rows and columns of `capture`
    nears_mm        near ends of the slabs, ascending
    fars_mm         their far ends, which may overlap the next slab
    """
    # the capture, and the region of each slab
    capture = grid.with_overscan(plan.margin_px)
    regions = [tuple(slice(part.start + most - margin, part.stop + most - 2 * overscan + margin)
                     for part, most, margin, overscan in zip(region, capture.overscan_px, margins, grid.overscan_px,
                                                             strict=True)) for margins in plan.margins_px]

    # the ends of the slabs
    start_m, end_m = _clipping_m(scene)
    overlap_per_mm = OVERLAP_PX / blur_per_nearness_px(lens, grid.pitch_um)
    nears_mm = [start_m * M_TO_MM, *plan.borders_mm]
    fars_mm = [*(_far_mm(border_mm, volumes_mm, bodies_mm, overlap_per_mm) for border_mm in plan.borders_mm), np.inf]

    # the slabs, without those beyond the camera's far end, and the world
    world_apart = all(np.isfinite(far_mm) for _, far_mm in volumes_mm)
    film, unit_m = scene.render.film_transparent, metres_per_unit(scene)
    slabs = [Slab(near_mm / M_TO_MM, far_m, part, bool(film or world_apart or far_m < end_m), True)
             for near_mm, far_mm, part in zip(nears_mm, fars_mm, regions, strict=True)
             if near_mm / M_TO_MM < (far_m := min(far_mm / M_TO_MM, end_m))]
    if world_apart and not film:
        slabs.append(Slab(*(units * unit_m for units in BEYOND_ALL_UNITS), regions[-1], False, False))
    return Cut(plan, capture, tuple(slabs))


def _far_mm(border_mm, volumes_mm, bodies_mm, overlap_per_mm):
    """The far end of the slab before a border: slightly behind the border if it cuts a closed body. There the next slab
    shows the dark inside of the body, and the outside covers it."""
    behind_mm = 1 / max(1 / border_mm - overlap_per_mm, 1 / BACKGROUND_MM)
    ends_mm = [min(far_mm, behind_mm) for near_mm, far_mm in bodies_mm if near_mm < border_mm < far_mm]
    volumes_begin_mm = [near_mm for near_mm, _ in volumes_mm if near_mm >= border_mm]
    return min([max(ends_mm, default=border_mm), *volumes_begin_mm])


def finer_region(region, times, across=1):
    """A region, as slices of rows and columns, with each pixel divided into `times` x `times`, and each of these into
    `across` columns."""
    return tuple(slice(parts * side.start, parts * side.stop)
                 for side, parts in zip(region, (times, times * across), strict=True))


def single_slab(scene, region):
    """The slab of everything that the camera sees in this region of the capture."""
    return Slab(*_clipping_m(scene), region, scene.render.film_transparent, False)


def _clipping_m(scene):
    """Clip distances of the scene's camera, in metres: (start, end)."""
    camera, unit_m = scene.camera.data, metres_per_unit(scene)
    return camera.clip_start * unit_m, camera.clip_end * unit_m
