"""PixelGrid: positions of pixels about the axis, and its frames, crops and rims."""

import numpy as np
import pytest

from lensfield.engine import ImageError
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.projection import FISHEYE
from refusals import refused


def test_x_runs_right_and_y_up_from_row_0_at_the_top():
    x_mm, y_mm = PixelGrid((3, 5), 10.0).axes_mm()
    np.testing.assert_allclose(x_mm, [-0.02, -0.01, 0, 0.01, 0.02], atol=1e-15)
    np.testing.assert_allclose(y_mm, [0.01, 0, -0.01], atol=1e-15)


def test_positions_are_relative_to_the_axis_wherever_it_lies():
    assert PixelGrid((3, 5), 5.0, (10, -20)).position_mm(0, 0) == pytest.approx((0.1, 0.05))


def test_grids_of_the_same_pixels_are_equal():
    assert PixelGrid((4, 6), 10, (1.5, 2.5)) == PixelGrid([4, 6], 10.0, overscan_px=np.zeros(2, int))
    assert hash(PixelGrid((4, 6), 10)) == hash(PixelGrid((4, 6), 10.0)) != hash(PixelGrid((6, 4), 10))


def test_removing_the_overscan_restores_the_frame():
    grid = PixelGrid.around_frame((4, 6), 10.0, (3, 2), FISHEYE)
    assert grid.shape_px == (10, 10) and grid.frame_px == (4, 6) and grid.centred
    assert grid.frame() == PixelGrid((4, 6), 10.0, projection=FISHEYE)


def test_the_farthest_corner_of_a_pixel_is_half_a_pixel_beyond_its_middle():
    assert PixelGrid((10, 12), 10.0, (2.0, 7.5)).farthest_px == pytest.approx(np.hypot(7.5, 8))


def test_a_shifted_sensor_is_farther_to_the_right_and_up():
    grid = PixelGrid((10, 12), 10.0, (2.0, 7.5))
    x_mm, y_mm = grid.position_mm(3, 4)
    assert grid.shifted(5, 2).position_mm(3, 4) == pytest.approx((x_mm + 0.05, y_mm + 0.02))


def test_crops_and_rims_keep_every_pixel_in_place():
    grid = PixelGrid((10, 12), 10.0, (2.0, 7.5), (3, 4))
    assert grid.cropped((1, 2)).position_mm(0, 0) == grid.position_mm(1, 2)
    part = grid.part((slice(1, 7), slice(2, 5)))
    assert part.position_mm(0, 0) == grid.position_mm(1, 2) and part.shape_px == part.frame_px == (6, 3)
    assert grid.framed(5).position_mm(5, 5) == grid.position_mm(0, 0)
    assert grid.framed(5).cropped((5, 5)) == grid
    assert grid.cropped((1, 2)).frame_px == grid.framed(5).frame_px == grid.frame_px


def test_finer_columns_cover_the_same_area_of_the_scene():
    grid = PixelGrid((10, 13), 10.0, (2.0, 7.5), (3, 4), squeeze=1.9)
    fine = grid.finer_across(4)
    assert fine.shape_px == (10, 52) and fine.frame_px == (4, 20) and fine.across == 4
    assert fine.squeeze == pytest.approx(1.9 / 4) and fine.on_sensor() == grid
    edges_mm = np.array(fine.edges_mm) * np.tile((fine.squeeze, 1), 2)
    np.testing.assert_allclose(edges_mm, np.array(grid.edges_mm) * np.tile((1.9, 1), 2))
    middles = fine.position_mm(0, 4 * 5 + np.arange(4))[0].mean() / 4, grid.position_mm(0, 5)[0]
    assert middles[0] == pytest.approx(middles[1])
    assert fine.finer(2) == grid.finer(2).finer_across(4)
    assert fine.finer_across(2) == grid.finer_across(8) and fine.framed(4).on_sensor().overscan_px == (7, 5)
    with refused(ImageError, field="shape_px", where="image", match="multiples of 4 columns"):
        fine.cropped((0, 2)).on_sensor()


@pytest.mark.parametrize("reach_px, overscan_px", [(0, (0, 0)), (3, (3, 3)), (100, (3, 4))])
def test_reach_is_limited_to_the_overscan(reach_px, overscan_px):
    assert PixelGrid((10, 12), 10.0, overscan_px=(3, 4)).within_reach(reach_px).overscan_px == overscan_px


def test_an_axis_off_the_middle_is_not_centred():
    assert not PixelGrid((10, 12), 10.0, (4.5, 5.6)).centred


@pytest.mark.parametrize("field, value", [("pitch_um", 0), ("pitch_um", None), ("overscan_px", (5, 0)),
                                          ("centre_px", (np.nan, 0)), ("projection", "orthographic"),
                                          ("shape_px", (1, 2, 3)),
                                          ("overscan_px", (1,)), ("centre_px", ("a", "b")), ("shape_px", (20.7, 30)),
                                          ("pitch_um", True), ("across", 0), ("across", 1.5)])
def test_a_wrong_field_is_named(field, value):
    with refused(ImageError, field=field):
        PixelGrid(**dict(shape_px=(10, 12), pitch_um=10.0) | {field: value})
