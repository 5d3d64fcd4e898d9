"""Depth: the range in which defocus stays small, by hand for thin lenses, and a picture's share outside it."""

from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest

from lenses import make_lens
from lensfield.engine.depth.depth_range import (
    blur_px,
    check_depth,
    focus_range_px,
    focus_share,
    planar_depth_mm,
    sharp_range_mm,
)
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.projection import FISHEYE
from lensfield.engine.lens.entrance_pupil import entrance_pupil_diameter_mm
from lensfield.engine.runtime.errors import ImageError, InputError
from refusals import refused
from varied_lenses import varied_lens

FAR_LENS = make_lens(efl_mm=50.0, object_distance_mm=np.inf, magnification=0.0, f_number_effective=5.0)
"""The pupil is 10 mm wide; the focus is at infinity."""


def thin_lens(focal_mm, diameter_mm, object_mm, pupil_offset_mm=0.0):
    """A thin lens whose rim is the pupil, `pupil_offset_mm` behind the point from which distances are measured."""
    image_mm = 1 / (1 / focal_mm - 1 / object_mm)
    sine = np.sin(np.arctan(diameter_mm / 2 / object_mm)) * object_mm / image_mm  # the sine condition
    return make_lens(efl_mm=focal_mm, magnification=-image_mm / object_mm, f_number_effective=0.5 / sine,
                     object_distance_mm=object_mm - pupil_offset_mm, entrance_pupil_mm=pupil_offset_mm)


def thin_lens_blur_mm(focal_mm, diameter_mm, object_mm, depth_mm):
    """Width of the cone behind the lens at the sensor, by similar triangles in image space."""
    sensor_mm = 1 / (1 / focal_mm - 1 / object_mm)
    image_mm = np.inf if depth_mm == focal_mm else 1 / (1 / focal_mm - 1 / depth_mm)
    return diameter_mm * abs(sensor_mm - image_mm) / abs(image_mm)


@pytest.mark.parametrize("focal_mm, diameter_mm, object_mm, offset_mm", [(50, 10, 1000, 0), (50, 25, 200, 0),
                                                                         (6, 3.2, 254, 4), (100, 20, 5000, -30)])
def test_the_pupil_of_a_thin_lens_is_its_rim(focal_mm, diameter_mm, object_mm, offset_mm):
    lens = thin_lens(focal_mm, diameter_mm, object_mm, offset_mm)
    assert entrance_pupil_diameter_mm(lens) == pytest.approx(diameter_mm, rel=1e-12)


def test_the_pupil_of_a_lens_in_focus_at_infinity_is_its_focal_length_over_its_f_number():
    assert entrance_pupil_diameter_mm(FAR_LENS) == pytest.approx(10.0)


@pytest.mark.sample(2)
@pytest.mark.parametrize("name, paraxial_mm", [
    ("edmund-54852", 3.381), ("muller-fisheye-25mm", 6.313), ("cooke-triplet-50mm", 10.004), ("nikkor-28mm", 9.900),
    ("apple-phone-4mm", 2.280), ("angenieux-50mm", 45.427)])
def test_the_pupils_of_real_lenses_are_near_their_paraxial_pupils(name, paraxial_mm):
    """Optiland's entrance pupil diameters of the prescriptions; the f-numbers in the lens data are from real rays."""
    assert entrance_pupil_diameter_mm(varied_lens(name)) == pytest.approx(paraxial_mm, rel=0.05)


@pytest.mark.parametrize("focal_mm, diameter_mm, object_mm, offset_mm", [(50, 10, 1000, 0), (50, 25, 200, 0),
                                                                         (6, 3.2, 254, 4), (100, 20, 5000, -30)])
@pytest.mark.parametrize("blur_um", [2.0, 10.0, 30.0])
def test_the_blur_at_both_ends_of_the_range_is_the_allowed_blur(focal_mm, diameter_mm, object_mm, offset_mm, blur_um):
    lens = thin_lens(focal_mm, diameter_mm, object_mm, offset_mm)
    near_mm, far_mm = sharp_range_mm(lens, blur_um)
    assert near_mm < object_mm < far_mm < np.inf
    for depth_mm in (near_mm, far_mm):
        assert 1e3 * thin_lens_blur_mm(focal_mm, diameter_mm, object_mm, depth_mm) == pytest.approx(blur_um, rel=1e-9)


