"""Scenes through a lens that squeezes the picture's width."""

import bpy
import numpy as np
import pytest

from lenses import fine_grid_lens
from lensfield import addon
from lensfield.engine.lens_files.package import write_package
from lensfield.engine.pictures.spectral_exr import read_exr, read_with_layers
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from lensfield.engine.stray.options import StrayOptions
from small_scenes import material, wall

ROWS, COLUMNS, PITCH_MM = 72, 96, 0.05
DISTANCE_M, ACROSS, UP, SIDE = 0.105, 0.2, 0.1, 0.095  # of a square from the entrance pupil; and tangents


@pytest.mark.parametrize("aspect", [1.0, 2.0])
def test_a_square_is_half_as_wide_as_tall_where_the_lens_puts_it(scene, tmp_path, aspect):
    lens = fine_grid_lens(squeeze=2.0, transmittance=0.5)
    write_package(lens, tmp_path / "scope.npz")
    square = wall(scene, material("Square", "ShaderNodeEmission")[0], DISTANCE_M, SIDE * DISTANCE_M)
    square.location.x, square.location.y = ACROSS * DISTANCE_M, UP * DISTANCE_M
    scene.render.resolution_x, scene.render.resolution_y, scene.render.pixel_aspect_x = COLUMNS, ROWS, aspect
    scene.cycles.samples = 16
    result = addon.render_through_lens(scene, lens=tmp_path / "scope.npz", wavelengths_nm=[550.0], depth="off",
                                       output_folder=tmp_path)
    assert read_exr(result.radiance).squeeze == 2
    light = read_exr(result.irradiance).cube[0].astype(float)
    place = np.array([np.average(index, weights=light) for index in np.indices(light.shape)])
    spread = [np.sqrt(np.average((index - at)**2, weights=light))
              for index, at in zip(np.indices(light.shape), place, strict=True)]
    focal_px = lens.capture_focal_length_mm / PITCH_MM
    right, up = focal_px / 2 * ACROSS, focal_px * UP
    np.testing.assert_allclose(place, ((ROWS - 1) / 2 - up, (COLUMNS - 1) / 2 + right), atol=0.02)
    np.testing.assert_allclose(spread, SIDE / np.sqrt(12) * np.array([focal_px, focal_px / 2]), rtol=0.02)


@pytest.fixture
def squares(scene, tmp_path):
    """Two squares at different distances, out of focus, and a lens with a squeeze: the fields of a render."""
    write_package(fine_grid_lens(squeeze=2.0, transmittance=0.5), tmp_path / "scope.npz")
    for name, (distance_m, across, up) in {"Near": (0.07, -0.1, -0.12), "Far": (0.18, ACROSS, UP)}.items():
        square = wall(scene, material(name, "ShaderNodeEmission")[0], distance_m, SIDE * distance_m)
        square.location.x, square.location.y = across * distance_m, up * distance_m
    scene.render.resolution_x, scene.render.resolution_y, scene.cycles.samples = COLUMNS, ROWS, 30
    return {"lens": tmp_path / "scope.npz", "wavelengths_nm": [500.0, 600.0], "output_folder": tmp_path,
            "stray": StrayOptions("off")}


def test_layers_have_columns_in_which_blur_is_round(scene, squares, tmp_path):
    """Four in a pixel of a 2x lens, with the pixel's samples together; all pictures have the sensor's pixels."""
    samples = []

    def note(scene, _):
        samples.append((scene.render.resolution_x, scene.cycles.samples))

    bpy.app.handlers.render_init.append(note)
    try:
        result = addon.render_through_lens(scene, **squares)
    finally:
        bpy.app.handlers.render_init.remove(note)
    radiance, planes, layers = read_with_layers(result.radiance)
    assert layers.grid.across == 4 and layers.grid.frame_px == (ROWS, 4 * COLUMNS) and len(layers.layers) > 1
    assert samples[-1] == (layers.grid.shape_px[1], 8) and scene.cycles.samples == 30  # 8 is 30 / 4, rounded up
    assert "; 4 columns in each pixel, which share its samples" in result.report.scene.layers
    assert radiance.frame_px == read_exr(result.irradiance).frame_px == (ROWS, COLUMNS)
    assert planes["Z"].shape == radiance.grid.shape_px
    np.testing.assert_allclose(radiance.cube, layers.cropped(np.subtract(
        layers.sampling.grid.overscan_px, radiance.overscan_px)).flat().cube, rtol=1e-6)
    assert sorted(set(np.unique(planes["Z"]).round(3)) - {np.float32(1e10)}) == pytest.approx([0.07, 0.18], abs=1e-3)

    again = addon.apply_lens(result.radiance, lens=squares["lens"], output_folder=tmp_path / "again",
                             stray=squares["stray"])
    np.testing.assert_array_equal(read_exr(again.irradiance).cube, read_exr(result.irradiance).cube)


def test_a_preview_has_layers_in_the_pixels_of_the_sensor(scene, squares):
    result = addon.render_through_lens(scene, spectral=SpectralOptions(tier="preview"), **squares)
    layers = read_with_layers(result.radiance)[2]
    assert layers.grid.across == 1 and layers.grid.frame_px == (ROWS, COLUMNS)


def test_a_render_region_shows_its_part_of_the_picture(scene, squares, tmp_path):
    scene.cycles.samples = 256
    complete = read_exr(addon.render_through_lens(scene, **squares).irradiance).cube
    for name, value in (("use_border", True), ("border_min_x", 10 / COLUMNS), ("border_max_x", 75 / COLUMNS),
                        ("border_min_y", 20 / ROWS), ("border_max_y", 63 / ROWS)):
        setattr(scene.render, name, value)
    part = read_exr(addon.render_through_lens(scene, **squares | {"output_folder": tmp_path / "part"}).irradiance).cube
    rows, columns = slice(ROWS - 63, ROWS - 20), slice(10, 75)
    shown = complete[:, rows, columns]
    assert 0.3 * complete.sum() < shown.sum() < 0.95 * complete.sum()
    assert np.abs(part[:, rows, columns] - shown).mean() < 0.01 * shown.mean()
    part[:, rows, columns] = 0
    assert not part.any()
