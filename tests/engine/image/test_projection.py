"""Projections: angles and radii, and the polynomial fitted to a lens."""

import numpy as np
import pytest

from lensfield.engine.image.projection import FISHEYE, PLANE, Projection, fitted_projection
from lensfield.engine.runtime.errors import ImageError
from refusals import refused

PANORAMA = Projection((0.9, 0.1, -0.15, 0.06))
ANGLES_RAD = np.radians([0, 0.01, 20, 55, 85])


def test_an_angle_is_the_polynomial_of_its_radius():
    assert PANORAMA.angle_rad(0.7) == pytest.approx(0.9 * 0.7 + 0.1 * 0.7**2 - 0.15 * 0.7**3 + 0.06 * 0.7**4)
    assert PLANE.angle_rad(1.0) == pytest.approx(np.pi / 4)


@pytest.mark.parametrize("projection", [PLANE, FISHEYE, PANORAMA])
def test_a_radius_shows_its_angle(projection):
    radius, slope = projection.radius(np.tan(ANGLES_RAD))
    np.testing.assert_allclose(projection.angle_rad(radius), ANGLES_RAD, atol=1e-7)
    farther, _ = projection.radius(np.tan(ANGLES_RAD) + 1e-4)
    np.testing.assert_allclose((farther - radius) / 1e-4, slope, rtol=1e-2)
    np.testing.assert_allclose(projection.shrinkage(np.tan(ANGLES_RAD[1:])), radius[1:] / np.tan(ANGLES_RAD[1:]))
    assert projection.shrinkage(np.zeros(1)) == pytest.approx(slope[0])


@pytest.mark.parametrize("projection", [FISHEYE, PANORAMA])
def test_the_table_of_shrinkage_is_interpolated_between_its_steps(projection):
    table = projection.shrinkage_table
    step = np.tan(ANGLES_RAD) / (1 + np.tan(ANGLES_RAD)) * (table.size - 1)
    np.testing.assert_allclose(np.interp(step, np.arange(table.size), table),
                               projection.shrinkage(np.tan(ANGLES_RAD)), atol=3e-6)


def test_radii_continue_beyond_the_largest_angle():
    """1 r - 0.5 r^2 increases up to r = 1, where it is 0.5 rad."""
    radius, slope = Projection((1.0, -0.5)).radius(np.tan([0.499, 0.5, 0.6, 1.0]))
    assert np.all(np.diff(radius) > 0) and np.all(np.isfinite(slope)) and radius[2] == pytest.approx(1.2, abs=1e-3)


def test_a_fit_follows_a_quartic_exactly():
    radius = np.linspace(0, 0.8, 100)
    fitted = fitted_projection(radius, np.tan(PANORAMA.angle_rad(radius)), 1.0)
    assert fitted.angle_per_radius == pytest.approx(PANORAMA.angle_per_radius, abs=1e-8)


def test_a_fit_increases_as_far_as_the_capture_extends():
    """The quartic that is closest to this turns beyond the fit, unlike the cubic."""
    radius = np.linspace(0, 0.5, 100)
    angle_rad = radius + radius**3 - 0.9 * radius**4
    near, far = (fitted_projection(radius, np.tan(angle_rad), farthest) for farthest in (0.6, 2.5))
    assert len(near.angle_per_radius) == 4 > len(far.angle_per_radius)
    assert np.all(np.diff(far.angle_rad(np.linspace(0, 1.5, 1000))) > 0)
    np.testing.assert_allclose(far.angle_rad(radius), angle_rad, atol=0.01)


@pytest.mark.parametrize("coefficients", [(1, 0, 0, 0, 0), (0,), (-1, 2), (np.nan,), (1, np.inf), (1, 1e300)], ids=str)
def test_other_polynomials_are_refused(coefficients):
    with refused(ImageError, field="projection", where="image"):
        Projection(coefficients)
