"""Sampling the scene's depth by rays: positions in the picture, and distances along the axis."""

import numpy as np
import pytest

from lenses import make_lens
from lensfield.addon.scene.camera import frame_capture, view_tangents
from lensfield.addon.scene.depth import visible_depth_mm
from lensfield.engine.image.pixel_grid import PixelGrid
from small_scenes import material, wall

FOCAL_MM = 10.5


def test_depth_is_planar_and_row_0_is_at_the_top(scene):
    """A wall that covers the left two thirds and the upper half of the view, at 2 m, without other objects."""
    lens, frame = make_lens(), PixelGrid((36, 48), 100.0)
    x_m, y_m = (0.2 * n * 0.1 / FOCAL_MM * 10 for n in (48, 36))  # of the view, at 2 m
    assert lens.capture_focal_length_mm == FOCAL_MM
    paint = material("Paint", "ShaderNodeBsdfDiffuse")[0]
    painted = wall(scene, paint, 2.0, 1.0)
    painted.scale = x_m, y_m, 1.0
    painted.location.x, painted.location.y = -x_m / 3, y_m / 2
    depth_mm = visible_depth_mm(scene, lens, frame)
    rows, columns = depth_mm.shape
    assert columns == 24 and rows == 18
    near = np.zeros(depth_mm.shape, bool)
    near[:9, :16] = True
    np.testing.assert_array_equal(np.isfinite(depth_mm), near)
    np.testing.assert_allclose(depth_mm[near], 2000.0, rtol=1e-6)


def test_room_around_a_frame_is_a_fraction_of_its_longer_side():
    capture = frame_capture(make_lens(), PixelGrid((36, 48), 10.0), [550.0], room=0.25)
    assert capture.overscan_px == (12, 12) and capture.frame_px == (36, 48)


def test_view_tangents_are_horizontal_and_vertical(scene):
    left, lower, right, upper = view_tangents(scene, "tessar-50mm", "lens")
    assert (-left, -lower) == (right, upper) and right / upper == pytest.approx(48 / 36)
    scene.camera.data.shift_y = 0.25  # of the width: a third of the height
    *_, shifted = view_tangents(scene, "tessar-50mm", "lens")
    assert shifted == pytest.approx((1 + 2 / 3) * upper)
