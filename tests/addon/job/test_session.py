"""State that exists only in a window, not in a copy of its file: the child process receives it too."""


import bpy
import numpy as np
import OpenEXR
import pytest
from PIL import Image

from lensfield.addon.render import session
from lensfield.addon.ui import window_render
from small_scenes import material, wall
from snapshot import differences, snapshot
from window_follow import follow


def blank(name, **properties):
    image = bpy.data.images.new(name, 4, 3, **properties)
    image.use_fake_user = True
    return image


@pytest.fixture
def painted(scene, tmp_path):
    """Images of all kinds, painted and not saved: those that can be transferred."""
    Image.new("RGB", (4, 3), (200, 30, 30)).save(tmp_path / "file.png")
    images = {"New": blank("New"), "Float": blank("Float", float_buffer=True)}
    for name in ("File", "Packed"):
        images[name] = bpy.data.images.load(str(tmp_path / "file.png"))
        images[name].name, images[name].use_fake_user = name, True
    images["Packed"].pack()
    random = np.random.default_rng(1)
    for image in images.values():
        image.pixels.foreach_set(random.random(48, dtype=np.float32))
    blank("Clean")
    return images


@pytest.mark.every_blender
def test_a_copy_receives_unsaved_pixels(painted, tmp_path):
    pixels = {name: list(image.pixels) for name, image in painted.items()}
    before = snapshot()
    session.write_session(tmp_path / "session.npz")
    assert not differences(before, snapshot()) and all(image.is_dirty for image in painted.values())
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "copy.blend"), copy=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "copy.blend"))
    session.take_session(tmp_path / "session.npz")
    assert {name: list(bpy.data.images[name].pixels) for name in pixels} == pixels
    assert bpy.data.images["Float"].is_float and not bpy.data.images["Clean"].is_dirty


def test_images_that_cannot_be_transferred_are_named(painted):
    assert not session.lost_images()
    tiles = blank("Tiles", tiled=True)
    tiles.pixels[0] = 0.5
    assert session.lost_images() == ["Tiles"]


def test_the_selected_devices_are_transferred(scene, tmp_path):
    preferences = bpy.context.preferences.addons["cycles"].preferences
    before = preferences.compute_device_type
    try:
        preferences.compute_device_type = "CUDA"
        session.write_session(tmp_path / "session.npz")
        preferences.compute_device_type = "NONE"
        session.take_session(tmp_path / "session.npz")
        assert preferences.compute_device_type == "CUDA"
    finally:
        preferences.compute_device_type = before


@pytest.mark.sample(1)
@pytest.mark.parametrize("source", ["New", "File"])
def test_a_window_render_shows_unsaved_paint(painted, scene, tmp_path, source):
    """Emission by colours that exist only in memory has their brightness, to 2 % of their spectra."""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    painted[source].colorspace_settings.name = "Non-Color"
    painted[source].pixels.foreach_set(np.tile(np.float32([0.6, 0.4, 0.2, 1]), 12))
    glow, shader = material("Glow", "ShaderNodeEmission")
    texture = glow.node_tree.nodes.new("ShaderNodeTexImage")
    texture.image = painted[source]
    glow.node_tree.links.new(texture.outputs["Color"], shader.inputs["Color"])
    wall(scene, glow)
    scene.cycles.samples = 4
    scene.lensfield.wavelength_count, scene.lensfield.depth = 31, "OFF"
    scene.camera.data.lensfield.coating = "IDEAL"
    assert not window_render.start(scene)
    try:
        follow()
    finally:
        window_render.end()
    with OpenEXR.File(str(tmp_path / "lensfield" / "scene_Scene_0001_lens_image.exr"), separate_channels=True) as file:
        middle = [file.parts[0].channels[name].pixels[17:19, 23:25].mean() for name in "RGB"]
    np.testing.assert_allclose(middle, (0.6, 0.4, 0.2), rtol=0.02)
