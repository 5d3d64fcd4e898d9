"""Distortion and relative illumination: the fits, their inverse, and the landing points of light."""

import re
from dataclasses import replace

import numpy as np
import pytest

from lenses import make_lens
from lensfield.engine import LensError
from lensfield.engine.field.footprints import LARGEST_FOOTPRINT_PX, RIM_PX
from lensfield.engine.field.radial.distortion import FieldGeometry, fit_polynomial, footprints
from lensfield.engine.image.pixel_grid import PixelGrid
from refusals import refused

HEIGHTS_MM = np.linspace(0, 3, 21)
EVERY_TENTH_MM = np.linspace(0, 2, 21)
WILD = np.where(np.arange(21) % 2, 1.0, -1.0)


def distorted(plane, source_centre_px, target_shape_px, target_centre_px, pitch_um, field):
    """A plane after distortion, in double precision, and the heights that its light came from."""
    framed, capture = np.pad(np.asarray(plane, dtype=float), RIM_PX), PixelGrid(plane.shape, pitch_um, source_centre_px)
    target = PixelGrid(target_shape_px, pitch_um, target_centre_px)
    areas, height_mm = footprints(capture.framed(RIM_PX), *target.axes_mm(), field)
    return areas.average(framed[None])[0], height_mm


def geometry(real_height_mm=None, relative_illumination=None, heights_mm=EVERY_TENTH_MM):
    lens = make_lens(real_height_mm=real_height_mm and (lambda nm, p: real_height_mm(p)),
                     relative_illumination=relative_illumination and (lambda nm, p: relative_illumination(p)),
                     heights_mm=heights_mm)
    return FieldGeometry(lens.at_wavelength(550), lens.name)


def barrel(p):
    """8 % barrel distortion at 2 mm."""
    return p - 0.02 * p**3


@pytest.mark.parametrize("powers, order", [({1: 2.7, 3: -0.3}, 4), ({1: 3.0, 5: -0.25}, 5),
                                           ({1: 1.0, 2: 0.5, 6: 0.1}, 6), ({1: 3.0, 3: -0.4, 8: 0.1}, 8)])
def test_fit_recovers_a_known_polynomial(powers, order):
    t = HEIGHTS_MM / 3
    fit = fit_polynomial(HEIGHTS_MM, sum(a * t**k for k, a in powers.items()), 1, 1e-10)
    expected = [powers.get(k, 0.0) for k in range(1, order + 1)]
    assert fit.order == order
    np.testing.assert_allclose(fit.coefficients, expected, atol=1e-10)
    assert fit.residual < 1e-12
    assert fit(1.2) == pytest.approx(sum(a * 0.4**k for k, a in powers.items()), abs=1e-12)


def test_points_have_the_flux_of_the_data_before_their_psfs_spread_it():
    lens = make_lens(relative_illumination=lambda nm, p: 1 - 0.1 * p**2, heights_mm=EVERY_TENTH_MM)
    lens = replace(lens, point_flux=np.broadcast_to(1 - 0.2 * EVERY_TENTH_MM**2, lens.relative_illumination.shape))
    field = FieldGeometry(lens.at_wavelength(550), lens.name)
    np.testing.assert_allclose(field.relative_flux(np.array([0, 1.23])), [1, (1 - 0.1 * 1.23**2) * (1 - 0.2 * 1.23**2)],
                               rtol=1e-6)


def test_fit_of_illumination_keeps_its_constant():
    fit = fit_polynomial(HEIGHTS_MM, 1 - 0.3 * (HEIGHTS_MM / 3)**2, 0, 1e-10)
    np.testing.assert_allclose(fit.coefficients, [1, 0, -0.3, 0, 0], atol=1e-12)


def test_a_straight_line_is_fitted_at_the_least_order():
    assert fit_polynomial(HEIGHTS_MM, HEIGHTS_MM, 1, 1e-10).order == 4


def test_no_table_is_fitted_above_order_8():
    assert fit_polynomial(HEIGHTS_MM, WILD, 0, 1e-10).order <= 8


