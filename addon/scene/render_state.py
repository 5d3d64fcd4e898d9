"""The render state: all settings that would alter the radiance, set for the passes and restored by the journal."""

import math

import bpy

from .camera import set_up_capture
from .units import metres_per_unit

RENDER = {"engine": "CYCLES", "use_border": False, "use_crop_to_border": False, "use_compositing": False,
          "use_sequencer": False, "use_multiview": False, "use_freestyle": False,
          "use_overwrite": True, "use_placeholder": False, "use_file_extension": False, "use_persistent_data": True,
          "use_single_layer": False, "use_stamp": False, "resolution_percentage": 100}
CYCLES = {"film_exposure": 1.0, "pixel_filter_type": "BOX"}
CLAMPS = "sample_clamp_direct", "sample_clamp_indirect"
LEAST_THRESHOLD, MIN_SAMPLES, MIN_SAMPLES_POWER = 1e-3, 16, -0.3  # of Cycles' own choices for adaptive sampling
FIRST_CROSSINGS = 16  # transparent surfaces that every ray crosses
HALF = 0.5  # of a pixel: protects the region from rounding
IMAGE = {"media_type": "MULTI_LAYER_IMAGE", "file_format": "OPEN_EXR_MULTILAYER", "color_depth": "32",
         "exr_codec": "NONE",  # files are read only once, and noise compresses badly
         "use_exr_interleave": True}  # Blender cannot write several parts if pixels are not square


def go_to_frame(scene, frame, journal):
    """Evaluate the scene at a frame, or between two, as a render would: its animation, and the camera that a marker
    binds."""
    if bpy.context.window:  # animation reaches the data-blocks to be copied only in the window's scene,
        journal.set(bpy.context.window, "scene", scene)
        bpy.context.evaluated_depsgraph_get()  # and in 4.5 only once that has been evaluated
    camera, current, subframe = scene.camera, scene.frame_current, scene.frame_subframe

    def go_back():
        scene.frame_set(current, subframe=subframe)
        scene.camera = camera

    journal.on_exit(go_back)
    first = math.floor(frame)
    scene.frame_set(first, subframe=frame - first)


def turn_on_layer(scene, name, journal):
    """Render only this view layer; without a name, change nothing."""
    for layer in scene.view_layers if name else ():
        journal.set(layer, "use", layer.name == name)


def rendered_layer(scene):
    """The only view layer that is on for rendering."""
    return next(layer for layer in scene.view_layers if layer.use)


def rendered_world(scene):
    """The world of the rendered view layer, or None."""
    return rendered_layer(scene).world_override or scene.world


def stand_in_camera(scene, journal):
    """Let a copy of the camera's data be set up for all renders: another copy would take Cycles longer to read."""
    original = scene.camera.data
    camera = journal.stand_in(original)
    camera.animation_data_clear()
    camera.dof.use_dof = False  # the lens adds the blur
    _keep_projections(camera, original, journal)


def _keep_projections(camera, original, journal):
    """Let UV Project modifiers project the view of the original camera data instead of the view of a capture."""
    projectors = [projector for obj in bpy.data.objects for modifier in obj.modifiers if modifier.type == "UV_PROJECT"
                  for projector in modifier.projectors if projector.object and projector.object.data == camera]
    for projector in projectors:
        with_original = projector.object.copy()
        with_original.data = original
        journal.on_exit(lambda spare=with_original: bpy.data.objects.remove(spare))
        journal.set(projector, "object", with_original)


def guard_render_state(scene, job, capture, path, journal):
    """Make all settings for the passes; each pass is written to `path`, a multilayer EXR of the light and its depth.

    The scene's camera is from `stand_in_camera`.
    """
    rows, columns = capture.shape_px
    size = {"resolution_y": rows, "resolution_x": columns,
            "pixel_aspect_x": max(1.0, capture.squeeze), "pixel_aspect_y": max(1.0, 1 / capture.squeeze)}
    for name, value in (RENDER | size | {"filepath": str(path)}).items():
        journal.set(scene.render, name, value)
    glass = scene.cycles.film_transparent_glass and scene.render.film_transparent
    for name, value in (CYCLES | {"use_denoising": job.denoises, "film_transparent_glass": glass,
                                  "min_transparent_bounces": _least_crossings(scene.cycles)}).items():
        journal.set(scene.cycles, name, value)
    layer = rendered_layer(scene)
    for name in (p.identifier for p in layer.bl_rna.properties if p.identifier.startswith("use_pass_")):
        journal.set(layer, name, name in ("use_pass_combined", "use_pass_z"))
    _guard_format(scene.render.image_settings, journal)
    set_up_capture(scene.camera.data, job.lens, capture, journal)


