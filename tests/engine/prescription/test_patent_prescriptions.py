"""Patents transcribed by others: the Optical Bench's text files and .lens."""

from dataclasses import replace

import numpy as np
import pytest

from lens_texts import DOT_LENS, OPTBENCH, SURFACES, changed, reader_of
from lensfield.engine import LensError
from lensfield.engine.prescription.prescription import Surface
from lensfield.engine.prescription.readers import ReadingOptions, read_file, read_prescription
from lensfield.engine.rays.focus import build_system
from places import SHARED_DATA
from refusals import refused

FRONT = Surface(50.0, 4.0, "1.5168/64.2", 8.0)
STOP = replace(SURFACES[0], semi_aperture_mm=2.5)
FIELD = ("image_height_mm", 12.0)
PATENTS = SHARED_DATA / "patent_lenses"


@pytest.fixture
def optbench(tmp_path):
    return reader_of(tmp_path / "lens.txt", OPTBENCH)


@pytest.fixture
def dot_lens(tmp_path):
    return reader_of(tmp_path / "lens.lens", DOT_LENS)


def test_a_text_of_the_optical_bench(optbench):
    lens = optbench()
    assert lens.surfaces == (STOP, FRONT, Surface(-50.0, 47.5, "", 8.0, -0.5, (0.0, 1e-6, -2e-9)))
    assert (lens.aperture, lens.field, lens.focus) == (("f_number", 9.8), ("angle_deg", 14.0), "best")
    assert np.isinf(lens.object_distance_mm) and lens.sensor_mm is None and "US 1,234,567" in lens.source
    assert lens.notes == "Number 1 of the file's 2 zoom and focus positions is used."
    assert build_system(lens).efl_mm == pytest.approx(49.0, abs=0.1)


MOVING = (("1\tAS\t2.0", "1\tAS\td1"), ("d3\t47.5\t52.8", "d3\t47.5\t45.8\nd1\t2.0\t9.0"))


def test_positions_that_differ_only_in_focus_describe_the_focus_ring(optbench, tmp_path):
    lens = optbench(*MOVING)
    assert lens.focused_at_mm == (np.inf, 500.0) and np.isinf(lens.object_distance_mm) and not lens.notes
    assert [surface.gaps_mm for surface in lens.surfaces] == [(2.0, 9.0), (), (47.5, 45.8)]
    near_first = optbench(*MOVING, ("d0\tInfinity\t500", "d0\t500\tInfinity"))
    assert near_first.focused_at_mm == (np.inf, 500.0) and near_first.surfaces[0].gaps_mm == (9.0, 2.0)
    assert not read_prescription(tmp_path / "lens.txt", ReadingOptions(which="1")).focused_at_mm


@pytest.mark.parametrize("change", [
    MOVING[1], ("d0\tInfinity\t500", "d0\tInfinity\tInfinity"), ("d0\tInfinity\t500", "d0\tInfinity\t-500"),
    ("d0\tInfinity\t500", "d0\tInfinity"), ("d0\tInfinity\t500\n", "")])
def test_other_positions_do_not_describe_the_focus_ring(optbench, change):
    moving = (MOVING[0], change, *MOVING[1:]) if change != MOVING[1] else (change,)
    assert not optbench(*moving).focused_at_mm


def test_trailing_tabs_are_not_positions(optbench):
    lens = optbench(*MOVING, ("Infinity\t500\n", "Infinity\t500\t\t\t\n"), ("-2e-9\n", "-2e-9\t\t\n"))
    assert lens.focused_at_mm == (np.inf, 500.0) and lens.surfaces[2].aspheric == (0.0, 1e-6, -2e-9)