@pytest.mark.parametrize("count, largest", [(2, 1), (3, 2), (4, 3), (5, 4), (6, 4), (7, 5), (8, 6), (10, 8), (11, 8)])
def test_few_heights_lower_the_order(count, largest):
    assert fit_polynomial(np.linspace(0, 3, count), WILD[:count], 0, 1e-10).order <= largest


def test_residual_is_the_largest_deviation():
    # Six heights allow order 4; the residual of an alternating table is the pattern of binomials, equal at both ends.
    values = np.array([1.0, -1, 1, -1, 1, -1])
    fit = fit_polynomial(np.linspace(0, 5, 6), values, 0, 1e-10)
    pattern = np.array([1, -5, 10, -10, 5, -1])
    deviation = values @ pattern / (pattern @ pattern) * pattern
    np.testing.assert_allclose(values - fit(np.linspace(0, 5, 6)), deviation, atol=1e-9)
    assert fit.residual == pytest.approx(np.abs(deviation).max())


def test_a_small_table_is_fitted_exactly():
    heights_mm = np.linspace(0, 3, 4)
    assert fit_polynomial(heights_mm, heights_mm - 0.05 * heights_mm**3, 1, 1e-10).residual < 1e-12


def test_height_on_the_axis_is_exactly_zero():
    assert geometry(barrel).distortion(0.0) == 0.0


def test_folding_distortion_is_an_error_that_names_the_height():
    with refused(LensError, field="real_height_mm", where="hand-made") as error:
        geometry(lambda p: p - 0.4 * p**2)  # its slope, 1 - 0.8 p, reaches zero at 1.25 mm
    named = float(re.search(r"height of ([\d.]+) mm", str(error.value))[1])
    assert named == pytest.approx(1.25, abs=2e-3)
    assert "550 nm" in str(error.value)


@pytest.mark.parametrize("real_height_mm", [barrel, lambda p: p + 0.02 * p**3, lambda p: 0.9 * p])
def test_inverse_of_the_distortion_round_trips(real_height_mm):
    paraxial_mm = np.linspace(0, 2, 777)
    field = geometry(real_height_mm)
    np.testing.assert_allclose(field.paraxial_height_mm(real_height_mm(paraxial_mm)), paraxial_mm, atol=1e-7)


def test_distortion_is_extrapolated_linearly():
    slope = 1 - 0.06 * 2**2
    beyond = geometry(barrel).paraxial_height_mm(barrel(2.0) + np.array([0.1, 0.2]))
    np.testing.assert_allclose(beyond, [2 + 0.1 / slope, 2 + 0.2 / slope], atol=2e-4)


def test_scale_on_the_axis_is_the_limit_of_the_ratio():
    ratio = geometry(lambda p: 0.8 * p).paraxial_per_real(np.array([0.0, 1e-9, 1.0]), np.array([0.0, 1.25e-9, 1.25]))
    np.testing.assert_allclose(ratio, 1.25, rtol=1e-9)


def test_relative_illumination_is_constant_beyond_the_last_height():
    field = geometry(relative_illumination=lambda p: 1 - 0.1 * p**2)
    np.testing.assert_allclose(field.relative_illumination(np.array([0, 1, 2, 5])), [1, 0.9, 0.6, 0.6], atol=1e-12)


def test_light_ends_at_the_first_dark_height():
    """Between the last height that is lit and the next one it falls evenly; the fit does not follow it."""
    field = geometry(relative_illumination=lambda p: np.where(p < 1.65, 1 - 0.1 * p**2, 0.0))
    heights_mm = np.array([0, 1, 1.6, 1.65, 1.7, 1.9, 2.0, 5.0])
    expected = [1, 0.9, 0.744, 0.372, 0, 0, 0, 0]
    np.testing.assert_allclose(field.relative_illumination(heights_mm), expected, atol=1e-9)
    np.testing.assert_allclose(field.relative_flux(heights_mm), expected, atol=1e-9)
    assert field.illumination.residual < 1e-12


