"""Irises: openings with the round stop's area, by hand calculation, and the discs that lamps show through them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import uniform_filter

from lenses import make_lens
from lensfield.engine import Options, simulate
from lensfield.engine.depth.cast import cast
from lensfield.engine.depth.depth_range import blur_per_nearness_px, blur_px
from lensfield.engine.field.radial.first_order import first_order_rays
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens.entrance_pupil import focus_nearness
from lensfield.engine.lens.iris import Iris, opening, opening_within
from lensfield.engine.library import prescription_of
from lensfield.engine.library.rays import lens_rays
from lensfield.engine.rays.rings import Rings, turned
from varied_lenses import lens_for_rays

PITCH_UM, BLUR_PX = 8.0, 40.0
IRISES = [Iris(3, 10.0), Iris(5, 20.0), Iris(5, -77.0, 0.4), Iris(6, 0.0, 0.2), Iris(8, 33.0), Iris(15, 3.0, 0.7)]
STRAIGHT = [iris for iris in IRISES if not iris.roundness]


def corner_of(blades):
    """The corner of a straight-sided polygon with the unit circle's area: n / 2 R^2 sin(2 pi / n) = pi."""
    return np.sqrt(np.pi / (blades / 2 * np.sin(2 * np.pi / blades)))


def is_open(stop, places):
    """Which points (2, ...) of the stop are open, according to `Opening.shape`."""
    margin, bend, slope = stop.shape
    square = np.sum(np.square(places), axis=0)
    along = [across * places[0] + up * places[1] for across, up in stop.iris.directions]
    return np.all([margin - bend * square - slope * each > 0 for each in along], axis=0)


def even_places(reach, count=1200):
    axis = reach * (2 * (np.arange(count) + 0.5) / count - 1)
    return np.stack(np.meshgrid(axis, axis)), (2 * reach / count) ** 2


@pytest.mark.sample(10)
@pytest.mark.parametrize("iris", IRISES)
@pytest.mark.parametrize("rim", [1.0, 1.004, 1.03, 2.0, np.inf])
def test_an_opening_has_the_area_of_the_round_stop(iris, rim):
    stop = opening_within(iris, rim)
    places, each = even_places(1.01 * stop.reach)
    open_ = is_open(stop, places) & (np.hypot(*places) < rim)
    assert open_.sum() * each == pytest.approx(np.pi, rel=2e-3)  # cells along the edge
    farthest = np.hypot(*places)[open_].max()
    assert stop.reach * (1 - 5e-3) < farthest <= stop.reach * (1 + 1e-9) <= rim * (1 + 1e-9)


@pytest.mark.parametrize("iris", STRAIGHT)
def test_straight_blades_form_a_regular_polygon(iris):
    stop = opening_within(iris, np.inf)
    assert stop.corner == stop.reach == pytest.approx(corner_of(iris.blades), rel=1e-6)
    towards = np.radians(iris.rotation_deg)
    for azimuth, distance in ((towards, stop.corner * np.cos(np.pi / iris.blades)),
                              (towards + np.pi / iris.blades, stop.corner)):
        direction = np.array([np.cos(azimuth), np.sin(azimuth)])
        assert is_open(stop, 0.999 * distance * direction) and not is_open(stop, 1.001 * distance * direction)


def test_full_roundness_or_no_blades_give_the_round_stop():
    for blades in (0, 3, 9):
        stop = opening_within(Iris(blades, 5.0, 1.0), np.inf)
        assert (stop.corner, stop.reach) == pytest.approx((1, 1), abs=1e-9)


@pytest.mark.parametrize("iris", IRISES)
def test_wide_open_blades_are_behind_the_rim(iris):
    """They emerge gradually as the lens is stopped down."""
    places, each = even_places(1.0)
    inside = np.hypot(*places) < 0.999
    assert is_open(opening_within(iris, 1.0), places)[inside].all()
    shut = [np.pi - (is_open(opening_within(iris, rim), places) & inside).sum() * each for rim in (1.0, 1.002, 1.02, 2)]
    assert np.all(np.diff(shut) >= 0) and shut[-1] > shut[0] + 0.001


