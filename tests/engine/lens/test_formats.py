"""Sensor formats."""

import pytest

from lensfield.engine import InputError
from lensfield.engine.lens.formats import FORMATS, crop_factor, format_mm


def test_formats_are_named_or_given_in_mm():
    assert format_mm("super35") == (24.89, 18.66) and format_mm("7.2X5.4") == (7.2, 5.4)
    assert all(format_mm(name) == sensor_mm for name, (_, sensor_mm) in FORMATS.items())
    with pytest.raises(InputError, match="--sensor is 36x-24: expected WIDTHxHEIGHT in mm, .* one of phone, super16,"):
        format_mm("36x-24")


def test_crop_factors_are_those_that_photographers_use():
    assert crop_factor((17.3, 13.0)) == pytest.approx(2.0, abs=0.01)
    assert crop_factor((13.2, 8.8)) == pytest.approx(2.7, abs=0.05)
