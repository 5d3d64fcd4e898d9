"""Depth from files: planes and distances, fisheyes, units, and layers of flat and deep pictures."""

from dataclasses import replace

import numpy as np
import pytest

from lenses import make_lens
from lensfield.engine.depth.depth_range import blur_per_nearness_px
from lensfield.engine.depth.slabs import SlabPlan
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.projection import FISHEYE
from lensfield.engine.image.spectral_image import SpectralImage
from lensfield.engine.pictures.deep_exr import DeepPicture
from lensfield.engine.simulation.file_depth import deep_in_mm, file_depth, layers_of_deep, layers_of_flat

LENS = make_lens()
GRID = PixelGrid((30, 40), 200.0, centre_px=(12.0, 25.0))


def slabs_at(*borders_mm):
    return SlabPlan(True, borders_mm, ((0, 0),) * (len(borders_mm) + 1), 0.0, 0.0, None)


def slants():
    """Distance divided by depth: pixels of 0.2 mm, 10.5 mm behind the pinhole."""
    rows, columns = np.indices(GRID.shape_px)
    return np.sqrt(1 + ((rows - 12) * 0.2 / 10.5)**2 + ((columns - 25) * 0.2 / 10.5)**2)


@pytest.mark.parametrize("unit_mm", [1.0, 10.0, 1000.0])
def test_distances_to_a_wall_become_a_constant_planar_depth(unit_mm):
    depth = file_depth(3000 / unit_mm * slants(), LENS, GRID, unit_mm, "distance")
    np.testing.assert_allclose(depth.planar_mm, 3000, rtol=1e-6)
    np.testing.assert_array_equal(depth.clip_mm, depth.planar_mm)
    assert depth.unknown == 0


@pytest.mark.parametrize("unit_mm", [0.1, 1.0, 25.4, 1000.0])
def test_mixed_edge_depths_are_recognised_by_their_blur_in_any_unit(unit_mm):
    """A depth between surfaces 0.4 px of blur apart is a step; between surfaces 8 px apart it is a mixture."""
    grid = replace(GRID, pitch_um=5.0)
    per_nearness = blur_per_nearness_px(LENS, grid.pitch_um)
    for apart_px, mixed in ((0.4, False), (8.0, True)):
        near_mm, far_mm = 200.0, 1 / (1 / 200.0 - apart_px / per_nearness)
        columns = np.full(40, far_mm)
        columns[:15], columns[15] = near_mm, 0.75 * near_mm + 0.25 * far_mm
        depth = file_depth(np.tile(columns / unit_mm, (30, 1)), LENS, grid, unit_mm)
        between = near_mm if mixed else columns[15]
        np.testing.assert_allclose(depth.planar_mm, np.where(np.arange(40) == 15, between, columns) * np.ones((30, 1)),
                                   rtol=1e-5)


def test_empty_pixels_are_infinitely_far_by_distance_too():
    depth = file_depth(np.where(np.arange(40) < 20, 1e10, 3.0) * np.ones((30, 1)), LENS, GRID, 1000.0, "distance")
    assert np.all(np.isinf(depth.planar_mm[:, :20])) and np.all(np.isfinite(depth.planar_mm[:, 20:]))


def test_fisheye_depth_is_a_distance_and_undefined_behind_the_camera():
    grid = PixelGrid((3, 201), 200.0, projection=FISHEYE)
    depth = file_depth(np.full(grid.shape_px, 2.0, np.float32), LENS, grid, 1000.0)
    angle = np.abs(np.arange(201) - 100) * 0.2 / 10.5
    np.testing.assert_array_equal(depth.clip_mm, 2000)
    np.testing.assert_allclose(depth.planar_mm[1, angle < 1.5], 2000 * np.cos(angle[angle < 1.5]), rtol=1e-5)
    assert np.all(np.isnan(depth.planar_mm[1, angle > 1.6]))
    radiance = SpectralImage(np.ones((1, *grid.shape_px)), [550.0], grid)
    near, far = layers_of_flat(radiance, depth, slabs_at(3000.0)).layers
    assert np.all(near.alpha == 1) and np.all(near.depth_mm[1, angle[near.place[1]] > 1.6] == np.inf)


def test_a_pixel_on_a_border_is_behind_it():
    radiance = SpectralImage(np.ones((1, 1, 3)), [550.0], pitch_um=200.0)
    depth = file_depth(np.float32([[1, 2, 3]]), LENS, radiance.grid, 1000.0)
    near, far = layers_of_flat(radiance, depth, slabs_at(2000.0)).layers
    assert near.alpha.shape == (1, 1) and far.depth_mm[0, 1:].tolist() == [2000, 3000]


def deep_picture():
    """One pixel with a half-covering pane at 1 m and a wall at 2 m behind it, one with only the wall, and empty pixels.
    """
    pixel, depth = np.array([0, 0, 1]), np.array([2.0, 1.0, 2.0], np.float32)
    alpha, light = np.array([1, 0.5, 1], np.float32), np.array([0.75, 0.25, 0.75], np.float32)
    return DeepPicture((1, 3), (0, 0), "", pixel, depth, alpha, np.repeat(light[:, None], 3, axis=1))


def test_layers_of_a_deep_picture_contain_the_wall_behind_the_pane():
    grid = PixelGrid((1, 3), 200.0)
    deep = deep_in_mm(deep_picture(), LENS, grid, 1000.0)
    assert deep.depth.tolist() == [1000, 2000, 2000] and deep.pixel.tolist() == [0, 0, 1]

    def light(picture):
        return SpectralImage(picture.rec709[None, ..., 0], [550.0], grid)

    (flat, _, _), = deep.slabs(np.zeros(3, int), 1)
    layered = layers_of_deep(light(flat), deep, slabs_at(1500.0), light)
    near, far = layered.layers
    assert (near.alpha, near.cube, near.depth_mm) == (0.5, 0.25, 1000)
    np.testing.assert_allclose(far.cube, [[[0.75, 0.75, 0]]])
    np.testing.assert_array_equal(far.alpha, 1)
    np.testing.assert_array_equal(far.depth_mm, [[2000, 2000, np.inf]])
    np.testing.assert_allclose(layered.flat().cube, [[[0.625, 0.75, 0]]])


def test_deep_distances_become_planar_depths():
    deep = deep_in_mm(deep_picture(), LENS, PixelGrid((1, 3), 200.0, centre_px=(0.0, 100.0)), 1000.0, "distance")
    np.testing.assert_allclose(deep.depth, np.array([1000, 2000, 2000]) / np.hypot(1, np.array([20, 20, 19.8]) / 10.5),
                               rtol=1e-6)
