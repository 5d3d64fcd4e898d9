"""The planner of slabs: borders between objects and not through them, and margins computed by hand."""

import numpy as np
import pytest

from lenses import make_lens
from lensfield.engine.depth.depth_range import blur_per_nearness_px, blur_px
from lensfield.engine.depth.slabs import DEEP_PX, SlabPlan, plan_slabs
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.projection import FISHEYE

LENS = make_lens(efl_mm=100.0, magnification=-0.05, f_number_effective=2.2, object_distance_mm=2000.0,
                 entrance_pupil_mm=0.0, sensor_mm=(36.0, 24.0))
"""The pupil is 45 mm wide; the focus is at 2 m."""
PITCH_UM = 93.75
FRAME = PixelGrid((96, 128), PITCH_UM)
ROOM = PixelGrid((288, 384), PITCH_UM)


def plan(depth_mm, capture=None, lens=LENS, *, accuracy=0.01, overscan_px=(0, 0), **options) -> SlabPlan:
    return plan_slabs(depth_mm, capture or PixelGrid(np.shape(depth_mm), PITCH_UM), lens, accuracy=accuracy,
                      overscan_px=overscan_px, **options)


def floor_mm(grid, height_mm=220.0):
    """A floor below the camera, up to the horizon, and an infinitely distant sky."""
    _, y_mm = grid.axes_mm()
    with np.errstate(divide="ignore"):
        down = np.where(y_mm < 0, height_mm * LENS.capture_focal_length_mm / -y_mm, np.inf)
    return np.broadcast_to(down[:, None], grid.shape_px).copy()


def room_mm(seed=3):
    """A floor in front of a wall with a window, a pillar, balls, leaves of grass, and lamps near and far."""
    random = np.random.default_rng(seed)
    depth_mm = np.minimum(floor_mm(ROOM), 5500)
    rows, columns = np.indices(ROOM.shape_px)
    window = (np.abs(columns - 250) < 45) & (rows < 130)
    depth_mm[window] = 30000
    depth_mm[:, 120:134] = np.minimum(depth_mm[:, 120:134], 3200)
    for row, column, radius, z in ((190, 230, 40, 2000), (200, 150, 20, 1150), (60, 260, 5, 25000), (60, 60, 4, 4500)):
        depth_mm[(rows - row)**2 + (columns - column)**2 < radius**2] = z
    for _ in range(25):
        column, top, z = random.integers(200, 380), random.integers(100, 250), random.uniform(750, 1000)
        depth_mm[top:, column:column + 2] = z
    return depth_mm


def hidden_share(borders_mm, depth_mm):
    """The share of all blur steps larger than a pixel that have both sides in the same slab."""
    blur, slab = blur_px(LENS, PITCH_UM, depth_mm), np.searchsorted(borders_mm, depth_mm)
    hidden = total = 0.0
    for axis in (0, 1):
        jumps = np.abs(np.diff(blur, axis=axis))
        jumps[jumps < 1] = 0
        total += jumps.sum()
        hidden += jumps[np.diff(slab, axis=axis) == 0].sum()
    return hidden / total


def test_four_planned_slabs_hide_less_than_eight_even_ones():
    depth_mm = room_mm()
    even = 1 / np.linspace(1 / depth_mm.min(), 1 / depth_mm.max(), 9)[1:-1]
    assert hidden_share(plan(depth_mm, accuracy=1e-6, most_slabs=4).borders_mm, depth_mm) < hidden_share(even, depth_mm)


def test_the_planned_hidden_share_is_that_of_the_borders():
    depth_mm = room_mm()
    for most in (1, 2, 4, 8):
        planned = plan(depth_mm, accuracy=1e-6, most_slabs=most)
        assert planned.hidden / planned.behind == pytest.approx(hidden_share(planned.borders_mm, depth_mm), abs=0.01)


@pytest.mark.parametrize("seed", range(4))
def test_more_slabs_never_hide_more(seed):
    depth_mm = room_mm(seed)
    left = [plan(depth_mm, accuracy=1e-9, most_slabs=most).hidden for most in range(1, 13)]
    assert np.all(np.diff(left) <= 0) and left[-1] < 0.05 * left[0]


def test_the_accuracy_determines_the_number_of_slabs():
    depth_mm = room_mm()
    numbers = [plan(depth_mm, accuracy=accuracy).slabs for accuracy in (0.5, 0.1, 0.01, 0.001)]
    assert numbers == sorted(numbers) and numbers[0] < numbers[-1] <= 12
    assert plan(depth_mm, accuracy=0.001, most_slabs=4).slabs == 4


