"""STMaps in Blender's own Map UV node."""

import bpy
import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from lensfield.engine import load_lens
from lensfield.engine.field.stmap import distort_map
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.pictures.spectral_exr import read_parts, write_rgb_exr


def image_node(tree, path):
    node = tree.nodes.new("CompositorNodeImage")
    node.image = bpy.data.images.load(str(path))
    node.image.colorspace_settings.name = "Non-Color"
    return node


@pytest.mark.skipif(bpy.app.version < (5, 0), reason="a tree of images alone is set up otherwise before 5.0")
def test_map_uv_applies_the_distortion_of_the_map(scene, tmp_path):
    grid = PixelGrid((120, 160), 30.0)
    stmap = distort_map(load_lens("edmund-54852"), grid, 587.6)
    row, column = np.indices(grid.shape_px)
    picture = 1 + 0.5 * np.sin(row / 9) * np.cos(column / 11) + row / 200
    write_rgb_exr(stmap, tmp_path / "map.exr")
    write_rgb_exr(np.dstack([picture] * 3).astype(np.float32), tmp_path / "picture.exr")
    tree = bpy.data.node_groups.new("warp", "CompositorNodeTree")
    tree.interface.new_socket(name="Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    warp, output = (tree.nodes.new(kind) for kind in ("CompositorNodeMapUV", "NodeGroupOutput"))
    tree.links.new(image_node(tree, tmp_path / "picture.exr").outputs["Image"], warp.inputs["Image"])
    tree.links.new(image_node(tree, tmp_path / "map.exr").outputs["Image"], warp.inputs["UV"])
    tree.links.new(warp.outputs[0], output.inputs[0])
    scene.compositing_node_group = tree
    if hasattr(scene.render, "compositor_device"):
        scene.render.compositor_device = "CPU"
    scene.render.resolution_x, scene.render.resolution_y = 160, 120
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = str(tmp_path / "warped.exr")
    bpy.ops.render.render(write_still=True)
    warped = read_parts(tmp_path / "warped.exr")[0][1]["R"]
    places = (1 - stmap[..., 1].astype(float)) * 120 - 0.5, stmap[..., 0].astype(float) * 160 - 0.5
    expected = map_coordinates(picture, places, order=1, mode="nearest")
    inside = (places[0] > 1) & (places[0] < 118) & (places[1] > 1) & (places[1] < 158)
    assert inside.mean() > 0.8
    np.testing.assert_allclose(warped[inside], expected[inside], atol=1e-5)
