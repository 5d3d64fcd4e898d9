"""The camera's Shift moves the sensor in the lens's image circle."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

from lensfield import addon
from lensfield.addon.scene import rings
from lensfield.addon.scene.camera import (
    frame_grid,
    frame_px,
    lens_for_view,
    match_camera_to_lens,
    set_up_capture,
    shift_px,
)
from lensfield.addon.scene.lens_cache import load_lens
from lensfield.addon.scene.lens_facts import facts_of
from lensfield.addon.scene.rings import scene_lens
from lensfield.addon.scene.undo import Journal
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.library import pinhole_of
from lensfield.engine.pictures.spectral_exr import read_exr
from small_scenes import material, wall
from varied_lenses import varied_lens

LENS = load_lens("edmund-54852")
NM = 562.0
FULL_PX, PART_PX, SHIFTED_PX = (240, 320), (120, 160), (72, -40)  # rows and columns; pixels to the right and up


def set_shift(camera, right, up):
    camera.shift_x, camera.shift_y = right, up


@pytest.mark.parametrize("shape_px", [(1080, 1920), (1920, 1080)])
@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
@pytest.mark.parametrize("aspect", [1.0, 2.0])
def test_the_frame_is_blenders(scene, fit, shape_px, aspect):
    """Also with pixels that an anamorphic lens squeezes."""
    scene.render.pixel_aspect_x = aspect
    camera = scene.camera.data
    camera.sensor_fit, camera.sensor_width, camera.sensor_height, camera.lens = fit, 23.5, 15.6, 35.0
    scene.render.resolution_y, scene.render.resolution_x = shape_px
    set_shift(camera, 0.3, -0.12)
    scene.camera.location = 1, 2, 3
    scene.camera.rotation_euler = 0.5, 0.2, -0.7
    bpy.context.view_layer.update()
    frame = frame_grid(scene, lens_for_view(scene, LENS, "camera")[0])
    for x, y in ((0.0, 0.0), (0.3, -0.2), (-0.1, 0.25)):  # tangents
        place = world_to_camera_view(scene, scene.camera, scene.camera.matrix_world @ Vector((x, y, -1)) * 1.0)
        row, column = frame.index_of(35.0 * x / aspect, 35.0 * y)
        right, up = (column + 0.5) / shape_px[1], 1 - (row + 0.5) / shape_px[0]
        np.testing.assert_allclose((right, up), place[:2], atol=2e-6)


def test_a_panorama_is_shifted_by_shares_of_its_sides(scene):
    """As in Cycles; a perspective camera is shifted by shares of one side."""
    scene.render.resolution_y, scene.render.resolution_x = 60, 100
    scene.camera.data.type = "PANO"
    set_shift(scene.camera.data, 0.1, -0.05)
    assert shift_px(scene) == pytest.approx((10, -3))


def test_a_percentage_of_the_resolution_is_rounded_down(scene):
    scene.render.resolution_y, scene.render.resolution_x, scene.render.resolution_percentage = 59, 101, 50
    assert frame_px(scene) == (29, 50)


def test_matching_the_camera_keeps_the_shift_of_a_portrait(scene):
    """AUTO measures it in heights of a portrait, and the matched camera in widths."""
    scene.render.resolution_y, scene.render.resolution_x = 1920, 1080
    set_shift(scene.camera.data, 0.1, 0.25)
    frame = frame_grid(scene, LENS)
    match_camera_to_lens(scene.camera.data, facts_of(LENS), frame)
    assert scene.camera.data.sensor_fit == "HORIZONTAL"
    np.testing.assert_allclose(frame_grid(scene, LENS).centre_px, frame.centre_px, atol=1e-3)
    assert frame.centre_px == pytest.approx((959.5 + 0.25 * 1920, 539.5 - 0.1 * 1920))


def test_a_squeezed_capture_is_shifted_alike(scene):
    frame, focal_mm = PixelGrid((100, 160), 20.0, squeeze=1.8).shifted(30, -12), 50.0
    scene.render.resolution_y, scene.render.resolution_x = frame.shape_px
    scene.render.pixel_aspect_x = 1.8
    set_up_capture(scene.camera.data, SimpleNamespace(capture_focal_length_mm=focal_mm), frame, Journal())
    left, lower, right, upper = frame.edges_mm
    corners = [Vector((1.8 * x_mm / focal_mm, y_mm / focal_mm, -1)) for x_mm, y_mm in ((left, lower), (right, upper))]
    bpy.context.view_layer.update()
    first, last = (world_to_camera_view(scene, scene.camera, scene.camera.matrix_world @ corner) for corner in corners)
    np.testing.assert_allclose((first[:2], last[:2]), ((0, 0), (1, 1)), atol=1e-5)


def waves(scene, distance_m, side_m, period_m):
    """A wall that shines in waves, which no two places of a picture share."""
    shining, shader = material("Waves", "ShaderNodeEmission")
    tree, square = shining.node_tree, wall(scene, shining, distance_m, side_m)
    place, waves = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeTexWave")
    waves.wave_type, waves.inputs["Distortion"].default_value = "RINGS", 3.0
    waves.inputs["Scale"].default_value, waves.inputs["Detail"].default_value = 0.3 / period_m, 0.0
    tree.links.new(place.outputs["Object"], waves.inputs["Vector"])
    tree.links.new(waves.outputs["Fac"], shader.inputs["Strength"])
    square.location.x, square.location.y = 0.1 * period_m, -0.2 * period_m


def photograph(scene, folder, lens, shape_px, pitch_um, **options):
    """The irradiance at pixels of this pitch, on a sensor of this many."""
    scene.render.resolution_y, scene.render.resolution_x = shape_px
    sensor = "{:.6g}x{:.6g}".format(*(n * pitch_um * 1e-3 for n in reversed(shape_px)))
    return read_exr(addon.render_through_lens(scene, lens=lens, view=sensor, wavelengths_nm=[NM], output_folder=folder,
                                              **options).irradiance)


def both(scene, folder, lens, pitch_um, **options):
    """A part of a frame by its own sensor, which is shifted, and the same part of a larger sensor's frame."""
    full = photograph(scene, folder / "full", lens, FULL_PX, pitch_um, **options)
    set_shift(scene.camera.data, *(px / max(PART_PX) for px in SHIFTED_PX))
    part = photograph(scene, folder / "part", lens, PART_PX, pitch_um, **options)
    (right, up), (row, column) = SHIFTED_PX, part.centre_px
    assert (row, column) == pytest.approx(((PART_PX[0] - 1) / 2 + up, (PART_PX[1] - 1) / 2 - right), abs=1e-9)
    first_row, first_column = (round(middle - at) for middle, at in zip(full.centre_px, part.centre_px, strict=True))
    return (part.cube[0], full.cube[0, first_row:first_row + PART_PX[0], first_column:first_column + PART_PX[1]])


