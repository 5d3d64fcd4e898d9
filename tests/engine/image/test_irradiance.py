"""Eq. 2: E = pi T L R / (4 N_eff^2)."""

import numpy as np
import pytest

from lensfield.engine.image.irradiance import ideal_irradiance, irradiance_per_radiance


@pytest.mark.parametrize("radiance, illumination, transmittance, f_number, expected", [
    (1.0, 1.0, 1.0, 0.5, np.pi),  # N = 0.5 is the whole hemisphere: NA = 1
    (2.0, 0.5, 0.9, 2.0, 0.17671458676442586),
    (100.0, 1.0, 1.0, 1.775, 24.92832893),
    (3.0, 1.037, 0.95, 1.8867924528301887, 0.6520264851),
])
def test_irradiance_of_equation_2(radiance, illumination, transmittance, f_number, expected):
    result = ideal_irradiance(np.array([[radiance]]), np.array([[illumination]]), transmittance, f_number)
    assert result[0, 0] == pytest.approx(expected, rel=1e-7)


def test_irradiance_is_that_of_the_cone_of_the_numerical_aperture():
    sine = 0.265
    assert irradiance_per_radiance(1.0, 0.5 / sine) == pytest.approx(np.pi * sine**2, rel=1e-14)


def test_relative_illumination_acts_pixel_by_pixel():
    profile = np.array([[1.0, 0.5], [0.25, 0.0]])
    result = ideal_irradiance(np.full((2, 2), 8.0), profile, 1.0, 1.0)
    np.testing.assert_allclose(result, 2 * np.pi * profile, rtol=1e-14)