def test_a_very_wide_pinhole_of_few_heights_has_no_distortion():
    """Its heights are no polynomial in the angle: one through all five falls near the axis."""
    heights_mm = np.linspace(0, 25, 5)
    lens = make_lens(heights_mm=heights_mm, magnification=0.0, object_distance_mm=np.inf)
    between_mm = np.linspace(0, 25, 60)
    field = FieldGeometry(lens.at_wavelength(550), lens.name)
    np.testing.assert_allclose(field.real_height_mm(between_mm), between_mm, atol=2e-4)


@pytest.mark.parametrize("degrees", [
    np.append(np.linspace(0, 88.5, 17), [89.0, 89.5]),  # heights are infinite at a right angle
    [0, 8.8, 17.6, 26.3, 30.9, 35.0, 43.7, 48.4, 52.4, 61.1, 69.9],  # a polynomial in height meets these, and folds
    [0, 9, 18, 27, 36, 45, 54, 63, 72]])
def test_very_wide_fields_are_fitted_over_angles(degrees):
    """An equal-area fisheye, also at few heights and uneven ones."""
    focal_mm = 10.0
    paraxial_mm = focal_mm * np.tan(np.radians(degrees))

    def real(p):
        return 2 * focal_mm * np.sin(np.arctan(p / focal_mm) / 2)

    lens = make_lens(real_height_mm=lambda nm, p: real(p), heights_mm=paraxial_mm, magnification=0.0,
                     object_distance_mm=np.inf)
    field = FieldGeometry(lens.at_wavelength(550), lens.name)
    between_mm = focal_mm * np.tan(np.radians(np.linspace(1, degrees[-1] - 0.1, 60)))
    step = 1e-5 * between_mm
    slope = (real(between_mm + step) - real(between_mm - step)) / (2 * step)
    np.testing.assert_allclose(field.real_height_mm(between_mm), real(between_mm), atol=2e-4)  # the fit's tolerance
    np.testing.assert_allclose(field.paraxial_height_mm(real(between_mm)), between_mm, rtol=2e-3)
    np.testing.assert_allclose(1 / field.paraxial_slope(between_mm), slope, rtol=1e-3)


def test_no_fit_of_a_very_wide_field_swings_between_heights():
    """The light falls faster next to the end. A polynomial in height meets this better than one in the angle, since it
    is nearly free between the last heights, which are far apart: it swings by many times the light."""
    degrees = np.array([0, 5, 10, 15, 20, 26, 31, 36, 41, 48, 52, 59, 64, 76, 86.5, 88, 89, 89.45])
    focal_mm = 10.0

    def light(nm, height_mm):
        angle = np.degrees(np.arctan(height_mm / focal_mm))
        return 1 - 0.6 * (angle / 90)**1.5 - np.interp(angle, [88, 89, 89.45], [0.0, 0.02, 0.06])

    lens = make_lens(relative_illumination=light, heights_mm=focal_mm * np.tan(np.radians(degrees)), magnification=0.0,
                     object_distance_mm=np.inf)
    field = FieldGeometry(lens.at_wavelength(550), lens.name)
    between_mm = focal_mm * np.tan(np.radians(np.linspace(0, 89.4, 500)))
    np.testing.assert_allclose(field.relative_illumination(between_mm), light(550, between_mm), atol=0.03)


def lit_after(real_height_mm, points, shape=(201, 201)):
    """{(x, y): value} after distorting points at (x, y) px of 10 um about the middle of the frame."""
    middle = shape[0] // 2
    plane = np.zeros(shape)
    for x, y in points:
        plane[middle - y, middle + x] = 1
    result, _ = distorted(plane, (middle, middle), shape, (middle, middle), 10.0, geometry(real_height_mm))
    return {(int(c - middle), int(middle - r)): result[r, c] for r, c in np.argwhere(result > 1e-3)}


@pytest.mark.parametrize("point, image", [((100, 0), (80, 0)), ((-100, 0), (-80, 0)), ((0, 100), (0, 80)),
                                          ((0, -100), (0, -80)), ((60, 80), (48, 64)), ((-60, 80), (-48, 64))])
