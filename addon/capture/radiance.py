"""The capture: scene -> spectral radiance, pass by pass, with the overscan that the lens needs."""

import math
from contextlib import ExitStack
from dataclasses import dataclass, replace

import numpy as np

from ...engine import SpectralImage
from ...engine.depth.depth_range import (
    AUTO,
    blur_px,
    check_depth,
    focus_in_capture,
    focus_range_px,
    focus_share,
    planar_depth_mm,
)
from ...engine.field.overscan import columns_for_blur
from ...engine.image.layers import Layer, LayeredRadiance
from ...engine.image.pixel_grid import PixelGrid
from ...engine.image.sources import Sources
from ...engine.plan.options import DEFAULT_ACCURACY, ON
from ...engine.runtime.files import temporary_folder
from ...engine.runtime.memory import check_room, taken_bytes
from ...engine.runtime.scratch import SAMPLE_BYTES, check_disk, folder_if_large, zeros_stored_like
from ...engine.simulation.report_parts import SceneFacts
from ...engine.spectral.wavelength_choice import FOREIGN_SURPRISE
from ..job.shown import write_growing
from ..job.steps import RenderPass, Work
from ..job.targets import check_files
from ..scene.camera import capture_grid, captured_region, frame_grid, render_region
from ..scene.render_state import (
    clamps_of,
    divide_samples,
    go_to_frame,
    guard_render_state,
    rendered_layer,
    show_slab,
    stand_in_camera,
    turn_on_layer,
)
from ..scene.traced_camera import trace_lens
from ..scene.undo import Journal
from ..scene.units import M_TO_MM, metres_per_unit
from .bands import WAVELENGTHS_PER_PASS
from .depth_behind_volumes import depth_behind_volumes
from .emitters import emitters_in, emitters_of
from .empty_frame import empty_reasons
from .film_alpha import alpha_steps
from .finished_passes import FinishedPasses, alone_with_passes
from .known_depth import known_depth_m
from .layering import layered_radiance
from .light import GatheredLight
from .outside_sources import outside_steps
from .remarks import colour_remarks, scale_remarks, scene_remarks, unlayered_remarks
from .sampled_passes import (
    CONTROL_CUBES,
    MOST_FINE_PX,
    DetailedPasses,
    SampledPasses,
    WholePasses,
    detail_times,
    shares_noise,
)
from .scene_plan import plan_scene
from .sky import map_steps
from .slabs import cut_steps, finer_region, looked_at, single_slab

BACKGROUND_M = 1e10
OPAQUE = 1 - 1e-5  # least alpha of an opaque pixel, by rounding
LOOK_SHARE = 0.01  # of the capture's time, for the depth pre-pass
PASS_BYTES, LAMP_BYTES = 100, 40  # per pixel of a pass, in Cycles, in Blender and on reading; plus this for each lamp
DENOISE_BYTES, MOST_DENOISE = 800, 3e9  # for the denoiser: bytes per pixel, and their upper limit in total
DETAIL_BYTES = 2  # per part of a pixel and wavelength
PLANES_BYTES, MEGABYTE = 8, 1e6  # the first: per pixel, for each slab's planes in addition to its light
LEAST_LIT = 0.1  # of a picture's pixels: noise is as large in a file as in memory, and only black shrinks