def test_a_lens_records_how_far_its_stop_can_open():
    prescription = prescription_of("nikkor-58mm-f1.4")
    wide, closed = (turned(prescription, Rings(f_number=number)).prescription for number in (None, 2.8))
    assert wide.stop_rim == 1 and closed.stop_rim == pytest.approx(2.8 / turned(prescription).f_number)
    assert closed.scaled(3.0).stop_rim == pytest.approx(closed.stop_rim)
    assert opening(Iris(5), make_lens()).reach == pytest.approx(corner_of(5)), "tables alone know no rim"


def depth_of_blur(lens, wanted_px):
    return 1 / (focus_nearness(lens) + wanted_px / blur_per_nearness_px(lens, PITCH_UM))


GRID = PixelGrid.around_frame((101, 121), PITCH_UM, (30, 30))
LAMP_PX, LIT = 8, (69, 87)  # the period of ray sequences, so that no ray misses the lamp; and its first pixel


def disc_of_a_lamp(lens, blur, iris):
    """The blurred plane of a square lamp, off the centre of a frame that is not square."""
    alpha = np.zeros(GRID.shape_px, np.float32)
    alpha[LIT[0]:LIT[0] + LAMP_PX, LIT[1]:LIT[1] + LAMP_PX] = 1
    lamp = Layer(alpha[None], alpha, np.full(GRID.shape_px, depth_of_blur(lens, blur)))
    dark = Layer(0 * alpha[None], np.ones(GRID.shape_px), np.full(GRID.shape_px, np.inf))
    layered = LayeredRadiance([lamp, dark], [550.0], GRID, lens.capture_focal_length_mm)
    plane, = cast(layered, lens, lambda: first_order_rays(lens, opening(iris, lens).reach), most_rays=1024, iris=iris)
    return plane.blurred


def expected_disc(iris, blur, size=1.0):
    """By hand: the polygon, `size` times as large as one of the circle's area, convolved with the lamp's square."""
    fine, half = 4, abs(blur) / 2
    corner, side = size * corner_of(iris.blades) * half, 1 if blur < 0 else -1  # upside down in front of the focus
    rows, columns = ((np.arange(fine * n) + 0.5) / fine - 0.5 for n in GRID.shape_px)
    middle = [first + (LAMP_PX - 1) / 2 for first in LIT]
    up, right = side * (middle[0] - rows)[:, None], side * (columns - middle[1])[None]
    azimuth = np.radians(iris.rotation_deg) + 2 * np.pi * np.arange(iris.blades) / iris.blades
    inside = np.all([right * np.cos(turn) + up * np.sin(turn) < corner * np.cos(np.pi / iris.blades)
                     for turn in azimuth], axis=0)
    spread = uniform_filter(uniform_filter(inside.astype(float), fine), LAMP_PX * fine)  # nearly bilinear; the lamp
    disc = spread.reshape(GRID.shape_px[0], fine, GRID.shape_px[1], fine).mean(axis=(1, 3))
    return disc[30:-30, 30:-30] * LAMP_PX**2 / (np.pi * (size * half) ** 2)


@pytest.fixture(scope="module")
def lens():
    return make_lens(object_distance_mm=700.0, magnification=-0.05, transmittance=0.7)