def test_a_position_is_selected_by_its_number(tmp_path):
    path = tmp_path / "lens.txt"
    path.write_text(OPTBENCH)
    near = read_prescription(path, ReadingOptions(which="2"))
    assert (near.object_distance_mm, near.surfaces[2].thickness_mm) == (500.0, 52.8)
    assert near.aperture == ("f_number", 9.8) and "Number 2 of the file's" in near.notes
    for wrong in ("3", "0", "x", "-1"):
        with pytest.raises(LensError, match=f"--which is {wrong}: expected the number of a position, 1 to 2"):
            read_prescription(path, ReadingOptions(which=wrong))


def test_the_first_position_for_infinity_is_used(optbench):
    assert optbench(("d0\tInfinity\t500", "d0\t500\tInfinity")).surfaces[2].thickness_mm == 52.8
    assert optbench(("d0\tInfinity\t500", "d0\t900\t500")).object_distance_mm == 900.0


def test_a_full_frame_sensor_is_recognised(optbench):
    assert optbench(("Image Height\t24.4\t24.4", "Image Height\t43.2\t43.2")).sensor_mm == (36.0, 24.0)


def test_an_asphere_may_start_with_the_second_power(optbench):
    lens = optbench(("Scaled\t50", "AsphericalA2\t1"))
    assert lens.surfaces[2].aspheric == (1e-6, -2e-9)


def test_other_rows_are_read_and_optional_rows_may_be_missing(optbench):
    rows = "2\t50.0\t4.0\t1.5168\t16\n2a\tFS\t0\t\t7\n2b\tCG\t1\t1.5\t9\t60"
    lens = optbench(("2\t50.0\t4.0\t1.5168\t16\t64.2\tBSC7", rows), ("1\tAS\t2.0\t\t5", "1\tAS\t2.0\t5"),
                    ("Focal Length\t49.0\t49.0\n", ""))
    assert lens.surfaces[:4] == (STOP, replace(FRONT, glass="1.5168"), Surface(semi_aperture_mm=3.5),
                                 Surface(thickness_mm=1.0, glass="1.5/60", semi_aperture_mm=4.5))
    assert optbench(("F-Number\t9.8\t9.8\n", "")).aperture == ("stop", 2.5)
    assert optbench(("Angle of View\t28.0\t27.0\n", "")).field == ("image_height_mm", 12.2)


def test_the_field_of_a_fisheye_is_limited_to_85_degrees(optbench):
    lens = optbench(("Angle of View\t28.0", "Angle of View\t180"))
    assert lens.field == ("angle_deg", 85.0) and "The field ends at 85 degrees." in lens.notes


@pytest.mark.parametrize("old, new, message", [
    ("[lens data]", "[lenses]", r"\[lens data\] is missing: expected a text file of PhotonsToPhotos' Optical Bench"),
    ("[variable distances]", "[distances]", r"\[variable distances\] is missing"),
    ("1\tAS", "1\tInfinity", "AS is in 0 rows: expected one row to be the aperture stop"),
    ("2\t50.0", "2\tfifty", "line 15 is 2 fifty 4.0 1.5168 16 64.2: expected a number as word 2"),
    ("\td3\t\t16", "\td4\t\t16", "line 16 is 3 -50.0 d4 16: expected a number as word 3"),
    ("d3\t47.5\t52.8", "d3\tundefined", "line 16, d3 is undefined: expected the distance at this position"),
    ("1.5168\t16\t64.2", "1.5168\t16\tx", "line 15 is .*: expected a number as word 6")])
def test_an_invalid_text_is_an_error_with_its_line(optbench, old, new, message):
    with pytest.raises(LensError, match=f"lens.txt: {message}"):
        optbench((old, new))


def coated(*surfaces):
    """The surfaces with the coatings of the text."""
    return tuple(replace(surface, coating=name) for surface, name in zip(surfaces, ("none", "single", "none"),
                                                                         strict=True))


