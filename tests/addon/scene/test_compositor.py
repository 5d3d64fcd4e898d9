"""The compositor step, on trees of 4.x and of 5.x."""

import bpy
import numpy as np
import OpenEXR
import pytest

from lensfield.addon.scene.compositor import NAME, compositing_tree, lens_image
from lensfield.addon.scene.errors import SceneError
from lensfield.addon.scene.working_space import rec709_from_working
from small_scenes import render, set_world


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


def lensfield_nodes(scene):
    return [node for node in compositing_tree(scene).nodes if node.name == NAME]


def test_composite_is_the_lens_image(scene, tmp_path):
    set_world(scene, (0.6, 0.4, 0.2))
    result = render(scene, tmp_path, to_compositor=True)
    composite = render_composite(scene, tmp_path / "composite.exr")
    np.testing.assert_allclose(composite, read_rgb(result.lens_image), rtol=1e-5)
    assert composite.mean() > 0.1


@pytest.mark.skipif(bpy.app.version < (5, 0, 0), reason="this Blender has one working space")
@pytest.mark.parametrize("space", ["Linear Rec.2020", "ACEScg"])
def test_composite_is_the_lens_image_in_other_working_spaces(scene, tmp_path, space):
    set_world(scene, (0.6, 0.4, 0.2))
    bpy.ops.wm.set_working_color_space(working_space=space)
    try:
        result = render(scene, tmp_path, to_compositor=True)
        composite = render_composite(scene, tmp_path / "composite.exr")  # which is in the working space
        expected = np.tensordot(np.linalg.inv(rec709_from_working()), read_rgb(result.lens_image), axes=1)
    finally:
        bpy.ops.wm.set_working_color_space(working_space="Linear Rec.709")
    np.testing.assert_allclose(composite, expected, rtol=1e-4)


def test_lens_image_is_as_bright_as_the_world(scene, tmp_path):
    set_world(scene, (0.6, 0.4, 0.2))
    picture = read_rgb(render(scene, tmp_path, np.linspace(400, 700, 31)).lens_image)
    np.testing.assert_allclose(picture[:, 17:19, 23:25].mean(axis=(1, 2)), (0.6, 0.4, 0.2), rtol=0.02)


def test_downstream_nodes_go_on_from_the_lens_image(scene, tmp_path):
    set_world(scene)
    tree = compositing_tree(scene)
    tree.nodes.clear()
    layers = tree.nodes.new("CompositorNodeRLayers")
    exposure = tree.nodes.new("CompositorNodeExposure")
    exposure.inputs["Exposure"].default_value = 1.0
    modern = hasattr(scene, "compositing_node_group")
    output = tree.nodes.new("NodeGroupOutput" if modern else "CompositorNodeComposite")
    tree.links.new(layers.outputs["Image"], exposure.inputs["Image"])
    tree.links.new(exposure.outputs["Image"], output.inputs[0])

    result = render(scene, tmp_path, to_compositor=True)
    composite = render_composite(scene, tmp_path / "composite.exr")
    np.testing.assert_allclose(composite, 2 * read_rgb(result.lens_image), rtol=1e-4)
    assert layers.mute and exposure.inputs["Image"].links[0].from_node.name == NAME


def test_second_render_refreshes_the_same_node(scene, tmp_path):
    set_world(scene, strength=1.0)
    render(scene, tmp_path, to_compositor=True)
    first = render_composite(scene, tmp_path / "composite.exr")
    set_world(scene, strength=3.0)
    render(scene, tmp_path, to_compositor=True)
    assert len(lensfield_nodes(scene)) == 1
    np.testing.assert_allclose(render_composite(scene, tmp_path / "composite.exr"), 3 * first, rtol=1e-4)


def test_scenes_keep_their_own_lens_images(scene, tmp_path):
    set_world(scene)
    render(scene, tmp_path / "one", to_compositor=True)
    other = scene.copy()
    other.name = "Other"
    set_world(other, strength=2.0)
    render(other, tmp_path / "two", to_compositor=True)
    paths = [lens_image(s).filepath for s in (scene, other)]
    assert [path.split("/")[-2] for path in paths] == ["one", "two"]


