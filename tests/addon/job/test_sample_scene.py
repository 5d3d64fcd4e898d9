"""The sample scene: small, with real spectra, and suitable for its lens."""


import bpy
import numpy as np
import pytest

from lensfield.engine import load_lens
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.spectral.spectra import library_names
from places import SAMPLE_SCENE
from small_scenes import render


@pytest.fixture
def sample_scene():
    bpy.ops.wm.open_mainfile(filepath=str(SAMPLE_SCENE))
    return bpy.context.scene


def test_file_is_small_and_self_contained(sample_scene):
    assert SAMPLE_SCENE.stat().st_size < 1_000_000
    assert not [image for image in bpy.data.images if image.source == "FILE"]
    assert not bpy.data.libraries


def test_file_opens_in_the_camera_view(sample_scene):
    views = {screen.name: [area.spaces.active for area in screen.areas if area.type == "VIEW_3D"]
             for screen in bpy.data.screens}
    assert {view.region_3d.view_perspective for screen_views in views.values() for view in screen_views} == {"CAMERA"}
    assert bpy.context.window_manager.windows[0].screen.name == "Layout"
    assert [view.show_region_ui for view in views["Layout"]] == [True]


def test_chart_and_lamps_have_measured_spectra(sample_scene):
    chart = {name for name in library_names() if name.startswith("chart-")}
    assert chart <= {material.lensfield.reflectance for material in bpy.data.materials}
    lamps = {light.lensfield.emission for light in bpy.data.lights}
    glowing = {material.lensfield.emission for material in bpy.data.materials} - {""}
    assert len(lamps) >= 2 and lamps | glowing <= set(library_names())


def test_camera_has_the_lens_field_of_view(sample_scene):
    width_over_distance = 4.8 / load_lens("edmund-54852").capture_focal_length_mm
    assert 2 * np.tan(sample_scene.camera.data.angle_x / 2) == pytest.approx(width_over_distance, rel=1e-4)


@pytest.mark.every_blender
def test_it_renders_with_light_to_the_corners(sample_scene, tmp_path):
    sample_scene.render.resolution_x, sample_scene.render.resolution_y = 96, 72
    sample_scene.cycles.samples = 4
    image = read_exr(render(sample_scene, tmp_path, [450, 550, 650]).irradiance)
    assert np.isfinite(image.cube).all() and image.cube.min() > -1e-6 * image.cube.max()
    corners = [image.cube[:, rows, columns].mean() for rows in (slice(8), slice(-8, None))
               for columns in (slice(8), slice(-8, None))]
    assert min(corners) > 0
