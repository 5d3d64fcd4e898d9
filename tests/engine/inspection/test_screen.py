"""Prescriptions judged by their rays: a good one damaged in various ways, and the complete library."""

import re
from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine.bake.bake import bake
from lensfield.engine.inspection.checks import check_lens
from lensfield.engine.inspection.screen import check_prescription
from lensfield.engine.library import BUNDLED, bundled_names, described_lenses, prescription_of
from lensfield.engine.prescription.prescription import Pose, Prescription, Surface
from lensfield.engine.prescription.readers.toml import read_lensfield
from lensfield.engine.rays.focus import build_system
from lensfield.engine.rays.rays import HalfPupil, trace_pupil

GOOD = read_lensfield(BUNDLED / "prescriptions" / "nikkor-z-50mm-f1.8.toml")  # has aspheres and moving parts
FRONT_ASPHERE, REAR_ASPHERE, GAP, LAST = 6, 17, 19, 26


def damaged(number, **changes):
    """The good lens with one of its surfaces, counted from 1, changed."""
    surfaces = list(GOOD.surfaces)
    surfaces[number - 1] = replace(surfaces[number - 1], **changes)
    return replace(GOOD, surfaces=tuple(surfaces))


def summary(prescription):
    return [(finding.severity, finding.field) for finding in check_prescription(prescription)]


def test_a_good_lens_has_no_findings():
    assert not check_prescription(GOOD)


@pytest.mark.sample(2)
@pytest.mark.parametrize("factor, severities", [(0.98, ["error"]), (0.992, []), (1.008, []), (1.02, ["error"])])
def test_the_focal_length_must_match_the_name(factor, severities):
    findings = check_prescription(replace(GOOD, focal_length_mm=factor * 51.601))
    assert [(finding.severity, finding.field) for finding in findings] == [
        (severity, "focal_length_mm") for severity in severities]
    assert all("the surfaces give 51.6 mm" in finding.value for finding in findings)


def test_without_a_name_the_focal_length_is_a_note():
    finding, = check_prescription(replace(GOOD, focal_length_mm=None))
    assert finding.severity == "note" and "they give 51.6 mm" in finding.remedy


@pytest.mark.parametrize("title, notes, expected", [
    ("A Lens 51 mm f/1.82 (2018)", "", []), ("A Lens, untitled", "", []), ("A Lens 51 mm T2.5", "", []),
    ("A Zoom 14-24 mm f/2.8", "", []),
    ("A Lens 50 mm f/1.8", "", ["50 mm, and the surfaces give 51.6 mm", "f/1.8, and the surfaces give f/1.85"]),
    ("A Lens 50 mm f/1.8", "Engraved 50 mm.", ["f/1.8, and the surfaces give f/1.85"]),
    ("A Lens 50 mm f/1.8", "Engraved 50 mm f/1.8; the design has 51.6 mm f/1.85.", [])])
def test_title_and_surfaces_agree_or_the_notes_say_so(title, notes, expected):
    findings = check_prescription(replace(GOOD, title=title, notes=notes))
    assert [(finding.severity, finding.field, finding.value) for finding in findings] == [
        ("warning", "title", each) for each in expected]


@pytest.mark.parametrize("number", [FRONT_ASPHERE, REAR_ASPHERE])
def test_a_lost_asphere_shows_on_the_axis(number):
    assert GOOD.surfaces[number - 1].aspheric
    findings = [finding for finding in check_prescription(damaged(number, aspheric=())) if finding.severity == "error"]
    assert [finding.field for finding in findings] == ["surfaces"] * 2
    assert "focused at infinity" in findings[0].value and "focused at 307.7 mm" in findings[1].value


def test_a_wrong_glass_shows_in_white_light():
    crown = 1 + [surface.glass for surface in GOOD.surfaces].index("1.59319/67.9")
    assert ("error", "surfaces") in summary(damaged(crown, glass="1.59319/30"))


def test_a_lens_may_be_intentionally_soft():
    soft = replace(damaged(REAR_ASPHERE, aspheric=()), character=("portrait", "soft focus"))
    assert "error" not in dict(summary(soft))
    assert "soft focus, as stated in its character" in {finding.remedy for finding in check_prescription(soft)}


@pytest.mark.sample(2)
@pytest.mark.parametrize("share, severity", [(0.95, "note"), (0.8, "error")])
def test_an_aperture_that_blocks_the_light_of_the_stop(share, severity):
    rim = trace_pupil(build_system(GOOD), [0.0], [GOOD.reference_wavelength_nm], HalfPupil(2, 1)).square_height_mm2
    narrowed = damaged(1, semi_aperture_mm=share * np.sqrt(rim[0, 0, 0, -1, 0]))
    finding = next(finding for finding in check_prescription(narrowed) if finding.field.startswith("aperture"))
    stated_share = float(re.search(r"(\d+)% of its width", finding.value)[1]) / 100
    assert finding.severity == severity and stated_share == pytest.approx(share, abs=0.02), "by the pupil's aberration"
    assert "surface 1 is the narrowest" in finding.remedy


def test_an_aperture_that_blocks_chief_rays():
    findings = check_prescription(damaged(LAST, semi_aperture_mm=15.0))
    assert [(finding.severity, finding.field) for finding in findings] == [
        ("error", f"surface {LAST}, semi_aperture_mm")] * 2, "at both distances"
    assert "15, and blocks chief rays from an image height of 1" in findings[0].value


def test_a_rim_that_darkens_the_corners_abruptly():
    """It is 1 mm from the image, where the beam is narrow, and just passes the last chief ray at infinity."""
    finding, = check_prescription(damaged(LAST, semi_aperture_mm=21.24))
    assert (finding.severity, finding.field) == ("warning", "semi_aperture_mm")
    assert "at 21.66 mm, focused at infinity" in finding.value and "mistyped aperture" in finding.remedy


