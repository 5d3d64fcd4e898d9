"""Scenes through a measured lens: lamps are where its calibration has them, in and out of focus, and in Quick Look."""

import bpy
import numpy as np
import pytest

from lensfield import addon
from lensfield.addon.ui.live.quick_look import compositor_lens
from lensfield.engine.calibration.models import KANNALA_BRANDT, RADTAN
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.library.rays import lens_rays
from lensfield.engine.look.lens_tables import NODES, lens_tables
from lensfield.engine.measured.camera import ModelledCamera
from lensfield.engine.measured.files import lens_of
from lensfield.engine.measured.options import MeasuredOptions
from lensfield.engine.pictures.spectral_exr import read_exr
from small_scenes import material

pytestmark = pytest.mark.one_blender
SIZE_PX, NEAR_PX, HALF_PX = (120, 80), 9, 0.2
FOCUS_M = 0.3
CAMERAS = {
    "decentred": ModelledCamera("made", "test", SIZE_PX, (100.0, 102.0), (64.3, 36.1), RADTAN,
                                (-0.2, 0.05, 0.01, -0.005)),
    "fisheye": ModelledCamera("made", "test", SIZE_PX, (80.0, 80.0), (59.5, 39.5), KANNALA_BRANDT,
                              (0.02, -0.01, 0.0, 0.0))}
PLACES = (0.0, 0.0), (-0.45, 0.2), (0.4, -0.22), (-0.3, -0.2)  # tangents, to the right and up


def lens_with(camera):
    options = MeasuredOptions(sensor_mm=(0.2 * SIZE_PX[0], 0.2 * SIZE_PX[1]), f_number=1.4, focus_mm=1e3 * FOCUS_M)
    return lens_of(camera, options)


def add_lamps(scene, depths_m):
    """Small glowing balls at PLACES, and how far the middle of each is from the axis: tangents."""
    scene.unit_settings.scale_length = 0.1
    glow, _ = material("Glow", "ShaderNodeEmission")
    for (right, up), depth_m in zip(PLACES, depths_m, strict=True):
        depth = depth_m / 0.1
        bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=4, radius=0.012 * depth,
                                              location=(right * depth, up * depth, -depth))
        bpy.context.object.data.materials.append(glow)


def middles(light, expected_px):
    """Middles of the light near places."""
    row, column = np.indices(light.shape)
    for x, y in expected_px:
        near = light * (np.hypot(column - x, row - y) < NEAR_PX)
        yield np.average(column, weights=near), np.average(row, weights=near)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("depth", ["off", "auto"])
def test_lamps_are_where_the_calibration_has_them(scene, tmp_path, name, depth):
    camera = CAMERAS[name]
    scene.render.resolution_x, scene.render.resolution_y = SIZE_PX
    scene.cycles.samples = 64
    depths_m = 4 * (FOCUS_M,) if depth == "off" else (FOCUS_M, 4 * FOCUS_M, 0.7 * FOCUS_M, 4 * FOCUS_M)
    add_lamps(scene, depths_m)
    result = addon.render_through_lens(scene, lens=lens_with(camera), wavelengths_nm=[540.0], output_folder=tmp_path,
                                       depth=depth)
    assert bool(result.report.scene.layers) == (depth == "auto")
    light = read_exr(result.irradiance).cube[0]
    expected = camera.pixels(np.array(PLACES) * (1, -1))
    for found, wanted in zip(middles(light, expected), expected, strict=True):
        assert np.hypot(*np.subtract(found, wanted)) < HALF_PX


@pytest.mark.parametrize("name", CAMERAS)
def test_live_and_quick_look_have_the_field_of_the_calibration(name):
    camera = CAMERAS[name]
    lens = lens_with(camera)
    frame = PixelGrid((SIZE_PX[1], SIZE_PX[0]), 200.0)
    tables = lens_tables(lens, lens_rays(lens), frame)
    corners = tables.angle_rad[::NODES - 1, ::NODES - 1, 1].reshape(-1, 2)  # to the right and up, of green
    pixels = np.array([(-0.5, 79.5), (119.5, 79.5), (-0.5, -0.5), (119.5, -0.5)])
    tangents = camera.straight(pixels).tangents * (1, -1)
    angle = np.hypot(*corners.T)[:, None]
    np.testing.assert_allclose(corners * np.tan(angle) / angle, tangents, atol=0.05 / 80)
    assert compositor_lens(lens, lens.f_number_effective, None, False, (0.0, 0.0), pixel_aspect=1.0)