def blocks(plane):
    """Means of blocks of 8 x 8 pixels."""
    rows, columns = (n // 8 for n in plane.shape)
    return plane.reshape(rows, 8, columns, 8).mean(axis=(1, 3), dtype=float)


CASES = {
    # lens; pitch in um; distance, side and period of the waves in m; options; noise of the noisiest block (in depth, at
    # the edges of the near square), in mean light
    "plane": (LENS, 15.0, (0.254, 0.4, 0.02), {"depth": "off"}, 2e-4),
    "panorama": ("muller-fisheye-25mm", 150.0, (2.0, 20.0, 0.8), {"depth": "off"}, 1e-4),
    "depth": (LENS, 15.0, (0.5, 0.8, 0.03), {}, 8e-4),
    "traced": ("tessar-50mm", 120.0, (100.0, 200.0, 6.0), {"depth": "traced"}, 8e-3)}


@pytest.mark.parametrize("case", CASES)
def test_a_shifted_sensor_sees_its_part_of_a_larger_one(scene, tmp_path, case):
    lens, pitch_um, (distance_m, side_m, period_m), options, noise = CASES[case]
    scene.cycles.samples = 64 if case == "plane" else 144
    waves(scene, distance_m, side_m, period_m)
    if case == "depth":
        near = wall(scene, material("Near", "ShaderNodeEmission")[0], 0.2, 0.02)
        near.location.x, near.location.y = 0.035, -0.01
    part, of_full = both(scene, tmp_path, varied_lens(lens) if isinstance(lens, str) else lens, pitch_um, **options)
    assert part.std() > 0.5 * part.mean()
    np.testing.assert_allclose(blocks(part), blocks(of_full), rtol=0, atol=5 * noise * part.mean())


@pytest.mark.parametrize("view, expected", [
    ("lens", (-16.0, -21.0, 8.0, 15.0)), ("24x16", (-10.6667, -14.0, 5.3333, 10.0)),
    ("camera", (-12.5 - 25 / 6, -21.875, -25 / 6 + 12.5, 15.625))])
def test_a_lens_on_a_grid_is_loaded_for_the_frame(scene, monkeypatch, view, expected):
    """Portrait, shifted to the left and down, on 36 x 24 mm; and before a camera's view scales the lens."""
    loaded, camera = [], scene.camera.data
    monkeypatch.setattr(rings, "load_lens", lambda *given: loaded.append(given[-1]) or LENS)
    scene.render.resolution_y, scene.render.resolution_x = 180, 120
    set_shift(camera, -1 / 9, -1 / 12)
    camera.sensor_fit, camera.sensor_height = "VERTICAL", 36.0
    camera.lens = 0.96 * pinhole_of("cooke-triplet-50mm").capture_focal_length_mm
    scene_lens(scene, "cooke-triplet-50mm", view, "preview", [NM], tilt_deg=(2.0, 0.0))
    np.testing.assert_allclose(loaded, [expected], atol=1e-3)
