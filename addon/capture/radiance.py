"""The capture: scene -> spectral radiance, pass by pass, with the overscan that the lens needs."""

import math
from contextlib import ExitStack
from dataclasses import replace

import numpy as np

from lensfield.engine import SpectralImage
from lensfield.engine.depth.depth_range import (
    AUTO,
    blur_px,
    focus_in_capture,
    focus_range_px,
    focus_share,
    planar_depth_mm,
)
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.sampling import Sampling
from lensfield.engine.plan.options import DEFAULT_ACCURACY, ON
from lensfield.engine.runtime.files import temporary_folder
from lensfield.engine.runtime.scratch import zeros_stored_like
from lensfield.engine.simulation.prepare import Expected
from lensfield.engine.simulation.report_parts import SceneFacts
from lensfield.engine.spectral.wavelength_choice import FOREIGN_SURPRISE

from ..job.shown import write_growing
from ..job.steps import RenderPass, Work
from ..scene.render_state import rendered_layer, show_slab
from ..scene.traced_camera import trace_lens
from ..scene.undo import Journal
from ..scene.units import M_TO_MM, metres_per_unit
from .captured import ALPHA, BACKGROUND_M, DEPTH, Captured, planes_of
from .depth_behind_volumes import depth_behind_volumes
from .emitters import emitters_in
from .film_alpha import alpha_steps
from .known_depth import known_depth_m
from .layering import layered_radiance
from .light import GatheredLight
from .outside_sources import outside_steps
from .ready import LOOK_SHARE, planned_steps, sliced_steps
from .remarks import colour_remarks
from .sampled_passes import (
    DetailedPasses,
    SampledPasses,
    WholePasses,
    detail_times,
    shares_noise,
)
from .slabs import finer_region
from .truth import truth_steps

OPAQUE = 1 - 1e-5  # least alpha of an opaque pixel, by rounding


def capture(scene, job, result, share, expect=lambda expected: None):
    """Steps that render the scene's spectral radiance, up to a `share` of the complete job; returns a Captured.

    For a traced lens, it contains the film's irradiance on the frame's pixels. For another lens, `expect` is called
    with an `Expected` before the passes.
    """
    with temporary_folder() as folder, Journal() as journal, ExitStack() as alone:
        planned = yield from planned_steps(scene, job, result.files, folder, journal, alone)
        ready = yield from sliced_steps(planned, share, journal)
        stray, outside, uncounted = bool(job.stray.parts(job.options.accuracy or DEFAULT_ACCURACY)), None, ()
        if not job.traced:
            outside, uncounted = yield from outside_steps(ready, _rendered_grid(ready), stray)
        lights, sampled, captured = yield from _captured_steps(ready, outside, share, journal, expect)
        if unfocused := unfocused_light(ready, captured):
            ready = yield from sliced_steps(planned, share, journal, emitters=ready.emitters.together(unfocused))
            lights, sampled, captured = yield from _captured_steps(ready, outside, share, journal, expect)
        truth = yield from truth_steps(ready, [light.slab for light in lights], sampled.times, share)
    captured = replace(captured, outside=outside, truth=truth,
                       remarks=(*captured.remarks, *(uncounted if stray else ())))
    result.report.add(_facts(ready, lights, captured, sampled.text))
    return captured


def _captured_steps(ready, outside, share, journal, expect):
    """Steps that render all passes of a scene; returns a GatheredLight for each slab, the passes and a Captured."""
    sampled = _passes(ready, journal)
    if not ready.job.traced:
        expect(_expected(ready, outside, sampled.times))
    lights = yield from light_steps(ready, sampled, ready.capture_px, ready.slabs, share, journal)
    if ready.job.traced and ready.film:
        lights[0].alpha = yield from alpha_steps(ready, lights[0], share, journal)
    return lights, sampled, captured_from(ready, lights, ready.grid, ready.capture_px)


def _expected(ready, outside, times):
    """The Expected of the passes of a scene: with Sources outside the picture, or None; one pass divides its pixels
    into so many parts, down and across."""
    job, grid = ready.job, ready.grid
    if ready.cut:
        grid = replace(ready.capture_px, focal_mm=job.lens.capture_focal_length_mm)
    return Expected(Sampling(grid.on_sensor(), tuple(job.wavelengths_nm.tolist())), ready.grid, times, grid.across,
                    bool(ready.cut), outside, ready.needed_bytes)


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
                          focus_range_px(lens, capture.pitch_um)) for lens in job.lenses]
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
    depth_m = np.where(np.isfinite(depth_mm), depth_mm / M_TO_MM, BACKGROUND_M).astype(np.float32)
    planes = planes_of({DEPTH: depth_m, ALPHA: alpha if ready.film or holdouts else None})
    return Captured(radiance, planes, region and _mask(region, rendered, grid), layers, tuple(map(str, remarks)))


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
    """The plan, and results of the passes: how well spectra were predicted, and the frame's depths. Several lenses that
    share the capture have different depths in focus: it states none."""
    job, plan, cut = ready.job, ready.plan, ready.cut
    choice, far = plan.choice, () if job.traced else captured.scale_remarks(*job.lenses)
    depth = None if job.traced or job.others else captured.depth_check(job.lens)
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
        depth=depth, lens_warning=job.lens_warning,
        scene_remarks=[*map(str, ready.remarks), *captured.remarks, *ready.passes.remarks, *far],
        layers=_cut_text(cut, job.others) if cut else "", samples=samples, capture_peak_mb=ready.peak_mb,
        device=ready.device)


def _cut_text(cut, others):
    """The slabs in words; with the depths in focus, unless there are others of them, through other lenses."""
    columns = cut.capture.across
    text = cut.plan.cut_text if others else cut.plan.text
    return text + (f"; {columns} columns in each pixel, which share its samples" if columns > 1 else "")


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