@dataclass(frozen=True, eq=False)
class Captured:
    """The radiance of a scene from its passes, with depth and alpha.

    Attributes
    ----------
    radiance : SpectralImage
        Premultiplied by alpha.
    depth_m : float32 array (row, column)
        Along the optical axis, BACKGROUND_M for the background.
    alpha : float32 array (row, column) or None
        None if the film is not transparent and shows no holdouts.
    region : float32 array (row, column) or None
        1 in Blender's render region, the only part of the picture; 0.5 around it, where the lens may draw light from; 0
        elsewhere. None without a render region.
    layers : LayeredRadiance or None
        The radiance in layers of depth; None if the lens data hold at all depths, or if layers were not requested.
    remarks : tuple of str
        Remarks on the scene's contents, shared by all frames of this capture.
    outside : Sources or None
        Sources of stray light that the radiance does not contain; None if they are not known.
    """

    radiance: SpectralImage
    depth_m: np.ndarray
    alpha: np.ndarray | None
    region: np.ndarray | None
    layers: LayeredRadiance | None = None
    remarks: tuple[str, ...] = ()
    outside: Sources | None = None

    def depth_check(self, lens):
        """How much of the frame is outside the depths at which a lens's data hold: DepthCheck."""
        return check_depth(self._frame_mm(), lens, self.radiance.pitch_um, empty=self._frame(self._empty),
                           light=self._frame(self.radiance.cube.mean(axis=0)))

    def scale_remarks(self, lens):
        """The `scale_remarks` for the frame and a lens: tuple of str."""
        depth_mm = self._frame_mm()
        depth_mm = np.where(depth_mm < BACKGROUND_M * M_TO_MM, depth_mm, np.inf)
        return tuple(map(str, scale_remarks(depth_mm, lens, self.radiance.pitch_um)))

    @property
    def _empty(self):
        """The pixels of the background without light."""
        background = self.depth_m >= BACKGROUND_M
        return background & ~self.radiance.cube.any(axis=0) if background.any() else background

    def _frame_mm(self):
        return self._frame(self.depth_m) * M_TO_MM

    def _frame(self, plane):
        """A plane's values at the pixels of the frame, or only of the render region."""
        (top, left), (rows, columns) = self.radiance.overscan_px, self.radiance.frame_px
        frame = slice(top, top + rows), slice(left, left + columns)
        return plane[frame][... if self.region is None else self.region[frame] == 1]

    def cut(self, planes):
        """Planes (..., row, column) of the frame, black outside the render region."""
        if self.region is None:
            return planes
        (top, left), (rows, columns) = self.radiance.overscan_px, self.radiance.frame_px
        return planes * (self.region[top:top + rows, left:left + columns] == 1)

    def cut_picture(self, picture):
        """A picture (row, column, 3) of the frame, black outside the render region."""
        return np.moveaxis(self.cut(np.moveaxis(picture, -1, 0)), 0, -1)


def room_for_capture(scene, job, grid, plan, slabs=()):
    """The memory that a capture needs in addition to the scene: a pass, control variates, and all light so far.

    Parameters
    ----------
    scene, job
    grid : PixelGrid
        Of the capture.
    plan : ScenePlan
    slabs : sequence of Slab
        Empty until they are known.

    Returns
    -------
    float, Path or None
        Bytes of memory; and, if the light would need too much of it, the folder for the light's scratch files.

    Raises
    ------
    InputError
        Not enough memory is free, or too little disk space for the least that the light needs.
    """
    pixels, planes = math.prod(grid.shape_px), job.wavelengths_nm.size
    gathered_px = sum(math.prod(side.stop - side.start for side in slab.region) for slab in slabs) or pixels
    lamps = len(plan.lamps)
    control_planes = CONTROL_CUBES * WAVELENGTHS_PER_PASS * lamps if shares_noise(scene, job, plan) else 0
    scratch = folder_if_large((planes + control_planes, gathered_px), job.output_folder)
    light_bytes = 0 if scratch else SAMPLE_BYTES * planes
    control_bytes = 0 if scratch else SAMPLE_BYTES * control_planes
    flat_bytes = light_bytes * pixels // grid.across if len(slabs) > 1 else 0  # the pinhole's view, after the passes
    times = detail_times(scene, job, pixels)
    needed = (gathered_px * (light_bytes + control_bytes + PLANES_BYTES) + detail_bytes(gathered_px, times)
              + max(pass_bytes(times**2 * pixels, lamps, job.denoises), flat_bytes))
    check_room(f"scene {scene.name!r}", needed, "render a smaller picture, or fewer wavelengths")
    if scratch:
        pictures = 2 + (len(slabs) > 1)  # the farthest slab's light, the irradiance, and a pinhole's view of the slabs
        check_disk(scratch, "scratch", SAMPLE_BYTES * (pictures * planes * pixels + control_planes * gathered_px))
    return needed, scratch


def check_room_for_light(scene, job, grid):
    """Raise an InputError if the disk is too full even for the least that the light takes there.

    Parameters
    ----------
    scene, job
    grid : PixelGrid
        Of the capture.
    """
    region = render_region(scene)
    lit_px = math.prod(side.stop - side.start for side in region) if region else math.prod(grid.shape_px)
    light_bytes = SAMPLE_BYTES * job.wavelengths_nm.size * lit_px
    check_disk(job.output_folder, "least size of the light", LEAST_LIT * light_bytes)


