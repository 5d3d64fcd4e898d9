"""Calibrations as JSON values: read back, they are the same."""

import json
from dataclasses import replace
from math import inf

import pytest

from calibrated import FRAME
from lensfield.engine.calibration.fit import Calibration
from lensfield.engine.calibration.models import MODELS
from lensfield.engine.calibration.stored import calibration_from, calibration_values

RATIONAL = Calibration(
    MODELS["rational"], FRAME, (477.3, 238.9), (61.4, 42.7), tuple(0.1 * (number - 3.5) for number in range(8)), 0.012,
    0.034, 0.97, "Lens of \u03b1, scaled by 0.5", 1234.5, 2.83, 587.56, 12.3, (0.11, 0.12, 0.13, 0.14), 2.8,
    34.5)


@pytest.mark.parametrize("calibration", [
    RATIONAL, replace(RATIONAL, focus_mm=inf, entrance_pupil_mm=None),
    replace(RATIONAL, model=MODELS["pinhole"], coefficients=())])
def test_a_calibration_is_the_same_after_json(calibration):
    values = json.loads(json.dumps(calibration_values(calibration), allow_nan=False))
    assert calibration_from(values) == calibration


def test_coefficients_have_names():
    values = calibration_values(RATIONAL)
    assert values["model"] == "rational" and values["coefficients"]["k2"] == RATIONAL.by_name["k2"]
