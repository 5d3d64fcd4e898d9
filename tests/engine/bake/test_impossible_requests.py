"""Physically impossible requests are refused with the real reason, before any ray is traced."""

from dataclasses import replace

import pytest

from lens_texts import SURFACES
from lensfield.engine import LensError
from lensfield.engine.prescription.prescription import Prescription
from lensfield.engine.rays.focus import build_system

SINGLET = Prescription("singlet", SURFACES, ("entrance_pupil_diameter_mm", 5.0), ("angle_deg", 14.0))
FOCUSED = replace(SINGLET, focus="best")


def refusal(lens):
    with pytest.raises(LensError) as error:
        build_system(lens)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_an_f_number_below_that_of_a_half_space():
    with pytest.raises(LensError, match="singlet: aperture, f_number is 0.3: no lens in air is below 0.5"):
        replace(SINGLET, aperture=("f_number", 0.3))


@pytest.mark.parametrize("kind, least, tried", [("f_number", 3.07, 1.4), ("entrance_pupil_diameter_mm", 16.0, 40.0)])
def test_an_aperture_that_the_surfaces_block(kind, least, tried):
    """The front of the 49 mm singlet is 16 mm wide, directly behind the stop."""
    message = refusal(replace(FOCUSED, aperture=(kind, tried)))
    assert f"aperture, {kind} is {tried}: the clear apertures of the surfaces pass {least:.3g} at most" in message
    build_system(replace(FOCUSED, aperture=(kind, least)))


def test_an_object_within_the_focal_length():
    """Its front focal point is 49.0 mm in front of its front principal plane, which is slightly behind the stop."""
    message = refusal(replace(FOCUSED, object_distance_mm=20.0))
    assert ("singlet: object_distance_mm is 20.0: the lens forms no real image of this object: expected more than 45."
            ) in message
    build_system(replace(FOCUSED, object_distance_mm=60.0, field=("image_height_mm", 5.0)))


def test_an_object_far_out_of_focus():
    message = refusal(replace(SINGLET, object_distance_mm=60.0, field=("image_height_mm", 5.0)))
    assert "singlet: object_distance_mm is 60.0: the image is " in message and " mm behind the image plane" in message
    build_system(replace(SINGLET, object_distance_mm=2000.0))


def test_an_image_plane_far_out_of_focus():
    surfaces = (*SURFACES[:2], replace(SURFACES[2], thickness_mm=400.0))
    message = refusal(replace(SINGLET, surfaces=surfaces))
    assert "singlet: focus is as given: the image is 352 mm in front of the image plane" in message