@pytest.mark.sample(2)
@pytest.mark.parametrize("blur", [-BLUR_PX, BLUR_PX])
@pytest.mark.parametrize("iris", STRAIGHT)
def test_a_lamps_disc_is_a_polygon_with_the_light_of_the_circle(lens, blur, iris):
    """Polygons with corners on the circle, and rotated or mirrored ones, differ more."""
    round_, disc = (disc_of_a_lamp(lens, blur, each) for each in (None, iris))
    assert disc.sum() == pytest.approx(round_.sum(), rel=0.01) and round_.sum() == pytest.approx(LAMP_PX**2, rel=0.01)
    expected = expected_disc(iris, blur)
    off = np.abs(disc - expected).sum() / expected.sum()
    rays = 1024 * LAMP_PX**2 / (np.pi * BLUR_PX**2 / 4)  # of a pixel, that meet the lamp
    assert off < 1 / np.sqrt(rays)
    others = [expected_disc(iris, blur, 1 / corner_of(iris.blades))]
    others += [expected_disc(replace(iris, rotation_deg=turn), blur)
               for turn in (iris.rotation_deg + 180 / iris.blades, -iris.rotation_deg)]
    assert all(np.abs(disc - other).sum() / expected.sum() > 1.5 * off for other in others)


@pytest.mark.sample(1)
@pytest.mark.parametrize("name, f_number", [("nikkor-58mm-f1.4", 4.0), ("tessar-50mm", 8.0)])
def test_traced_rays_carry_equal_light_through_blades_and_the_round_stop(name, f_number):
    """On the axis, by the weights of traced rays: blades only redistribute them over the pupil."""
    lens = lens_for_rays(name, Rings(f_number=f_number))
    for iris in (Iris(3, 10.0), Iris(6, 40.0, 0.3)):
        stop = opening(iris, lens)
        table = lens_rays(lens, stop.reach).at([550.0])
        places, each = even_places(stop.reach, 300)
        places = places.reshape(2, -1)
        rays = table.bundles(np.array([0.0]), places)
        passing = (rays.surface_margin[0, 0] > 0) & is_open(stop, places)
        light = (rays.weight[0, 0] * passing).sum() * each
        assert light == pytest.approx(table.irradiance_per_radiance(np.array([0.0]))[0, 0], rel=0.01)


def test_a_stopped_down_lens_is_equally_bright_with_blades(tmp_path):
    """A uniform plane out of focus, through a real lens: in the middle and in the corner, with and without blades."""
    lens = lens_for_rays("nikkor-58mm-f1.4", Rings(1500.0, 4.0))
    grid = PixelGrid((20, 28), 200.0, (4.3, 22.1))
    layer = Layer(np.full((2, *grid.shape_px), 3.0), np.ones(grid.shape_px), np.full(grid.shape_px, 4000.0))
    layered = LayeredRadiance([layer], [500.0, 600.0], grid, lens.capture_focal_length_mm)
    assert abs(blur_px(lens, grid.pitch_um, 4000.0)) > 0.5
    round_, bladed = (simulate(layered, lens, Options(), iris=iris).cube for iris in (None, Iris(5, 12.0)))
    np.testing.assert_allclose(bladed, round_, rtol=1e-3)


def test_a_table_with_more_reach_has_the_rays_of_a_wider_stop():
    lens = lens_for_rays("nikkor-58mm-f1.4", Rings(f_number=4.0))
    stop_mm, prescription = lens.prescription.aperture[1], lens.prescription
    wider = replace(lens, prescription=replace(prescription, aperture=("stop", 1.25 * stop_mm)))
    reaching, wide = lens_rays(lens, 1.2).at([550.0]), lens_rays(wider).at([550.0])
    assert reaching.reach == 1.25
    rng = np.random.default_rng(3)
    radius, azimuth = np.sqrt(rng.random(200)), 2 * np.pi * rng.random(200)
    places = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth)])
    at_mm = np.array([[-7.0], [11.0]]) + 0 * places
    rays, expected = reaching.rays(0, at_mm, 1.25 * places), wide.rays(0, at_mm, places)
    for name in ("entrance_mm", "direction", "surface_margin", "path_mm"):
        np.testing.assert_allclose(getattr(rays, name), getattr(expected, name), rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(1.25**2 * rays.weight, expected.weight, rtol=1e-5)
    heights_mm = np.array([0.0, 5.0, 20.0])
    np.testing.assert_allclose(reaching.irradiance_per_radiance(heights_mm),
                               lens_rays(lens).at([550.0]).irradiance_per_radiance(heights_mm), rtol=2e-3)
