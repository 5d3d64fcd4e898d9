"""Scenes through a lens that squeezes the picture's width."""

import numpy as np
import pytest

from lenses import fine_grid_lens
from lensfield import addon
from lensfield.engine.lens_files.package import write_package
from lensfield.engine.pictures.spectral_exr import read_exr
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
