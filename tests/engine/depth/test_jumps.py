"""Layers with surfaces at several depths: none of their light is lost, and nothing else changes."""

from dataclasses import replace

import numpy as np
import pytest

from lenses import make_lens
from lensfield.engine.depth.cast import cast
from lensfield.engine.depth.depth_range import blur_px
from lensfield.engine.depth.jumps import without_jumps
from lensfield.engine.field.radial.first_order import first_order_rays
from lensfield.engine.image.detail import Detail
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens.entrance_pupil import focus_nearness

PITCH_UM, ACCURACY, LIGHT = 8.0, 0.01, 4.0
GRID = PixelGrid((120, 150), PITCH_UM, (-14.0, 90.5))  # off the axis
SKY = -14.0  # its blur


@pytest.fixture(scope="module")
def lens():
    return make_lens(object_distance_mm=700.0, magnification=-0.05)


def depth_of_blur(lens, wanted_px):
    return 1 / (focus_nearness(lens) + wanted_px / blur_px(lens, PITCH_UM, 1 / (1 + focus_nearness(lens))))


def radiance(lens, blur, light, alpha=1.0, detail=None):
    """Layered radiance of one layer with this blur."""
    light = np.broadcast_to(light, GRID.shape_px) * np.array([1.0, 0.5])[:, None, None]
    layer = Layer(light * alpha, np.broadcast_to(alpha, GRID.shape_px), depth_of_blur(lens, blur), detail=detail)
    return LayeredRadiance((layer,), lens.wavelengths_nm[[0, -1]], GRID, lens.capture_focal_length_mm)


def lamps(number, nearest, farthest, side, sky=SKY, seed=1):
    """Blur and light of lamps at random depths in front of a dark sky, none at another's edge."""
    rng, blur, lit = np.random.default_rng(seed), np.full(GRID.shape_px, sky), np.zeros(GRID.shape_px, bool)
    while number:
        row, column = (rng.integers(30, n - 30) for n in GRID.shape_px)
        if not lit[row - 1:row + side + 1, column - 1:column + side + 1].any():
            lit[row:row + side, column:column + side] = True
            blur[row:row + side, column:column + side] = rng.uniform(nearest, farthest)
            number -= 1
    return blur, LIGHT * lit


@pytest.mark.parametrize("side", [1, 3])
@pytest.mark.parametrize("number, nearest, farthest, sky", [
    (1, -10, -2, -14.0), (10, -10, -2, -14.0), (100, -10, -2, -14.0), (40, -25, -3, -30.0), (40, 5, 30, -14.0)])
@pytest.mark.parametrize("grey", [0.0, 0.2])
def test_lamps_at_many_depths_before_the_sky_keep_their_light(lens, side, number, nearest, farthest, sky, grey):
    blur, light = lamps(number, nearest, farthest, side, sky)
    parted = without_jumps(radiance(lens, blur, np.maximum(light, grey)), lens, ACCURACY)
    plane, other = cast(parted, lens, lambda: first_order_rays(lens), most_of_lamps=1024)
    kept = (plane.blurred + plane.sharp * plane.clear - grey).sum(dtype=float) / (light - grey)[light > 0].sum()
    assert kept == pytest.approx(1, abs=0.02)
    assert other.blurred.sum() == pytest.approx(plane.blurred.sum() / 2, rel=1e-3)


def test_the_view_of_a_pinhole_stays_the_same(lens):
    """With a hole, lamps whose edges cover pixels in part, and noise."""
    blur, light = lamps(60, -12.0, 20.0, 3)
    light = light * np.random.default_rng(3).uniform(0.2, 1.0, GRID.shape_px) + 0.1
    alpha = np.ones(GRID.shape_px, np.float32)
    alpha[40:60, 70:100] = 0
    alpha[60:64, 70:100] = 0.5
    before = radiance(lens, blur, light, alpha)
    given = before.layers[0].cube.copy()
    parted = without_jumps(before, lens, ACCURACY)
    assert len(parted.layers) > 1
    np.testing.assert_allclose(parted.flat().cube, before.flat().cube, atol=1e-6 * light.max())
    np.testing.assert_allclose(parted.flat_alpha(), alpha, atol=1e-6)
    np.testing.assert_array_equal(before.layers[0].cube, given)


def test_a_surface_continues_behind_a_nearer_one_without_the_light_of_its_edge(lens):
    """A lamp's edge covers the pixels around it in part; their light belongs to the lamp, and the rest to the sky."""
    blur, light = np.full(GRID.shape_px, SKY), np.full(GRID.shape_px, 0.5)
    light[50:55, 60:65] = 0.5 + 0.25 * (9 - 0.5)  # a quarter of each pixel of the rim
    blur[51:54, 61:64], light[51:54, 61:64] = 10.0, 9.0
    near, far = without_jumps(radiance(lens, blur, light), lens, ACCURACY).layers
    np.testing.assert_allclose(far.cube[0], 0.5, rtol=1e-6)
    assert np.all(far.alpha == 1) and near.origin_px == (50, 60)
    np.testing.assert_allclose(near.alpha, np.pad(np.ones((3, 3)), 1, constant_values=0.25), rtol=1e-6)
    np.testing.assert_allclose(near.cube[0], 9 * near.alpha, rtol=1e-6)
    np.testing.assert_allclose(near.depth_mm, depth_of_blur(lens, 10.0), rtol=1e-6)


def slope():
    rows, columns = np.indices(GRID.shape_px)
    return -20 + 40 * (rows + 0.3 * columns) / 160, 1.0


def faint():
    blur, light = lamps(3, -10.0, -2.0, 1)
    return blur, 1.0 + 1e-3 * light


def lamps_at_one_depth():
    blur, light = lamps(20, -6.0, -6.0 + 1e-9, 3)
    return np.where(light > 0, blur, -6.5), light


@pytest.mark.parametrize("scene", [slope, faint, lamps_at_one_depth])
def test_layers_without_jumps_that_matter_stay_as_they_are(lens, scene):
    before = radiance(lens, *scene())
    assert without_jumps(before, lens, ACCURACY) is before
    flat = before.flat()
    assert without_jumps(flat, lens, ACCURACY) is flat


def test_the_detail_of_pixels_goes_with_their_surface(lens):
    blur, light = lamps(20, 5.0, 20.0, 3)
    shares = np.random.default_rng(1).uniform(0.5, 1.5, (1, 2 * GRID.shape_px[0], 2 * GRID.shape_px[1]))
    detail = Detail.of(shares, np.array([550.0]), 2)
    before = radiance(lens, blur, light + 0.1, detail=detail)
    near, *_, far = without_jumps(before, lens, ACCURACY).layers
    place = near.place
    np.testing.assert_array_equal(near.detail.shares, detail.within(*place).shares)
    np.testing.assert_array_equal(far.detail.shares, detail.even_in(blur > SKY).shares)


def test_no_more_layers_than_slabs(lens):
    blur, light = lamps(100, -60.0, 60.0, 3, -100.0)
    before = radiance(lens, blur, light)
    twelve = replace(before, layers=before.layers * 12)
    assert without_jumps(twelve, lens, ACCURACY) is twelve
