"""Renders of a scene by Cycles alone, in RGB, without Lensfield."""

import bpy
import numpy as np
import OpenEXR


def picture(scene, folder, samples=4, columns=8, rows=8):
    """Red, green and blue of a render: array (3, row, column)."""
    render, image = scene.render, scene.render.image_settings
    render.resolution_x, render.resolution_y = columns, rows
    scene.cycles.samples, scene.cycles.use_denoising = samples, False
    scene.cycles.sample_clamp_indirect, scene.cycles.pixel_filter_type = 0, "BOX"
    if hasattr(image, "media_type"):  # added in 5.0
        image.media_type = "IMAGE"
    image.file_format, image.color_depth, image.color_mode = "OPEN_EXR", "32", "RGB"
    render.filepath = str(folder / "picture.exr")
    bpy.ops.render.render(write_still=True, scene=scene.name)
    with OpenEXR.File(render.filepath, separate_channels=True) as file:
        return np.stack([file.parts[0].channels[name].pixels for name in "RGB"])