def layer_columns(job, capture):
    """Columns of layers in a column of the sensor, for a capture in the sensor's pixels: 1 in Preview, and fewer for
    large pictures."""
    columns = 1 if job.spectral.tier == "preview" else columns_for_blur(job.lens)
    while columns > 1 and columns * math.prod(capture.shape_px) > MOST_FINE_PX:
        columns //= 2
    return columns


def detail_bytes(pixels, times):
    """Bytes of the detail of this many pixels; 0 for whole pixels."""
    return DETAIL_BYTES * WAVELENGTHS_PER_PASS * pixels * times**2 if times > 1 else 0


def pass_bytes(pixels, lamps, denoise):
    """Bytes that a pass of this many pixels needs in Cycles, in Blender, and on reading."""
    denoiser = min(DENOISE_BYTES * pixels, MOST_DENOISE) if denoise else 0
    return pixels * (PASS_BYTES + LAMP_BYTES * lamps) + denoiser


def job_grid(scene, job):
    """The pixels that Cycles renders of the scene's current frame: of a capture or, for a traced lens, of the film."""
    if job.traced:
        return frame_grid(scene, job.lens)
    return capture_grid(scene, job.lens, job.wavelengths_nm, job.options, job.room, job.others)


def capture(scene, job, result, share):
    """Steps that render the scene's spectral radiance, up to a `share` of the complete job; returns a Captured.

    For a traced lens, it contains the film's irradiance on the frame's pixels.
    """
    with temporary_folder() as folder, Journal() as journal, ExitStack() as alone:
        ready = yield from ready_steps(scene, job, result.files, share, folder, journal, alone)
        stray, outside, uncounted = bool(job.stray.parts(job.options.accuracy or DEFAULT_ACCURACY)), None, ()
        if not job.traced:
            outside, uncounted = yield from outside_steps(ready, _rendered_grid(ready), stray)
        lights, sampled, captured = yield from _captured_steps(ready, share, journal)
        if unfocused := unfocused_light(ready, captured):
            ready = yield from sliced_steps(ready.with_emitters(unfocused), share, journal)
            lights, sampled, captured = yield from _captured_steps(ready, share, journal)
    captured = replace(captured, outside=outside, remarks=(*captured.remarks, *(uncounted if stray else ())))
    result.report.add(_facts(ready, lights, captured, sampled.text))
    return captured


def _captured_steps(ready, share, journal):
    """Steps that render all passes of a scene; returns a GatheredLight for each slab, the passes and a Captured."""
    sampled = _passes(ready, journal)
    lights = yield from light_steps(ready, sampled, ready.capture_px, ready.slabs, share, journal)
    if ready.job.traced and ready.film:
        lights[0].alpha = yield from alpha_steps(ready, lights[0], share, journal)
    return lights, sampled, captured_from(ready, lights, ready.grid, ready.capture_px)


def unfocused_light(ready, captured):
    """The out-of-focus light of a Captured without layers, as Emitters; None if it is within the accuracy, or allowed.

    It is too small for the look at depth, and not known as an emitter.
    """
    job, radiance, accuracy = ready.job, captured.radiance, ready.job.options.depth_accuracy
    if ready.cut or job.depth != AUTO:
        return None
    capture = replace(radiance.grid, focal_mm=radiance.focal_mm)
    planar_mm = np.where(captured.depth_m < BACKGROUND_M, captured.depth_m * M_TO_MM, np.inf)
    rows, columns = np.indices(capture.shape_px, sparse=True)
    shares = [focus_share(blur_px(lens, capture.pitch_um, planar_mm, focus_in_capture(lens, capture, rows, columns)),
                          focus_range_px(lens, capture.pitch_um)) for lens in (job.lens, *job.others)]
    spread = 1 - np.min(shares, axis=0)
    light = np.nan_to_num(np.maximum(radiance.cube.mean(axis=0), 0), posinf=0.0)  # without fireflies
    if np.sum(spread * light) <= accuracy * light.sum():
        return None
    return emitters_in(radiance, planar_mm, (spread > accuracy) & (light > 0))


def _rendered_grid(ready):
    """The pixels that the radiance contains: a PixelGrid, with the focal length of the capture."""
    grid, (rows, columns) = ready.grid, ready.rendered
    return replace(grid, shape_px=(rows.stop - rows.start, columns.stop - columns.start), overscan_px=(0, 0),
                   centre_px=(grid.centre_px[0] - rows.start, grid.centre_px[1] - columns.start),
                   focal_mm=ready.job.lens.capture_focal_length_mm)


