"""The render region: its pixels in a frame that is not square, and the part of a capture that can light them."""

import pytest

from lenses import gaussian_psf, make_lens
from lensfield.addon.scene.camera import captured_region, render_region
from lensfield.addon.scene.render_state import guard_region
from lensfield.addon.scene.undo import Journal
from lensfield.engine import Options
from lensfield.engine.field.psf_samples import psf_radius_px
from lensfield.engine.image.pixel_grid import PixelGrid
from small_scenes import set_region

SHAPE_PX, PITCH_UM = (36, 48), 10.0
COMPLETE = Options(method="exact")


def test_rows_count_from_the_top_and_columns_from_the_left(scene):
    set_region(scene, left=1 / 4, right=1 / 2, bottom=1 / 6, top=3 / 4)
    assert render_region(scene) == (slice(9, 30), slice(12, 24))


def test_a_disabled_region_is_none(scene):
    set_region(scene, 0.25, 0.5, 0.25, 0.5)
    scene.render.use_border = False
    assert render_region(scene) is None


@pytest.mark.parametrize("region", [(slice(9, 30), slice(12, 24)), (slice(0, 7), slice(30, 48)),
                                    (slice(35, 36), slice(0, 1)), (slice(0, 36), slice(5, 47))], ids=str)
def test_a_region_round_trips_through_blender(scene, region):
    """Even though thirty-sixths are not exact in binary."""
    with Journal() as journal:
        guard_region(scene.render, region, SHAPE_PX, journal)
        assert render_region(scene) == region


def reach_of(captured, region, capture):
    """Margin of a part of a capture around a region of its frame, equal on all four sides."""
    (above, below), (left, right) = (
        (part.start + overscan - wider.start, wider.stop - part.stop - overscan)
        for part, wider, overscan in zip(region, captured, capture.overscan_px, strict=True))
    assert above == below == left == right
    return above


@pytest.mark.parametrize("heights, room, least, most", [
    (1.0, 0.0, 4, 5), (1.0, 0.25, 11, 12), (0.9, 0.0, 8, 8)], ids=["PSFs", "room", "distortion"])
def test_the_captured_region_extends_by_the_reach_of_the_lens(heights, room, least, most):
    """The margin is the sum of three terms.

    3 px for the PSFs, one more, and another for rounding; a quarter of the frame's 48 columns; and the shift of the
    corner by distortion, 30 px from the axis: 30 / 0.9 - 30, rounded up.
    """
    lens = make_lens(gaussian_psf(5, 8, 2.5, 17), lambda nm, height_mm: heights * height_mm)
    assert psf_radius_px(lens, PITCH_UM) == 3
    capture, region = PixelGrid.around_frame(SHAPE_PX, PITCH_UM, (14, 17)), (slice(9, 20), slice(24, 30))
    assert least <= reach_of(captured_region(region, lens, [550.0], capture, COMPLETE, room), region,
                             capture) <= most


def test_the_captured_region_omits_light_that_the_plan_trims():
    lens = make_lens(gaussian_psf(5, 8, 2.5, 41))
    capture, region = PixelGrid.around_frame(SHAPE_PX, PITCH_UM, (14, 17)), (slice(9, 20), slice(24, 30))
    coarse, fine, complete = (reach_of(captured_region(region, lens, [550.0], capture, options), region, capture)
                              for options in (Options(accuracy=0.1), Options(accuracy=0.001), COMPLETE))
    assert coarse < fine < complete


def test_the_captured_region_is_clipped_to_the_capture():
    lens = make_lens(gaussian_psf(5, 8, 2.5, 17))
    capture = PixelGrid.around_frame(SHAPE_PX, PITCH_UM, (2, 1))
    captured = captured_region((slice(1, 36), slice(0, 47)), lens, [550.0], capture, COMPLETE, 0.1)
    assert captured == (slice(0, 40), slice(0, 50))
