"""Room for a capture: the memory and the disk space that its light needs."""

import math

from lensfield.engine.runtime.memory import check_room
from lensfield.engine.runtime.scratch import SAMPLE_BYTES, check_disk, folder_if_large

from ..scene.camera import render_region
from .bands import WAVELENGTHS_PER_PASS
from .sampled_passes import CONTROL_CUBES, detail_times, shares_noise

PASS_BYTES, LAMP_BYTES = 100, 40  # per pixel of a pass, in Cycles, in Blender and on reading; plus this for each lamp
DENOISE_BYTES, MOST_DENOISE = 800, 3e9  # for the denoiser: bytes per pixel, and their upper limit in total
DETAIL_BYTES = 2  # per part of a pixel and wavelength
PLANES_BYTES = 8  # per pixel, for each slab's planes in addition to its light
LEAST_LIT = 0.1  # of a picture's pixels: noise is as large in a file as in memory, and only black shrinks


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


def detail_bytes(pixels, times):
    """Bytes of the detail of this many pixels; 0 for whole pixels."""
    return DETAIL_BYTES * WAVELENGTHS_PER_PASS * pixels * times**2 if times > 1 else 0


def pass_bytes(pixels, lamps, denoise):
    """Bytes that a pass of this many pixels needs in Cycles, in Blender, and on reading."""
    denoiser = min(DENOISE_BYTES * pixels, MOST_DENOISE) if denoise else 0
    return pixels * (PASS_BYTES + LAMP_BYTES * lamps) + denoiser
