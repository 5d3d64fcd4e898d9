"""Eq. 2: E = pi T L R / (4 N_eff^2)."""

import numpy as np
import pytest

from lensfield.engine.image.irradiance import irradiance_per_radiance


@pytest.mark.parametrize("transmittance, f_number, expected", [
    (1.0, 0.5, np.pi),  # N = 0.5 is the full hemisphere: NA = 1
    (0.9, 2.0, 0.17671458676442586), (1.0, 1.775, 0.2492832893), (0.95, 1.8867924528301887, 0.2095874269),
])
def test_irradiance_per_radiance_of_equation_2(transmittance, f_number, expected):
    assert irradiance_per_radiance(transmittance, f_number) == pytest.approx(expected, rel=1e-9)


def test_irradiance_is_that_of_the_cone_of_the_numerical_aperture():
    sine = 0.265
    assert irradiance_per_radiance(1.0, 0.5 / sine) == pytest.approx(np.pi * sine**2, rel=1e-14)
