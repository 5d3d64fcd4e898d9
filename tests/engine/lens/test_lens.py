"""Lens: its checks, its interpolation in wavelength, and the figures of the paper's lens."""

from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from lenses import comatic_lens, make_grid_lens, make_lens, marked_psf
from lensfield.engine import LensError, Options, SpectralImage, load_lens, simulate
from lensfield.engine.image.projection import FISHEYE, PLANE, Projection
from lensfield.engine.lens.entrance_pupil import focus_nearness
from lensfield.engine.lens.pinhole import fitting_pitch_um
from refusals import refused

REFERENCE_NM = 587.6


@pytest.fixture(scope="module")
def edmund():
    return load_lens("edmund-54852")


def test_a_lens_cannot_be_changed():
    lens = make_lens()
    with pytest.raises(FrozenInstanceError):
        lens.efl_mm = 1.0
    with pytest.raises(ValueError):
        lens.psf[0, 0, 0, 0] = 1.0


def test_a_lens_copies_the_arrays_given_to_it():
    heights = np.linspace(0, 2, 11)
    lens = make_lens(heights_mm=heights)
    heights[5] = 99
    assert lens.heights_mm[5] == pytest.approx(1.0)


@pytest.mark.parametrize("field, value", [
    ("efl_mm", 0.0), ("efl_mm", np.nan), ("efl_mm", np.inf), ("f_number_effective", -2.0), ("magnification", np.nan),
    ("object_distance_mm", -1.0), ("entrance_pupil_mm", np.inf), ("reference_wavelength_nm", 0.0),
    ("psf_pitch_um", 0.0), ("sensor_mm", (4.8, 0.0)), ("sensor_mm", (1.0, 2.0, 3.0)),
    ("wavelengths_nm", (700.0, 400.0)), ("heights_mm", np.linspace(2, 0, 11)), ("heights_mm", np.linspace(1, 2, 11)),
    ("heights_mm", np.zeros((2, 3))), ("real_height_mm", np.zeros((2, 10))),
    ("real_height_mm", np.full((2, 11), np.nan)), ("relative_illumination", np.full((2, 11), -1.0)),
    ("transmittance", (1.0, 1.5)), ("transmittance", (-0.1, 1.0)), ("transmittance", (1.0, 1.0, 1.0)),
    ("enclosed_energy", np.ones((1, 11))), ("psf", np.ones((2, 11, 1, 2)) / 2), ("psf", np.ones((2, 11, 2, 2))),
    ("psf", np.full((2, 11, 1, 1), np.nan)), ("psf", np.tile([[-1.0, 1.0], [0.5, 0.5]], (2, 11, 1, 1))),
])
def test_a_wrong_field_is_named(field, value):
    with refused(LensError, field=field, where="hand-made"):
        replace(make_lens(), **{field: value})


@pytest.mark.parametrize("nm, weight", [(400, 0.0), (475, 0.25), (550, 0.5), (700, 1.0)])
def test_psfs_are_linear_in_wavelength(nm, weight):
    table = np.stack([np.tile(marked_psf(0, 0), (11, 1, 1)), np.tile(marked_psf(5, 2), (11, 1, 1))])
    psf = make_lens(table).at_wavelength(nm).psf[3]
    np.testing.assert_allclose(psf, (1 - weight) * marked_psf(0, 0) + weight * marked_psf(5, 2), atol=1e-7)


def test_psfs_between_wavelengths_depend_on_the_nearest_two_only():
    table = np.stack([np.tile(marked_psf(v, 0), (11, 1, 1)) for v in (0, 3, 6)])
    psf = make_lens(table, wavelengths_nm=(400.0, 500.0, 700.0)).at_wavelength(550).psf[0]
    np.testing.assert_allclose(psf, 0.75 * marked_psf(3, 0) + 0.25 * marked_psf(6, 0), atol=1e-7)


@pytest.mark.parametrize("wavelengths_nm, power", [((400, 700), 1), ((400, 500, 700), 2), ((400, 480, 600, 700), 3),
                                                   ((400, 450, 500, 550, 600, 650, 700), 3)])
