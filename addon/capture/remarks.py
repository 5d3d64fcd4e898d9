"""Remarks on scene settings that a lens render ignores or treats differently, before the render and in its report.

Settings that have the same effect as in Blender get no remark.
"""

from dataclasses import dataclass

import numpy as np

from lensfield.engine.depth.depth_range import AUTO, OFF, blur_per_nearness_px
from lensfield.engine.rays.rings import in_metres
from lensfield.engine.runtime.errors import listed
from lensfield.engine.spectral.wavelength_choice import REFERENCE, STANDARD_COLOUR_ERROR

from ..scene import devices
from ..scene.camera import frame_px, matching_focal_length_mm, pixel_aspect
from ..scene.compositor import unreplaced_passes
from ..scene.instances import SHADED_TYPES, rendered_blocks, rendered_instances
from ..scene.motion import sees_camera, view_animated
from ..scene.render_state import effective_samples
from ..shading.lobes import MIRRORED, REFRACTED
from ..shading.node_paths import uses_window
from .unlayered import VOLUME, unlayered

MOST_NAMED = 3
MANY_SAMPLES, ENOUGH_SAMPLES = 1024, 256
ENGINES = {"BLENDER_EEVEE": "EEVEE", "BLENDER_EEVEE_NEXT": "EEVEE", "BLENDER_WORKBENCH": "Workbench"}
BLENDERS_FILTER = "BLACKMAN_HARRIS", 1.5  # a new scene's pixel filter and its width
SAME_VIEW = 0.02
SAME_RATIO = 1e-3
REMARK_SHARE = 0.01  # of the picture
UNLAYERED = {  # its name, its part of the picture, and the effect on that part
    REFRACTED: ("Glass", "is visible through it", "is blurred as if on its surface"),
    MIRRORED: ("Mirrors", "is reflected in them", "is blurred as if on their surface"),
    VOLUME: ("Volumes", "contains their light", "is blurred like the surface behind them")}
ROUND_BLUR = "a package without rays; out-of-focus light becomes round discs, by pupil and focal length"
MASK_BYTES, LARGE_MASKS_GB = 4, 2
PANES = "hide thin panes, including their tint, from the camera (Object > Visibility > Ray Visibility > Camera)"


@dataclass(frozen=True)
class Remark:
    """One setting whose effect differs from Blender's own render.

    Attributes
    ----------
    what, value : str
        The setting, as in Blender's panels, and its value.
    becomes : str
        Its effect here.
    remedy : str
        The remedy; "" for none.
    """

    what: str
    value: str
    becomes: str
    remedy: str = ""

    def __str__(self):
        return "; ".join(filter(None, (f"{self.what} {self.value}".strip() + f": {self.becomes}", self.remedy)))


def scene_remarks(scene, job):
    """Remarks on the scene at its current frame, with the job's view layer as the only one on: list of Remark."""
    return [*_of_engine(scene, job), *_of_device(scene, job), *_of_traced_lens(scene, job), *_of_reference(scene, job),
            *_of_rays(job), *_of_camera(scene, job), *_of_pixels(scene), *_of_masks(scene, job), *_left_out(scene, job)]


def depth_remarks(job, slabs):
    """Remarks on depths at which the lens data do not hold, by a SlabPlan from before the render: list of Remark."""
    check = slabs.check
    if check is None or check.outside_fraction < REMARK_SHARE:
        return []
    apart = (f"about {check.outside_fraction:.0%} of the picture is outside the in-focus range of "
             f"{in_metres(check.near_mm)} to {in_metres(check.far_mm)}")
    if job.depth == OFF:
        return [Remark("Depth", "", f"{apart}, and stays sharp", "focus with the camera's Depth of Field")]
    return [Remark("Depth", "", f"{apart}: {slabs.cut_text}")] if slabs.needed else []


def colour_remarks(plan):
    """Remarks on glass and volumes that differ visibly from an RGB render, by a ScenePlan: list of Remark."""
    apart = [each for each in plan.repeated if each.rgb_difference[0] >= STANDARD_COLOUR_ERROR]
    if not apart:
        return []
    (difference, power), more = apart[0].rgb_difference, len(apart) - MOST_NAMED
    way = f"through an optical depth of {power:.2g}" if apart[0].volume else f"after {power:g} crossings"
    return [Remark("Saturated Colours", ", ".join(each.place for each in apart[:MOST_NAMED])
                   + f" (and {more} more)" * (more > 0),
                   f"up to CIEDE2000 {difference:.1f} from an RGB render {way}: spectra absorb more light than RGB "
                   "values; physics, not an error")]