def test_barrel_pulls_a_point_toward_the_axis(point, image):
    lit = lit_after(lambda p: 0.8 * p, [point])
    assert lit[image] == pytest.approx(0.64, abs=1e-6)  # the pixel sees 1.25 x 1.25 px of the source
    assert max(lit, key=lit.get) == image


@pytest.mark.parametrize("point, image", [((50, 0), (60, 0)), ((0, 50), (0, 60)), ((-30, -40), (-36, -48))])
def test_pincushion_pushes_a_point_outwards(point, image):
    lit = lit_after(lambda p: 1.2 * p, [point])
    assert max(lit, key=lit.get) == image
    assert lit[image] == pytest.approx(1.0, abs=1e-6)


def test_cubic_barrel_lands_where_calculated_by_hand():
    # real = p - p^3 / 20: 1 mm, 100 px, goes to 0.95 mm, 95 px. The slope there is 0.85: pixel 96 samples 1.18 px
    # farther, with a footprint of 1.18 px, and of 1 / 0.95 px across the radius.
    lit = lit_after(lambda p: p - 0.05 * p**3, [(100, 0)])
    assert set(lit) == {(95, 0)}
    assert lit[95, 0] == pytest.approx(0.85 * 0.95, abs=1e-3)


@pytest.mark.parametrize("scale", [0.6, 0.8, 0.93, 1.0])
def test_a_point_keeps_its_energy_wherever_it_falls(scale):
    points = [(x, y) for x in range(-90, 91, 13) for y in range(-90, 91, 17)]
    lit = lit_after(lambda p: scale * p, points)
    assert sum(lit.values()) == pytest.approx(len(points) * scale**2, rel=1e-9)
    for x, y in points:
        near = [value for (px, py), value in lit.items() if np.hypot(px - scale * x, py - scale * y) < 3]
        assert sum(near) == pytest.approx(scale**2, rel=1e-9)


def test_points_keep_their_energy_under_growing_barrel_distortion():
    points = [(x, y) for x in range(-84, 85, 12) for y in range(-84, 85, 12)]
    energy = sum(lit_after(lambda p: p - 0.05 * p**3, points).values())
    radius_mm = np.hypot(*np.array(points).T) * 0.01
    areas = (1 - 0.05 * radius_mm**2) * (1 - 0.15 * radius_mm**2)
    assert energy == pytest.approx(areas.sum(), rel=2e-3)


@pytest.mark.parametrize("real_height_mm", [lambda p: 0.7 * p, lambda p: 1.3 * p, lambda p: p - 0.05 * p**3])
def test_even_light_stays_even(real_height_mm):
    plane = np.full((301, 301), 5.0)
    result, _ = distorted(plane, (150, 150), (101, 101), (50, 50), 10.0, geometry(real_height_mm))
    np.testing.assert_allclose(result, 5.0, rtol=1e-12)


def test_the_returned_height_is_that_of_the_source():
    _, height_mm = distorted(np.ones((21, 21)), (10, 10), (21, 21), (10, 10), 100.0, geometry(lambda p: 0.8 * p))
    assert height_mm[10, 10] == 0
    assert height_mm[10, 18] == pytest.approx(1.0)  # 0.8 mm right of the axis
    assert height_mm[2, 16] == pytest.approx(1.25)  # 0.8 mm up and 0.6 mm right


def test_source_and_target_may_have_their_axes_at_different_pixels():
    plane = np.zeros((9, 11))
    plane[2, 7] = 1  # 3 right of and 2 above the axis
    result, _ = distorted(plane, (4, 4), (7, 7), (3, 2), 10.0, geometry())
    assert np.unravel_index(result.argmax(), result.shape) == (1, 5)
    assert result.max() == pytest.approx(1.0, abs=1e-9)