def _least_crossings(cycles):
    """Transparent surfaces that no ray ends at by chance: Cycles would record the depth of such a surface, even of a
    clear one."""
    return max(cycles.min_transparent_bounces, min(cycles.transparent_max_bounces, FIRST_CROSSINGS))


def clamps_of(scene):
    """The scene's clamps by name, which limit the mean of red, green and blue in each sample; 0 for none.

    The same values hold for passes: light of colour 1 and strength 1 is 1 there, as in Blender's own renders.
    """
    return {name: getattr(scene.cycles, name) for name in CLAMPS}


def effective_samples(scene):
    """Samples of a render: as in the scene, unless the rendered view layer, if any is on, overrides them."""
    cycles, of_layer = scene.cycles, next((layer.samples for layer in scene.view_layers if layer.use), 0)
    if not of_layer or cycles.use_layer_samples == "IGNORE":
        return cycles.samples
    return min(of_layer, cycles.samples) if cycles.use_layer_samples == "BOUNDED" else of_layer


def show_samples(scene, first, last, adaptive, journal):
    """Limit the render of a guarded scene to the samples from `first` to before `last`."""
    for name, value in (("use_sample_subset", True), ("sample_offset", first), ("sample_subset_length", last - first),
                        ("use_adaptive_sampling", adaptive)):
        journal.set(scene.cycles, name, value)
    read_again(scene)


def divide_samples(scene, columns, journal):
    """Let pixels that are divided into columns have the samples and the noise of the undivided ones."""
    journal.set(scene.cycles, "samples", -(-effective_samples(scene) // columns))
    journal.set(rendered_layer(scene), "samples", 0)  # no override of the scene's samples
    if scene.cycles.use_adaptive_sampling:
        show_noise(scene, columns**0.5, journal)


def show_noise(scene, times, journal):
    """Let adaptive sampling of pixels that are divided into `times` x `times` leave the noise of the undivided ones."""
    cycles = scene.cycles
    threshold = cycles.adaptive_threshold or max(LEAST_THRESHOLD, 1 / cycles.samples)  # 0: Cycles' own choice
    samples = cycles.adaptive_min_samples or MIN_SAMPLES * threshold**MIN_SAMPLES_POWER
    journal.set(cycles, "adaptive_threshold", times * threshold)
    journal.set(cycles, "adaptive_min_samples", max(1, round(samples / times**2)))


def read_again(scene):
    """Make Cycles read the scene's settings and attributes again, which it otherwise keeps with persistent data.

    Tagging the scene would synchronise its meshes, too; setting a property of the view layer does not.
    """
    layer = rendered_layer(scene)
    layer.samples = layer.samples


def show_slab(scene, slab, capture, journal):
    """Limit the render of a guarded scene to a slab: its depths, and its region of the capture, in these pixels."""
    unit_m = metres_per_unit(scene)
    for name, clip_m in (("clip_start", slab.near_m), ("clip_end", slab.far_m)):
        journal.set(scene.camera.data, name, clip_m / unit_m)
    full = slab.region == tuple(slice(0, n) for n in capture.shape_px)
    rows, columns = capture.shape_px
    for name, value in (("resolution_y", rows), ("resolution_x", columns), ("film_transparent", slab.transparent),
                        ("use_border", not full), ("use_crop_to_border", not full)):
        journal.set(scene.render, name, value)
    if not full:
        guard_region(scene.render, slab.region, capture.shape_px, journal)


def guard_region(render, region, shape_px, journal):
    """Render only a region, given as slices of rows and columns: Blender counts rows from the bottom, and truncates
    fractions of pixels."""
    (top, bottom), (left, right) = ((part.start, part.stop) for part in region)
    rows, columns = shape_px
    journal.set(render, "use_border", True)
    for name, pixel, count in (("min_x", left, columns), ("max_x", right, columns), ("min_y", rows - bottom, rows),
                               ("max_y", rows - top, rows)):
        journal.set(render, f"border_{name}", min((pixel + HALF) / count, 1.0))


def _guard_format(image, journal):
    """Set the format. Blender changes incompatible settings along with it, so all are restored together, in this
    order."""
    formats = {name: value for name, value in IMAGE.items() if hasattr(image, name)}  # two of them came with 5.0
    before = {name: getattr(image, name) for name in ("media_type", "file_format", "color_mode", "color_depth",
                                                      "exr_codec", "use_exr_interleave") if hasattr(image, name)}
    colour_space = image.linear_colorspace_settings.name
    if colour_space:  # a factory-new scene has none until a format is chosen
        journal.on_exit(lambda: setattr(image.linear_colorspace_settings, "name", colour_space))
    journal.on_exit(lambda: _assign(image, before))
    _assign(image, formats)


def _assign(owner, values):
    for name, value in values.items():
        setattr(owner, name, value)
