"""Curves of lenses against closed forms."""

import numpy as np
import pytest
from scipy.special import j1, jn_zeros

from lenses import SENSOR_POINT, gaussian_psf, make_lens, marked_psf
from lensfield.engine import LensError
from lensfield.engine.inspection.curves import (
    airy_radius_um,
    cosine_fourth,
    diffraction_cutoff_per_mm,
    distortion_grid,
    distortion_percent,
    field_angle_rad,
    field_of,
    lateral_colour_um,
    preferred_frequencies_per_mm,
    relative_illumination,
    transfer,
    white_mtf,
)
from lensfield.engine.spectral.spectra import colour_matching
from refusals import refused


def airy_psf(wavelength_um, f_number, pitch_um, window):
    offset_um = (np.arange(window) - window // 2) * pitch_um
    argument = np.pi * np.hypot(offset_um[:, None], offset_um) / (wavelength_um * f_number)
    amplitude = np.divide(2 * j1(argument), argument, out=np.ones_like(argument), where=argument > 0)
    return amplitude**2 / (amplitude**2).sum()


def barrel(nm, paraxial_mm):
    return paraxial_mm * (1 - 0.02 * paraxial_mm**2)


def test_relative_illumination_includes_the_light_that_psfs_move():
    """Light that moves outwards by a twentieth of its height comes from closer to the axis."""
    table = np.stack([[marked_psf(step, 0) for step in range(11)]])  # 10 um per 0.2 mm
    lens = make_lens(table, None, lambda nm, p: 1 + 0.05 * p**2, wavelengths_nm=(550.0,), psf_pitch_um=10.0,
                     transmittance=0.5)
    curve = relative_illumination(lens, [550.0])[0]
    expected = 1 + 0.05 * (lens.heights_mm / 1.05)**2
    np.testing.assert_allclose(curve[2:-1] / curve[5], expected[2:-1] / expected[5], rtol=0.01)
    assert curve[5] < 0.97 * expected[5]  # on the axis, little moves


@pytest.mark.parametrize("window", [81, 80])
def test_mtf_of_a_gaussian_is_a_gaussian(window):
    frequencies = [5.0, 20.0, 50.0]
    tangential, sagittal = transfer(gaussian_psf(4, 6, 1.0, window), 1.0, frequencies)
    for result, sigma_mm in ((tangential, 4e-3), (sagittal, 6e-3)):
        expected = np.exp(-2 * (np.pi * sigma_mm * np.array(frequencies))**2)
        np.testing.assert_allclose(np.abs(result), expected, atol=1e-5)


def test_mtf_of_an_airy_pattern_is_that_of_a_circular_aperture():
    wavelength_um, f_number = 0.55, 4.0
    share = np.linspace(0.1, 1.1, 6)  # of the cutoff, 1 / (wavelength times f-number), and beyond it
    psf = airy_psf(wavelength_um, f_number, 0.5, 401)
    inside = np.minimum(share, 1)
    expected = 2 / np.pi * (np.arccos(inside) - inside * np.sqrt(1 - inside**2))
    for result in transfer(psf, 0.5, 1e3 * share / (wavelength_um * f_number)):
        np.testing.assert_allclose(np.abs(result), expected, atol=0.008)  # the share of the light outside the window


def test_a_point_off_the_chief_ray_has_full_mtf_and_its_phase():
    tangential, sagittal = transfer(marked_psf(3, -1), 2.5, [10.0])
    assert tangential == pytest.approx(np.exp(-2j * np.pi * 10 * 7.5e-3))
    assert sagittal == pytest.approx(np.exp(2j * np.pi * 10 * 2.5e-3))


def test_tables_of_psfs_keep_their_axes():
    table = np.stack([[gaussian_psf(1 + w, 1 + h, 1.0, 31) for h in range(2)] for w in range(3)])
    tangential, sagittal = transfer(table, 1.0, [20.0, 40.0])
    assert tangential.shape == sagittal.shape == (3, 2, 2)
    assert np.ptp(np.abs(tangential), axis=1).max() < 1e-6 < np.ptp(np.abs(tangential), axis=0).min()
    assert np.ptp(np.abs(sagittal), axis=0).max() < 1e-6 < np.ptp(np.abs(sagittal), axis=1).min()


def test_white_mtf_of_a_lens_without_colour_errors_is_that_of_its_psf():
    lens = make_lens(gaussian_psf(4, 6, 1.0, 61), psf_pitch_um=1.0)
    tangential, sagittal = white_mtf(lens, [10.0, 30.0])
    expected = [np.abs(part) for part in transfer(lens.psf[0, 0], 1.0, [10.0, 30.0])]
    np.testing.assert_allclose(tangential, np.broadcast_to(expected[0], (11, 2)), atol=1e-6)
    np.testing.assert_allclose(sagittal, np.broadcast_to(expected[1], (11, 2)), atol=1e-6)


def test_lateral_colour_lowers_tangential_mtf_as_the_eye_sees_it():
    lens = make_lens(real_height_mm=lambda nm, p: p * (1 + 5e-5 * (nm - 550)))
    tangential, sagittal = white_mtf(lens, [40.0])
    nm = np.arange(380.0, 781)
    weights = colour_matching(nm)[:, 1]
    moved_mm = 2 * 5e-5 * (np.clip(nm, 400, 700) - 550)  # at the last height, 2 mm
    expected = np.abs((weights * np.exp(2j * np.pi * 40 * moved_mm)).sum()) / weights.sum()
    assert expected < 0.6
    assert tangential[-1, 0] == pytest.approx(expected, abs=1e-9) and tangential[0, 0] == pytest.approx(1)
    np.testing.assert_allclose(sagittal, 1, atol=1e-9)


def test_white_mtf_of_an_infrared_lens():
    tangential, _ = white_mtf(make_lens(gaussian_psf(4, 4, 1.0, 61), psf_pitch_um=1.0, wavelengths_nm=(900.0,)), [30.0])
    np.testing.assert_allclose(tangential, np.exp(-2 * (np.pi * 0.004 * 30)**2), atol=1e-4)


@pytest.mark.parametrize("frequency", [0.0, -1.0, 201.0, np.nan, np.inf])
def test_frequencies_that_the_samples_cannot_resolve_are_refused(frequency):
    with pytest.raises(LensError, match="frequency is .* cycles/mm: expected more than 0 and at most 200"):
        white_mtf(make_lens(psf_pitch_um=2.5), [10.0, frequency])


@pytest.mark.parametrize("changes, expected", [
    ({"psf_pitch_um": 0.5}, [20, 50, 100]),  # f/2: a cutoff of 909 / mm
    ({"psf_pitch_um": 0.5, "f_number_effective": 16.0}, [2, 5, 10]),
    ({"psf_pitch_um": 25.0}, [2, 5, 10])])  # 20 / mm is the limit of its samples
def test_frequencies_follow_the_lens(changes, expected):
    lens = make_lens(**changes)
    assert preferred_frequencies_per_mm(lens) == expected
    white_mtf(lens, expected)


def test_diffraction_cutoff():
    assert diffraction_cutoff_per_mm(make_lens(f_number_effective=4.0)) == pytest.approx(1 / (550e-6 * 4))


def test_airy_radius_is_the_first_zero_of_the_bessel_function():
    first_zero = jn_zeros(1, 1)[0] / np.pi  # 1.2197
    assert airy_radius_um(make_lens(f_number_effective=4.0), 500.0) == pytest.approx(first_zero * 0.5 * 4, rel=1e-3)


@pytest.mark.parametrize("changes, height_mm", [
    ({"object_distance_mm": np.inf, "efl_mm": 10.0}, 10.0),
    ({"object_distance_mm": 100.0, "entrance_pupil_mm": 5.0, "magnification": -0.1}, 10.5)])
def test_light_falls_off_with_the_fourth_power_of_the_cosine_on_the_object_side(changes, height_mm):
    lens = make_lens(**changes)
    assert np.degrees(field_angle_rad(lens, height_mm)) == pytest.approx(45)
    assert cosine_fourth(lens, np.array([0, height_mm])) == pytest.approx([1, 0.25])
    assert cosine_fourth(lens, np.tan(np.radians(70)) * height_mm) == pytest.approx(np.cos(np.radians(70))**4)


def test_lateral_colour_is_relative_to_the_reference():
    lens = make_lens(real_height_mm=lambda nm, p: p * (1 + 1e-5 * (nm - 400)), wavelengths_nm=(400.0, 500.0, 600.0))
    np.testing.assert_allclose(lateral_colour_um(lens, [400, 550, 600, 700])[:, -1], [-3, 0, 1, 1], atol=1e-9)


def test_lateral_colour_of_one_wavelength_is_zero():
    assert not lateral_colour_um(make_lens(wavelengths_nm=(500.0,)), [450, 500, 550]).any()


def test_a_barrel_grid_is_where_its_polynomial_puts_it():
    lens = make_lens(real_height_mm=barrel, heights_mm=np.linspace(0, 3.2, 17))
    ideal_mm, real_mm = distortion_grid(lens, field_of(lens))
    squared = (ideal_mm**2).sum(axis=-1, keepdims=True)
    known = squared <= 3.2**2
    np.testing.assert_allclose(real_mm, np.where(known, ideal_mm * (1 - 0.02 * squared), np.nan), atol=1e-6)


def test_the_ideal_grid_is_square_and_has_the_sensors_edges():
    lens = make_lens(heights_mm=np.linspace(0, 3.2, 17))
    ideal_mm, _ = distortion_grid(lens, field_of(lens))
    upright = [line[0, 0] for line in ideal_mm if np.ptp(line[:, 0]) == 0]
    level = [line[0, 1] for line in ideal_mm if np.ptp(line[:, 1]) == 0]
    np.testing.assert_allclose(np.diff(upright), 0.6)
    np.testing.assert_allclose(np.diff(level), 0.6)
    assert np.abs(upright).max() == pytest.approx(3.0) and np.isclose(upright, 2.4).any()  # the corner is at 3 mm
    assert np.isclose(level, -1.8).any()


def test_the_grid_of_a_fisheye_fills_its_sensor():
    """Equidistant over 72 degrees, with the sensor's corner at 1.2 rad: 2.6 focal lengths are compressed to 1.2."""
    lens = make_lens(real_height_mm=lambda nm, p: 2 * np.arctan(p / 2), sensor_mm=(3.84, 2.88),
                     heights_mm=2 * np.tan(np.radians(np.linspace(0, 72, 40))))
    field = field_of(lens)
    assert field.reaches_corner and field.edge_mm == pytest.approx(2 * np.tan(1.2), rel=2e-3)
    assert distortion_percent(field, field.edge_mm) == pytest.approx(100 * (1.2 / np.tan(1.2) - 1), abs=0.2)
    ideal_mm, real_mm = distortion_grid(lens, field)
    across, up = (np.nanmax(np.abs(real_mm[..., axis])) for axis in (0, 1))
    assert across > 1.92 and up > 1.44
    angle = np.arctan(np.hypot(*np.moveaxis(ideal_mm, -1, 0)) / 2)
    known = np.isfinite(real_mm[..., 0])
    np.testing.assert_allclose(np.hypot(*np.moveaxis(real_mm, -1, 0))[known], 2 * angle[known], atol=0.01)


def test_the_field_may_end_before_the_sensors_corner():
    field = field_of(make_lens(real_height_mm=barrel))
    assert not field.reaches_corner and field.edge_mm == 2.0
    assert distortion_percent(field, 2.0) == pytest.approx(-8.0, abs=1e-6)


def test_a_lens_that_folds_the_picture_is_named():
    with refused(LensError, field="real_height_mm", where="hand-made"):
        field_of(make_lens(real_height_mm=lambda nm, p: p * (1 - 0.2 * p**2)))


def test_an_ideal_point_has_full_mtf():
    tangential, sagittal = white_mtf(make_lens(SENSOR_POINT), [10.0, 100.0])
    np.testing.assert_allclose(tangential, 1)
    np.testing.assert_allclose(sagittal, 1)