def test_a_throat_that_takes_the_light_only_up_close():
    """It is 41.35 mm behind the rear principal plane, and the image 49.04 mm for infinity, 54.47 mm up close: of the
    beam's semi-diameter of 3.07 mm, 0.48 mm and 0.74 mm are left at the throat of 0.5 mm."""
    surfaces = (Surface(50.0, 4.0, "SCHOTT N-BK7", stop=True), Surface(-50.0, 40.0), Surface(thickness_mm=8.0,
                                                                                           semi_aperture_mm=0.5))
    throat = Prescription("throat", surfaces, ("f_number", 8.0), ("angle_deg", 0.2), focus="best",
                          character=("soft focus",))
    finding, = (finding for finding in check_prescription(throat) if finding.severity == "error")
    share = float(re.match(r"(\d+)% of the stop has light on the axis, focused at 490.4 mm", finding.value)[1]) / 100
    assert share == pytest.approx((0.5 / (49.04 / 16 * (1 - 41.35 / 54.47)))**2, abs=0.02)


def test_a_field_that_ends_before_the_corners_or_before_the_sides():
    assert summary(replace(GOOD, field=("image_height_mm", 21.0))) == [("note", "sensor_mm")]
    assert summary(replace(GOOD, field=("image_height_mm", 15.0))) == [("error", "field")]


def test_a_mistyped_gap_moves_the_image():
    far, near = GOOD.surfaces[GAP - 1].gaps_mm
    assert summary(damaged(GAP, gaps_mm=(far, near - 2.0))) == [("warning", "focused_at_mm")]


def test_a_lens_without_an_image_has_only_that_finding():
    rigid = tuple(replace(surface, gaps_mm=()) for surface in GOOD.surfaces)
    stuck = replace(GOOD, focused_at_mm=(), surfaces=rigid)
    assert summary(replace(stuck, closest_focus_mm=5.0)) == [("error", "object_distance_mm")]
    assert summary(damaged(1, glass="UNOBTAINIUM")) == [("error", "surface 1, glass")]


def test_fast_lenses_that_move_as_a_unit_may_be_soft_up_close():
    rigid = tuple(replace(surface, gaps_mm=()) for surface in GOOD.surfaces)
    findings = check_prescription(replace(GOOD, focused_at_mm=(), surfaces=rigid, closest_focus_mm=45.0))
    assert [finding.severity for finding in findings] == ["note"] and "sharper farther away" in findings[0].remedy


@pytest.mark.sample(12)
@pytest.mark.parametrize("name", bundled_names())
def test_the_library_matches_its_descriptions(name):
    lens = prescription_of(name)
    assert lens.name == name
    assert all((lens.title, lens.maker, lens.story, lens.source, lens.character, lens.sensor_mm, lens.focal_length_mm))
    assert lens.year is None or f"({lens.year})" in lens.title
    assert lens.provenance[0][0] == "figures", "each other part may differ from them"
    findings = check_prescription(lens)
    assert not [finding for finding in findings if finding.severity == "error"]
    assert {finding.field for finding in findings if finding.severity == "warning"} <= {"sensor_mm"}


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["olympus-fisheye-8mm", "pentax-fisheye-17mm"])
def test_polynomials_fitted_to_fisheyes_do_not_fold(name):
    """For the engine's polynomials over paraxial heights, which are infinite at a right angle."""
    lens = bake(read_lensfield(BUNDLED / "prescriptions" / f"{name}.toml"), quality="preview", samples=17, pitch_um=4.0)
    assert "error" not in {finding.severity for finding in check_lens(lens) if not finding.field.startswith("psf")}


def test_the_library_is_large_and_its_titles_differ():
    assert len(described_lenses()) >= 60
    assert len({lens.title for lens in described_lenses().values()}) == len(described_lenses())


def singlet(rim_mm=np.inf, rim_offset_mm=0.01, **front):
    """A singlet at f/16, with a rim half-way to the image that is displaced along x: not rotationally symmetric."""
    rim = Surface(thickness_mm=20.0, semi_aperture_mm=rim_mm, pose=Pose((rim_offset_mm, 0.0, 0.0)))
    surfaces = (Surface(40.0, 4.0, "1.5/1000", stop=True, **front), Surface(-60.0, 25.0), rim)
    return Prescription("displaced", surfaces, ("f_number", 16.0), ("image_height_mm", 2.6), sensor_mm=(4.0, 3.0),
                        focus="best")


def test_a_lens_without_rotational_symmetry_passes_as_its_centred_design_does():
    lens = singlet()
    centred = replace(lens, surfaces=(*lens.surfaces[:2], replace(lens.surfaces[2], pose=None)))
    assert summary(lens) == summary(centred) == [("note", "focal_length_mm")]


def test_astigmatism_of_a_mistyped_section_lowers_the_contrast():
    finding = check_prescription(singlet(radius_x_mm=38.0))[0]
    assert (finding.severity, finding.field) == ("error", "surfaces") and "focused at infinity" in finding.value


def test_a_displaced_rim_blocks_chief_rays_on_its_side_of_the_picture():
    """Half-way to the image, it lets those on the left of the upside-down image pass up to 0.5 mm on the right."""
    blocked = [finding for finding in check_prescription(singlet(2.5, -2.0)) if "blocks chief rays" in finding.value]
    assert {(finding.severity, finding.field) for finding in blocked} == {("error", "surface 3, semi_aperture_mm")}
    x_mm = float(re.search(r"chief rays from x = (\S+), y = 0 mm, focused at infinity", blocked[0].value)[1])
    assert -1.1 < x_mm < -0.8