@dataclass(frozen=True, eq=False)
class Ready:
    """A scene that is ready for its passes: planned, substituted, cut into slabs, and guarded by a journal.

    Attributes
    ----------
    scene, job, plan, substitution, cut, passes
    grid, capture_px : PixelGrid
        The picture's capture; and, with slabs, the larger one that the blur of near objects needs, for a lens with a
        squeeze in finer columns.
    slabs : tuple of Slab
    group_names : list of str
        Of the light groups.
    clamps : dict
    path : Path
        The file that a render writes.
    scratch : Path or None
        The folder for the light's scratch files.
    region, rendered : (slice, slice)
        Blender's render region in the frame, or None; and the rows and columns of the capture that it takes.
    empty : EmptyReasons
    emitters : Emitters or None
        None until the scene is cut.
    exposure : float
    film : bool
        Whether the film is transparent.
    remarks, of_capture : list
    peak_mb : float
    """

    scene: object
    job: object
    plan: object
    substitution: object
    cut: object
    passes: FinishedPasses
    grid: PixelGrid
    capture_px: PixelGrid
    slabs: tuple
    group_names: list
    clamps: dict
    path: object
    scratch: object
    region: object
    rendered: tuple
    empty: object
    emitters: object
    exposure: float
    film: bool
    remarks: list
    of_capture: list
    peak_mb: float

    @property
    def sky(self):
        """Whether the film shows light from the world."""
        return self.empty.sky and not self.film

    def with_emitters(self, more):
        """The same scene with more Emitters, to be cut anew."""
        return replace(self, emitters=self.emitters.together(more))


def ready_steps(scene, job, files, share, folder, journal, alone, times=1):
    """Steps that prepare a scene for its passes; returns a Ready. The parameters are as for the two below."""
    planned = yield from planned_steps(scene, job, files, folder, journal, alone, times)
    return (yield from sliced_steps(planned, share, journal, times))


