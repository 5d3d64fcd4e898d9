"""What of a scene's settings takes no part in a lens render, or another one: said before it, and in its report.

What is honoured as Blender would is not among it.
"""

from dataclasses import dataclass

from ...engine.bake.rings import in_metres
from ...engine.image.depth_range import AUTO, OFF
from ..scene.camera import matching_focal_length_mm
from ..scene.compositor import unreplaced_passes
from ..scene.traced_camera import traces_on_device
from ..shading.lobes import MIRRORED, REFRACTED
from .unlayered import VOLUME, unlayered

MANY_SAMPLES, ENOUGH_SAMPLES = 1024, 256
ENGINES = {"BLENDER_EEVEE": "EEVEE", "BLENDER_EEVEE_NEXT": "EEVEE", "BLENDER_WORKBENCH": "Workbench"}
BLENDERS_FILTER = "BLACKMAN_HARRIS", 1.5, 1.0  # a new scene's pixel filter, its width, and Filter Glossy
SAME_VIEW = 0.02
SAME_RATIO = 1e-3
DEPTH_TOLD = 0.01  # of the picture
UNLAYERED = {  # what it is called, what of the picture it is, and what becomes of that
    REFRACTED: ("Glass", "is seen through it", "is blurred as if it were on it"),
    MIRRORED: ("Mirrors", "is reflected", "is blurred as if it were on them"),
    VOLUME: ("Volumes", "has light from within", "is blurred as what lies behind it")}
ROUND_BLUR = "of tables alone: what is out of focus is blurred in round discs, by pupil and focal length"
PANES = "take thin panes out of the camera's view (Object > Visibility > Ray Visibility > Camera), tint and all"


@dataclass(frozen=True)
class Remark:
    """One setting that does not hold as it would in Blender's own render.

    Attributes
    ----------
    what, value : str
        The setting, as Blender's panels call it.
    becomes : str
        What becomes of it.
    remedy : str
        What to do about that; "" for nothing.
    """

    what: str
    value: str
    becomes: str
    remedy: str = ""

    def __str__(self):
        return "; ".join(filter(None, (f"{self.what} {self.value}".strip() + f": {self.becomes}", self.remedy)))


def scene_remarks(scene, job):
    """Remarks on the scene at its frame, its only view layer for rendering being the job's: list of Remark."""
    return [*_of_engine(scene, job), *_of_traced_lens(scene, job), *_of_reference(scene, job),
            *_of_camera(scene, job), *_of_pixels(scene), *_left_out(scene)]


def depth_remarks(job, slabs):
    """Remarks on how far away what the picture shows is, by a SlabPlan from before it is rendered: list of Remark."""
    check = slabs.check
    if check is None or check.outside_fraction < DEPTH_TOLD:
        return []
    apart = (f"about {check.outside_fraction:.0%} of the picture is not at {in_metres(check.near_mm)} to "
             f"{in_metres(check.far_mm)}")
    if job.depth == OFF:
        return [Remark("Depth", "", f"{apart}, and comes out as sharp", "focus by the camera's Depth of Field")]
    return [Remark("Depth", "", f"{apart}: {slabs.cut_text}")] if slabs.needed else []


def unlayered_remarks(scene, job, capture):
    """Remarks on what layers of depth would blur by another distance than its own, or otherwise than the lens,
    estimated before it is rendered: generator."""
    if job.depth == AUTO and not job.lens.prescription:
        yield Remark("Lens", job.lens.name, ROUND_BLUR, "a prescription has rays")
    traced = ["Depth: Traced Lens renders it as it is"] if job.lens.prescription else []
    for kind, found in unlayered(scene, job.lens, capture).items() if job.depth == AUTO else ():
        if found.share < DEPTH_TOLD:
            continue
        what, part, becomes = UNLAYERED[kind]
        more = f" (and {len(found.names) - 1} more)" if len(found.names) > 1 else ""
        yield Remark(what, repr(found.names[0]) + more if found.names else "of the world",
                     f"about {found.share:.0%} of the picture {part}, and {becomes}",
                     ", or ".join(traced + [PANES] * (kind == REFRACTED)))