def scale_remarks(depth_mm, lenses, pitch_um):
    """A remark if the scene is so far away that the lenses show no visible blur, wherever they are focused.

    Beyond the distance at which the defocus of infinity is one pixel wide, the blur of two depths differs by less than
    a pixel. Rooms are often modelled several times larger than life.

    Parameters
    ----------
    depth_mm : array (row, column)
        Of the frame, along the axis; inf for the background, NaN where unknown.
    lenses : sequence of Lens
    pitch_um : float
    """
    finite_mm = np.asarray(depth_mm)[np.isfinite(depth_mm)]
    known = np.count_nonzero(~np.isnan(depth_mm))
    beyond_mm = max(blur_per_nearness_px(lens, pitch_um) for lens in lenses)
    shows = "this lens shows" if len(lenses) == 1 else "these lenses show"
    if finite_mm.size < REMARK_SHARE * max(known, 1) or np.mean(finite_mm < beyond_mm) > REMARK_SHARE:
        return []
    return [Remark("Unit Scale", "", f"most of the picture is about {in_metres(float(np.median(finite_mm)))} away; "
                   f"beyond {in_metres(beyond_mm)} {shows} no blur at any focus distance",
                   "if the scene is meant to be smaller, set Unit Scale in the scene properties")]


def unlayered_remarks(scene, job, capture):
    """Remarks on content that layers of depth would blur for a wrong distance, or not as the lens does, estimated
    before the render: generator. For a capture that several lenses share, they hold for all of these."""
    traced = ["Depth: Traced Lens renders it correctly"] if all(lens.prescription for lens in job.lenses) else []
    amount = "up to" if job.others else "about"
    for kind, content in unlayered(scene, job.lens, capture, job.others).items() if job.depth == AUTO else ():
        if content.share < REMARK_SHARE:
            continue
        what, part, becomes = UNLAYERED[kind]
        more = f" (and {len(content.names) - 1} more)" if len(content.names) > 1 else ""
        yield Remark(what, repr(content.names[0]) + more if content.names else "of the world",
                     f"{amount} {content.share:.0%} of the picture {part}, and {becomes}",
                     ", or ".join(traced + [PANES] * (kind == REFRACTED)))


def _of_engine(scene, job):
    engine, cycles = scene.render.engine, scene.cycles
    if engine != "CYCLES":
        yield Remark("Render Engine", ENGINES.get(engine, engine), "Cycles renders instead",
                     "check the scene in Cycles first")
    samples = effective_samples(scene)
    if samples >= MANY_SAMPLES:
        until = f", until the noise is below {cycles.adaptive_threshold:.2g}" if cycles.use_adaptive_sampling else ""
        yield Remark("Samples", str(samples), f"maximum per render{until}",
                     f"{ENOUGH_SAMPLES}{'' if job.denoises else ' with Denoise on'} suffice for most pictures, up to "
                     f"{samples // ENOUGH_SAMPLES} times as fast")
    if cycles.time_limit:
        yield Remark("Time Limit", f"{cycles.time_limit:g} s", "applies to each render")


def _of_device(scene, job):
    kind = devices.device_of(scene, job.device)
    if job.traced and kind not in devices.TRACING:
        yield Remark("Device", kind.upper(), "the CPU renders instead", "of GPUs, only OptiX traces lenses")
    elif kind == devices.CPU and scene.cycles.device == "GPU" and job.device == devices.AUTO:
        yield Remark("Device", "GPU Compute", "the CPU renders instead",
                     "install a driver for a GPU, or choose one in Preferences > System")
    elif kind != devices.CPU and scene.cycles.device == "GPU" and job.denoises and not scene.cycles.denoising_use_gpu:
        yield Remark("Denoise", "", "by the CPU, and the GPU waits", "turn on its Use GPU unless memory is short")


def _of_traced_lens(scene, job):
    if not job.traced:
        return
    yield Remark("Depth", "Traced Lens", "rays only, no diffraction; the scene's light is not stored for other lenses")
    if names := [block.name for block in rendered_blocks(scene) if uses_window(block)]:
        yield Remark("Window Coordinates", f"of {min(names)!r}", "Cycles does not compute them for a traced lens",
                     "set Depth to As Needed")