def planned_steps(scene, job, files, folder, journal, alone, times=1):
    """Steps that plan a scene's passes and substitute its materials; returns a Ready that is not cut into slabs.

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
    ready = Ready(scene, job, plan, substitution, None, passes, grid, grid, (single_slab(scene, rendered),), names,
                  clamps_of(scene), folder / "pass.exr", None, region, rendered, empty, None, exposure, film, remarks,
                  of_capture, 0.0)
    yield from map_steps(ready, journal)
    return ready


def sliced_steps(planned, share, journal, times=1):
    """Steps that cut a planned scene into slabs, if its depth requires it, and guard its render state; returns a Ready.

    Parameters
    ----------
    planned : Ready
    share : float
        The capture's part of the complete job.
    journal : Journal
    times : int
        Parts of a pixel, down and across, in the finest pixels to be captured: the scene is cut for these.
    """
    scene, job, plan, grid, cut = planned.scene, planned.job, planned.plan, planned.grid, None
    emitters = planned.emitters or (None if job.traced else _emitters(planned))
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
    capture_px, slabs = (cut.capture, cut.slabs) if cut else (grid, planned.slabs)
    guard_render_state(scene, job, capture_px, planned.path, journal)
    planned.substitution.place_window(capture_px)
    needed_bytes, scratch = room_for_capture(scene, job, capture_px.finer(times), plan,
                                             [slab.finer(times) for slab in slabs])
    return replace(planned, emitters=emitters, cut=cut, capture_px=capture_px, slabs=slabs, scratch=scratch,
                   peak_mb=(taken_bytes() + needed_bytes) / MEGABYTE)


def _emitters(planned):
    """The Emitters of a planned scene."""
    job, substitution = planned.job, planned.substitution
    return emitters_of(planned.scene, lambda block: substitution.emission_at(block, job.wavelengths_nm))


def _passes(ready, journal):
    """The passes of a capture, which share their noise if possible.

    Several complete passes share it in whole pixels, so only one of them, or an explicit request, is divided.
    """
    scene, job, plan, count = ready.scene, ready.job, ready.plan, len(ready.plan.bands)
    times = detail_times(scene, job, math.prod(ready.capture_px.shape_px))
    if not shares_noise(scene, job, plan):
        of_all, divided = (ready.passes, ready.path, count), times > 1 and (count == 1 or job.options.detail == ON)
        return DetailedPasses(*of_all, scene, ready.capture_px, times) if divided else WholePasses(*of_all)
    return SampledPasses(ready.passes, ready.path, count, scene, ready.scratch, journal, job.denoises,
                         ready.capture_px, times)


def light_steps(ready, sampled, capture_px, slabs, share, journal):
    """Steps that render all passes of all slabs; returns a GatheredLight for each slab.

    Parameters
    ----------
    ready : Ready
    sampled : WholePasses
    capture_px : PixelGrid
    slabs : sequence of Slab
        Of these pixels.
    share : float
        The capture's part of the complete job.
    journal : Journal
    """
    scene, job, plan, cut = ready.scene, ready.job, ready.plan, ready.cut
    lights = [GatheredLight(plan, rendered_layer(scene).name, ready.group_names, slab, ready.scratch,
                            metres_per_unit(scene)) for slab in slabs]
    fraction, share = LOOK_SHARE * share, (1 - LOOK_SHARE) * share / len(lights)
    weights = np.arange(len(plan.bands)) == sampled.order[-1] if job.traced else plan.alpha_weights()
    for turn, index in enumerate(sampled.order, 1):
        band = plan.bands[index]
        ready.substitution.set_wavelengths(band, plan.dispersive)
        for name, clamp in ready.clamps.items():
            journal.set(scene.cycles, name, clamp * ready.substitution.brightest(band) if job.clamp else 0.0)
        if job.traced:
            trace_lens(scene, job.lens, ready.grid, band[0], journal)
        step = share * sampled.share(index)
        for number, light in enumerate(lights, 1):
            if not light.is_spare(lights):
                show_slab(scene, light.slab, capture_px, journal)
                label = _label(turn, len(plan.bands), band, f"Layer {number} of {len(lights)}" if cut else "")
                light.add(index, (yield from sampled.light(index, light, RenderPass(scene, label, fraction, step))),
                          float(weights[index]))
            fraction += step
        if job.picture:
            complete = turn == len(plan.bands)
            yield Work(lambda _, complete=complete: _show(complete, ready, lights, capture_px),
                       "Updating the picture", fraction)
    lights = [light for light in lights if not light.is_spare(lights)]
    yield from depth_behind_volumes(ready, lights, capture_px, fraction)
    return lights


def captured_from(ready, lights, grid, capture_px):
    """The Captured of the light of all slabs.

    Parameters
    ----------
    ready : Ready
    lights : sequence of GatheredLight
    grid, capture_px : PixelGrid
        As in `Ready`, or both with each pixel divided into as many rows as columns.
    """
    job, times, sensor_px = ready.job, grid.shape_px[0] // ready.grid.shape_px[0], capture_px.on_sensor()
    region, rendered = (side and finer_region(side, times) for side in (ready.region, ready.rendered))
    margin = [overscan - n for overscan, n in zip(sensor_px.overscan_px, grid.overscan_px, strict=True)]
    inside = tuple(slice(rim, rim + n) for rim, n in zip(margin, grid.shape_px, strict=True))
    if not job.traced:
        sightings = ready.emitters.seen(replace(capture_px, focal_mm=job.lens.capture_focal_length_mm))
        cosine = planar_depth_mm(np.ones(capture_px.shape_px, np.float32), job.lens, capture_px)
        for light in lights:
            light.depth_m = known_depth_m(light, sightings, ready.sky, cosine)
    nearest_m = _nearest_m(lights, capture_px)[:, capture_px.across // 2::capture_px.across]
    depth_mm = planar_depth_mm(nearest_m * M_TO_MM, job.lens, sensor_px)[inside]
    layers = layered_radiance(lights, job.lens, capture_px, job.wavelengths_nm, ready.exposure,
                              job.others) if ready.cut else None
    if layers:
        cropped = layers.cropped(margin)
        radiance, alpha = cropped.flat(), cropped.flat_alpha()
    else:
        cube, alpha = (_placed(planes, rendered, grid) for planes in (lights[0].radiance(), lights[0].alpha))
        detail = lights[0].detail and lights[0].detail.placed(*rendered, grid.shape_px)
        radiance = SpectralImage(cube, job.wavelengths_nm, grid, focal_mm=job.lens.capture_focal_length_mm,
                                 exposure=ready.exposure, detail=detail)
    picture = _picture_part(region, grid)
    opaque = not job.traced and len(lights) == 1 and not lights[0].slab.transparent
    holdouts = opaque and np.any(alpha[picture] < OPAQUE)  # nothing else opens an opaque film
    remarks = [*ready.of_capture, *colour_remarks(ready.plan), *ready.empty.after_render(
        not np.any(radiance.cube[(..., *picture)]), ready.film and not np.any(alpha[picture]))]
    return Captured(radiance, np.where(np.isfinite(depth_mm), depth_mm / M_TO_MM, BACKGROUND_M).astype(np.float32),
                    alpha if ready.film or holdouts else None, region and _mask(region, rendered, grid), layers,
                    tuple(map(str, remarks)))


def _nearest_m(lights, capture):
    """Depth of the nearest surface in any slab, by one sample of each pixel, in metres: array (row, column)."""
    depth_m = np.full(capture.shape_px, BACKGROUND_M, np.float32)
    for light in lights:
        part = depth_m[light.slab.region]
        np.minimum(part, light.depth_m, out=part)
    return depth_m


def _placed(planes, region, grid):
    """Planes (..., row, column) of a region, padded with zeros to the complete capture."""
    if planes.shape[-2:] == grid.shape_px:
        return planes
    padded = zeros_stored_like(planes, (*planes.shape[:-2], *grid.shape_px))
    padded[(..., *region)] = planes
    return padded


def _show(complete, ready, lights, capture_px):
    """Write a PNG of the frame after a pass, as the capture shows it."""
    layers = [Layer(light.cube, light.alpha, light.depth_m * M_TO_MM, tuple(side.start for side in light.slab.region))
              for light in lights if not light.is_spare(lights)]
    layered = LayeredRadiance(layers, ready.plan.choice.output_nm, capture_px, exposure=ready.exposure)
    write_growing(layered.cropped(layered.sampling.grid.overscan_px).flat(), complete, ready.job)


def _facts(ready, lights, captured, samples):
    """The plan, and results of the passes: how well spectra were predicted, and the frame's depths."""
    job, plan, cut = ready.job, ready.plan, ready.cut
    choice, far = plan.choice, () if job.traced else captured.scale_remarks(job.lens)
    surprise = choice.surprise(np.concatenate([light.blocks() for light in lights], axis=1))
    foreign = bool(surprise > FOREIGN_SURPRISE)
    return SceneFacts(
        passes=len(plan.bands), wavelengths_per_pass=plan.per_pass,
        rendered_nm=[round(float(nm), 3) for nm in choice.nodes_nm],
        wavelengths_nm=[float(nm) for nm in choice.output_nm], scene_plan=plan.text,
        lamps=[lamp.name for lamp in plan.lamps], predicted_colour_error=choice.colour_error,
        predicted_sensor_error=choice.sensor_error, predicted_spectral_error=choice.spectral_error,
        spectral_surprise=float(surprise), foreign_spectra=foreign,
        estimated_colour_error=choice.colour_error * (float(surprise) if foreign else 1),
        rgb_difference=plan.repeated[0].rgb_difference[0] if plan.repeated else 0.0,
        depth=None if job.traced else captured.depth_check(job.lens), lens_warning=job.lens_warning,
        scene_remarks=[*map(str, ready.remarks), *captured.remarks, *ready.passes.remarks, *far],
        layers=_cut_text(cut) if cut else "", samples=samples, capture_peak_mb=ready.peak_mb)


def _cut_text(cut):
    columns = cut.capture.across
    return cut.plan.text + (f"; {columns} columns in each pixel, which share its samples" if columns > 1 else "")


def _picture_part(region, grid):
    """Rows and columns of the capture that the picture shows: the frame, or Blender's render region in it."""
    region = region or tuple(slice(0, n) for n in grid.frame_px)
    return tuple(slice(side.start + margin, side.stop + margin)
                 for side, margin in zip(region, grid.overscan_px, strict=True))


def _mask(region, rendered, grid):
    """The array `Captured.region`, from slices of the frame and slices of the capture."""
    mask = np.zeros(grid.shape_px, np.float32)
    mask[rendered] = 0.5
    mask[_picture_part(region, grid)] = 1
    return mask


def _label(turn, passes, band, layer):
    """The label of a pass, counted from 1, or of a layer of depth in it; a single pass of layers is not numbered."""
    if layer and passes == 1:
        return layer
    return f"{', '.join(filter(None, (f'Pass {turn} of {passes}', layer.lower())))}: {_span(band)} nm"


def _span(band):
    return f"{band[0]:.0f}" if band[0] == band[-1] else f"{band[-1]:.0f} to {band[0]:.0f}"
