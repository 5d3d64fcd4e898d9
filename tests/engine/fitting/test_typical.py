"""Rims that give a lens the light of a typical lens."""

from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine import LensError
from lensfield.engine.fitting.even_light import EvenField
from lensfield.engine.fitting.lensfun import SHARES
from lensfield.engine.fitting.typical import FULL_FRAME, TypicalLight, with_typical_rims
from lensfield.engine.fitting.vignetting import light_of
from lensfield.engine.inspection.screen import check_prescription
from lensfield.engine.library import prescription_of
from lensfield.engine.prescription.photographs import Vignetting
from refusals import refused

DARK = TypicalLight(0.7, 0.0, 2.0)


def light_wide_open(lens):
    """Light of a lens at its widest f-stop over its light six f-stops below, where rims block nothing."""
    heights_mm = SHARES * np.hypot(*lens.sensor_mm) / 2
    wide, closed = light_of(lens, [Vignetting(f_number, np.inf, heights_mm, heights_mm)
                                   for f_number in (lens.aperture[1], 8 * lens.aperture[1])])
    return wide / closed


def test_half_of_the_light_arrives_at_the_place_of_half_the_light():
    typical = TypicalLight(0.9, 0.25, 2.2)
    assert [typical.at(2, 0.9), typical.at(4, 0.9 * 2**0.25)] == pytest.approx([0.5, 0.5])
    assert typical.at(2.0, np.array([0.0, 0.45])) == pytest.approx([1.0, 1 / (1 + 0.5**2.2)])


@pytest.mark.parametrize("name, typical", [("helios-44-2-58mm", FULL_FRAME), ("helios-44-2-58mm", DARK),
                                           ("nikkor-z-50mm-f1.8", FULL_FRAME), ("zeiss-planar-80mm", FULL_FRAME)])
def test_the_light_is_as_the_rule_has_it(name, typical):
    """The rule is not of any one design: two rims follow it within 0.04."""
    lens = with_typical_rims(prescription_of(name), typical)
    assert light_wide_open(lens) == pytest.approx(typical.at(lens.aperture[1], SHARES), abs=0.04)


def test_only_apertures_change_and_the_file_states_their_origin():
    lens = prescription_of("helios-44-2-58mm")
    found = with_typical_rims(lens)
    assert found.aperture_origin == "typical of photographed lenses"
    assert replace(found, surfaces=lens.surfaces) == lens != found
    wider = replace(lens, surfaces=tuple(replace(surface, semi_aperture_mm=40.0) for surface in lens.surfaces))
    assert [surface.semi_aperture_mm for surface in with_typical_rims(wider).surfaces if not surface.stop] == [
        surface.semi_aperture_mm for surface in found.surfaces if not surface.stop], "whatever they were"


@pytest.mark.parametrize("name", ["helios-44-2-58mm", "pentax-macro-200mm"])
def test_one_rim_on_each_side_of_the_stop_blocks_light_and_no_chief_ray(name):
    lens = with_typical_rims(prescription_of(name), DARK)
    heights_mm = np.array([0.0, 10.0, 20.0])
    field = EvenField(lens, np.inf, heights_mm)
    sizes_mm = np.array([surface.semi_aperture_mm for surface in lens.surfaces])
    blocking = sizes_mm < 0.995 * field.most_mm[:, 2]
    assert blocking[:lens.stop_index].any() and blocking[lens.stop_index + 1:].any()
    assert not [each for each in check_prescription(lens) if each.severity == "error"], "up close, too"
    chief_mm = np.sqrt(field.square_mm2[:, :, 0, 0]).max(axis=1)
    assert np.all(sizes_mm >= np.maximum(field.most_mm[:, 0], chief_mm) * 0.999)


def test_a_lens_without_a_sensor_is_refused():
    with refused(LensError, field="sensor_mm", where="helios-44-2-58mm", match="missing: typical rims need the sensor"):
        with_typical_rims(replace(prescription_of("helios-44-2-58mm"), sensor_mm=None))
