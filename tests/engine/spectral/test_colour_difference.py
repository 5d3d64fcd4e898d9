"""CIEDE2000 against published pairs (Sharma, Wu and Dalal, Color Res. Appl. 30, 2005, table 1)."""

import numpy as np
import pytest

from lensfield.engine.spectral.colour_difference import ciede2000, lab_from_xyz

PAIRS = [
    ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
    ((50.0, 3.1571, -77.2803), (50.0, 0.0, -82.7485), 2.8615),
    ((50.0, -1.3802, -84.2814), (50.0, 0.0, -82.7485), 1.0000),
    ((50.0, 0.0, 0.0), (50.0, -1.0, 2.0), 2.3669),
    ((50.0, 2.4900, -0.0010), (50.0, -2.4900, 0.0009), 7.1792),
    ((50.0, -0.0010, 2.4900), (50.0, 0.0009, -2.4900), 4.8045),
    ((50.0, 2.5, 0.0), (50.0, 0.0, -2.5), 4.3065),
    ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
    ((50.0, 2.5, 0.0), (58.0, 24.0, 15.0), 19.4535),
    ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
    ((22.7233, 20.0904, -46.6940), (23.0331, 14.9730, -42.5619), 2.0373),
    ((90.8027, -2.0831, 1.4410), (91.1528, -1.6435, 0.0447), 1.4441),
    ((2.0776, 0.0795, -1.1350), (0.9033, -0.0636, -0.5514), 0.9082)]


@pytest.mark.parametrize("first, second, expected", PAIRS)
def test_published_pairs(first, second, expected):
    assert ciede2000(first, second) == pytest.approx(expected, abs=1e-4)
    assert ciede2000(second, first) == pytest.approx(expected, abs=1e-4)


def test_white_and_black_and_grey():
    white = np.array([0.9505, 1.0, 1.089])
    np.testing.assert_allclose(lab_from_xyz(white, white), (100, 0, 0), atol=1e-10)
    np.testing.assert_allclose(lab_from_xyz(0 * white, white), (0, 0, 0), atol=1e-10)
    np.testing.assert_allclose(lab_from_xyz(0.18418652 * white, white), (50, 0, 0), atol=1e-4)