def test_a_dot_lens(dot_lens):
    lens = dot_lens(field=FIELD)
    assert lens.surfaces == coated(STOP, FRONT, Surface(-50.0, 47.5, "", 8.0))
    assert (lens.name, lens.aperture, lens.field) == ("Singlet 50mm f/10", ("f_number", 10.0), FIELD)
    assert lens.focus == "best" and "diameters" in lens.notes
    assert build_system(lens).efl_mm == pytest.approx(49.0, abs=0.1)


@pytest.mark.parametrize("layers, coating", [("0", "none"), ("1", "single"), ("2", "multi"), ("7", "multi"), ("", "")])
def test_the_layers_of_a_coating_in_a_dot_lens(dot_lens, layers, coating):
    row = "64.20    16.000    "
    assert dot_lens((f"{row}1", f"{row}{layers}"), field=FIELD).surfaces[1].coating == coating


@pytest.mark.parametrize("name, aperture", [
    ("Lens 50mm F9.7 AI", ("f_number", 9.7)), ("Lens 50mm f9", ("f_number", 9.0)), ("Lens 50mm", ("stop", 2.5)),
    ("Pentax-F 85mm F9.5 Soft", ("f_number", 9.5)), ("Lens F 85 mm f/9.6", ("f_number", 9.6)),
    ("Lens-F 300mm", ("stop", 2.5)), ("Nikon F 17mm", ("stop", 2.5)), ("NF 80mm F9", ("f_number", 9.0))])
def test_the_f_number_of_a_dot_lens_is_in_its_name(dot_lens, name, aperture):
    """A letter before a focal length is not an f-number: f/85 was the Pentax-F's."""
    no_header = "1 glass elements, f/10.0", "1 glass elements"
    assert dot_lens(("name: Singlet 50mm f/10", f"name: {name}"), no_header, field=FIELD).aperture == aperture


@pytest.mark.parametrize("name, header, used", [("9.75", "9.8", 9.75), ("9.7", "9.6", 9.7), ("9", "9.8", 9.8)])
def test_differing_f_numbers_of_a_dot_lens_are_noted(dot_lens, name, header, used):
    lens = dot_lens(("name: Singlet 50mm f/10", f"name: Singlet f/{name}"),
                    ("elements, f/10.0", f"elements, f/{header}"), field=FIELD)
    assert lens.aperture == ("f_number", used)
    assert f"The name says f/{name}, the header f/{header}: f/{used:g} is used." in lens.notes


@pytest.mark.parametrize("size", ["1e6", "1000000.000", "0"])
def test_a_dot_lens_may_state_no_aperture(dot_lens, size):
    """The Hologon's stop is 1e6 wide: it has none, and the f-number sets its size."""
    lens = dot_lens(("0.00     5.000 ", f"0.00 {size} "), field=FIELD)
    assert lens.surfaces[0] == replace(STOP, semi_aperture_mm=np.inf, coating="none")
    assert build_system(lens).stop_semi_aperture_mm == pytest.approx(2.4, abs=0.1)


def test_a_dot_lens_without_any_size_of_its_stop_is_rejected(dot_lens):
    with refused(LensError, field="aperture, stop", value=np.inf, where="lens.lens"):
        dot_lens(("0.00     5.000 ", "0.00 1e6 "), ("f/10", "slow"), field=FIELD)


LAST_ROW = "16.000    0\n"


@pytest.mark.parametrize("kind, changes", [
    ("cyl_x", dict(radius_x_mm=np.inf)), ("cylinder_y", dict(radius_mm=np.inf, radius_x_mm=-50.0)),
    ("CYL_Y", dict(radius_mm=np.inf, radius_x_mm=-50.0)), ("spherical", {}),
    ("toric -80.0", dict(radius_mm=-80.0, radius_x_mm=-50.0, profile="y"))])
