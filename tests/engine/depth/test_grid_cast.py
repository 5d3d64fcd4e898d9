"""Casting through lenses without rotational symmetry: against the rays of heights, and first-order optics by hand."""

from functools import partial

import numpy as np
import pytest

from lenses import make_grid_lens, make_lens
from lensfield.engine.depth.cast import cast
from lensfield.engine.depth.depth_range import blur_per_nearness_px, check_depth, focus_in_capture
from lensfield.engine.depth.slabs import plan_slabs
from lensfield.engine.field.field_map import field_map
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.projection import FISHEYE
from lensfield.engine.kernels.library import available
from lensfield.engine.lens.entrance_pupil import entrance_pupil_diameter_mm, entrance_pupil_size_mm, focus_nearness
from lensfield.engine.library import prescription_of
from lensfield.engine.rays.focus import build_system
from lensfield.engine.rays.grid_rays import grid_ray_table
from lensfield.engine.rays.ray_table import ray_table
from loops import using

pytestmark = pytest.mark.one_blender
PITCH_UM, NM = 16.0, (500.0, 600.0)
FAR = 1e9


def layer(alpha, depth_mm, light=1.0):
    alpha = np.asarray(alpha, np.float32)
    return Layer((np.ones((2, 1, 1)) * light * alpha).astype(np.float32), alpha, np.broadcast_to(depth_mm, alpha.shape),
                 (0, 0))


def planes(layers, lens, grid, rays=None, **options):
    scene = LayeredRadiance(tuple(layers), np.array(lens.wavelengths_nm), grid, lens.capture_focal_length_mm)
    return list(cast(scene, lens, lambda: rays or field_map(lens).first_order_rays(1.0), **options))


def depth_of_blur(lens, wanted_px, in_focus=None):
    in_focus = focus_nearness(lens) if in_focus is None else in_focus
    return 1 / np.float64(in_focus + wanted_px / blur_per_nearness_px(lens, PITCH_UM))


def textured(shape, seed=1):
    return np.random.default_rng(seed).random((2, *shape), np.float32)


@pytest.fixture(scope="module")
def lenses():
    """A triplet with tables over heights, and with tables over x and y in one half; their focal length is 50 mm."""
    system = build_system(prescription_of("cooke-triplet-50mm"))
    facts = dict(wavelengths_nm=NM, efl_mm=system.efl_mm, magnification=0.0, object_distance_mm=np.inf,
                 entrance_pupil_mm=system.entrance_pupil_mm, f_number_effective=3.0, sensor_mm=(24.0, 16.0),
                 prescription=system.prescription)
    return (make_lens(heights_mm=np.linspace(0, 15, 11), **facts),
            make_grid_lens(half_mm=(9.0, 13.0), mirrored=(False, True), **facts))


def scene_in_depth(lens, grid):
    """Overlapping rectangles in front of a far plane, through the focus."""
    rng, things = np.random.default_rng(3), []
    for blur in (14.0, 6.0, 1.2, 0.3):
        alpha = np.zeros(grid.shape_px)
        top, left = rng.integers(0, 40, 2)
        alpha[top:top + 50, left:left + 80] = 1
        things.append(layer(alpha, depth_of_blur(lens, blur), textured(grid.shape_px, top)))
    return [*things, layer(np.ones(grid.shape_px), 1 / max(focus_nearness(lens), 1 / FAR), textured(grid.shape_px))]


GRID = PixelGrid((120, 170), 110.0, (52.0, 95.0), (20, 20))
"""Unmirrored, with the axis off its middle."""


def test_a_rotationally_symmetric_lens_is_the_same_by_a_mesh(lenses):
    radial, grid_lens = lenses
    things = scene_in_depth(radial, GRID)
    expected = planes(things, radial, GRID, ray_table(radial.prescription, NM), most_rays=256)
    table = grid_ray_table(radial.prescription, *grid_lens.inverted_ends_mm, grid_lens.mirrored, NM)
    for plane, of_heights in zip(planes(things, grid_lens, GRID, table, most_rays=256), expected, strict=True):
        np.testing.assert_allclose(plane.sharp, of_heights.sharp, atol=2e-3)  # parallax by different rays
        np.testing.assert_allclose(plane.blurred, of_heights.blurred, atol=0.015)
        assert np.mean(np.abs(plane.clear - of_heights.clear) > 0.02) < 2e-3  # rays turn with heights: edges of alpha
        assert np.abs(plane.blurred - of_heights.blurred).mean() < 5e-4
        np.testing.assert_allclose(plane.per_radiance, of_heights.per_radiance, rtol=1e-3)


