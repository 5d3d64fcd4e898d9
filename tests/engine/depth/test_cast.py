"""Casting: layers of depth along rays, against first-order optics, and C against numpy."""

import tracemalloc
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import lensfield.engine.depth.cast as cast_module
from lenses import make_lens
from lensfield.engine.depth.cast import cast, casting_bytes
from lensfield.engine.depth.depth_range import blur_px
from lensfield.engine.depth.meetings import plan_meetings
from lensfield.engine.depth.prepared_layer import PreparedLayer
from lensfield.engine.field.radial.first_order import first_order_rays
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.projection import FISHEYE, PLANE, Projection
from lensfield.engine.kernels.cast import cast as cast_row
from lensfield.engine.kernels.levels import sharpened
from lensfield.engine.kernels.library import available, running
from lensfield.engine.kernels.sample_casting import sample_casting
from lensfield.engine.lens.entrance_pupil import entrance_pupil_diameter_mm, focus_nearness
from lensfield.engine.lens.iris import Iris
from lensfield.engine.library.rays import lens_rays
from lensfield.engine.runtime import threads
from loops import using
from varied_lenses import varied_lens

PITCH_UM, IN_FOCUS_MM = 8.0, 700.0
FAR_MM = 1e6


@pytest.fixture(scope="module")
def lens():
    return make_lens(object_distance_mm=IN_FOCUS_MM, magnification=-0.05)


def layer(alpha, depth_mm, light=1.0, count=2, origin_px=(0, 0)):
    alpha = np.asarray(alpha, np.float32)
    cube = np.broadcast_to(light, (count, *alpha.shape)) * alpha
    return Layer(cube, alpha, np.broadcast_to(depth_mm, alpha.shape), origin_px)


def layered(layers, lens, grid):
    nm = np.linspace(*lens.wavelengths_nm[[0, -1]], len(layers[0].cube))
    return LayeredRadiance(tuple(layers), nm if len(nm) > 1 else lens.wavelengths_nm[:1], grid,
                           lens.capture_focal_length_mm)


def planes(layers, lens, grid, rays=None, **options):
    return list(cast(layered(layers, lens, grid), lens, lambda: rays or first_order_rays(lens), **options))


def depth_of_blur(lens, wanted_px):
    """A depth whose points blur to a disc of this many pixels; positive values are nearer than focus."""
    return 1 / (focus_nearness(lens) + wanted_px / blur_px(lens, PITCH_UM, 1 / (1 + focus_nearness(lens))))


def centroid_and_width(picture):
    """Row, column, and the diameter of a uniform disc with the same second moment."""
    rows, columns = np.indices(picture.shape)
    total = picture.sum()
    row, column = (picture * rows).sum() / total, (picture * columns).sum() / total
    square = (picture * ((rows - row) ** 2 + (columns - column) ** 2)).sum() / total
    return row, column, np.sqrt(8 * square)


@pytest.mark.parametrize("side", ["above", "below", "left", "right"])
def test_a_layer_continues_only_across_the_border_of_the_capture(lens, side):
    """A strip along one side of a picture, blurred by 16 px in front of the focus.

    Beyond three of its sides all rays meet its continuation, at its free end half of them do.
    """
    grid, width = PixelGrid((60, 80), PITCH_UM, centre_px=(22.0, 51.0)), 30
    across, first = side in ("left", "right"), side in ("above", "left")
    shape = (60, width) if across else (width, 80)
    origin = (0, 0) if first else (0, 80 - width) if across else (60 - width, 0)
    strip = layer(np.ones(shape), depth_of_blur(lens, 16.0), 3.0, origin_px=origin)
    blurred = planes([strip, layer(np.zeros(grid.shape_px), FAR_MM)], lens, grid)[0].blurred
    profile = blurred if across else blurred.T
    profile = profile if first else profile[:, ::-1]
    np.testing.assert_allclose(profile[:, :width - 12], 3.0, rtol=1e-5)
    np.testing.assert_allclose(profile[:, width - 1:width + 1].mean(axis=1), 1.5, rtol=0.1)
    assert not profile[:, width + 12:].any()


