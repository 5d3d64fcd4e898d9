"""Corrections of lenses: against closed forms of distortion, lateral colour and falloff, and for the paper's lens."""

import numpy as np
import pytest

from lenses import make_lens
from lensfield.engine import load_lens
from lensfield.engine.field.field_map import field_map
from lensfield.engine.field.lens_correction import lens_correction
from lensfield.engine.image.pixel_grid import PixelGrid

OFF_CENTRE = PixelGrid((190, 301), 10.0, centre_px=(70.0, 180.0))  # 2.16 mm to the farthest pixel, lower left
HEIGHTS_MM = np.linspace(0, 3, 41)
BLUE_GREEN_RED = np.array([450.0, 550.0, 650.0])


def barrel(nm, p):
    """3 % of barrel distortion at 1 mm, and 0.2 % of lateral colour in 100 nm."""
    return (1 + 2e-5 * (nm - 550)) * p * (1 - 0.03 * p**2 + 0.001 * p**4)


def lens_of(real_height_mm=None, relative_illumination=None, **changes):
    return make_lens(real_height_mm=real_height_mm, relative_illumination=relative_illumination,
                     heights_mm=HEIGHTS_MM, wavelengths_nm=BLUE_GREEN_RED, **changes)


def warped_px(correction, channel, grid, row, column):
    """Place in the lens's picture of a place in the straightened one, as the DNG specification defines it."""
    last = np.subtract(grid.shape_px, 1)
    centre = np.array(correction.centre[::-1]) * last
    farthest = np.hypot(*np.maximum(centre, last - centre))
    offset = np.array([row, column]) - centre
    r2 = (offset @ offset) / farthest**2
    return centre + offset * (correction.warp[channel] @ [1, r2, r2**2, r2**3])


def test_each_channel_is_straightened_by_the_mean_of_its_wavelengths():
    weights = np.array([[0.0, 0.2, 0.8], [0.1, 0.8, 0.1], [0.9, 0.1, 0.0]])
    transmittance = np.array([0.3, 0.6, 0.9])
    correction = lens_correction(lens_of(barrel, transmittance=transmittance), OFF_CENTRE, BLUE_GREEN_RED, weights)
    assert correction.centre == pytest.approx((180 / 300, 70 / 189))
    assert correction.distortion == pytest.approx(barrel(550, 2.16) / 2.16 - 1, abs=0.003)
    assert correction.magnification == 1 and correction.distortion_error < 1e-4 and correction.remarks == []
    for row, column in ((3, 290), (189, 0), (70, 210), (150, 170)):
        height_mm = np.hypot(row - 70, column - 180) * 0.01
        for channel, share in enumerate(weights * transmittance):
            landing_mm = share @ barrel(BLUE_GREEN_RED, height_mm) / share.sum()
            expected = [70 + (row - 70) * landing_mm / height_mm, 180 + (column - 180) * landing_mm / height_mm]
            np.testing.assert_allclose(warped_px(correction, channel, OFF_CENTRE, row, column), expected, atol=0.02)


def test_a_picture_that_pincushion_stretches_is_magnified_to_fill_the_frame():
    correction = lens_correction(lens_of(lambda nm, p: p * (1 + 0.02 * p**2)), OFF_CENTRE, BLUE_GREEN_RED, np.eye(3))
    assert correction.magnification == pytest.approx(1.07, abs=0.02)
    border = [(row, column) for row in (0, 189) for column in range(301)] + \
             [(row, column) for row in range(190) for column in (0, 300)]
    places = np.array([warped_px(correction, 1, OFF_CENTRE, *place) for place in border])
    assert np.all((places > -0.05) & (places < [189.05, 300.05]))
    assert np.any(np.abs(places - [189, 0]).sum(axis=1) < 0.1)
    height_mm = 0.3 / correction.magnification
    moved = 180 + 100 * height_mm * (1 + 0.02 * height_mm**2)
    assert warped_px(correction, 0, OFF_CENTRE, 70, 210)[1] == pytest.approx(moved, abs=0.01)


def test_the_gain_compensates_for_the_falloff():
    lens = lens_of(relative_illumination=lambda nm, p: 1 / (1 + (p / 4)**2)**2)
    correction = lens_correction(lens, OFF_CENTRE, BLUE_GREEN_RED, np.eye(3))
    radius_mm = np.hypot(119, 180) * 0.01
    for height_mm in (0.2, 1.0, radius_mm):
        powers = (height_mm / radius_mm)**np.arange(2, 12, 2)
        assert 1 + correction.gain @ powers == pytest.approx((1 + (height_mm / 4)**2)**2, rel=1e-3)
    assert correction.warp[0] == pytest.approx([1, 0, 0, 0], abs=1e-6)


def test_what_polynomials_cannot_describe_is_left_out_and_reported():
    fisheye = lens_of(lambda nm, p: 1.2 * np.arctan(p / 1.2), lambda nm, p: np.where(p < 1.5, 1, 0.03))
    correction = lens_correction(fisheye, OFF_CENTRE, BLUE_GREEN_RED, np.eye(3))
    assert correction.warp is None and correction.gain is None
    distortion, falloff = correction.remarks
    assert distortion.endswith("distortion of -40.9%: more than 25%") and "falloff: its polynomial would be" in falloff
    beside = PixelGrid((190, 301), 10.0, centre_px=(70.0, 400.0))
    correction = lens_correction(lens_of(barrel), beside, BLUE_GREEN_RED, np.eye(3))
    assert correction.warp is None and correction.remarks[0].endswith("the optical axis is outside the frame")


def test_the_papers_lens_is_straightened_to_a_tenth_of_a_percent():
    lens = load_lens("edmund-54852")
    frame = PixelGrid((576, 768), 6.25)
    green = np.exp(-((lens.wavelengths_nm - 540) / 40)**2)[None]
    correction = lens_correction(lens, frame, lens.wavelengths_nm, green / green.sum())
    assert correction.distortion == pytest.approx(-0.085, abs=0.003)
    assert correction.distortion_error < 1e-3
    nm = float(green[0] @ lens.wavelengths_nm / green.sum())
    rows, columns = (each.ravel() for each in np.mgrid[0:576:25, 0:768:25])
    x_mm, y_mm = field_map(lens).at_wavelength(nm).landing_mm(*frame.position_mm(rows, columns))
    for row, column, landed_row, landed_column in zip(rows, columns, *frame.index_of(x_mm, y_mm), strict=True):
        error_px = warped_px(correction, 0, frame, row, column) - [landed_row, landed_column]
        assert np.hypot(*error_px) < 1e-3 * np.hypot(row - 287.5, column - 383.5)