def _of_engine(scene, job):
    engine, cycles = scene.render.engine, scene.cycles
    if engine != "CYCLES":
        yield Remark("Render Engine", ENGINES.get(engine, engine), "Cycles renders instead",
                     "look at the scene in Cycles first")
    samples = next((layer.samples for layer in scene.view_layers if layer.use and layer.samples), cycles.samples)
    if samples >= MANY_SAMPLES:
        until = f", until the noise is below {cycles.adaptive_threshold:.2g}" if cycles.use_adaptive_sampling else ""
        yield Remark("Samples", str(samples), f"up to so many in each render{until}",
                     f"{ENOUGH_SAMPLES}{'' if job.denoise else ' with Denoise on'} do for most pictures, up to "
                     f"{samples // ENOUGH_SAMPLES} times as fast")
    if cycles.time_limit:
        yield Remark("Time Limit", f"{cycles.time_limit:g} s", "holds for each render")


def _of_traced_lens(scene, job):
    if not job.traced:
        return
    yield Remark("Depth", "Traced Lens", "rays alone, no diffraction; the scene's light is not kept for another lens")
    if not traces_on_device(scene):
        yield Remark("Device", "GPU Compute", "the CPU renders instead", "of GPUs only OptiX traces lenses")


def _of_reference(scene, job):
    """What is physical but in the Reference tier, where it takes no part."""
    cycles = scene.cycles
    if job.spectral.tier != "reference":
        return
    for name, value in (("Clamp Direct", cycles.sample_clamp_direct), ("Clamp Indirect", cycles.sample_clamp_indirect)):
        if value:
            yield Remark(name, f"{value:g}", "left out in Reference")
    if cycles.use_denoising and not job.denoise:
        yield Remark("Denoise", "", "left out in Reference", "Lensfield's own Denoise turns it on")


def _of_camera(scene, job):
    camera = scene.camera.data if scene.camera and scene.camera.type == "CAMERA" else None
    if camera is None:
        return
    for word in job.ring_words:
        yield Remark("Focus and F-Stop", "", word)
    if camera.dof.use_dof and abs(camera.dof.aperture_ratio - 1) > SAME_RATIO:
        yield Remark("Aperture Ratio", f"{camera.dof.aperture_ratio:.3g}", "left out")
    if job.traced and job.iris:
        yield Remark("Iris Blades", str(job.iris.blades), "left out by the traced lens, whose stop is round")
    if camera.type != "PERSP":  # refused, or made by Match Camera to Lens
        return
    matching_mm = matching_focal_length_mm(scene, job.lens)
    if abs(matching_mm / camera.lens - 1) > SAME_VIEW:
        yield Remark("Focal Length", f"{camera.lens:.3g} mm", f"the lens shows what {matching_mm:.3g} mm would",
                     "Match Camera to Lens, or set View to The Camera's")


def _of_pixels(scene):
    cycles = scene.cycles
    kind, width_px, glossy = BLENDERS_FILTER
    if cycles.pixel_filter_type not in (kind, "BOX") or cycles.filter_width not in (width_px, 1.0):
        yield Remark("Pixel Filter", f"{cycles.filter_width:.3g} px",
                     "left out; a pixel averages the light on its own square")
    if cycles.blur_glossy > glossy:
        yield Remark("Filter Glossy", f"{cycles.blur_glossy:.3g}", "left out")


def _left_out(scene):
    render, sequences = scene.render, scene.sequence_editor
    if render.use_border and render.use_crop_to_border:
        yield Remark("Crop to Render Region", "", "left out; the picture keeps its size, black outside the region")
    if render.use_multiview:
        yield Remark("Stereoscopy", "", "left out; one picture, from the camera itself")
    if render.use_freestyle:
        yield Remark("Freestyle", "", "left out; no lines")
    if render.use_sequencer and sequences and len(sequences.strips):
        yield Remark("Sequencer", "", "left out; the scene itself is rendered")
    if passes := unreplaced_passes(scene):
        yield Remark("Compositor", ", ".join(passes), "as the camera sees it; the lens has Image, Alpha and Depth",
                     "warp others by the Lensfield node's STMap Distort")