@pytest.mark.parametrize("blur", [-24.0, 24.0])
def test_a_lamp_out_of_focus_is_a_disc_with_first_order_size_and_position(lens, blur):
    grid, lit = PixelGrid.around_frame((81, 81), PITCH_UM, (12, 12)), (50, 55)
    alpha = np.zeros(grid.shape_px)
    alpha[lit] = 1
    lamp = layer(alpha, depth_of_blur(lens, blur))
    plane, _ = planes([lamp, layer(np.ones(grid.shape_px), np.inf, 0.0)], lens, grid, most_rays=1024)
    row, column, width = centroid_and_width(plane.blurred)
    assert plane.blurred.sum() == pytest.approx(1, rel=0.02)
    assert (row + 12, column + 12) == pytest.approx(lit, abs=0.1)
    assert np.sqrt(width**2 - 8 / 6) == pytest.approx(24, rel=5e-3)  # minus the pixel; look-ups add 0.4 %
    assert not plane.sharp.any()


@pytest.mark.parametrize("reach_px", [0, 3, 20, 10**12])
def test_rays_skip_a_layer_where_they_reach_none_of_it(reach_px):
    """At the edge of a fisheye, rays may reach the horizon of a plane capture."""
    alpha = np.zeros((17, 29), np.float32)
    alpha[5, 8] = 0.3
    depth = np.ones((*alpha.shape, 2), np.float32)
    near = PreparedLayer(layer(alpha, 500.0), depth, PixelGrid((40, 50), PITCH_UM), 1.0)
    rows, columns = np.indices(alpha.shape)
    skipped = np.maximum(np.abs(rows - 5), np.abs(columns - 8)) > reach_px
    np.testing.assert_array_equal(near.near_surfaces(reach_px).depth[..., 1], np.where(skipped, -1, 1))


@pytest.mark.parametrize("lamp, sky", [(-10.0, -14.0), (-6.0, -14.0), (4.0, -14.0), (20.0, -14.0), (24.0, 12.0)])
@pytest.mark.parametrize("side, sky_light", [(1, 0.0), (3, 0.5)])
def test_a_lamp_before_the_sky_in_one_layer_keeps_its_light(lens, lamp, sky, side, sky_light):
    """As in two layers, whose lamps lose and gain nothing."""
    grid = PixelGrid.around_frame((56, 64), PITCH_UM, (25, 25))
    lit = np.zeros(grid.shape_px, bool)
    lit[52:52 + side, 57:57 + side] = True
    depth_mm = np.where(lit, depth_of_blur(lens, lamp), depth_of_blur(lens, sky))
    one = [layer(np.ones(grid.shape_px), depth_mm, np.where(lit, 4.0, sky_light))]
    blurred = planes(one, lens, grid, most_of_lamps=1024)[0].blurred
    assert (blurred - sky_light).sum() == pytest.approx(side**2 * (4 - sky_light), rel=0.02)


@pytest.mark.parametrize("blur", [-30.0, -6.0, 9.0])
def test_an_opaque_plane_is_even_across_layer_borders(lens, blur):
    grid, depth_mm = PixelGrid.around_frame((60, 70), PITCH_UM, (20, 20)), depth_of_blur(lens, blur)
    columns = np.indices(grid.shape_px)[1]
    parts = [layer((columns >= left) & (columns < left + 40), depth_mm, 3.0) for left in (0, 40, 80)]
    for plane in planes(parts, lens, grid):
        mean = plane.blurred.mean(axis=0)  # half-covering alphas remove the light of a sixth of a pixel from a disc
        assert mean.min() > 3 * (1 - 0.4 / abs(blur)) and mean.max() < 3.0001
        assert not plane.sharp.any() and plane.clear.min() == 1


@pytest.mark.parametrize("far, near, slabs", [(10.0, 50.0, 4), (-50.0, -10.0, 4), (20.0, 60.0, 12)])
def test_a_tilted_plane_is_the_same_if_cut_into_slabs(lens, far, near, slabs):
    """A plane with a stripe for each slab, 1 or 5 bright, before the dark: rays look up wide parts of several slabs."""
    grid = PixelGrid.around_frame((48, 60), PITCH_UM, (40, 40))
    row, column = np.indices(grid.shape_px)
    place = far + (near - far) * (row + 0.3 * column) / (row + 0.3 * column).max()
    per_px = np.hypot(*np.gradient(place)).mean()
    beyond = [np.clip((place - border) / per_px + 0.5, 0, 1) for border in np.linspace(far, near, slabs + 1)[1:-1]]
    alphas = -np.diff([np.ones_like(place), *beyond, np.zeros_like(place)], axis=0)[::-1]
    lights, depth_mm = np.resize([5.0, 1.0], slabs), depth_of_blur(lens, place)
    cut = [layer(alpha, depth_mm, light).cropped() for alpha, light in zip(alphas, lights, strict=True)]
    uncut = [layer(np.ones(grid.shape_px), depth_mm, np.tensordot(lights, alphas, 1))]
    even = [replace(each, cube=np.stack([each.alpha] * 2)) for each in cut]
    dark = layer(np.ones(grid.shape_px), np.inf, 0.0)
    of_cut, of_uncut, of_even = (planes([*plane, dark], lens, grid)[0].blurred for plane in (cut, uncut, even))
    off = np.abs(of_cut - of_uncut) / of_uncut.mean()
    assert off.mean() < 0.01 and off.max() < 0.05
    np.testing.assert_allclose(of_even, 1, atol=0.01)