def _of_reference(scene, job):
    """Unphysical settings, which the Reference tier leaves out."""
    cycles = scene.cycles
    if job.spectral.tier != REFERENCE:
        return
    for name, value in (("Clamp Direct", cycles.sample_clamp_direct), ("Clamp Indirect", cycles.sample_clamp_indirect)):
        if value:
            yield Remark(name, f"{value:g}", "ignored in Reference")
    if cycles.use_denoising and not job.denoises:
        yield Remark("Denoise", "", "ignored in Reference", "turn on Lensfield's own Denoise")


def _of_rays(job):
    """A lens without rays, in a capture for this lens alone."""
    if job.depth == AUTO and not job.lens.prescription and not job.others:
        yield Remark("Lens", job.lens.name, ROUND_BLUR, "use a prescription for the lens's own blur")


def _of_camera(scene, job):
    camera = scene.camera.data if scene.camera and scene.camera.type == "CAMERA" else None
    if camera is None:
        return
    for word in job.ring_words:
        yield Remark("Focus and F-Stop", "", word)
    if camera.dof.use_dof and abs(camera.dof.aperture_ratio - 1) > SAME_RATIO:
        yield Remark("Aperture Ratio", f"{camera.dof.aperture_ratio:.3g}", "ignored")
    if job.traced and job.iris:
        yield Remark("Iris Blades", str(job.iris.blades),
                     "ignored by the traced lens: its stop is round, with the same area")
    if scene.render.use_motion_blur and (names := view_animated(camera)):
        yield Remark("Motion Blur", "", f"none from the camera's {listed(sorted(names), MOST_NAMED)}: each frame has "
                     "one view; moves of the camera and of objects are blurred")
    if names := sees_camera(obj for obj in scene.objects if not obj.hide_render):
        yield Remark("Camera Info", "", f"the geometry nodes of {listed(names, MOST_NAMED)} read the camera of the "
                     "capture, which shows more than the picture")
    aspect, squeeze = pixel_aspect(scene), job.lens.squeeze
    if abs(aspect / squeeze - 1) > SAME_VIEW:
        yield Remark("Pixel Aspect", f"{aspect:.3g}", f"the lens squeezes the picture by {squeeze:.3g}",
                     "press Match Camera to Lens")
    if camera.type != "PERSP":  # refused, or set by Match Camera to Lens
        return
    matching_mm = matching_focal_length_mm(scene, job.lens)
    if abs(matching_mm / camera.lens - 1) > SAME_VIEW:
        yield Remark("Focal Length", f"{camera.lens:.3g} mm", f"the lens's view matches {matching_mm:.3g} mm",
                     "press Match Camera to Lens, or set Field of View to Camera")


def _of_pixels(scene):
    cycles = scene.cycles
    kind, width_px = BLENDERS_FILTER
    if cycles.pixel_filter_type not in (kind, "BOX") or cycles.filter_width not in (width_px, 1.0):
        yield Remark("Pixel Filter", f"{cycles.filter_width:.3g} px",
                     "ignored; each pixel averages the light over its own square")


def _of_masks(scene, job):
    """Masks of many objects, which are in memory at once."""
    if "coverage" not in job.truth.split(","):
        return
    objects = len({instance.obj for instance in rendered_instances(scene) if instance.obj.type in SHADED_TYPES})
    rows, columns = frame_px(scene)
    size_gb = objects * rows * columns * MASK_BYTES / 1e9
    if size_gb > LARGE_MASKS_GB:
        yield Remark("Ground Truth", "Coverage",
                     f"the masks of {objects} objects take up to {size_gb:.1f} GB of memory",
                     "choose Collection Coverage or Material Coverage")


def _left_out(scene, job):
    render, sequences = scene.render, scene.sequence_editor
    if render.use_border and render.use_crop_to_border:
        yield Remark("Crop to Render Region", "", "ignored; the picture keeps its size and is black outside the region")
    if render.use_multiview:
        yield Remark("Stereoscopy", "", "ignored; one picture, from the camera itself")
    if render.use_freestyle:
        yield Remark("Freestyle", "", "ignored; no lines")
    if render.use_sequencer and sequences and len(sequences.strips):
        yield Remark("Sequencer", "", "ignored; the scene itself is rendered")
    if passes := unreplaced_passes(scene, job.truth.split(",")):
        yield Remark("Compositor", ", ".join(passes),
                     "not distorted; only Image, Alpha, Depth and passes of Ground Truth go through the lens",
                     "choose them in Ground Truth, or warp them with STMap Distort from the Lensfield node")
