"""The light on a lens's axis and the stop's diameter, compared with the figures in its file: by hand."""

from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine.inspection.screen import check_prescription
from lensfield.engine.library import load_lens, prescription_of
from lensfield.engine.prescription.prescription import Prescription, Surface
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.axial_light import axial_f_number
from lensfield.engine.rays.rings import Rings, turned, widest_notes

EFL_MM = 100.0


def thin_lens(rim_mm=np.inf, stop_rim_mm=np.inf, aperture=("f_number", 2.5), gap_mm=6.0):
    """A stop, then a thin plano-convex lens of n = 1.5, convex towards the object: f = 2 r."""
    return Prescription("thin", (
        Surface(thickness_mm=gap_mm, semi_aperture_mm=stop_rim_mm, stop=True),
        Surface(EFL_MM / 2, 1e-9, "1.5/60", rim_mm),
        Surface(thickness_mm=EFL_MM)), aperture, ("image_height_mm", 5.0), focus="paraxial", focal_length_mm=EFL_MM)


@pytest.mark.parametrize("rim_mm, expected", [(np.inf, 2.5), (20.5, 2.5), (16.0, 100 / 32), (10.0, 5.0)])
def test_the_narrower_of_stop_and_rim_limits_a_beam_from_infinity(rim_mm, expected):
    """The beam is parallel in front of the lens."""
    assert axial_f_number(system_of(thin_lens(rim_mm))) == pytest.approx(expected, rel=1e-4)


def test_a_rim_in_front_of_the_stop_limits_the_wider_beam():
    """A stop 10 mm behind the lens: a ray at height h on the lens is at 0.9 h there, except for spherical aberration.
    """
    lens = Prescription("thin", (Surface(EFL_MM / 2, 1e-9, "1.5/60", 7.0), Surface(thickness_mm=10.0),
                                 Surface(thickness_mm=90.0, stop=True)), ("f_number", 5.0), ("image_height_mm", 5.0))
    assert axial_f_number(system_of(lens)) == pytest.approx(100 / 14, rel=1e-3)
    wide = replace(lens, surfaces=(replace(lens.surfaces[0], semi_aperture_mm=30.0), *lens.surfaces[1:]))
    assert axial_f_number(system_of(wide)) == pytest.approx(5.0, rel=0.01)


def test_a_rim_that_blocks_light_is_noted_with_the_remaining_share():
    note, = widest_notes(thin_lens(16.0))
    assert "f/3.12: 64% of the light of f/2.5" in note
    assert not widest_notes(thin_lens(19.7)), "1.5 %, within the tolerance"


def test_a_stop_opened_wider_than_the_files_is_noted():
    note, = widest_notes(thin_lens(stop_rim_mm=18.5))
    assert "f/2.5 needs a stop of 40 mm, which passes 117% of the light of the file's 37 mm stop" in note
    assert not widest_notes(thin_lens(stop_rim_mm=20.2)) and not widest_notes(thin_lens(aperture=("stop", 20.0)))


@pytest.mark.parametrize("rings", [Rings(), Rings(2000.0), Rings(f_number=8.0), Rings(900.0, 8.0)])
def test_notes_describe_the_lens_wide_open_at_infinity_for_any_rings(rings):
    lens = replace(thin_lens(16.0, 18.5), notes="Made up.")
    notes = turned(lens, rings).prescription.notes
    assert notes == " ".join(("Made up.", *widest_notes(lens))) and len(widest_notes(lens)) == 2


def test_notes_are_not_repeated():
    once = turned(thin_lens(16.0, 18.5)).prescription
    assert turned(once).prescription.notes == once.notes


def test_a_users_file_has_notes_in_its_lens_and_in_the_check(tmp_path):
    text = '''format = "lensfield-prescription"
version = 1
aperture = { f_number = 5 }
field = { image_height_mm = 5 }
focus = "paraxial"
surfaces = [
  { thickness_mm = 2, semi_aperture_mm = 9, stop = true },
  { radius_mm = 50, thickness_mm = 3, glass = "1.5/60", semi_aperture_mm = 9.5 },
  { thickness_mm = 90 }
]
'''
    (tmp_path / "own.toml").write_text(text)
    notes = load_lens(tmp_path / "own.toml", quality="preview").notes
    assert "f/5 needs a stop of 20 mm, which passes 123% of the light of the file's 18 mm stop" in notes
    assert "f/5.26: 90% of the light of f/5" in notes
    findings = [str(finding) for finding in check_prescription(prescription_of(tmp_path / "own.toml"))]
    assert sum(line.startswith("note: aperture: ") for line in findings) == 2


def test_the_elcans_stop_is_where_it_has_room():
    """The stop is 6 mm behind the third lens.

    In front of that lens, the gap closes to 0.1 mm at the rim of the f/2 beam, and a stop in it let the light of f/2.26
    through.
    """
    lens = prescription_of("leica-elcan-50mm")
    glasses = [bool(surface.glass) for surface in lens.surfaces[:lens.stop_index]]
    assert sum(glasses) == 3 and not widest_notes(lens)


@pytest.mark.parametrize("name", ["leica-elcan-50mm", "pentax-soft-85mm", "mamiya-soft-focus-150mm", "nikon-l35af-35mm",
                                  "canon-ef-200mm-f1.8", "zeiss-distagon-35mm-f1.4"])
def test_notes_state_stops_that_differ_from_the_patent(name):
    notes = prescription_of(name).notes
    assert "stop" in notes and ("assumed" in notes or "estimated" in notes)