@pytest.mark.parametrize("nearer", [True, False])
def test_in_focus_light_stays_in_the_pinhole_image(lens, nearer):
    """In front of a hidden world, or next to out-of-focus light."""
    grid = PixelGrid.around_frame((64, 96), PITCH_UM, (16, 16))
    light = np.random.default_rng(1).random((2, *grid.shape_px), np.float32)
    things = [layer(np.ones(grid.shape_px), IN_FOCUS_MM + lens.entrance_pupil_mm, light)]
    if nearer:
        alpha = np.zeros((30, 20))
        alpha[5:25, 5:15] = 1
        things.insert(0, layer(alpha, depth_of_blur(lens, 6.0), 5.0, origin_px=(20, 10)))
    else:
        things.append(layer(np.ones(grid.shape_px), np.inf))
    for plane, expected in zip(planes(things, lens, grid), light, strict=True):
        assert np.array_equal(plane.sharp, expected)
        assert plane.clear[:, 50:].min() == 1 and not plane.blurred[:, 50:].any()
        if nearer:
            assert plane.clear[19, 4] == 0 and plane.blurred[19, 4] == pytest.approx(5, rel=1e-5)
            assert np.allclose(plane.blurred, 5 * (1 - plane.clear), atol=0.15)  # fewer rays meet bright pixels
        else:
            assert not plane.blurred.any() and plane.clear.min() == 1


def test_a_near_edge_dims_in_focus_light_by_the_area_of_its_disc(lens):
    """The share of a disc beyond a straight line through it."""
    grid, blur = PixelGrid.around_frame((16, 120), PITCH_UM, (40, 40)), 32.0
    columns = np.indices(grid.shape_px)[1]
    near = layer(columns < 100, depth_of_blur(lens, blur), 0.0)
    far = layer(np.ones(grid.shape_px), IN_FOCUS_MM + lens.entrance_pupil_mm, 2.0)
    plane, _ = planes([near, far], lens, grid, most_rays=1024)
    away = np.clip((np.arange(120) + 40 - 99.5) / (blur / 2), -1, 1)
    share = 1 - (np.arccos(away) - away * np.sqrt(1 - away**2)) / np.pi
    assert np.allclose(plane.clear.mean(axis=0), share, atol=0.01)
    assert not plane.blurred.any()