def test_a_card_in_front_of_a_wall_needs_one_border():
    depth_mm = np.full(FRAME.shape_px, 4000.0)
    depth_mm[30:60, 40:80] = 1000
    planned = plan(depth_mm)
    assert planned.needed and planned.hidden < 0.01 * planned.behind
    border_mm, = planned.borders_mm
    assert 1100 < border_mm < 3500
    assert "2 slabs, cut at" in planned.text


def test_bright_edges_count_more():
    """A card in front of a near wall, and a lamp in front of a far one: two slabs can separate only one of them."""
    depth_mm = np.where(np.arange(128) < 64, 2000.0, 20000.0) * np.ones((96, 1))
    depth_mm[20:60, 20:50], depth_mm[40:44, 100:104], depth_mm[:, 64] = 1500, 5000, np.nan
    light = np.where(depth_mm == 5000, 1000.0, 1.0)
    assert 1500 < plan(depth_mm, most_slabs=2).borders_mm[0] < 2000
    assert 5000 < plan(depth_mm, light=light, most_slabs=2).borders_mm[0] < 20000
    for none in (0 * light, np.full(FRAME.shape_px, np.nan)):
        assert plan(depth_mm, light=none).borders_mm == pytest.approx(plan(depth_mm).borders_mm)


def test_a_border_avoids_surfaces_close_to_it():
    """Few pixels of blur separate a lamp at 25 m from a wall at 30 m."""
    depth_mm = np.full(FRAME.shape_px, 30000.0)
    depth_mm[30:60, 40:80] = 12000
    border_mm, = plan(depth_mm).borders_mm
    assert 14000 < border_mm < 26000


@pytest.mark.parametrize("z_mm", [700.0, 2300.0, 50000.0, np.inf])
def test_a_plane_out_of_focus_needs_one_slab(z_mm):
    planned = plan(np.full(FRAME.shape_px, z_mm))
    assert planned.needed and planned.slabs == 1 and planned.hidden == planned.behind == 0


def test_a_scene_in_focus_needs_no_slabs():
    planned = plan(np.full(FRAME.shape_px, 2001.0))
    assert not planned.needed and planned.slabs == 1 and planned.margins_px == ((0, 0),)
    assert planned.text == "the lens data apply to all depths of the scene"


def test_the_accuracy_decides_whether_slight_defocus_needs_slabs():
    """0.97 px of blur is slightly more than the 0.8 px that pixels hide."""
    z_mm = 1 / (1 / 2000 + 0.97 / blur_per_nearness_px(LENS, PITCH_UM))
    assert not plan(np.full(FRAME.shape_px, z_mm), accuracy=0.1).needed
    assert plan(np.full(FRAME.shape_px, z_mm), accuracy=0.01).needed


@pytest.mark.parametrize("every", [1, 3])
def test_a_floor_alone_needs_one_slab(every):
    depth_mm = floor_mm(ROOM)[::every, ::every]
    assert plan(depth_mm, ROOM).slabs == 1


def test_a_slanted_floor_with_a_horizon_needs_one_slab():
    x_mm, y_mm = ROOM.axes_mm()
    nearness = np.maximum((0.3 * x_mm - y_mm[:, None]) / (220 * LENS.capture_focal_length_mm), 0)
    with np.errstate(divide="ignore"):
        assert plan(1 / nearness).slabs == 1


def test_an_infinitely_distant_scene_needs_slabs_unless_in_focus():
    far = make_lens(efl_mm=50.0, object_distance_mm=np.inf, magnification=0.0, f_number_effective=5.0)
    depth_mm = np.full(FRAME.shape_px, np.inf)
    assert not plan(depth_mm, lens=far).needed
    assert plan(depth_mm).slabs == 1 and plan(depth_mm).needed


def test_a_scene_without_depth_needs_no_slabs():
    planned = plan(np.full(FRAME.shape_px, np.nan))
    assert not planned.needed and planned.check is None and planned.text


