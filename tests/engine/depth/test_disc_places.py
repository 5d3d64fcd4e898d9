"""The discs of lamps out of focus are in their places for any number of rays."""

import numpy as np
import pytest

from lenses import make_lens
from lensfield.engine.depth.cast import cast
from lensfield.engine.depth.depth_range import blur_px
from lensfield.engine.field.radial.first_order import first_order_rays
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens.entrance_pupil import focus_nearness

LAMP_PX = 3


def disc(lens, rays, grid, depth_mm, at, count):
    """The picture of a lamp whose first row and column are `at`."""
    alpha = np.zeros(grid.shape_px, np.float32)
    alpha[tuple(slice(start, start + LAMP_PX) for start in at)] = 1
    lamp = Layer(alpha[None], alpha, np.full(alpha.shape, depth_mm))
    scene = LayeredRadiance((lamp,), [550.0], grid, lens.capture_focal_length_mm)
    plane, = cast(scene, lens, lambda: rays, most_rays=count)
    return plane.blurred.astype(float)


def centroid(picture):
    return [(picture * places).sum() / picture.sum() for places in np.indices(picture.shape)]


@pytest.mark.parametrize("rays", [64, 256, 1024])
@pytest.mark.parametrize("at", [(60, 71), (61, 74), (66, 77)])
def test_a_disc_is_in_its_place_for_any_number_of_rays(rays, at):
    """The lamp's own pixels, not those of the levels that rays look up, determine where the disc is."""
    lens, pitch_um = make_lens(object_distance_mm=700.0, magnification=-0.05), 8.0
    grid = PixelGrid((128, 145), pitch_um, (-22.0, 81.0))
    depth_mm = 1 / (focus_nearness(lens) + 70 / blur_px(lens, pitch_um, 1.0, 0.0))
    picture = disc(lens, first_order_rays(lens), grid, depth_mm, at, rays)
    middle = [start + (LAMP_PX - 1) / 2 for start in at]
    assert centroid(picture) == pytest.approx(middle, abs=0.2)
    assert picture.sum() == pytest.approx(LAMP_PX**2, rel=0.01)