def test_at_the_hyperfocal_distance_the_range_starts_at_half_of_it():
    # 50 mm f/5 and 30 um: H = f^2 / (N c) + f = 16717 mm. Everything beyond is sharp; the near limit is about half of
    # it.
    hyperfocal_mm = 50**2 / (5 * 0.03) + 50
    near_mm, far_mm = sharp_range_mm(thin_lens(50, 10, hyperfocal_mm), 30.0)
    assert near_mm == pytest.approx(hyperfocal_mm / 2, rel=1e-6)
    assert far_mm > 1e6 * hyperfocal_mm
    assert sharp_range_mm(thin_lens(50, 10, hyperfocal_mm), 30.1)[1] == np.inf


def test_at_infinity_focus_the_near_limit_is_focal_length_times_pupil_over_blur():
    assert sharp_range_mm(FAR_LENS, 20.0) == (pytest.approx(50 * 10 / 0.02), np.inf)


def test_infinity_focus_is_the_limit_of_distant_focus():
    near_mm = sharp_range_mm(thin_lens(50, 10, 1e9), 20.0)[0]
    assert near_mm == pytest.approx(sharp_range_mm(FAR_LENS, 20.0)[0], rel=1e-4)


def test_the_range_scales_with_lens_and_blur():
    lens = thin_lens(6, 3.2, 254, 4)
    np.testing.assert_allclose(sharp_range_mm(lens.scaled(5), 50.0), 5 * np.array(sharp_range_mm(lens, 10.0)))


@pytest.mark.parametrize("blur_um", [0.0, -1.0, np.nan, np.inf])
def test_an_invalid_blur_is_refused(blur_um):
    with refused(InputError, field="blur"):
        sharp_range_mm(FAR_LENS, blur_um)


def test_depths_outside_the_range_are_counted():
    lens = thin_lens(50, 10, 1000)  # image at 1000/19 mm, m = 1/19: 20 um of blur from 963.4 to 1039.5 mm
    depth_mm = np.array([[900, 963, 964, 1000], [1039, 1040, 5000, 1e13]])
    check = check_depth(depth_mm, lens, 20.0)
    assert (check.near_mm, check.far_mm) == (pytest.approx(963.39, abs=0.01), pytest.approx(1039.50, abs=0.01))
    assert check.outside_fraction == 5 / 8
    assert (check.nearest_mm, check.farthest_mm) == (900, np.inf) and check.blur_um == 20
    with pytest.raises(FrozenInstanceError):
        check.outside_fraction = 0.0


def test_light_outside_the_range_is_counted_without_fireflies():
    lens, depth_mm = thin_lens(50, 10, 1000), np.array([[900.0, 1000.0, 1000.0, np.nan, 5000.0]])
    check = check_depth(depth_mm, lens, 20.0, light=np.array([[2.0, 5.0, np.inf, 9.0, 1.0]]))
    assert check.outside_light == 3 / 8
    assert "; out of focus: 50.0% of the frame and 37.5% of its light; " in check.text


def test_an_empty_background_is_not_out_of_focus():
    lens, depth_mm = thin_lens(50, 10, 1000), np.array([[900.0, 1000.0, np.inf, np.nan, np.inf]])
    check = check_depth(depth_mm, lens, 20.0, empty=np.isinf(depth_mm))
    assert check.outside_fraction == 0.25 and check.farthest_mm == 1000
    assert check_depth([np.inf], lens, 20.0, empty=[True]).outside_fraction == 0


def test_the_allowed_blur_can_be_increased():
    lens, depth_mm = thin_lens(50, 10, 1000), np.full((2, 2), 950.0)
    assert check_depth(depth_mm, lens, 20.0).outside_fraction == 1
    assert check_depth(depth_mm, lens, 20.0, blur_um=40.0).outside_fraction == 0


def test_the_background_is_in_focus_only_for_a_lens_focused_at_infinity():
    background = np.full((3, 3), 1e13, dtype=np.float32)
    assert check_depth(background, FAR_LENS, 20.0).outside_fraction == 0
    assert check_depth(background, thin_lens(50, 10, 1000), 20.0).outside_fraction == 1