def test_heights_and_illumination_follow_a_polynomial_in_wavelength_exactly(wavelengths_nm, power):
    lens = make_lens(real_height_mm=lambda nm, p: p * (1 + 0.01 * (nm / 500 - 1)**power),
                     relative_illumination=lambda nm, p: 1 - 0.05 * p**2 * (nm / 500)**power,
                     wavelengths_nm=wavelengths_nm)
    optics = lens.at_wavelength(531.0)
    np.testing.assert_allclose(optics.real_height_mm, lens.heights_mm * (1 + 0.01 * 0.062**power), rtol=1e-12)
    np.testing.assert_allclose(optics.relative_illumination, 1 - 0.05 * lens.heights_mm**2 * 1.062**power, atol=1e-12)


def test_transmittance_is_linear_between_two_wavelengths():
    assert make_lens(transmittance=(0.5, 0.9)).at_wavelength(475).transmittance == pytest.approx(0.6)


def test_transmittance_stays_within_0_and_1_near_the_edge_of_a_filter():
    lens = make_lens(wavelengths_nm=(400., 420., 440., 460., 480., 500.), transmittance=(0., 0., 0., 1., 1., 1.))
    values = [lens.at_wavelength(nm).transmittance for nm in np.arange(400, 501)]
    assert min(values) >= 0 and max(values) <= 1


@pytest.mark.parametrize("nm", [399.9, 700.1, 0.0, -5.0, np.nan, np.inf])
def test_a_wavelength_outside_the_lens_data_is_an_error(nm):
    with refused(LensError, field="wavelength", where="hand-made", match="400 to 700 nm"):
        make_lens().at_wavelength(nm)


def test_a_lens_of_one_wavelength_serves_that_wavelength_only():
    lens = make_lens(wavelengths_nm=(587.6,), transmittance=0.5)
    assert lens.at_wavelength(587.6).transmittance == 0.5
    with pytest.raises(LensError):
        lens.at_wavelength(588.0)


def test_capture_focal_length_of_a_thin_lens_is_its_image_distance():
    # f = 10 mm, object at 100 mm: image at 100/9 mm, m = -1/9; the rim is the pupil, at the first surface.
    lens = make_lens(magnification=-1 / 9, object_distance_mm=100.0, entrance_pupil_mm=0.0)
    assert lens.capture_focal_length_mm == pytest.approx(100 / 9, rel=1e-14)


def test_capture_focal_length_at_infinity_is_the_focal_length():
    assert make_lens(object_distance_mm=np.inf, magnification=0.0).capture_focal_length_mm == 10.0


def test_edmund_first_order_figures(edmund):
    assert edmund.efl_mm == pytest.approx(5.99997, abs=1e-4)
    assert edmund.magnification == pytest.approx(-0.023954, abs=1e-6)
    assert edmund.entrance_pupil_mm == pytest.approx(4.05795, abs=1e-4)
    assert edmund.object_distance_mm == 250.0
    assert 0.5 / edmund.f_number_effective == pytest.approx(0.2657, abs=5e-4)


def test_edmund_reaches_3_mm_at_its_half_field(edmund):
    half_field_deg = np.degrees(np.arctan(3.0 / edmund.capture_focal_length_mm))
    assert half_field_deg == pytest.approx(26.2, abs=0.1)


def test_edmund_distortion_at_3_mm(edmund):
    optics = edmund.at_wavelength(REFERENCE_NM)
    real_mm = make_interp_spline(optics.heights_mm, optics.real_height_mm)(3.0)
    assert 100 * (real_mm / 3.0 - 1) == pytest.approx(-8.4, abs=0.1)


def test_edmund_relative_illumination(edmund):
    optics = edmund.at_wavelength(REFERENCE_NM)
    at = np.interp([0, 0.75, 1.5, 2.25, 3.0], optics.heights_mm, optics.relative_illumination)
    np.testing.assert_allclose(at, [1, 0.996, 0.988, 0.990, 1.037], atol=2e-3)


def test_edmund_lateral_colour_from_f_to_c(edmund):
    f_line, c_line = (make_interp_spline(edmund.heights_mm, edmund.at_wavelength(nm).real_height_mm)(
        np.linspace(0, 3, 61)) for nm in (486.1, 656.3))
    assert 1000 * np.abs(f_line - c_line).max() == pytest.approx(13.8, abs=0.3)