def test_cylinders_and_toroids_of_a_dot_lens(tmp_path, kind, changes):
    """A cylinder is named after its axis, along which it is straight; the second radius of a toroid is along y. Files
    with these contain semi-diameters."""
    path = tmp_path / "lens.lens"
    path.write_text(changed(DOT_LENS, (LAST_ROW, LAST_ROW.rstrip() + f"  {kind}\n")))
    lens = read_file(path, ReadingOptions(FIELD)).prescription
    factor = 2 if changes else 1
    expected = coated(STOP, FRONT, replace(Surface(-50.0, 47.5, "", 8.0), **changes))
    assert lens.surfaces == tuple(replace(surface, semi_aperture_mm=factor * surface.semi_aperture_mm)
                                  for surface in expected)
    assert f"Apertures are read as {'semi-' * bool(changes)}diameters" in lens.notes


@pytest.mark.parametrize("kind", ["biconic", "toric", "toric x", "toric 0", "cyl_x 3", "sph 3", "toric 1 2"])
def test_an_unknown_kind_of_surface_of_a_dot_lens_is_rejected(dot_lens, kind):
    with pytest.raises(LensError, match="surface 3, radius_mm is 0" if kind == "toric 0" else
                       f"line 13 is .*{kind}: expected"):
        dot_lens((LAST_ROW, LAST_ROW.rstrip() + f"  {kind}\n"), field=FIELD)


@pytest.mark.parametrize("name", ["Nikkor 35-70mm f/10", "Canon 12.5 - 62.5 mm f/10", "Zoom-Nikkor f/10"])
def test_one_position_of_a_zoom_is_reported(dot_lens, name):
    assert "The file has one position of a zoom lens: 49 mm." in dot_lens(
        ("name: Singlet 50mm f/10", f"name: {name}"), field=FIELD).notes
    assert "zoom" not in dot_lens(field=FIELD).notes


def test_an_attachment_in_a_dot_lens_is_rejected(dot_lens):
    with pytest.raises(LensError, match="focal_length is inf: expected a lens with a positive focal length"):
        dot_lens(("focal_length: 49.00", "focal_length: inf"), field=FIELD)


@pytest.mark.parametrize("old, new, message", [
    ("  stop  ", "  0     ", "stop is 0 rows: expected one row that begins with stop"),
    ("64.20    16.000    1", "64.20    16.000    -1", "line 12 is .*-1: expected the number of a coating's layers"),
    ("64.20    16.000    1", "64.20", "line 12 is 50.0000 4.0000 1.51680 64.20: expected radius or stop"),
    ("1.51680", "glass", "line 12 is 50.0000 4.0000 glass .*: expected a number as word 3")])
def test_an_invalid_dot_lens_is_an_error_with_its_line(dot_lens, old, new, message):
    with pytest.raises(LensError, match=f"lens.lens: {message}"):
        dot_lens((old, new), field=FIELD)


def test_a_dot_lens_needs_a_field_and_contains_one_lens(dot_lens, tmp_path):
    with pytest.raises(LensError, match="field is missing: a .lens does not state .*--field-angle or --field-height"):
        dot_lens()
    with pytest.raises(LensError, match="--which is 2: the file contains one lens: leave it out"):
        read_prescription(tmp_path / "lens.lens", ReadingOptions(FIELD, "2"))


@pytest.mark.skipif(not PATENTS.is_dir(), reason="the patents of ../shared/data are not there")
@pytest.mark.parametrize("name, efl_mm", [
    ("optbench/ARRI-signature-prime-58mm__US20200341250_Example01.txt", 57.99),
    ("optbench/canon-ef50mm-f1.0L__US004717245_Example02.txt", 51.99),
    ("lens/AI_Nikkor_35mm_F1.4S.lens", 35.0)])
def test_real_files_have_the_focal_lengths_that_they_state(name, efl_mm):
    lens = read_prescription(PATENTS / name,
                             ReadingOptions(None if name.endswith("txt") else ("image_height_mm", 21.6)))
    assert build_system(replace(lens, focus="paraxial")).efl_mm == pytest.approx(efl_mm, rel=5e-3)
