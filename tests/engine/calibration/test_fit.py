"""Fits return the parameters of lenses whose distortion is that of a model, and the place of the axis."""

import numpy as np
import pytest

from calibrated import FOCAL_MM, FOCAL_PX, FRAME, HEIGHTS_MM, modelled_lens, radial_lens
from lenses import make_lens
from lensfield.engine import LensError, load_lens
from lensfield.engine.calibration.fit import TARGET_PX, calibrate
from lensfield.engine.calibration.models import (
    BROWN_CONRADY,
    DOUBLE_SPHERE,
    KANNALA_BRANDT,
    MODELS,
    PINHOLE,
    RADIAL,
    RADTAN,
    THIN_PRISM,
)
from lensfield.engine.calibration.rays import frame_rays
from lensfield.engine.field.field_map import field_map
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.rays.rings import Rings
from refusals import refused

AXIS_PX = FRAME.centre_px[::-1]
TABLE_PX = 2e-3  # the field map follows its table to 1e-5 of the last height, 4 mm, on pixels of 22 um


def test_a_lens_without_distortion_is_a_pinhole():
    fit = calibrate(make_lens(heights_mm=HEIGHTS_MM), FRAME, 550.0, list(MODELS.values()))
    assert fit.model is PINHOLE and fit.size_px == (140, 90)
    np.testing.assert_allclose([*fit.focal_px, *fit.principal_px], [FOCAL_PX, FOCAL_PX, *AXIS_PX], rtol=1e-6)
    assert fit.largest_px < 1e-5 and fit.focus_mm == 105.0 and fit.covered == 1


def test_light_from_the_upper_right_lands_at_the_upper_right():
    fit = calibrate(make_lens(heights_mm=HEIGHTS_MM), FRAME, 550.0, [PINHOLE])
    right, up = 1 / FOCAL_MM, 0.5 / FOCAL_MM
    np.testing.assert_allclose(fit.pixels(np.array([[right, -up, 1.0]])),
                               [[42 + 1 / 0.022, 61 - 0.5 / 0.022]], rtol=1e-6)


@pytest.mark.parametrize("coefficients", [(-0.5,), (-0.9, 2.0), (0.4, -3.0, 20.0)])
def test_radial_coefficients_return(coefficients):
    def distorted(t):
        return t * (1 + sum(k * t**(2 * power) for power, k in enumerate(coefficients, 1)))

    fit = calibrate(radial_lens(distorted), FRAME, 550.0, [RADIAL[len(coefficients) - 1]])
    np.testing.assert_allclose(fit.coefficients[0], coefficients[0], rtol=0.03)
    tangent = np.linspace(0, 0.24, 9)
    exact_px = AXIS_PX + FOCAL_PX * distorted(tangent)[:, None] * (0.6, -0.8)
    fitted_px = fit.pixels(np.stack([0.6 * tangent, -0.8 * tangent, np.ones(9)], axis=1))
    np.testing.assert_allclose(fitted_px, exact_px, atol=TABLE_PX)
    assert fit.principal_px == AXIS_PX and fit.largest_px < 2 * TABLE_PX


def test_the_simplest_sufficient_model_is_chosen():
    models, lens = [PINHOLE, *RADIAL], radial_lens(lambda t: t * (1 - 0.9 * t**2 + 2 * t**4))
    fits = [calibrate(lens, FRAME, 550.0, [model]) for model in models]
    assert fits[1].largest_px > TARGET_PX / 20 > fits[2].largest_px
    assert calibrate(lens, FRAME, 550.0, models, TARGET_PX / 20).model is RADIAL[1]
    assert calibrate(lens, FRAME, 550.0, models[:2], TARGET_PX / 20).model is RADIAL[0]
    assert fits[0].rms_px < fits[0].largest_px


def test_of_models_that_all_miss_the_target_the_simplest_of_nearly_the_best_is_chosen():
    lens = modelled_lens(RADTAN, (0.0, 0.0, 0.011, -0.007))
    pinhole, *radial = fits = [calibrate(lens, FRAME, 550.0, [model]) for model in (PINHOLE, *RADIAL)]
    best_px = radial[2].largest_px
    assert pinhole.largest_px > 1.2 * best_px and best_px < radial[0].largest_px < 1.05 * best_px
    assert calibrate(lens, FRAME, 550.0, [fit.model for fit in fits]) == radial[0]


def test_a_fisheye_returns_its_angles():
    def distorted(angle):
        return angle * (1 - 0.05 * angle**2)

    fit = calibrate(radial_lens(lambda t: distorted(np.arctan(t)), np.linspace(0, 30, 65)),
                    PixelGrid((90, 140), 100.0, centre_px=(61.0, 42.0)), 550.0, [KANNALA_BRANDT])
    angle, corner_mm = np.linspace(0, 1.5, 1001), 0.1 * np.hypot(97.5, 61.5)  # the upper right one
    corner_deg = np.degrees(np.interp(corner_mm / FOCAL_MM, distorted(angle), angle))
    assert fit.largest_px < 0.01 and fit.largest_angle_deg == pytest.approx(corner_deg, abs=0.02)
    np.testing.assert_allclose(fit.coefficients[0], -0.05, atol=1e-3)
    np.testing.assert_allclose(fit.focal_px, FOCAL_MM / 0.1, rtol=1e-4)


