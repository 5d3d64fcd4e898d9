"""Parallax by depth, against chief rays of two depths."""

import numpy as np
import pytest

from lenses import make_lens
from lensfield.engine.depth.parallax import parallax_per_nearness_px
from lensfield.engine.field.field_map import field_map
from lensfield.engine.field.radial.first_order import first_order_rays
from lensfield.engine.field.ray_blur import tangents
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.projection import FISHEYE, PLANE
from lensfield.engine.library.rays import lens_rays
from lensfield.engine.rays.stop_places import stop_places
from varied_lenses import varied_lens

NM, NEAR = 550.0, 1e-5  # per mm
PLACE = slice(10, 50), slice(0, 70)  # of the capture


def parallax(lens, rays, capture):
    sample = field_map(lens).pixel_rays(rays, capture.frame()).sample(
        np.array([NM]), lens.capture_focal_length_mm, 256, 1.0)
    return parallax_per_nearness_px(lens, sample, capture, PLACE, NM)


def test_a_pupil_that_stays_in_place_has_no_parallax():
    lens = make_lens(object_distance_mm=700.0, magnification=-0.05)
    capture = PixelGrid((60, 80), 40.0, (20.0, 51.0), (4, 6))
    assert np.abs(parallax(lens, first_order_rays(lens), capture)).max() < 1e-3 * lens.efl_mm / 40e-3


@pytest.mark.parametrize("projection", [FISHEYE, PLANE])
def test_the_image_of_a_near_point_moves_as_the_middle_of_its_rays(projection):
    lens = varied_lens("muller-fisheye-25mm")
    pitch_um = 1e3 * lens.sensor_mm[0] / 160
    capture = PixelGrid((60, 80), pitch_um, (20.0, 51.0), (4, 6), projection=projection)
    table, stop = lens_rays(lens).at([NM]), stop_places(1024)
    heights_mm = np.linspace(0, 0.9 * table.last_height_mm, 200)
    rays = table.bundles(heights_mm, stop)
    light = np.where(rays.margin > 0, rays.weight, 0)[0]
    entrance_mm, slope = (np.average(each, axis=1, weights=light)
                          for each in (rays.entrance_mm[1, 0], tangents(rays)[1, 0]))
    rows, columns = (np.arange(side.start, side.stop) for side in PLACE)
    x_mm, y_mm = capture.position_mm(rows[:, None], columns)
    tangent = np.tan(projection.angle_rad(np.hypot(x_mm, y_mm) / lens.capture_focal_length_mm))
    at_mm = [np.interp(tangent, np.abs(entrance_mm * nearness - slope), heights_mm) for nearness in (0.0, NEAR)]
    expected = np.abs(np.subtract(*at_mm)) / (pitch_um * 1e-3) / NEAR
    np.testing.assert_allclose(parallax(lens, lens_rays(lens), capture), expected, rtol=0.05,  # cells at rims
                               atol=0.1 * expected.max())
