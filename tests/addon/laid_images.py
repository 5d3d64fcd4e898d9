"""Lens images of a single colour in the compositor, and whether Blender's own render shows them."""

import bpy
import numpy as np
import OpenEXR

from lensfield.addon.scene.compositor import lay_into_compositor
from lensfield.engine.pictures.spectral_exr import write_picture_exr, write_plane_exr


def render_composite(scene, path):
    if hasattr(scene.render.image_settings, "media_type"):
        scene.render.image_settings.media_type = "IMAGE"
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_mode = "RGB"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = str(path)
    scene.render.use_compositing = True
    if hasattr(scene.render, "compositor_device"):
        scene.render.compositor_device = "CPU"
    bpy.ops.render.render(write_still=True)
    return read_rgb(path)


def read_rgb(path):
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return np.stack([file.parts[0].channels[name].pixels.copy() for name in "RGB"])


def lay(scene, folder, frames=(1,), colour=(5.0, 3.0, 2.0), shape=(36, 48)):
    """Add lens images of a single colour each, times the frame, to the compositor; returns their paths."""
    paths = []
    for frame in frames:
        paths.append(folder / f"unsaved_{bpy.path.clean_name(scene.name)}_{frame:04d}_lens_image.exr")
        write_picture_exr(np.full((*shape, 3), np.array(colour) * frame), paths[-1], np.full(shape, 0.5))
        write_plane_exr(np.full(shape, 7.0 * frame), folder / paths[-1].name.replace("lens_image", "depth"))
        stray_path = folder / paths[-1].name.replace("lens_image", "stray_light")
        write_picture_exr(np.full((*shape, 3), 0.5 * frame), stray_path)
    for name in ("relative_illumination", "stmap_distort", "stmap_undistort"):
        write_plane_exr(np.full(shape, 0.25), folder / f"unsaved_{bpy.path.clean_name(scene.name)}_{name}.exr")
    lay_into_compositor(scene, *paths)
    return paths


def shows_lens_image(scene, folder, frame=1):
    """Whether a render of a frame shows the lens image of `lay`; otherwise it must be the black world."""
    scene.frame_set(frame)
    red = float(render_composite(scene, folder / "composite.exr")[0].mean())
    assert red in (0, 5.0 * frame), red
    return red > 0