def test_a_scaled_lens_is_the_same_lens_in_larger_units():
    lens = make_lens(entrance_pupil_mm=5.0, real_height_mm=lambda nm, p: 0.9 * p, psf_pitch_um=2.5)
    large = lens.scaled(3.0)
    assert (large.efl_mm, large.object_distance_mm, large.entrance_pupil_mm) == (30.0, 300.0, 15.0)
    assert large.sensor_mm == pytest.approx((14.4, 10.8)) and large.psf_pitch_um == 7.5
    np.testing.assert_allclose(large.heights_mm, np.linspace(0, 6, 11))
    np.testing.assert_allclose(large.real_height_mm, 0.9 * np.tile(np.linspace(0, 6, 11), (2, 1)))
    assert large.f_number_effective == lens.f_number_effective and large.magnification == lens.magnification
    assert large.capture_focal_length_mm == pytest.approx(3 * lens.capture_focal_length_mm)
    assert lens.name in large.name and large.name != lens.name


def test_the_plane_of_focus_of_a_scaled_lens_leans_by_the_same_angle():
    lens = make_grid_lens(focus_slope=(1e-3, -2e-3), squeeze=1.5)
    x_mm, y_mm = np.array([0.0, 0.7, -1.1]), np.array([0.0, 1.2, 0.4])
    np.testing.assert_allclose(3 * focus_nearness(lens.scaled(3.0), 3 * x_mm, 3 * y_mm),
                               focus_nearness(lens, x_mm, y_mm))


def test_a_lens_in_focus_at_infinity_stays_so_when_scaled():
    assert make_lens(object_distance_mm=np.inf, magnification=0.0).scaled(0.1).object_distance_mm == np.inf


@pytest.mark.parametrize("factor", [0.0, -2.0, np.inf, np.nan])
def test_a_lens_is_scaled_by_a_positive_number(factor):
    with refused(LensError, field="scale", where="hand-made"):
        make_lens().scaled(factor)


@pytest.mark.parametrize("factor", [0.25, 5.751])
@pytest.mark.parametrize("method", [Options(section_size=16), Options(method="pixels", azimuths=8)])
@pytest.mark.parametrize("projection", [PLANE, FISHEYE, Projection((0.9, 0.1, -0.15))])
def test_a_scaled_lens_gives_the_same_picture_on_an_equally_scaled_pitch(factor, method, projection):
    lens = comatic_lens(object_distance_mm=np.inf, magnification=0.0, efl_mm=3.0)
    cube = np.random.default_rng(5).random((1, 60, 70))
    pictures = [simulate(SpectralImage(cube, [550.0], pitch_um=20.0 * scale, overscan_px=(8, 8), projection=projection),
                         lens.scaled(scale), method).cube for scale in (1.0, factor)]
    np.testing.assert_allclose(pictures[1], pictures[0], rtol=1e-5, atol=1e-6 * pictures[0].max())
    assert np.ptp(pictures[0]) > 0.1 * pictures[0].max()


def test_a_scaled_lens_puts_as_much_light_on_every_square_metre():
    lens = make_lens(f_number_effective=2.0).scaled(7.0)
    image = SpectralImage(np.ones((1, 40, 40)), [550.0], pitch_um=70.0, overscan_px=(4, 4))
    in_single_precision = 16 * np.finfo(np.float32).eps  # each pixel is a sum of shares and one or two products
    np.testing.assert_allclose(simulate(image, lens).cube, np.pi / 16, rtol=in_single_precision)


@pytest.mark.parametrize(("frame_px", "squeeze", "pitch_um"), [
    ((180, 240), 1, 20.0), ((240, 180), 1, 20.0), ((160, 240), 1, 20.0), ((180, 240), 2, 20.0), ((240, 180), 2, 15.0)])
def test_the_sensor_turns_with_a_portrait_frame_unless_the_lens_squeezes(frame_px, squeeze, pitch_um):
    lens = make_lens() if squeeze == 1 else make_grid_lens(squeeze=squeeze, sensor_mm=(4.8, 3.6))
    assert fitting_pitch_um(lens, frame_px) == pytest.approx(pitch_um)