def test_a_copy_made_before_the_first_lens_render_has_a_composite_of_its_own(scene, tmp_path):
    tree = compositing_tree(scene)
    tree.nodes.clear()
    layers = tree.nodes.new("CompositorNodeRLayers")
    modern = hasattr(scene, "compositing_node_group")
    output = tree.nodes.new("NodeGroupOutput" if modern else "CompositorNodeComposite")
    tree.links.new(layers.outputs["Image"], output.inputs[0])
    other = scene.copy()
    render(other, tmp_path, to_compositor=True)
    assert lens_image(scene) is None and lens_image(other)
    node = next(n for n in compositing_tree(other).nodes if n.name == NAME)
    assert node.outputs["Image"].is_linked


def test_a_renamed_scene_keeps_its_picture(scene, tmp_path):
    render(scene, tmp_path / "one", to_compositor=True)
    other = scene.copy()
    scene.name = "Renamed"
    render(other, tmp_path / "two", to_compositor=True)
    assert [lens_image(s).filepath.split("/")[-2] for s in (scene, other)] == ["one", "two"]


def test_an_emptied_group_is_mended(scene, tmp_path):
    node = lens_node(scene, tmp_path)
    node.node_tree.nodes.clear()
    assert lens_node(scene, tmp_path) == node and lens_image(scene).filepath


def lens_node(scene, folder):
    render(scene, folder, to_compositor=True)
    return lensfield_nodes(scene)[0]


def test_other_scenes_in_the_composite_are_left_alone(scene, tmp_path):
    set_world(scene)
    backdrop = bpy.data.scenes.new("Backdrop")
    tree = compositing_tree(scene)
    tree.nodes.clear()
    exposure = tree.nodes.new("CompositorNodeExposure")
    layers = tree.nodes.new("CompositorNodeRLayers")
    layers.scene = backdrop
    tree.links.new(layers.outputs["Image"], exposure.inputs["Image"])
    render(scene, tmp_path, to_compositor=True)
    assert not layers.mute and exposure.inputs["Image"].links[0].from_node == layers


def test_several_view_layers_are_refused_by_name(scene, tmp_path):
    scene.view_layers.new("Foreground")
    with pytest.raises(SceneError, match="view layers for rendering is ViewLayer, Foreground: choose one"):
        render(scene, tmp_path)


@pytest.mark.parametrize("folder", ["plain", "with space"])
def test_operator_renders_with_the_settings(scene, tmp_path, folder):
    set_world(scene)
    settings = scene.lensfield
    settings.wavelength_mode = "LIST"
    settings.wavelength_list = "500, 600"
    settings.output_folder = str(tmp_path / folder)
    assert bpy.ops.lensfield.render() == {"FINISHED"}
    assert sorted(path.name for path in (tmp_path / folder).iterdir()) == [
        "Scene_0001_after.png", "Scene_0001_before.png", "Scene_0001_depth.exr", "Scene_0001_irradiance.exr",
        "Scene_0001_lens_image.exr", "Scene_0001_radiance.exr", "Scene_relative_illumination.exr",
        "Scene_stmap_distort.exr", "Scene_stmap_undistort.exr"]
    assert lensfield_nodes(scene)


@pytest.mark.parametrize("settings, message", [
    ({"wavelength_mode": "LIST", "wavelength_list": "700, 500"}, "options: wavelengths is 700, 500: expected"),
    ({"wavelength_last_nm": 900.0}, "edmund-54852: wavelength is .* nm: the lens data spans 400 to 700 nm"),
    ({"lens": "FILE", "lens_file": "/no/such/lens.npz"}, "/no/such/lens.npz: lens is not there"),
    ({"lens": "FILE", "lens_file": ""}, "scene settings: lens file is empty"),
    ({"output_folder": " "}, "scene settings: output folder is empty"),
    ({"output_folder": "//lensfield/"}, "save the .blend first")])
def test_operator_tells_bad_settings_in_one_line(scene, tmp_path, settings, message):
    scene.lensfield.output_folder = str(tmp_path)
    for name, value in settings.items():
        setattr(scene.lensfield, name, value)
    with pytest.raises(RuntimeError, match=message) as caught:
        bpy.ops.lensfield.render()
    assert "Traceback" not in str(caught.value)