def test_half_a_pixel_of_shift_is_bilinear_and_outside_is_black():
    plane = np.array([[4.0, 8.0]])
    result, _ = distorted(plane, (0, 0.5), (1, 3), (0, 1.0), 10.0, geometry())
    np.testing.assert_allclose(result, [[2.0, 6.0, 4.0]], atol=1e-9)


def test_distorted_light_stays_within_its_range():
    plane = np.random.default_rng(3).random((40, 50))
    result, _ = distorted(plane, (19.5, 24.5), (40, 50), (19.5, 24.5), 40.0, geometry(barrel))
    assert result.min() >= 0 and result.max() <= plane.max()


@pytest.mark.parametrize("real_height_mm", [lambda p: 0.7 * p, lambda p: 1.3 * p, barrel])
def test_shares_of_every_footprint_sum_to_one(real_height_mm):
    target = PixelGrid((50, 70), 20.0, (20, 30))
    areas, _ = footprints(PixelGrid((200, 200), 20.0, (100, 100)), *target.axes_mm(), geometry(real_height_mm))
    np.testing.assert_allclose(sum(areas.row_shares), 1, atol=1e-14)
    np.testing.assert_allclose(sum(areas.column_shares), 1, atol=1e-14)


def test_a_stack_of_captures_is_averaged_plane_by_plane():
    rng = np.random.default_rng(6)
    stack = np.pad(rng.random((3, 60, 80)), ((0, 0), (RIM_PX, RIM_PX), (RIM_PX, RIM_PX)))
    capture, target = PixelGrid(stack.shape[1:], 40.0, (40, 50)), PixelGrid((40, 50), 40.0, (20, 25))
    areas, _ = footprints(capture, *target.axes_mm(), geometry(barrel))
    together = areas.average(stack)
    for plane, result in zip(stack, together, strict=True):
        np.testing.assert_array_equal(areas.average(plane[None])[0], result)


def test_the_largest_footprint_averages_its_square():
    # 16 px of the capture per pixel: pixel (0, 1) covers rows -8 to 8 and columns 8 to 24 about the axis.
    plane = np.random.default_rng(7).random((101, 101))
    result, _ = distorted(plane, (50, 50), (1, 2), (0, 0), 10.0, geometry(lambda p: p / LARGEST_FOOTPRINT_PX))
    weights = np.concatenate([[0.5], np.ones(LARGEST_FOOTPRINT_PX - 1), [0.5]]) / LARGEST_FOOTPRINT_PX
    expected = [weights @ plane[42:59, 42 + 16 * column:59 + 16 * column] @ weights for column in (0, 1)]
    np.testing.assert_allclose(result[0], expected, rtol=1e-9)


def test_a_larger_footprint_is_represented_by_its_middle():
    plane = np.random.default_rng(7).random((101, 101))
    result, _ = distorted(plane, (50, 50), (1, 1), (0, 0), 10.0, geometry(lambda p: p / 40))
    weights = np.concatenate([[0.5], np.ones(LARGEST_FOOTPRINT_PX - 1), [0.5]]) / LARGEST_FOOTPRINT_PX
    assert result[0, 0] == pytest.approx(weights @ plane[42:59, 42:59] @ weights, rel=1e-9)


@pytest.mark.parametrize("scale", [0.07, 0.5, 1.0, 1.4])
def test_everything_outside_the_capture_is_black(scale):
    plane = np.ones((5, 7))
    result, _ = distorted(plane, (2, 3), (81, 81), (40, 40), 10.0, geometry(lambda p: scale * p))
    row, column = np.indices((81, 81)) - 40
    # A footprint is at least a pixel wide, or 1 / scale.
    reach = np.maximum(1, 1 / scale) / 2
    outside = (np.abs(row) / scale > 2.5 + reach) | (np.abs(column) / scale > 3.5 + reach)
    inside = (np.abs(row) / scale < 2.5 - reach) & (np.abs(column) / scale < 3.5 - reach)
    assert not result[outside].any()
    np.testing.assert_allclose(result[inside], 1, rtol=1e-12)
    assert 0 <= result.min() and result.max() <= 1 + 1e-12