def test_partly_in_focus_light_adds_up_to_one(lens):
    """A plane through focus, rendered partly by each method, without light from behind it."""
    grid = PixelGrid.around_frame((48, 160), PITCH_UM, (16, 16))
    columns = np.indices(grid.shape_px)[1]
    depth_mm = depth_of_blur(lens, 6 * (columns - 96) / 96)
    texture = 1 + (columns // 16) % 2
    things = [layer(np.ones(grid.shape_px), depth_mm, 1.0), layer(np.ones(grid.shape_px), np.inf, 7.0 * texture)]
    for plane in planes(things, lens, grid, most_rays=512):
        total = plane.sharp[16:-16, 16:-16] * plane.clear + plane.blurred
        assert np.abs(total - 1).max() < 0.03  # the share of in-focus light changes over half a pixel


@pytest.mark.parametrize("blur", [1.1, 1.4, 1.9])
def test_a_partly_in_focus_plane_hides_in_focus_light_behind_it(lens, blur):
    grid = PixelGrid.around_frame((40, 48), PITCH_UM, (8, 8))
    behind = np.random.default_rng(1).random((2, *grid.shape_px)) * 9
    things = [layer(np.ones(grid.shape_px), depth_of_blur(lens, blur), 1.0),
              layer(np.ones(grid.shape_px), IN_FOCUS_MM + lens.entrance_pupil_mm, behind)]
    for plane in planes(things, lens, grid):
        total = plane.sharp[8:-8, 8:-8] * plane.clear + plane.blurred
        assert np.abs(total - 1).max() < 0.05 and abs(total.mean() - 1) < 0.005


def test_empty_layers_are_black(lens):
    grid = PixelGrid.around_frame((20, 24), PITCH_UM, (4, 4))
    for plane in planes([layer(np.zeros(grid.shape_px), 1.0), layer(np.zeros((1, 1)), np.inf)], lens, grid):
        assert not plane.sharp.any() and plane.blurred is None


def random_scene(lens, grid, count, seed=0):
    rng = np.random.default_rng(seed)
    rows, columns = grid.shape_px
    things = []
    for blur in (14.0, 5.0, 0.3, -4.0, -16.0):
        top, left = rng.integers(0, (max(1, rows // 2), max(1, columns // 2)))
        shape = tuple(rng.integers(1, (rows - top + 1, columns - left + 1)))
        alpha = rng.random(shape) * (rng.random(shape) < 0.7)
        things.append(layer(alpha, depth_of_blur(lens, blur * (1 + 0.2 * rng.random(shape))),
                            rng.random((count, *shape)), count, (int(top), int(left))))
    return [*things, layer(np.ones(grid.shape_px), np.inf, rng.random((count, rows, columns)), count)]


GRIDS = [PixelGrid.around_frame((40, 52), PITCH_UM, (12, 9)), PixelGrid((1, 1), PITCH_UM), PixelGrid((1, 37), PITCH_UM),
         PixelGrid((23, 2), PITCH_UM), PixelGrid((45, 30), PITCH_UM, (-20.3, 55.2)),
         PixelGrid((31, 33), PITCH_UM, projection=FISHEYE)]


ROUNDING = 64 * 2.0**-24  # of float32 sums over 64 rays, each of light up to 1


@pytest.mark.sample(5)
@pytest.mark.skipif(len(available()) < 2, reason="no library of the loops: no compiler")
@pytest.mark.parametrize("grid", GRIDS, ids=lambda grid: f"{grid.shape_px}")
@pytest.mark.parametrize("iris", [None, Iris(5, 20.0, 0.3)])
def test_variants_agree_bit_for_bit_and_with_numpy_up_to_rounding(lens, grid, iris):
    scene, results = random_scene(lens, grid, 5), []
    for name in available():
        with using(name):
            assert running() == name
            results.append(planes(scene, lens, grid, most_rays=64, iris=iris))
    by_numpy, expected, *others = results
    for result in others:
        for plane, same in zip(result, expected, strict=True):
            assert np.array_equal(plane.blurred, same.blurred) and np.array_equal(plane.clear, same.clear)
    for plane, close in zip(by_numpy, expected, strict=True):
        np.testing.assert_allclose(plane.blurred, close.blurred, rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(plane.clear, close.clear, rtol=0, atol=ROUNDING)
        assert np.isfinite(plane.blurred).all() and plane.clear.min() >= 0 and plane.clear.max() <= 1


@pytest.mark.skipif(len(available()) < 2, reason="no library of the loops: no compiler")
@pytest.mark.parametrize("steps", [1, 2, 3])
def test_the_rays_that_are_followed_together_do_not_change_the_result(steps):
    """Where the search ends with the depth before, but from another pixel with another focus share."""
    casting, random, results = sample_casting(2, False), np.random.default_rng(3), []
    casting.meetings["steps"], casting.meetings["focused"] = steps, 1
    for layer in casting.layers:
        layer.depth[..., 0] *= random.choice([1, 0.99], layer.depth.shape[:2])
        layer.depth[..., 1] = random.random(layer.depth.shape[:2])
    for name in available():
        with using(name):
            blurred, clear = np.zeros((2, 2, 27, 43), np.float32)
            for row in range(2):
                cast_row(casting, row, blurred, clear)
            results.append((blurred, clear))
    by_numpy, expected, *others = results
    assert all(np.array_equal(one, other) for result in others for one, other in zip(result, expected, strict=True))
    np.testing.assert_allclose(by_numpy, expected, rtol=0, atol=16 * ROUNDING)


def test_threads_do_not_change_the_result(lens, monkeypatch):
    scene, results = random_scene(lens, GRIDS[0], 5), []
    for count in (1, 5):
        monkeypatch.setattr(threads, "thread_count", lambda count=count: count)
        results.append([plane.blurred for plane in planes(scene, lens, GRIDS[0])])
    assert np.array_equal(*results)


@pytest.mark.parametrize("panorama", [FISHEYE, Projection((1.05, -0.1, 0.1))])
def test_panoramas_and_plane_captures_agree(lens, panorama):
    """For a uniform scene with an edge, in pixels of the same sensor."""
    focal_mm, depth_mm = lens.capture_focal_length_mm, depth_of_blur(lens, -20.0)
    results = []
    for projection in (PLANE, panorama):
        grid = PixelGrid.around_frame((60, 300), 40.0, (30, 40), projection)
        x_mm, y_mm = (each[None] if axis == 0 else each[:, None] for axis, each in enumerate(grid.axes_mm()))
        radius = np.hypot(x_mm, y_mm) / focal_mm
        x_mm = x_mm * np.tan(projection.angle_rad(radius)) / radius
        stripes = 1 + np.sin(x_mm * 6 + 0 * y_mm)
        results.append(planes([layer(np.ones(grid.shape_px), depth_mm, stripes)], lens, grid, most_rays=512)[0].blurred)
    assert np.abs(results[1] - results[0]).max() < 0.02 and np.ptp(results[0]) > 0.1


def test_sharpening_subtracts_the_spread_of_look_ups():
    """A smooth spot gets narrower by a pixel and a cell; light is only moved, evenly lit planes stay as they are."""
    row, column = np.indices((40, 52))
    spot = np.exp(-((row - 17.3) / 5) ** 2 - ((column - 30.8) / 6) ** 2).astype(np.float32)
    lamp = np.zeros_like(spot)
    lamp[10:13, 20:24] = np.array([0.2, 1.0, 0.7])[:, None] * (0.01, 1.0, 1.0, 0.5)
    result = sharpened(np.stack([spot + 1e-3, lamp, np.full_like(spot, 3.0)]))
    squares = [centroid_and_width(plane - 1e-3)[2] ** 2 / 8 for plane in (spot + np.float32(1e-3), result[0])]
    assert squares[0] - squares[1] == pytest.approx(2 / 6, rel=0.01)
    assert centroid_and_width(result[0] - 1e-3)[:2] == pytest.approx((17.3, 30.8), abs=1e-3)
    assert result[1].sum() == pytest.approx(lamp.sum(), rel=1e-6) and result[1].min() == 0
    assert result[1].max() > 1.1 and not result[1, 9].any() and np.all(result[2] == 3)


def test_lamps_receive_more_rays(lens):
    """A lamp's disc has a sharper rim, and areas without lamps are the same."""
    grid = PixelGrid.around_frame((64, 192), PITCH_UM, (24, 24))
    alpha = np.zeros(grid.shape_px)
    alpha[55:58, 55:58] = 1
    lamp = layer(alpha, depth_of_blur(lens, 36.0), 5000.0)
    ground = layer(np.ones(grid.shape_px), depth_of_blur(lens, -12.0), 1 + np.indices(grid.shape_px)[1] % 2)
    few, many = (planes([lamp, ground], lens, grid, most_rays=64, most_of_lamps=rays)[0].blurred for rays in (64, 1024))
    disc = np.hypot(*(axis - 32 for axis in np.indices(few.shape))) < 18
    level = 9 * 5000 / (np.pi * 18**2)
    rims = [np.abs(picture - np.where(disc, level, 1.5))[:64, :64].sum() for picture in (few, many)]
    assert rims[0] > 1.5 * rims[1]
    np.testing.assert_allclose(few[:, 144:], many[:, 144:], rtol=1e-4)  # positions are rounded


@pytest.mark.parametrize("blur", [-8.0, 5.0, 14.0])
def test_larger_cells_take_fewer_rays(lens, monkeypatch, blur):
    """A lamp in noise: the misplaced light is that of the tiers, which are at most as accurate as these cells."""
    grid = PixelGrid((70, 90), PITCH_UM, (-40.3, 55.2))
    light, counts, pictures = np.random.default_rng(2).random((2, *grid.shape_px)), [], []
    light[:, 30:33, 40:43] = 200
    scene = [layer(np.ones(grid.shape_px), depth_of_blur(lens, blur), light)]

    def planned(*given):
        plan = plan_meetings(*given)
        counts.append(plan.counts.sum())
        return plan

    monkeypatch.setattr(cast_module, "plan_meetings", planned)
    for cell_px, of_lamps in ((0.25, 4096), (0.5, 1024), (0.7, 1024), (1.0, 1024)):
        pictures.append(planes(scene, lens, grid, most_rays=64, most_of_lamps=of_lamps, finest_px=cell_px)[0].blurred)
    assert counts[1] > 1.2 * counts[2] and counts[1] > 2 * counts[3]
    for picture, off in zip(pictures[1:], (0.006, 0.015, 0.025), strict=True):
        assert np.abs(picture - pictures[0]).sum() < off * pictures[0].sum()
        assert picture.sum() == pytest.approx(pictures[0].sum(), rel=1e-3)


@pytest.mark.parametrize("blur, rays", [(16.0, 64), (26.0, 256), (-40.0, 256), (40.0, 576)])
def test_the_disc_of_a_lamp_is_even_and_has_all_of_its_light(lens, blur, rays):
    """The lens's own opening is even, so all light and dark inside the disc is an error of the rays' places."""
    grid = PixelGrid((96, 110), PITCH_UM, (-150.0, 260.0))
    alpha = np.zeros(grid.shape_px)
    alpha[46:49, 51:54] = 1
    lamp = layer(alpha, depth_of_blur(lens, blur), 4.0)
    plane, _ = planes([lamp, layer(np.ones(grid.shape_px), np.inf, 0.0)], lens, grid, most_rays=rays)
    row, column, _ = centroid_and_width(plane.blurred)
    cell_px = abs(blur) * np.sqrt(np.pi / 4 / rays)
    away = np.hypot(*(axis - at for axis, at in zip(np.indices(grid.shape_px), (row, column), strict=True)))
    inside = plane.blurred[away < abs(blur) / 2 - 2 - 2 * max(cell_px, 1)]
    assert plane.blurred.sum() == pytest.approx(9 * 4, rel=0.01)
    assert inside.size > 12 and inside.std() < 0.06 * inside.mean()


def test_a_scene_that_is_black_or_in_focus_needs_no_rays(lens):
    grid = PixelGrid.around_frame((20, 24), PITCH_UM, (4, 4))
    light = np.random.default_rng(1).random((2, *grid.shape_px))
    in_focus = layer(np.ones(grid.shape_px), depth_of_blur(lens, 0.7), light)
    black = [layer(np.ones(grid.shape_px), depth_of_blur(lens, blur), 0.0) for blur in (9.0, -9.0)]
    for scene, expected in (([in_focus], light), (black, 0 * light)):
        capture = layered(scene, lens, grid)
        for plane, sharp in zip(cast(capture, lens, pytest.fail), expected, strict=True):
            assert plane.blurred is None and np.array_equal(plane.sharp, sharp.astype(np.float32))


def test_the_dark_behind_light_in_focus_needs_no_rays(lens):
    """A lit square in focus; behind it, or next to it in the same layer, the dark."""
    grid = PixelGrid.around_frame((40, 52), PITCH_UM, (8, 8))
    alpha = np.zeros(grid.shape_px)
    alpha[12:30, 20:41] = 1
    light, focus_mm = np.random.default_rng(1).random((2, *grid.shape_px)), IN_FOCUS_MM + lens.entrance_pupil_mm
    square, dark = layer(alpha, focus_mm, light), layer(np.ones(grid.shape_px), np.inf, 0.0)
    together = layer(np.ones(grid.shape_px), np.where(alpha, focus_mm, np.inf), light * alpha)
    for scene in ([square, dark], [together]):
        for plane, sharp in zip(cast(layered(scene, lens, grid), lens, pytest.fail), square.cube, strict=True):
            assert plane.blurred is None and np.array_equal(plane.sharp, sharp)


def test_tiles_that_a_dark_surface_hides_light_from_are_cast(lens):
    """A dark strip in front of the focus covers a lit plane in focus; no tile beyond its blur is cast."""
    grid = PixelGrid((160, 192), PITCH_UM)
    strip = layer(np.ones((160, 20)), depth_of_blur(lens, 12.0), 0.0, origin_px=(0, 30))
    ground = layer(np.ones(grid.shape_px), IN_FOCUS_MM + lens.entrance_pupil_mm, 2.0)
    for plane in planes([strip, ground], lens, grid):
        assert not plane.blurred.any() and np.array_equal(plane.sharp, ground.cube[0])
        assert plane.clear[:, 39:41].max() == 0 and plane.clear[:, 96:].min() == 1
        assert plane.clear[:, 10:70].mean(axis=0).sum() == pytest.approx(40, abs=0.5)


def test_dark_tiles_are_not_cast(lens):
    """Light in one corner, and blur that does not reach the others."""
    grid = PixelGrid((160, 192), PITCH_UM)
    ground = layer(np.ones(grid.shape_px), depth_of_blur(lens, -8.0), 0.0)
    cube = ground.cube.copy()
    cube[1, 20:30, 30:40] = 3.0
    scene = [Layer(cube, ground.alpha, ground.depth_mm)]
    _, lit = planes(scene, lens, grid)
    assert lit.blurred.sum() == pytest.approx(300, rel=1e-3) and not lit.blurred[64:].any()


def test_tiles_in_focus_are_not_cast_and_blur_of_a_pixel_needs_few_rays(lens, monkeypatch):
    """A lit plane in focus, and one corner of it behind the focus: rays of the other tiles do not reach this corner."""
    grid = PixelGrid((160, 192), PITCH_UM)
    light = 1 + np.random.default_rng(1).random(grid.shape_px)
    for blur, least, most in ((-1.0, 16, 16), (-12.0, 64, 144)):
        depth_mm = np.full(grid.shape_px, IN_FOCUS_MM + lens.entrance_pupil_mm)
        depth_mm[100:, :40] = depth_of_blur(lens, blur)
        plans = []

        def planned(*given, plans=plans):
            plans.append(plan_meetings(*given))
            return plans[0]

        monkeypatch.setattr(cast_module, "plan_meetings", planned)
        planes([layer(np.ones(grid.shape_px), depth_mm, light)], lens, grid, most_rays=144)
        counts = plans[0].counts
        assert not counts[:4].any() and not counts[:, 5:].any()
        assert least <= counts[8:, :1].min() and counts.max() <= most


def test_rays_of_a_fisheye_meet_surfaces_beside_it_only_there(lens, monkeypatch):
    """A wall around the camera, and a post 100 mm from it. Their depth along the axis is tiny where they are beside it:
    in the plane of an ideal image, blur of surfaces so near would be as wide as the view."""
    grid = PixelGrid((64, 128), 400.0, projection=FISHEYE).with_overscan((128, 96))
    rows, columns = np.indices(grid.shape_px) - np.reshape(grid.centre_px, (2, 1, 1))
    angle_rad = np.hypot(rows, columns) * grid.pitch_um * 1e-3 / lens.capture_focal_length_mm
    ahead = np.maximum(np.cos(angle_rad), 1e-6)
    post, wall = (columns > 12) & (columns < 16) & (angle_rad < 0.3), angle_rad < np.pi / 2
    beside = wall & (angle_rad > 1.5)
    parts = [layer(post, 100.0 * ahead), layer(beside, 400.0 * ahead), layer(wall & ~beside, 400.0 * ahead)]
    plans, pictures = [], []
    for scene in (parts, parts[::2]):
        monkeypatch.setattr(cast_module, "plan_meetings",
                            lambda *given: plans.append(plan_meetings(*given)) or plans[-1])
        pictures.append(np.stack([plane.blurred for plane in planes(scene, lens, grid)]))
    with_all, without = plans
    met = with_all.kinds["steps"] >= 0
    assert not met[..., 1].any() and met[..., 2].all() and met[:, 4, 0].any() and not met[:, 0, 0].any()
    np.testing.assert_array_equal(with_all.counts, without.counts)
    np.testing.assert_array_equal(*pictures)


@pytest.mark.parametrize("blur, step", [(-22.0, 2), (44.0, 4)])
@pytest.mark.parametrize("variant", available())
def test_pixels_of_wide_blur_are_interpolated(lens, monkeypatch, variant, blur, step):
    """A texture next to a strip in focus: the difference from all pixels is below that between 64 and 256 rays."""
    grid, texture = PixelGrid((150, 203), PITCH_UM, (-31.3, 90.8)), np.random.default_rng(1).random((2, 150, 203))
    depth_mm = np.full(grid.shape_px, depth_of_blur(lens, blur))
    depth_mm[:, :20] = IN_FOCUS_MM + lens.entrance_pupil_mm
    scene, plans, pictures = [layer(np.ones(grid.shape_px), depth_mm, texture)], [], []

    def planned(*given, step=None):
        plans.append(plan_meetings(*given))
        return plans[-1] if step is None else replace(plans[-1], steps=np.full_like(plans[-1].steps, step))

    with using(variant):
        for rays, forced in ((64, None), (64, 1), (256, 1)):
            monkeypatch.setattr(cast_module, "plan_meetings", partial(planned, step=forced))
            pictures.append(np.stack([plane.blurred for plane in planes(scene, lens, grid, most_rays=rays)])[:, :, 64:])
    few, full, many = pictures
    assert plans[0].steps[:, :2].max() == 1 and np.all(plans[0].steps[:, 5:] == step)
    assert 0 < np.abs(few - full).mean() < 0.5 * np.abs(full - many).mean()
    assert few.mean() == pytest.approx(full.mean(), rel=1e-3)


@pytest.mark.parametrize("size", [1e30, 1e37, 3e38])
def test_the_brightest_floats_do_not_overflow(lens, size):
    """Light scaled by a power of two scales the result by the same power, although its sums exceed float32."""
    grid, power = PixelGrid((40, 52), PITCH_UM, (12.3, 30.7)), np.float32(2.0 ** np.floor(np.log2(size)))
    scene = random_scene(lens, grid, 3)
    bright = [Layer(each.cube * power, each.alpha, each.depth_mm, each.origin_px) for each in scene]
    with np.errstate(all="raise"):
        result = planes(bright, lens, grid, most_rays=256, most_of_lamps=1024)
    for plane, expected in zip(result, planes(scene, lens, grid, most_rays=256, most_of_lamps=1024), strict=True):
        assert expected.blurred.max() > 0.5
        np.testing.assert_allclose(plane.blurred, power * expected.blurred, rtol=1e-5)
        np.testing.assert_allclose(plane.clear, expected.clear, atol=1e-5)


def test_a_lamp_in_the_corner_is_a_cats_eye_cut_by_the_apertures():
    """Against rays from every pixel through random points of the stop, looked up one by one."""
    lens, side = varied_lens("kodak-petzval-100mm"), 29
    rays, focal_mm = lens_rays(lens), lens.capture_focal_length_mm
    corner_mm = 0.85 * rays.last_height_mm / np.sqrt(2)
    pitch_mm = 2 * entrance_pupil_diameter_mm(lens) * focal_mm * 2e-4 / side
    middle = (side - 1) / 2
    centre_px = middle + corner_mm / pitch_mm, middle - corner_mm / pitch_mm  # the lamp is to the upper right of it
    grid = PixelGrid((side, side), 1e3 * pitch_mm, centre_px)
    x_mm, y_mm = np.meshgrid(*grid.axes_mm())
    nearness = focus_nearness(lens) + 2e-4
    rng = np.random.default_rng(2)
    radius, azimuth = np.sqrt(rng.random((side, side, 400))), 2 * np.pi * rng.random((side, side, 400))
    traced = rays.at([550.0]).rays(0, -np.stack([x_mm, y_mm])[..., None],
                                   np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth)]))
    place_mm = focal_mm * (traced.entrance_mm * nearness - traced.direction[:2] / traced.direction[2])
    passing = traced.margin > 0
    lit_mm = [(each * passing).sum() / passing.sum() for each in place_mm]
    column, row = (round(middle + sign * (at - corner_mm) / pitch_mm) for at, sign in zip(lit_mm, (1, -1), strict=True))
    alpha = np.zeros(grid.shape_px)
    alpha[row, column] = 1
    at_x, at_y = (axis[index] for axis, index in zip(grid.axes_mm(), (column, row), strict=True))
    # the mean of a pixel over a ray's cell, which is half a pixel wide
    share = np.prod([np.clip(2 * (0.5 - np.abs(place - at) / pitch_mm) + 0.5, 0, 1)
                     for place, at in zip(place_mm, (at_x, at_y), strict=True)], axis=0)
    light = traced.weight * passing
    expected = (share * light).sum(axis=-1) / np.maximum(light.sum(axis=-1), 1e-9)
    scene = LayeredRadiance((layer(alpha, 1 / nearness, count=1),), [550.0], grid, focal_mm)
    plane, = cast(scene, lens, lambda: rays, most_rays=1024)
    off = plane.blurred - expected
    noise = np.sqrt((share**2 * passing).sum(axis=-1)) / np.maximum(passing.sum(axis=-1), 1)
    assert np.abs(off).max() < 5 * noise.max() and abs(off.sum()) < 5 * np.sqrt((noise**2).sum())
    assert 0.3 < passing.mean() < 0.8 and expected.sum() > 0.5
    widths = [np.sqrt(((axis - (axis * plane.blurred).sum() / plane.blurred.sum())**2 * plane.blurred).sum())
              for axis in (x_mm + y_mm, x_mm - y_mm)]
    assert abs(np.log(widths[0] / widths[1])) > 0.1  # it is not round


@pytest.mark.parametrize("count, rays", [(2, 256), (13, 1024)])
def test_casting_uses_the_estimated_memory(lens, count, rays):
    """Excluding the loops' own memory, which is small. A lamp needs all of the rays, a slanted ground many levels."""
    grid, lamp = PixelGrid((480, 640), PITCH_UM), np.zeros((480, 640))
    lamp[240, 320] = 1
    ground_mm = depth_of_blur(lens, np.linspace(-2, -20, 480)[:, None])
    parts = [layer(lamp, depth_of_blur(lens, 40.0), 1e6, count), layer(np.ones_like(lamp), ground_mm, 1.0, count)]
    scene, table = layered(parts, lens, grid), first_order_rays(lens)
    tracemalloc.start()
    for view in cast(scene, lens, lambda: table, most_rays=64, most_of_lamps=rays):
        del view
    used = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert used < 1.3 * casting_bytes(scene, lens, rays) < 1.3**2 * used