@pytest.mark.parametrize("mirrored", [(False, False), (True, True)])
def test_all_loops_cast_the_same_picture_by_a_mesh(mirrored):
    lens = make_grid_lens(source_mm=lambda nm, x, y: (x * (1 - 0.01 * x**2) * nm / 550, y * (1 - 0.02 * y**2)),
                          object_distance_mm=700.0, magnification=-0.05, mirrored=mirrored, squeeze=1.5)
    grid = PixelGrid((56, 60), PITCH_UM, (20.0, 32.0), (10, 10), projection=FISHEYE, squeeze=1.5)
    things = scene_in_depth(lens, grid)
    with using("numpy"):
        expected = planes(things, lens, grid, most_rays=16)
    for variant in available():
        with using(variant):
            pictures = planes(things, lens, grid, most_rays=16)
        for plane, by_numpy in zip(pictures, expected, strict=True):
            np.testing.assert_allclose(plane.blurred, by_numpy.blurred, atol=2e-4)
            np.testing.assert_allclose(plane.clear, by_numpy.clear, atol=2e-4)


def leaning_lens(**changes):
    return make_grid_lens(object_distance_mm=700.0, magnification=-0.05, half_mm=(2.0, 2.0), sensor_mm=(3.2, 2.4),
                          **changes)


def test_a_leaning_plane_is_sharp_where_an_upright_one_is_not():
    """The sensor's tilt makes the inverse depth in focus rise by 16 px of blur from the axis to the picture's top."""
    grid = PixelGrid((100, 90), PITCH_UM, (60.0, 40.0), (10, 10))
    slope = 16 / blur_per_nearness_px(leaning_lens(), PITCH_UM) / (50 * PITCH_UM * 1e-3)
    lens = leaning_lens(focus_slope=(0.0, slope))
    up = 60 - np.arange(100)[:, None] + np.zeros(90)
    leaning = 1 / (focus_nearness(lens) + slope * up * PITCH_UM * 1e-3)
    light, dark = textured(grid.shape_px), layer(np.ones(grid.shape_px), np.inf, 0.0)
    in_focus, _ = planes([layer(np.ones(grid.shape_px), leaning, light), dark], lens, grid)
    assert np.array_equal(in_focus.sharp, light[0]) and in_focus.blurred is None

    upright, _ = planes([layer(np.ones(grid.shape_px), depth_of_blur(lens, 0.0), light), dark], lens, grid,
                        most_rays=256)
    contrast = (upright.blurred + upright.sharp[10:-10, 10:-10]).std(axis=1)
    axis = 60 - 10
    assert contrast[axis] == pytest.approx(light[0, 60, 10:-10].std())
    assert contrast[axis - 25] < contrast[axis] / 4 and contrast[axis + 20] < contrast[axis] / 4
    assert not upright.sharp[:30].any() and not upright.sharp[90:].any()


@pytest.mark.parametrize("blur", [-14.0, 14.0])
def test_a_leaning_plane_of_focus_blurs_by_the_distance_from_it(blur):
    """A lamp above the axis, at a distance from the plane that is in focus there."""
    grid, lit = PixelGrid((100, 90), PITCH_UM, (60.0, 40.0), (10, 10)), (30, 52)
    lens = leaning_lens(focus_slope=(1e-4, 2e-4))
    in_focus = focus_in_capture(lens, grid, *lit)
    assert in_focus == pytest.approx(focus_nearness(lens) + (12 * 1e-4 + 30 * 2e-4) * PITCH_UM * 1e-3)
    alpha = np.zeros(grid.shape_px)
    alpha[lit] = 1
    plane, _ = planes([layer(alpha, depth_of_blur(lens, blur, in_focus)),
                       layer(np.ones(grid.shape_px), np.inf, 0.0)], lens, grid, most_rays=1024)
    middle, (down, across) = moments(plane.blurred)
    assert plane.blurred.sum() == pytest.approx(1, rel=0.02) and middle + 10 == pytest.approx(lit, abs=0.5)
    # the plane of focus also leans across the disc: the blur of a ray grows with its landing place
    assert np.sqrt(16 * down - 8 / 6) == pytest.approx(14, rel=0.02)
    assert np.sqrt(16 * across - 8 / 6) == pytest.approx(14, rel=0.02)


def moments(picture):
    """Row and column of the middle of light, and its variances along both."""
    at, total = np.indices(picture.shape), picture.sum()
    middle = (at * picture).sum(axis=(1, 2)) / total
    return middle, ((at - middle[:, None, None]) ** 2 * picture).sum(axis=(1, 2)) / total