@pytest.mark.parametrize("every", [1, 3])
def test_an_empty_background_needs_no_slabs(every):
    """An object in focus fills a quarter of the frame; without the rest's light there is nothing out of focus."""
    depth_mm, empty = np.full(ROOM.shape_px, np.inf), np.ones(ROOM.shape_px, bool)
    rows, columns = (n // 2 for n in ROOM.shape_px)
    depth_mm[:rows, :columns], empty[:rows, :columns] = 2001.0, False
    depth_mm, empty = depth_mm[::every, ::every], empty[::every, ::every]
    assert plan(depth_mm, ROOM).needed and plan(depth_mm, ROOM).check.outside_fraction == pytest.approx(0.75, abs=0.01)
    planned = plan(depth_mm, ROOM, empty=empty)
    assert not planned.needed and planned.check.outside_fraction == 0 and planned.check.farthest_mm == 2001
    depth_mm[:5] = np.where(empty[:5], np.inf, 900.0)
    assert plan(depth_mm, ROOM, empty=empty).needed


def test_pixels_without_depth_do_not_count():
    depth_mm = np.full(FRAME.shape_px, 2000.0)
    for nothing in (np.nan, 0.0, -5.0):
        depth_mm[10:20] = nothing
        assert not plan(depth_mm).needed


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1), (2, 2), (1, 2)])
def test_tiny_depth_maps_are_supported(shape):
    depth_mm = np.full(shape, 4000.0)
    depth_mm[-1, -1] = 1000
    assert plan(depth_mm, FRAME).slabs == (1 if depth_mm.size == 1 else 2)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("name", ["uncut_mm", "bodies_mm"])
def test_no_border_cuts_a_body_or_volume(seed, name):
    random, depth_mm = np.random.default_rng(seed), room_mm(seed)
    near_mm = random.uniform(600, 6000, 6)
    reach_px = random.uniform(0, DEEP_PX, near_mm.size)
    far_mm = 1 / np.maximum(1 / near_mm - reach_px / blur_per_nearness_px(LENS, PITCH_UM), 1e-9)
    extents_mm = list(zip(near_mm, far_mm, strict=True))
    borders = plan(depth_mm, accuracy=1e-4, **{name: extents_mm}).borders_mm
    assert borders
    assert not any(near < border < far for near, far in extents_mm for border in borders)


def test_a_deep_body_may_be_cut_but_a_volume_never():
    depth_mm = room_mm()
    free = plan(depth_mm).borders_mm
    assert plan(depth_mm, bodies_mm=[(500, 20000)]).borders_mm == pytest.approx(free, rel=0.05)
    assert all(border >= 20000 * (1 - 1e-9) for border in plan(depth_mm, uncut_mm=[(0, 20000)]).borders_mm)


@pytest.mark.parametrize("world", [(0, np.inf), (-1000, np.inf)])
def test_a_world_volume_needs_one_slab(world):
    assert plan(room_mm(), uncut_mm=[world]).slabs == 1


def test_coarse_and_fine_depth_maps_give_similar_plans():
    depth_mm = room_mm()
    fine, coarse = plan(depth_mm, ROOM, most_slabs=3), plan(depth_mm[::2, ::2], ROOM, most_slabs=3)
    assert hidden_share(coarse.borders_mm, depth_mm) < hidden_share(fine.borders_mm, depth_mm) + 0.02


def test_large_depth_maps_are_subsampled():
    depth_mm = np.full((1200, 1600), 4000.0)
    depth_mm[300:600, 400:800] = 1000
    planned = plan(depth_mm)
    assert planned.slabs == 2 and 1100 < planned.borders_mm[0] < 3500


def margin_of(near_mm, distance_px, side, overscan_px=(0, 0)):
    """The plan for a wall in focus, with a near object that begins this far beyond the frame on one side."""
    capture = PixelGrid((96 + 80, 128 + 80), PITCH_UM, overscan_px=(40, 40))
    depth_mm = np.full(capture.shape_px, 2000.0)
    turned = np.moveaxis(depth_mm, {"rows": 0, "columns": 1}[side], 0)
    turned[:40 - distance_px] = near_mm
    return plan(depth_mm, capture, overscan_px=overscan_px)


@pytest.mark.parametrize("side", ["rows", "columns"])
def test_near_objects_count_beyond_the_frame_within_their_blur(side):
    """At 1 m the blur is 24.3 px wide: a ray 12.1 px beyond the frame enters it, and the centres of pixels count."""
    radius_px = float(blur_px(LENS, PITCH_UM, 1000.0)) / 2
    assert 12 < radius_px < 12.5
    planned = margin_of(1000.0, 3, side)
    assert planned.needed and planned.slabs == 2
    rows, columns = planned.margin_px
    assert (rows if side == "rows" else columns) == 13  # 11.5 px to the centre of the last pixel, and one more
    assert not margin_of(1000.0, 13, side).needed
    assert margin_of(1000.0, 13, side, overscan_px=(3, 3)).needed


