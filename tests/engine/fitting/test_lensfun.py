"""Lensfun's database through lensfunpy, if it is installed: make test-photographs."""

import sys

import numpy as np
import pytest

from lensfield.engine import InputError, LensError
from lensfield.engine.fitting.lensfun import (
    SHARES,
    channel_heights_mm,
    find_photographed,
    straight_and_real_mm,
    vignetting_of,
)
from lensfield.engine.library import prescription_of
from refusals import refused

SONY, CANON = "Sony FE 55mm f/1.8 ZA", "Canon RF 85mm F1.2L USM"


def test_without_lensfunpy_one_line_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "lensfunpy", None)
    with refused(InputError, field="lensfunpy", where="lensfun", match="pip install lensfunpy"):
        find_photographed(SONY)


@pytest.fixture
def lensfunpy():
    return pytest.importorskip("lensfunpy", reason="Lensfun's data come with lensfunpy: make test-photographs")


def test_unknown_lenses_are_refused_with_similar_ones(lensfunpy):
    with refused(InputError, field="lens", value="nikkor z 50", match="such as Nikon NIKKOR Z 50mm"):
        find_photographed("nikkor z 50")
    with refused(InputError, field="lens", value="no such thing"):
        find_photographed("no such thing")


def test_light_is_the_inverse_of_lensfuns_correction(lensfunpy):
    """Its model is 1 + k1 r^2 + k2 r^4 + k3 r^6 of the half diagonal."""
    photographed = find_photographed(SONY.lower())
    assert photographed.name == SONY
    curves = vignetting_of(photographed, prescription_of("sony-zeiss-55mm-f1.8"))
    terms = {round(each.aperture, 2): each.terms for each in photographed.lens.calib_vignetting}
    assert len(curves) == len(terms) > 10
    for curve in curves:
        expected = 1 + sum(term * SHARES**power for term, power in zip(terms[curve.f_number], (2, 4, 6), strict=True))
        assert np.allclose(curve.light, expected, atol=1e-3)
        assert np.allclose(curve.heights_mm, SHARES * np.hypot(36, 24) / 2)
        assert np.isinf(curve.focus_mm), "its two distances have the same light: one photograph"


def test_distances_count_from_the_sensor_and_end_where_the_lens_focuses(lensfunpy):
    lens = prescription_of("canon-rf-85mm-f1.2")
    distances_mm = {curve.focus_mm for curve in vignetting_of(find_photographed(CANON), lens)}
    far, middle, near = sorted(distances_mm, reverse=True)
    assert np.isinf(far) and 4200 < middle < 4280 and 1570 < near < 1650, "the closest, 0.82 m, is too close for it"


def test_distortion_is_lensfuns_polynomial(lensfunpy):
    """ptlens: a r^4 + b r^3 + c r^2 + (1 - a - b - c) r, in half heights of the picture."""
    photographed = find_photographed(SONY)
    straight_mm, real_mm = straight_and_real_mm(photographed)
    a, b, c = photographed.lens.calib_distortion[0].terms[:3]
    r = straight_mm / 12
    assert np.allclose(real_mm, 12 * (a * r**4 + b * r**3 + c * r**2 + (1 - a - b - c) * r), atol=0.004)
    assert straight_mm[-1] == pytest.approx(0.95 * np.hypot(36, 24) / 2, abs=0.02)
    assert np.abs(real_mm - straight_mm).max() > 0.1


def test_red_and_blue_differ_from_green(lensfunpy):
    red_mm, green_mm, blue_mm = channel_heights_mm(find_photographed(SONY))
    terms = photographed_terms = find_photographed(SONY).lens.calib_tca[0].terms
    assert np.allclose(red_mm / green_mm, terms[0], atol=1e-5) and np.allclose(
        blue_mm / green_mm, photographed_terms[1], atol=1e-5) and not np.allclose(red_mm, blue_mm, rtol=1e-5)


def test_lenses_without_a_measurement_have_none(lensfunpy):
    helios, nikkor = find_photographed("KMZ Helios-44 58mm 1:2"), find_photographed(
        "Nikon AF-S Nikkor 58mm f/1.4G")
    assert straight_and_real_mm(helios) is not None and channel_heights_mm(nikkor) is None
    with refused(LensError, field="vignetting", value="missing", match="Nikkor 58mm f/1.4G"):
        vignetting_of(nikkor, prescription_of("nikkor-58mm-f1.4"))
