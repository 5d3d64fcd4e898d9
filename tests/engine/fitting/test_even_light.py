"""The light of an even field: closed forms of discs in front of the sensor, and the pictures of baked lenses."""

from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine import LensError, load_lens
from lensfield.engine.field.radial.distortion import FieldGeometry
from lensfield.engine.field.radial.uniform_light import picture_illumination
from lensfield.engine.fitting.even_light import GREEN_NM, EvenField, picture_corner_mm
from lensfield.engine.library import prescription_of
from lensfield.engine.prescription.prescription import Prescription, Surface
from lensfield.engine.rays.rings import Rings
from refusals import refused

HEIGHTS_MM = np.array([0.0, 2.0, 5.0, 9.0])
STOP, DISC = 2, 3
TO_STOP_MM, TO_DISC_MM = 80.0, 55.0  # from the sensor


def lens_with_discs(stop_mm=2.0):
    """A weak singlet in front of a stop and of another disc: nothing bends light behind them."""
    return Prescription("discs", (
        Surface(100.0, 4.0, "1.5168/64.17"), Surface(np.inf, 100.0),
        Surface(np.inf, TO_STOP_MM - TO_DISC_MM, stop=True), Surface(np.inf, TO_DISC_MM)),
        ("stop", stop_mm), ("image_height_mm", 10.0), focus="paraxial")


def disc_light(radius_mm, distance_mm, height_mm):
    """Projected solid angle of a disc over pi: the view factor from a small parallel face to it."""
    square = height_mm**2 + distance_mm**2
    return (1 - (square - radius_mm**2) / np.sqrt((square + radius_mm**2)**2 - 4 * radius_mm**2 * height_mm**2)) / 2


@pytest.mark.parametrize("stop_mm", [1.0, 14.0])
def test_a_disc_lights_the_sensor_by_its_projected_solid_angle(stop_mm):
    field = EvenField(lens_with_discs(stop_mm), np.inf, HEIGHTS_MM)
    distance_mm = TO_STOP_MM + field.system.prescription.surfaces[-1].thickness_mm - TO_DISC_MM  # with the focus
    expected = disc_light(stop_mm, distance_mm, HEIGHTS_MM)
    assert np.allclose(field.through(field.f_number).at([], np.zeros(0)), expected / expected[0], atol=2e-4)
    narrow = disc_light(stop_mm / 3, distance_mm, HEIGHTS_MM)
    assert np.allclose(field.through(3 * field.f_number).at([], np.zeros(0)), narrow / narrow[0], atol=2e-4)


def overlap(first_mm, second_mm, apart_mm):
    """Area that two circles share."""
    if apart_mm <= abs(first_mm - second_mm):
        return np.pi * min(first_mm, second_mm)**2
    angles = [2 * np.arccos(np.clip((apart_mm**2 + own**2 - other**2) / (2 * apart_mm * own), -1, 1))
              for own, other in ((first_mm, second_mm), (second_mm, first_mm))]
    return sum(own**2 * (angle - np.sin(angle)) / 2 for own, angle in zip((first_mm, second_mm), angles, strict=True))


def test_a_rim_takes_the_part_of_the_stop_that_it_hides():
    field = EvenField(lens_with_discs(), np.inf, HEIGHTS_MM)
    light = field.through(field.f_number)
    to_disc_mm = field.system.prescription.surfaces[-1].thickness_mm
    to_stop_mm = to_disc_mm + TO_STOP_MM - TO_DISC_MM
    rim_mm = 2.6
    # the disc's shadow on the stop, from a point of the sensor
    radius_mm, apart_mm = rim_mm * to_stop_mm / to_disc_mm, HEIGHTS_MM * (to_stop_mm / to_disc_mm - 1)
    shares = np.array([overlap(2.0, radius_mm, each) for each in apart_mm]) / (np.pi * 2.0**2)
    assert 0.1 < shares.min() < 0.6 < shares.max()
    assert np.allclose(light.at([DISC], np.array([rim_mm])), shares * light.at([], np.zeros(0)), atol=4e-3)


def test_pixels_lose_light_by_its_angle():
    field = EvenField(lens_with_discs(0.1), np.inf, HEIGHTS_MM)
    light, distance_mm = field.through(field.f_number), TO_STOP_MM - TO_DISC_MM
    distance_mm += field.system.prescription.surfaces[-1].thickness_mm
    square_sine = HEIGHTS_MM**2 / (HEIGHTS_MM**2 + distance_mm**2)
    lossless = light.at([], np.zeros(0))
    assert np.allclose(light.at([], np.zeros(0), 3.0) / lossless, np.exp(-3 * square_sine), rtol=1e-4)


def test_lost_rays_carry_no_light():
    field = EvenField(prescription_of("sony-zeiss-55mm-f1.8"), np.inf, np.array([0.0, 12.0, 21.0]))
    dark = field.through(field.f_number).weight == 0
    assert not field.lost[0].any() and not dark[0].any() and field.lost[2].mean() > 0.02
    assert dark[2].mean() == pytest.approx(field.lost[2].mean(), abs=0.1) and dark[2].any()


@pytest.mark.parametrize("name, f_number", [("helios-44-2-58mm", 2.0), ("nikkor-z-50mm-f1.8", 4.0)])
def test_it_is_the_light_of_pictures(name, f_number):
    """Also wide open, where PSFs are wide: they add 0.004 to the noise of both integrals."""
    lens = load_lens(name, Rings(f_number=f_number), quality="preview", wavelengths_nm=[GREEN_NM])
    heights_mm = np.linspace(0, 0.9, 7) * np.hypot(*lens.sensor_mm) / 2
    optics = lens.at_wavelength(GREEN_NM)
    expected = picture_illumination(optics, FieldGeometry(optics, lens.name), heights_mm)
    prescription = prescription_of(name)
    sizes_mm = {number: surface.semi_aperture_mm for number, surface in enumerate(prescription.surfaces)
                if not surface.stop}
    light = EvenField(prescription, np.inf, heights_mm).through(f_number)
    assert expected[-1] < 0.8
    assert np.allclose(light.at(list(sizes_mm), np.array(list(sizes_mm.values()))), expected, atol=0.008)


def test_lenses_with_mirrors_or_without_symmetry_are_refused():
    with refused(LensError, field="surface 5", where="nikkor-reflex-500mm", match="needs a lens without mirrors"):
        EvenField(prescription_of("nikkor-reflex-500mm"), np.inf, HEIGHTS_MM)
    with refused(LensError, field="surface 1", where="atlas-42mm-1.5x"):
        EvenField(prescription_of("atlas-42mm-1.5x"), np.inf, HEIGHTS_MM)


def test_the_picture_ends_behind_the_corner_or_with_the_chief_rays():
    assert picture_corner_mm(prescription_of("helios-44-2-58mm"), np.inf) == pytest.approx(1.01 * np.hypot(18, 12))
    fisheye = prescription_of("pentax-fisheye-17mm")
    wide_mm = picture_corner_mm(replace(fisheye, sensor_mm=(60.0, 40.0)), np.inf)
    assert 19.2 < wide_mm < 28, "beyond the picture of 31.6 x 21.1 mm, and less than to the corner of this frame"
    EvenField(fisheye, np.inf, np.array([0.0, wide_mm]))
    with refused(LensError, field="height on the sensor"):
        EvenField(fisheye, np.inf, np.array([0.0, 1.1 * wide_mm]))


def test_heights_beyond_the_field_are_refused():
    with refused(LensError, field="height on the sensor", value="900 mm", match="reduce the field"):
        EvenField(prescription_of("tessar-50mm"), np.inf, np.array([0.0, 900.0]))
