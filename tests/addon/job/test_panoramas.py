"""Captures projected by the lens: the same picture as by a perspective camera."""

from dataclasses import replace

import bpy
import numpy as np
import pytest
from PIL import Image

from lenses import tinted
from lensfield import addon
from lensfield.engine import InputError, load_lens
from lensfield.engine.field import overscan
from lensfield.engine.pictures.spectral_exr import read_exr, read_with_layers
from refusals import refused
from small_scenes import material, set_world, wall

WAVELENGTHS_NM = (450.0, 550.0, 650.0)
SHAPE_PX = 60, 100
BLOCK_PX = 10
METRES = 0.01  # a Blender unit


@pytest.fixture
def painted(scene):
    """A glowing wall with a smooth pattern, unlike any of its mirrored or turned images, in the plane of focus; and, a
    tenth of the way to the camera, a grey disc that covers some of its left upper corner."""
    scene.unit_settings.scale_length = METRES
    scene.render.resolution_y, scene.render.resolution_x = SHAPE_PX
    scene.cycles.samples = 64
    camera = scene.camera.data
    camera.clip_start, camera.clip_end = 0.05, 1e4
    set_world(scene, (0, 0, 0))
    glow, shader = material("Glow", "ShaderNodeEmission")
    nodes, link = glow.node_tree.nodes, glow.node_tree.links.new
    place, pattern = nodes.new("ShaderNodeNewGeometry"), nodes.new("ShaderNodeTexNoise")
    pattern.inputs["Scale"].default_value, pattern.inputs["Detail"].default_value = 0.25, 0.0
    link(place.outputs["Position"], pattern.inputs["Vector"])
    link(pattern.outputs[0], shader.inputs["Strength"])
    lens = load_lens("edmund-54852")
    wall(scene, glow, (lens.object_distance_mm + lens.entrance_pupil_mm) * 1e-3 / METRES, side_m=100.0)
    return scene


def both(scene, folder, monkeypatch, **options):
    """Results by a perspective camera and by a panorama."""
    for name, most in (("plane", np.inf), ("panorama", 0.0)):
        monkeypatch.setattr(overscan, "MOST_PLANE", most)
        result = addon.render_through_lens(scene, lens=tinted(load_lens("edmund-54852")), output_folder=folder / name,
                                           wavelengths_nm=WAVELENGTHS_NM, denoise="off", **options)
        assert read_exr(result.radiance).projection.is_plane == (name == "plane")
        yield result


def assert_same(plane, panorama, rtol):
    """Means over blocks differ by at most rtol of the brightest block."""
    means = [each.reshape(len(each), SHAPE_PX[0] // BLOCK_PX, BLOCK_PX, -1, BLOCK_PX).mean(axis=(2, 4), dtype=float)
             for each in (plane, panorama)]
    assert np.abs(means[1] - means[0]).max() < rtol * means[0].max() < np.ptp(means[0])


@pytest.mark.every_blender
def test_a_textured_plane_is_the_same(painted, tmp_path, monkeypatch):
    """64 samples of a pattern that varies little within a pixel are accurate to 0.1 %, and blocks to a tenth of it."""
    plane, panorama = both(painted, tmp_path, monkeypatch, depth="off")
    assert_same(read_exr(plane.irradiance).cube, read_exr(panorama.irradiance).cube, 0.003)
    before = [np.moveaxis(np.asarray(Image.open(each.before).convert("RGB"), float), -1, 0)
              for each in (plane, panorama)]
    assert_same(*before, 0.005)
    assert np.prod(read_exr(panorama.radiance).grid.shape_px) < 0.85 * np.prod(read_exr(plane.radiance).grid.shape_px)


def test_layers_of_depth_are_the_same(painted, tmp_path, monkeypatch):
    bpy.ops.mesh.primitive_circle_add(radius=0.6, fill_type="NGON", location=(-1.0, 0.6, -4.0))
    grey, shader = material("Grey", "ShaderNodeEmission")
    shader.inputs["Strength"].default_value = 0.3
    bpy.context.object.data.materials.append(grey)
    plane, panorama = both(painted, tmp_path, monkeypatch)
    assert all(len(read_with_layers(each.radiance)[2].layers) >= 2 for each in (plane, panorama))
    assert_same(read_exr(plane.irradiance).cube, read_exr(panorama.irradiance).cube, 0.003)


def test_a_lens_that_needs_more_than_was_captured_is_refused(painted, tmp_path, monkeypatch):
    """The capture shows as much as its own lens; one with twice the distortion needs more."""
    *_, panorama = both(painted, tmp_path, monkeypatch, depth="off")
    lens = load_lens("edmund-54852")
    bent = replace(lens, real_height_mm=lens.heights_mm + 2 * (lens.real_height_mm - lens.heights_mm))
    with refused(InputError, field="overscan", where="unsaved_Scene_0001_radiance.exr"):
        addon.apply_lens(panorama.radiance, lens=bent, output_folder=tmp_path / "bent")