def test_the_text_states_fraction_and_distances_in_one_line():
    text = check_depth([[900.0, 1000.0, 1000.0, 1e13]], thin_lens(50, 10, 1000), 20.0).text
    assert text == ("In focus: 0.963 m to 1.04 m, within 20 um; out of focus: 50.0% of the frame; the scene spans "
                    "0.9 m to infinity")


def test_pixels_without_a_depth_do_not_count():
    check = check_depth([[np.nan, 1000.0, 500.0]], thin_lens(50, 10, 1000), 20.0)
    assert check.outside_fraction == 0.5 and check.nearest_mm == 500
    with refused(ImageError, field="pixels", value="empty", where="depth"):
        check_depth([[np.nan]], FAR_LENS, 20.0)


def test_perspective_depth_is_already_planar():
    depth_mm = np.array([[1.0, 2.0], [1e13, 3.0]])
    np.testing.assert_array_equal(planar_depth_mm(depth_mm, FAR_LENS, PixelGrid((2, 2), 20.0)), [[1, 2], [np.inf, 3]])


def test_panoramic_distance_exceeds_planar_depth_off_the_axis():
    # 50 mm times pi/6 is 30 degrees: a tenth of that per pixel.
    pitch_um = 1e3 * 50 * np.pi / 6 / 10
    distance_mm = np.full((1, 81), 100.0)
    distance_mm[0, 60] = 1e13
    depth_mm = planar_depth_mm(distance_mm, FAR_LENS, PixelGrid((1, 81), pitch_um, projection=FISHEYE))[0]
    assert depth_mm[[40, 50, 30]] == pytest.approx(100 * np.array([1, np.sqrt(0.75), np.sqrt(0.75)]))
    assert depth_mm[20] == pytest.approx(50) and depth_mm[60] == np.inf
    assert np.isnan(depth_mm[[0, 9, 71, 80]]).all() and not np.isnan(depth_mm[11:70]).any()


def test_the_angle_is_measured_from_the_axis():
    lens = replace(FAR_LENS, efl_mm=1.0)
    depth_mm = planar_depth_mm(np.ones((5, 5)), lens, PixelGrid((5, 5), 1e3 * np.pi / 3, (4, 1), projection=FISHEYE))
    assert depth_mm[4, 1] == 1 and depth_mm[3, 1] == pytest.approx(0.5) and depth_mm[4, 0] == pytest.approx(0.5)
    assert np.isnan(depth_mm[2, 2])


def test_blur_is_signed_and_zero_in_focus():
    paper_lens = varied_lens("edmund-54852")
    away_mm = paper_lens.object_distance_mm + paper_lens.entrance_pupil_mm
    near, in_focus, far = blur_px(paper_lens, 5.0, [away_mm / 2, away_mm, np.inf])
    assert near > 0 > far and in_focus == pytest.approx(0, abs=1e-9)
    assert near == pytest.approx(-far)
    near_mm, far_mm = sharp_range_mm(paper_lens, 5.0)
    assert blur_px(paper_lens, 5.0, near_mm) == pytest.approx(1)
    assert far_mm == np.inf or blur_px(paper_lens, 5.0, far_mm) == pytest.approx(-1)


def test_rays_replace_diffraction_from_a_wave_of_defocus_on():
    """At the f-number N, a wavelength of defocus is a disc 8 N wavelengths wide."""
    lens, pitch_um = make_lens(), 0.1
    wave_px = 8 * lens.rim_f_number * 1e-3 * lens.reference_wavelength_nm / pitch_um
    assert focus_range_px(lens, pitch_um) == pytest.approx((wave_px / 4, wave_px))


@pytest.mark.parametrize("pitch_um", [0.5, 5.0, 50.0])
def test_the_focus_share_fades_smoothly(pitch_um):
    paper_lens = varied_lens("edmund-54852")
    sharp, blurred = focus_range_px(paper_lens, pitch_um)
    assert 0 < sharp < blurred
    shares = focus_share(np.linspace(-1.1 * blurred, 1.1 * blurred, 1001), (sharp, blurred))
    assert np.allclose(shares, shares[::-1], atol=1e-12) and shares[0] == 0 and shares[500] == 1
    assert np.all(np.diff(shares[500:]) <= 0) and np.abs(np.diff(shares)).max() < 0.01
    assert focus_share(sharp, (sharp, blurred)) == 1 and focus_share(-blurred, (sharp, blurred)) == 0