def test_a_squeezed_lens_has_oval_discs_with_the_paraxial_sides():
    """By the invariants of both sections, f = 10 and 5 mm, the disc is four times as high as wide on the sensor, and
    twice in the scene."""
    grid, lit = PixelGrid((100, 60), PITCH_UM, (44.0, 27.0), squeeze=2.0), (50, 30)
    lens = leaning_lens(squeeze=2.0)
    width_mm, height_mm = entrance_pupil_size_mm(lens)
    assert height_mm == entrance_pupil_diameter_mm(lens) and height_mm / width_mm == pytest.approx(2, rel=1e-3)
    alpha = np.zeros(grid.shape_px)
    alpha[lit] = 1
    plane, _ = planes([layer(alpha, depth_of_blur(lens, 40.0)), layer(np.ones(grid.shape_px), np.inf, 0.0)], lens, grid,
                      most_rays=1024)
    _, (down, across) = moments(plane.blurred)
    assert plane.blurred.sum() == pytest.approx(1, rel=0.02)
    assert np.sqrt(16 * down - 8 / 6) == pytest.approx(40, rel=0.01)
    assert np.sqrt(16 * across - 8 / 6) == pytest.approx(10, rel=0.05)


def test_depth_checks_follow_a_leaning_plane_of_focus():
    grid = PixelGrid((100, 90), PITCH_UM)
    lens = leaning_lens(focus_slope=(0.0, 2e-3))
    in_focus = focus_in_capture(lens, grid, np.arange(100)[:, None], np.arange(90))
    plan = partial(plan_slabs, capture=grid, lens=lens, accuracy=0.01, overscan_px=(4, 4))
    leaning, upright = plan(1 / in_focus), plan(np.full(grid.shape_px, 1 / focus_nearness(lens)))
    assert not leaning.needed and leaning.check.outside_fraction == 0
    assert upright.needed and 0.5 < upright.check.outside_fraction < 1 and "on the axis" in upright.check.text
    inside = np.abs(in_focus - focus_nearness(lens)) * blur_per_nearness_px(lens, PITCH_UM) <= 1
    check = check_depth(np.full(grid.shape_px, 1 / focus_nearness(lens)), lens, PITCH_UM, in_focus=in_focus)
    assert check.outside_fraction == pytest.approx(1 - inside.mean())


def striped(grid, seed=5):
    """Vertical stripes of light, a column of the grid wide."""
    light = np.random.default_rng(seed).random((2, 1, grid.shape_px[1]), np.float32)
    return np.repeat(light, grid.shape_px[0], axis=1)


@pytest.mark.parametrize("mirrored", [(False, False), (True, True)])
def test_finer_columns_show_what_finer_pixels_do(mirrored):
    """Stripes and posts that are narrower than the sensor's pixels, through a lens with a squeeze, off its axis: as
    cast in pixels a quarter as tall and wide, and merged. In whole pixels the difference is many times as large."""
    lens = make_grid_lens(source_mm=lambda nm, x, y: (x * (1 - 0.01 * x**2) * nm / 550, y * (1 - 0.02 * y**2)),
                          object_distance_mm=700.0, magnification=-0.05, mirrored=mirrored, squeeze=2.0)
    coarse = PixelGrid((40, 48), 4 * PITCH_UM, (13.0, 29.0), (8, 8), squeeze=2.0)
    depths = [1 / (focus_nearness(lens) + blur / blur_per_nearness_px(lens, coarse.pitch_um)) for blur in (7.0, -5.0)]
    fine, across = coarse.finer(4), coarse.finer_across(4)
    posts = np.random.default_rng(6).random(fine.shape_px[1]) < 0.3

    def scene(merged):
        covers = [np.broadcast_to(posts, fine.shape_px), np.ones(fine.shape_px)]
        lights = [striped(fine) * posts, striped(fine, 7)]
        return [Layer(merged(light), merged(cover), np.broadcast_to(depth_mm, merged(cover).shape))
                for light, cover, depth_mm in zip(lights, covers, depths, strict=True)]

    def merging(rows, columns):
        return lambda planes: planes.reshape(*planes.shape[:-2], planes.shape[-2] // rows, rows,
                                             planes.shape[-1] // columns, columns).mean(axis=(-3, -1))

    expected = [merging(4, 4)(plane.blurred * plane.per_radiance) for plane in
                planes(scene(merging(1, 1)), lens, fine, most_rays=256)]
    errors = []
    for grid, merged in ((across, merging(4, 1)), (coarse, merging(4, 4))):
        cast_planes = planes(scene(merged), lens, grid, most_rays=256)
        assert all(plane.clear.shape == plane.blurred.shape == coarse.frame_px for plane in cast_planes)
        errors.append([np.abs(plane.blurred * plane.per_radiance - of_fine).mean() / of_fine.mean()
                       for plane, of_fine in zip(cast_planes, expected, strict=True)])
    assert max(errors[0]) < 0.025 and min(errors[1]) > 3 * max(errors[0])