def test_nearer_slabs_have_wider_margins():
    near, far = margin_of(700.0, 0, "rows").margins_px
    assert near[0] > far[0]
    assert margin_of(100.0, 0, "rows").margin_px == (40, 40)  # the limit of the search


def test_no_margin_is_smaller_than_the_overscan():
    planned = margin_of(1000.0, 0, "rows", overscan_px=(5, 7))
    assert np.all(np.array(planned.margins_px) >= (5, 7)) and planned.margins_px[0] > (5, 7)


def test_fisheye_borders_are_distances():
    """Two shells around the camera, which a border in distance separates.

    Far off the axis, the far shell has planar depths as small as the near shell's.
    """
    lens = make_lens(efl_mm=10.0, magnification=-0.005, f_number_effective=1.0, object_distance_mm=2000.0,
                     entrance_pupil_mm=0.0)
    grid = PixelGrid((200, 300), 100.0, projection=FISHEYE)
    x_mm, y_mm = grid.axes_mm()
    angle = np.hypot(x_mm, y_mm[:, None]) / lens.capture_focal_length_mm
    distance_mm = np.where(np.indices(grid.shape_px)[1] % 40 < 20, 300.0, 600.0)
    planar_mm = np.where(angle < np.pi / 2, distance_mm * np.cos(angle), np.nan)
    assert np.isnan(planar_mm).any() and np.nanmin(planar_mm[distance_mm == 600]) < 300
    planned = plan_slabs(planar_mm, grid, lens, accuracy=0.05, overscan_px=(0, 0))
    border_mm, = planned.borders_mm
    assert 305 < border_mm < 595


def turned(focus_mm=2000.0, stopped=1.0):
    """The lens focused elsewhere, moved as a unit, and stopped down."""
    focal_mm = 100.0 * focus_mm / (focus_mm - 100.0)  # |m| S
    return make_lens(efl_mm=100.0, magnification=-focal_mm / focus_mm, object_distance_mm=focus_mm,
                     f_number_effective=2.2 * stopped * focal_mm / 105.0, entrance_pupil_mm=0.0, sensor_mm=(36.0, 24.0))


def test_a_plan_for_several_lens_settings_suffices_for_each():
    depth_mm, capture = room_mm(), PixelGrid.around_frame((96, 128), PITCH_UM, (96, 128))
    lenses = [turned(focus_mm, stopped) for focus_mm, stopped in ((1000.0, 1.0), (5000.0, 1.0), (2000.0, 4.0))]
    planned = plan(depth_mm, capture, lenses[0], others=lenses[1:])
    assert planned == plan(depth_mm, capture, lenses[0], others=lenses[:0:-1])  # in any order
    alone = [plan(depth_mm, capture, lens) for lens in lenses]
    assert planned.slabs >= max(one.slabs for one in alone)
    assert np.all(np.array(planned.margin_px) >= [one.margin_px for one in alone])
    near, far, stopped = (one.margin_px for one in alone)
    assert near != far and stopped < far  # the deciding settings differ


def test_slabs_are_needed_if_any_lens_needs_them():
    depth_mm = np.full((96, 128), 2000.0)
    assert not plan(depth_mm, FRAME, turned()).needed and plan(depth_mm, FRAME, turned(4000.0)).needed
    for first, other in ((turned(), turned(4000.0)), (turned(4000.0), turned())):
        assert plan(depth_mm, FRAME, first, others=[other]).needed
    assert not plan(depth_mm, FRAME, turned(), others=[turned(2000.0, 4.0)]).needed


@pytest.mark.parametrize("place", [(300, 401), (301, 400), (302, 403), (899, 1199)])
def test_a_lamp_smaller_than_the_steps_through_a_large_picture_is_not_left_out(place):
    """Such pictures are planned by some of their pixels."""
    depth_mm, light = np.full((900, 1200), np.inf), np.zeros((900, 1200))
    depth_mm[100:200, 100:200], light[100:200, 100:200] = 2000.0, 1.0  # in focus
    assert not plan(depth_mm, light=light, empty=light == 0).needed
    depth_mm[place], light[place] = 12e3, 50.0
    planned = plan(depth_mm, light=light, empty=light == 0)
    assert planned.needed and planned.check.farthest_mm == 12e3
