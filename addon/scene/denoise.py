"""Denoising of light that no single render contains, by Cycles' own denoiser, which takes files for this."""

import bpy
import numpy as np
import scipy

from lensfield.engine.pictures.spectral_exr import read_parts, write_planes_exr

from .errors import SceneError, blenders_reason
from .render_state import rendered_layer

NOISY, GUIDES, MOTION = "Noisy Image", {"Denoising Albedo": "RGB", "Denoising Normal": "XYZ"}, ("Vector", "XYZW")
QUICK = {"denoiser": "OPENIMAGEDENOISE", "denoising_prefilter": "FAST", "denoising_quality": "FAST"}
LEAST_ALPHA = 0.02  # less of a surface has too few samples to show its light


def can_denoise():
    """Whether this Blender contains a denoiser for the processor."""
    import _cycles  # only available within Blender

    return _cycles.with_openimagedenoise


def guide_planes(scene):
    """Names of the planes with which a render guides the denoiser: list of str."""
    layer = rendered_layer(scene).name
    return [f"{layer}.{name}.{channel}" for name, channels in GUIDES.items() for channel in channels]


def denoise_quickly(scene, journal):
    """Let the denoiser take the least time, on the device that renders, rather than leave the least noise."""
    for name, value in (QUICK | {"denoising_use_gpu": scene.cycles.device == "GPU"}).items():
        journal.set(scene.cycles, name, value)


def render_with_guides(scene, journal):
    """Let renders be noisy, with the guides of the denoiser."""
    journal.set(scene.cycles, "use_denoising", False)
    journal.set(rendered_layer(scene).cycles, "denoising_store_passes", True)


def denoised(scene, picture, alpha, guides, folder):
    """A picture, denoised with the scene's settings.

    On the black of a transparent film, the denoiser changes the edges of small lamps, and their light by up to 30 %.
    So it treats the light of surfaces without their alpha, continued beyond their edges.

    Parameters
    ----------
    scene : bpy.types.Scene
    picture : array (3, row, column)
        Red, green and blue; premultiplied.
    alpha : array (row, column)
    guides : array (plane, row, column)
        As in `guide_planes`.
    folder : Path
        For files.

    Returns
    -------
    float32 array (3, row, column)

    Raises
    ------
    InputError
        Cycles cannot denoise, or the disk is full.
    """
    covered = np.where(alpha >= LEAST_ALPHA, alpha, picture.any(axis=0)).astype(np.float32)  # 1 for a flame's light
    if not covered.any():
        return np.zeros_like(picture)
    continued = [_continued(planes / np.where(covered, covered, 1), covered > 0) for planes in (picture, guides)]
    return _denoised(scene, *continued, folder) * covered


def _continued(planes, known):
    """Planes with the value of the nearest known pixel in each of the others."""
    if known.all():
        return planes
    rows, columns = scipy.ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    return planes[:, rows, columns]


def _denoised(scene, picture, guides, folder):
    layer, noisy, result = rendered_layer(scene).name, folder / "noisy.exr", folder / "denoised.exr"
    combined = [f"{layer}.Combined.{channel}" for channel in "RGB"]
    planes = dict(zip(guide_planes(scene), guides, strict=True))
    for name in combined, [f"{layer}.{NOISY}.{channel}" for channel in "RGB"]:
        planes |= zip(name, picture, strict=True)
    name, axes = MOTION  # not used for a single picture, but required
    planes |= {f"{layer}.{name}.{axis}": np.zeros_like(guides[0]) for axis in axes}
    write_planes_exr(planes, noisy, {f"cycles.{layer}.samples": "1"})
    try:
        with bpy.context.temp_override(scene=scene, view_layer=rendered_layer(scene)):
            bpy.ops.cycles.denoise_animation(input_filepath=str(noisy), output_filepath=str(result))
    except RuntimeError as error:
        raise SceneError(f"scene {scene.name!r}", "denoising", "refused by Blender", blenders_reason(error)) from None
    parts = {name: plane for _, channels in read_parts(result) for name, plane in channels.items()}
    return np.array([parts[name] for name in combined])
