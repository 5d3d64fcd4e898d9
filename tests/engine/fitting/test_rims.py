"""Rims that may be fitted: groups of components, where glass ends, and the sizes of rims that block nothing."""

import numpy as np
import pytest

from lensfield.engine.fitting.even_light import EvenField
from lensfield.engine.fitting.rims import (
    CLEARANCE,
    GROUPS,
    glass_ends_mm,
    passing_chief_rays,
    rim_ends_mm,
    rim_ranges,
    with_rims,
)
from lensfield.engine.library import prescription_of
from lensfield.engine.prescription.prescription import Prescription, Surface

HELIOS = prescription_of("helios-44-2-58mm")
FIELD = EvenField(HELIOS, np.inf, np.array([0.0, 10.0, 21.0]))


def test_rims_are_grouped_by_components_and_the_stop():
    """Two singlets and a doublet around the stop, in this order: front 1-2, doublet 3-5; doublet 7-9, singlet 10-11."""
    groups = {rim.surface + 1: rim.group for rim in rim_ranges(HELIOS, [FIELD])}
    assert groups.items() <= {**dict.fromkeys((1, 2), GROUPS[0]), **dict.fromkeys((3, 4, 5), GROUPS[1]),
                              **dict.fromkeys((7, 8, 9), GROUPS[2]), **dict.fromkeys((10, 11), GROUPS[3])}.items()
    assert set(groups.values()) == set(GROUPS)


def test_a_plate_in_front_of_the_sensor_has_no_rim_to_fit():
    nikkor = prescription_of("nikkor-z-50mm-f1.8")
    field = EvenField(nikkor, np.inf, np.array([0.0, 10.0, 21.0]))
    assert {rim.surface + 1 for rim in rim_ranges(nikkor, [field])}.isdisjoint({25, 26})


def test_rims_pass_the_light_of_the_axis_and_end_with_the_light():
    paraxial_mm = np.abs(FIELD.system.marginal_heights_mm)
    for rim in rim_ranges(HELIOS, [FIELD]):
        assert rim.least_mm == pytest.approx(paraxial_mm[rim.surface], rel=0.12), "with aberrations"
        assert rim.least_mm < rim.most_mm <= CLEARANCE * FIELD.most_mm[rim.surface].max() + 1e-9


def test_glass_ends_where_an_element_has_no_thickness():
    """A lens of two equal spheres ends where their sags are half of its thickness; the air between two, as well."""
    radius_mm, thick_mm, gap_mm = 30.0, 6.0, 4.0
    lens = Prescription("ends", (
        Surface(radius_mm, thick_mm, "1.5/60"), Surface(-radius_mm, 10.0), Surface(np.inf, 1.0, stop=True),
        Surface(-50.0, 2.0, "1.5/60"), Surface(40.0, gap_mm), Surface(np.inf, 2.0, "1.5/60"), Surface(-60.0, 20.0)),
        ("stop", 2.0), ("image_height_mm", 5.0), focal_length_mm=30.0)
    ends_mm = glass_ends_mm(lens)
    sag_mm = thick_mm / 2
    assert ends_mm[:2] == pytest.approx(np.sqrt(2 * radius_mm * sag_mm - sag_mm**2), abs=0.05)
    assert np.isinf(ends_mm[2]) and ends_mm[5:] == pytest.approx(np.sqrt(2 * 60 * 2 - 4), abs=0.05)
    assert ends_mm[3] == pytest.approx(40.0, abs=0.05), "a biconcave lens ends with its smaller sphere"
    assert ends_mm[4] == pytest.approx(np.sqrt(2 * 40 * 4 - 16), abs=0.05), "where it touches the plane behind it"


def test_elements_that_touch_at_the_axis_do_not_end_there():
    """Surfaces 2 and 3 of the Nikkor touch, and the second is steeper."""
    lens = prescription_of("nikkor-58mm-f1.4")
    assert lens.surfaces[1].thickness_mm == 0 and min(glass_ends_mm(lens)) > 15


def test_no_rim_ends_in_the_light_of_the_axis():
    """Surfaces 5 and 6 of the Canon meet 15.6 mm from the axis, and its light on the axis is wider."""
    lens = prescription_of("canon-50mm-f0.95")
    field = EvenField(lens, np.inf, np.array([0.0, 10.0, 21.0]))
    assert glass_ends_mm(lens)[5] < 16 < 20 < field.most_mm[5, 0] == rim_ends_mm(lens, [field])[5]
    assert np.all(rim_ends_mm(lens, [field]) >= glass_ends_mm(lens))


def test_rims_that_pass_chief_rays():
    wide = prescription_of("nikkor-28mm")
    field = EvenField(wide, np.inf, np.array([0.0, 10.0, 21.0]))
    chief_mm, ranges = np.sqrt(field.square_mm2[:, -1, 0, 0]), rim_ranges(wide, [field])  # of the corner
    assert any(rim.least_mm < chief_mm[rim.surface] for rim in ranges)
    passing = passing_chief_rays(ranges, [field])
    assert passing and all(rim.most_mm > rim.least_mm >= chief_mm[rim.surface] for rim in passing)


def test_other_rims_are_as_wide_as_the_light_that_passes():
    fitted = with_rims(HELIOS, [FIELD], {10: 11.0})
    sizes_mm = [surface.semi_aperture_mm for surface in fitted.surfaces]
    assert sizes_mm[10] == 11.0 and sizes_mm[5] == np.inf == HELIOS.surfaces[5].semi_aperture_mm
    passing = ~FIELD.lost & (FIELD.square_mm2[10] <= 11.0**2)
    for index in set(range(11)) - {5, 10}:
        outermost_mm = np.sqrt(FIELD.square_mm2[index][passing].max())
        end_mm = glass_ends_mm(HELIOS)[index]
        assert sizes_mm[index] == pytest.approx(min(CLEARANCE * outermost_mm, end_mm), abs=1e-3)
    shapes = [(surface.radius_mm, surface.thickness_mm, surface.glass) for surface in fitted.surfaces]
    assert shapes == [(surface.radius_mm, surface.thickness_mm, surface.glass) for surface in HELIOS.surfaces]