def test_a_double_sphere_returns():
    xi, alpha = -0.2, 0.6

    def distorted(t):
        return DOUBLE_SPHERE.placed(t, 0 * t, np.ones_like(t), xi, alpha)[0]

    slope = 1 / (1 + xi)  # on the axis, where lens data begin with their focal length
    fit = calibrate(radial_lens(lambda t: distorted(t) / slope, np.linspace(0, 20, 65)),
                    PixelGrid((90, 140), 120.0, centre_px=(61.0, 42.0)), 550.0, [DOUBLE_SPHERE])
    np.testing.assert_allclose(fit.coefficients, (xi, alpha), atol=2e-3)
    np.testing.assert_allclose(fit.focal_px, FOCAL_MM / 0.12 / slope, rtol=2e-3)


@pytest.mark.parametrize("model, coefficients, squeeze", [
    (RADTAN, (-0.4, 0.5, 0.011, -0.007), 1.0), (BROWN_CONRADY, (-0.4, 0.5, 0.003, 0.008, 1.0), 1.5),
    (THIN_PRISM, (0, 0, 0, 0, 0, 0, 0, 0, 0.012, 0.1, -0.02, -0.2), 1.0)])
def test_lenses_without_symmetry_return_all_coefficients(model, coefficients, squeeze):
    lens = modelled_lens(model, coefficients, squeeze)
    fit = calibrate(lens, FRAME, 550.0, [model])
    np.testing.assert_allclose(fit.focal_px, (FOCAL_PX / squeeze, FOCAL_PX), rtol=1e-3)
    np.testing.assert_allclose(fit.principal_px, AXIS_PX, atol=0.3)  # tangential terms move with it
    assert fit.largest_px < 5e-3
    tangents = np.array([[0.15, -0.1, 1.0], [-0.08, 0.05, 1.0]])
    exact = model.place(tangents, coefficients) * (FOCAL_PX / squeeze, FOCAL_PX) + AXIS_PX
    np.testing.assert_allclose(fit.pixels(tangents), exact, atol=5e-3)


def test_pixels_are_where_the_field_map_puts_the_light():
    lens = modelled_lens(RADTAN, (-0.4, 0.5, 0.011, -0.007))
    fit = calibrate(lens, FRAME, 550.0, [RADTAN])
    x_mm, y_mm = np.array([1.4, -0.6]), np.array([0.9, -0.4])  # in the ideal image
    row, column = FRAME.index_of(*field_map(lens).at_wavelength(550.0).landing_mm(x_mm, y_mm))
    directions = np.stack([x_mm / FOCAL_MM, -y_mm / FOCAL_MM, np.ones(2)], axis=1)
    np.testing.assert_allclose(fit.pixels(directions), np.stack([column, row], axis=1), atol=5e-3)


def test_each_wavelength_has_its_focal_length():
    lens = make_lens(real_height_mm=lambda nm, p: p * (1 + 1e-5 * (nm - 550)), heights_mm=HEIGHTS_MM)
    for nm in (450.0, 650.0):
        fit = calibrate(lens, FRAME, nm, [PINHOLE])
        np.testing.assert_allclose(fit.focal_px, FOCAL_PX * (1 + 1e-5 * (nm - 550)), rtol=1e-7)
        assert fit.wavelength_nm == nm


def test_places_beyond_the_lens_data_are_left_out():
    lens = make_lens(real_height_mm=lambda nm, p: p - 0.02 * p**3, heights_mm=np.linspace(0, 1.5, 21))
    rays = frame_rays(lens, FRAME, 550.0)
    assert np.hypot(*(rays.pixels - AXIS_PX).T).max() * 0.022 <= 1.5 - 0.02 * 1.5**3 + 1e-9
    assert 0.3 < rays.covered < 0.9
    with refused(LensError, field="frame", where="hand-made"):
        frame_rays(lens, FRAME.shifted(1000, 0), 550.0)


def test_only_strong_barrel_distortion_makes_a_fisheye():
    frame = PixelGrid((90, 140), 40.0)
    for distorted, fisheye in ((np.arctan, False), (lambda t: t * (1 - 6.0 * t**2 / 2), True)):
        rays = frame_rays(radial_lens(distorted, np.linspace(0, 3.4, 33)), frame, 550.0)
        assert rays.fisheye == fisheye, rays.distortion


def test_the_entrance_pupil_counts_from_the_image_plane_towards_the_object():
    """In the drawing of a lens of twice the size that is focused at 2 m, each distance is twice as long."""
    lens = load_lens("nikkor-28mm", Rings(focus_mm=2000.0), quality="preview")
    fit, twice = (calibrate(each, PixelGrid((90, 140), 200.0), 550.0, [PINHOLE]) for each in (lens, lens.scaled(2.0)))
    track_mm = sum(surface.thickness_mm for surface in lens.prescription.surfaces)
    assert 0 < lens.entrance_pupil_mm < track_mm
    np.testing.assert_allclose(fit.entrance_pupil_mm + fit.focus_mm, lens.object_distance_mm + track_mm)
    np.testing.assert_allclose(twice.entrance_pupil_mm, 2 * fit.entrance_pupil_mm)
    at_infinity = load_lens("nikkor-28mm", quality="preview").f_number_effective
    np.testing.assert_allclose(fit.f_stop, at_infinity, rtol=1e-3)
    assert fit.f_number > 1.005 * at_infinity
    assert calibrate(make_lens(heights_mm=HEIGHTS_MM), FRAME, 550.0, [PINHOLE]).entrance_pupil_mm is None
