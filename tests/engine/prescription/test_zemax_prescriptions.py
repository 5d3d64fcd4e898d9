"""Zemax .zmx prescriptions: the fields read, their units, and refused content."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

from lens_texts import SURFACES, ZEMAX, reader_of
from lensfield.engine import LensError
from lensfield.engine.bake.bake import bake
from lensfield.engine.prescription.prescription import Pose, Prescription, Surface
from lensfield.engine.prescription.readers import ReadingOptions, read_prescription
from lensfield.engine.prescription.readers.toml import write_prescription
from lensfield.engine.rays.focus import build_system
from lensfield.engine.runtime.unread import unread_note
from refusals import refused

SINGLET = Prescription("singlet", SURFACES, ("entrance_pupil_diameter_mm", 5.0), ("angle_deg", 14.0),
                       reference_wavelength_nm=587.5618, source="lens.ZMX (Zemax)")
GLASS = "GLAS N-BK7 0 0 1.5 40 0 0 0 0 0 0"
NEAR = ("DISZ INFINITY", "DISZ 250")
BREAK = "SURF 4\n  TYPE COORDBRK\n  {}\n  CURV 0\n  DISZ 0\n"
LAST = "DISZ 4.75E+1\n"
FRONT = "TYPE STANDARD\n  CURV 2.0E-2"


@pytest.fixture
def read(tmp_path):
    """Read the singlet's file with parts of it changed."""
    return reader_of(tmp_path / "lens.ZMX", ZEMAX)


def test_a_singlet(read):
    lens = read()
    assert replace(lens, reference_wavelength_nm=587.5618) == SINGLET
    assert lens.reference_wavelength_nm == pytest.approx(587.5618)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig", "latin-1", "utf-16-le"])
def test_encodings(read, encoding):
    text = ("NAME singlet", "NAME Schärfe")
    assert replace(read(text, encoding=encoding), name="singlet", reference_wavelength_nm=587.5618) == SINGLET
    assert read(text, encoding=encoding).name == "Schärfe"


def test_a_latin_1_letter_late_in_a_file_does_not_duplicate_surfaces(read):
    """Decoding as UTF-8 fails after thousands of bytes, and reading starts again."""
    long = ("BLNK\n", "BLNK\n" * 4000 + "NOTE 0 für\n")
    assert read(long, encoding="latin-1").surfaces == SURFACES


def test_decimal_commas(read):
    numbers = ("5.0E+0", "1.4E+1", "2.0E-2", "4.75E+1", "8.0 0", "-0.5")
    commas = [(number, number.replace(".", ",")) for number in numbers]
    assert replace(read(*commas, ("NAME singlet", "NAME f 1,8")), name="singlet",
                   reference_wavelength_nm=587.5618) == SINGLET
    assert read(("NAME singlet", "NAME f 1,8")).name == "f 1,8"


@pytest.mark.parametrize("unit, mm", [("CM", 10.0), ("IN", 25.4), ("INCH", 25.4), ("METER", 1000.0)])
def test_units(read, unit, mm):
    asphere = ("TYPE STANDARD\n  CURV -2.0E-2", "TYPE EVENASPH\n  PARM 1 1e-3\n  PARM 2 2e-5\n  CURV -2.0E-2")
    lens = read(("UNIT MM", f"UNIT {unit}"), NEAR, ("FTYP 0", "FTYP 1"), asphere)
    front, back = lens.surfaces[1:]
    assert (front.radius_mm, front.thickness_mm, front.semi_aperture_mm) == pytest.approx((50 * mm, 4 * mm, 8 * mm))
    assert back.aspheric[:2] == pytest.approx((1e-3 / mm, 2e-5 / mm**3)) and back.conic == -0.5
    assert lens.aperture == ("entrance_pupil_diameter_mm", pytest.approx(5 * mm))
    assert lens.field == ("object_height_mm", pytest.approx(14 * mm))
    assert lens.object_distance_mm == pytest.approx(250 * mm)


@pytest.mark.parametrize("line, aperture", [
    ("ENPD 4.0", ("entrance_pupil_diameter_mm", 4.0)), ("FNUM 1.8 0", ("f_number", 1.8)),
    ("FNUM 1.8 1", ("working_f_number", 1.8)), ("OBNA 0.1 0", ("object_na", 0.1)), ("FLOA", ("stop", 2.5)),
    ("FNUM 1.2", ("f_number", 1.2)), ("OBNA 0.1", ("object_na", 0.1))])
def test_apertures(read, line, aperture):
    assert read(("ENPD 5.0E+0", line), NEAR).aperture == aperture


@pytest.mark.parametrize("kind, field", [
    (0, ("angle_deg", 14.0)), (1, ("object_height_mm", 14.0)), (2, ("image_height_mm", 14.0)),
    (3, ("image_height_mm", 14.0))])
def test_fields(read, kind, field):
    lens = read(("FTYP 0", f"FTYP {kind}"), NEAR)
    assert lens.field == field
    assert ("real image height" in lens.notes) == (kind == 3)


def test_the_field_ends_at_its_farthest_point(read):
    """For angles in two planes, by their tangents; points beyond the number in FTYP do not count."""
    points = [("XFLN 0 0 0 0", "XFLN -20 0 0 0"), ("YFLN 0 1.4E+1 0 0", "YFLN 15 -16 80 0")]
    corner = np.degrees(np.arctan(np.hypot(np.tan(np.radians(20)), np.tan(np.radians(15)))))
    assert read(*points).field == ("angle_deg", pytest.approx(corner))
    assert read(*points, ("FTYP 0", "FTYP 2")).field == ("image_height_mm", 25.0)
    assert read(*points, ("FTYP 0", "FTYP 4"), field=("angle_deg", 9.0)).field == ("angle_deg", 9.0)
    old = [("FTYP 0 0 2 3 0 0 0", "FTYP 0 0"), ("XFLN 0 0 0 0\n", ""), ("YFLN 0 1.4E+1 0 0", "YFLD 0 14\nYFLN 0 14")]
    assert read(*old).field == ("angle_deg", 14.0)


def test_missing_vignetting_factors_do_not_remove_fields(read):
    lens = read(("VCYN 0 0 0 0", "VCYN 0.1"))
    assert lens.field == ("angle_deg", 14.0)
    assert lens.notes == "The file's vignetting factors are not used: its apertures vignette."
    bare = "8.0 1 0 0 1 \"\"\n  FLAP 0 8.0 0", "8.0 0"
    assert "there is no vignetting" in read(("VCYN 0 0 0 0", "VCYN 0 0.1"), bare).notes


@pytest.mark.parametrize("text, distance_mm", [("INFINITY", np.inf), ("1.0E+10", np.inf), ("120", 120.0)])
def test_object_distances(read, text, distance_mm):
    assert read(("DISZ INFINITY", f"DISZ {text}")).object_distance_mm == distance_mm


def test_the_reference_wavelength(read):
    assert read(("PWAV 2", "PWAV 3")).reference_wavelength_nm == pytest.approx(656.27)
    new = "WAVM 1 4.8613E-1 1\nWAVM 2 5.875618E-1 1\nWAVM 3 6.5627E-1 1\nWAVM 4 5.5E-1 1"
    old = (new, "WAVL 4.8613E-1 5.875618E-1 6.5627E-1")
    assert read(old).reference_wavelength_nm == pytest.approx(587.5618)
    assert read(old, ("PWAV 2", "PWAV 1")).reference_wavelength_nm == pytest.approx(486.13)


@pytest.mark.parametrize("line, glass", [
    ("GLAS ___BLANK 1 0 1.51680001 6.417E+1 0 0 0", "1.51680001/64.17"), ("GLAS 517642 0 0 1.5 40", "1.517/64.2"),
    ("GLAS n-bk7 0 0 1.5 40", "SCHOTT N-BK7"), ("GLAS LAK10C 0 0 1.5 40", "LAK10C"), ("GLAS S-LAL8 0 0", "S-LAL8"),
    ("GLAS ___BLANK 2 1 1.5 40", "___BLANK")])
def test_glasses(read, line, glass):
    assert read((GLASS, line)).surfaces[1].glass == glass


@pytest.mark.parametrize("line", ["GLAS LAK10C 0 0 1.5 40", "GLAS ___BLANK 2 1 1.5 40"])
def test_the_index_after_a_name_does_not_define_a_glass(read, line):
    """Zemax writes 1.5 and 40 after every glass name, whatever the glass."""
    with refused(LensError, field="surface 2, glass", value=line.split()[1], where="singlet"):
        build_system(read((GLASS, line)))


def test_the_files_index_of_an_unknown_glass_is_suggested(read):
    lens = read((GLASS, "GLAS RXGLASS 0 0 1.6511 55.89 0 0"))
    assert lens.surfaces[1].glass_figures == "1.6511/55.89"
    with refused(LensError, field="surface 2, glass", value="RXGLASS", match="1.6511/55.89"):
        build_system(lens)


def test_the_notes_state_which_configuration_is_used(read):
    text = ("MNUM 1 1\n", "MNUM 3 2\nTHIC 2 1 1 4.0 0\nTHIC 2 2 1 5.0 0\nTHIC 2 3 1 6.0 0\n")
    assert read(text).notes == "Configuration 2 of 3 is used, the active one when the file was saved."
    assert read().notes == ""


@pytest.mark.parametrize("makers, glass", [("HIKARI SCHOTT", "HIKARI SF10"), ("SCHOTT HIKARI", "SCHOTT SF10"),
                                           ("RXGLASS SCHOTT", "SCHOTT SF10"), ("OHARA", "SF10"), ("RXGLASS", "SF10")])
def test_the_files_catalogues_take_precedence(read, makers, glass):
    assert read(("GCAT SCHOTT", f"GCAT {makers}"), (GLASS, "GLAS SF10 0 0 1.5 40")).surfaces[1].glass == glass


def test_an_even_asphere_has_all_its_terms(read):
    terms = tuple(float(f"{number}e-{2 * number}") for number in range(1, 9))
    lines = "".join(f"  PARM {number} {term:.15E}\n" for number, term in enumerate(terms, 1))
    lens = read(("TYPE STANDARD\n  CURV -2.0E-2", f"TYPE EVENASPH\n{lines}  CURV -2.0E-2"))
    assert lens.surfaces[2] == replace(SURFACES[2], aspheric=terms)
    without_terms = read(("TYPE STANDARD\n  CURV -2.0E-2", "TYPE EVENASPH\n  PARM 1 0\n  CURV -2.0E-2"))
    assert without_terms.surfaces == SURFACES


def test_an_odd_asphere_has_all_its_terms(read):
    terms = tuple(float(f"{number}e-{2 * number}") for number in range(1, 9))
    lines = "".join(f"  PARM {number} {term:.15E}\n" for number, term in enumerate(terms, 1))
    lens = read(("TYPE STANDARD\n  CURV -2.0E-2", f"TYPE ODDASPHE\n{lines}  CURV -2.0E-2"))
    assert lens.surfaces[2] == replace(SURFACES[2], aspheric=terms[1::2], odd_aspheric=terms[::2])


FORM = "TYPE STANDARD\n  CURV -2.0E-2 0 0 0 0 \"\"\n  CONI -0.5"


def form(kind, conic, *parameters):
    """The rear surface of another kind: of radius -50 along y."""
    lines = "".join(f"\n  PARM {number} {value!r}" for number, value in enumerate(parameters, 1))
    return FORM, f"TYPE {kind}{lines}\n  CURV -2.0E-2\n  CONI {conic}"


@pytest.mark.parametrize("kind, conic, parameters, changes", [
    ("TOROIDAL", -0.5, (-80.0,), dict(radius_x_mm=-80.0, profile="y")),
    ("TOROIDAL", -0.5, (0.0, 0.0, 2e-6), dict(radius_x_mm=np.inf, profile="y", aspheric=(0.0, 2e-6, *5 * (0.0,)))),
    ("BICONICX", -0.5, (-80.0, 0.7), dict(radius_x_mm=-80.0, conic_x=0.7)),
    ("BICONICX", 0.0, (), dict(radius_x_mm=np.inf, conic=0.0))])
def test_the_sections_of_toroids_and_biconic_surfaces(read, kind, conic, parameters, changes):
    """CURV and CONI are those along y. The radius along x is the first parameter, and 0 for a plane section."""
    assert read(form(kind, conic, *parameters)).surfaces[2] == replace(SURFACES[2], **changes)


def test_a_toroid_is_scaled_to_mm(read):
    back = read(("UNIT MM", "UNIT CM"), form("TOROIDAL", -0.5, -80.0, 1e-3, 2e-5)).surfaces[2]
    assert (back.radius_mm, back.radius_x_mm, back.conic) == (pytest.approx(-500), pytest.approx(-800), -0.5)
    assert back.aspheric[:2] == pytest.approx((1e-4, 2e-8))


def broken(*breaks, rear=""):
    """The rear surface between coordinate breaks, each (parameters, thickness); 4 mm behind the front surface."""
    before, after = ([f"SURF 9\n  TYPE COORDBRK\n  CURV 0\n  DISZ {thickness}\n" + "".join(
        f"  PARM {number} {value!r}\n" for number, value in enumerate(parameters, 1)) for parameters, thickness in part]
        for part in (breaks[:1], breaks[1:]))
    return [("DISZ 4.0\n", "DISZ 3.0\n"), ("SURF 3\n", f"{''.join(before)}SURF 3\n{rear}"),
            ("SURF 4\n", f"{''.join(after)}SURF 4\n")]


def close(pose, offset_mm, tilt_deg):
    """Whether a pose has this offset and tilt."""
    return np.allclose(pose.offset_mm, offset_mm, atol=1e-9) and np.allclose(pose.tilt_deg, tilt_deg, atol=1e-9)


def test_a_returning_pair_of_coordinate_breaks_displaces_the_surface_between(read):
    """Decentred, then turned about x: +y goes towards +z, and the axis towards -y. The second break returns, from a
    plane as far behind the surface as that is behind the first break."""
    tilt, back = (0.3, -0.2, 3.0, 0.0, 0.0, 0), (-0.3, 0.2, -3.0, 0.0, 0.0, 1)
    lens = read(*broken((tilt, 1.0), ((), -1.0), (back, 48.5)), ("DISZ 4.75E+1", "DISZ 0"))
    lean, gap = np.radians(3.0), lens.surfaces[2]
    assert gap == Surface(thickness_mm=gap.thickness_mm, glass="SCHOTT N-BK7")
    assert gap.thickness_mm == pytest.approx(np.cos(lean))
    assert close(lens.surfaces[3].pose, (0.3, -0.2 - np.sin(lean), 0), (3, 0, 0)) and lens.image_pose is None
    assert sum(surface.thickness_mm for surface in lens.surfaces[1:]) == pytest.approx(3.0 + 48.5)


def test_turns_of_a_coordinate_break_follow_one_another(read):
    """About the turned axes; poses turn about fixed ones. The z axes of both agree."""
    tilt, back = (0.0, 0.0, 10.0, 20.0, 30.0, 0), (0.0, 0.0, -10.0, -20.0, -30.0, 1)
    pose = read(*broken((tilt, 1.0), (back, 47.5)), ("DISZ 4.75E+1", "DISZ 0"),
                form("TOROIDAL", -0.5, -80.0)).surfaces[3].pose
    x, y, z = np.radians((10, 20, 30))
    along_z = (np.sin(y), -np.sin(x) * np.cos(y), np.cos(x) * np.cos(y))  # by hand: about x of one turned about y
    along_x = (np.cos(y) * np.cos(z), *(np.array([[np.cos(x), -np.sin(x)], [np.sin(x), np.cos(x)]])
                                        @ [np.sin(z), -np.sin(y) * np.cos(z)]))
    turn = scipy.spatial.transform.Rotation.from_euler("xyz", pose.tilt_deg, degrees=True)  # about fixed axes
    assert turn.apply([0, 0, 1]) == pytest.approx(along_z) and turn.apply([1, 0, 0]) == pytest.approx(along_x)


def test_a_break_in_front_of_the_image_tilts_the_sensor(read):
    lens = read(("UNIT MM", "UNIT CM"), (LAST, f"DISZ 47.5\n{BREAK.format('PARM 2 0.5{0}  PARM 4 2').format(chr(10))}"))
    assert close(lens.image_pose, (0, 5, 0), (0, 2, 0)) and all(surface.pose is None for surface in lens.surfaces)


@pytest.mark.parametrize("degrees, changes", [
    (90.0, dict(radius_mm=-80.0, radius_x_mm=-50.0, conic=0.0, conic_x=-0.5, profile="x")),
    (180.0, dict(radius_x_mm=-80.0, profile="y")),
    (30.0, dict(radius_x_mm=-80.0, profile="y", pose=Pose(tilt_deg=(0.0, 0.0, 30.0))))])
def test_a_toroid_turned_about_the_axis(read, degrees, changes):
    """A quarter turn exchanges the two sections."""
    breaks = broken(((0, 0, 0, 0, degrees), 1.0), ((0, 0, 0, 0, -degrees), 47.5))
    lens = read(*breaks, ("DISZ 4.75E+1", "DISZ 0"), form("TOROIDAL", -0.5, -80.0))
    assert lens.surfaces[3] == replace(SURFACES[2], thickness_mm=0.0, **changes) and lens.image_pose is None


def test_circular_apertures_stop_light_and_automatic_semi_diameters_do_not(read):
    assert [surface.semi_aperture_mm for surface in read().surfaces] == [np.inf, 8.0, np.inf]
    assert read(("FLAP 0 8.0 0", "CLAP 0 7.0 0")).surfaces[1].semi_aperture_mm == 7.0
    assert read(("FLAP 0 8.0 0", "OBDC 0 0\n  CLAP 0 7.0 0")).surfaces[1].semi_aperture_mm == 7.0


def sizes(lens):
    return [surface.semi_aperture_mm for surface in lens.surfaces]


BARE = ("8.0 1 0 0 1 \"\"\n  FLAP 0 8.0 0", "8.0 0 0 0 1 \"\"")  # no surface has an aperture


@pytest.mark.parametrize("words, semi_mm", [
    ("7.5 1 0 0 1 \"\"", 7.5), ("7.5 0 0 0 1 \"\"", np.inf), ("0 1 0 0 1 \"\"", np.inf),
    ("7.5 3 0 0 1 \"\"", np.inf), ("7.5", 7.5), ("7.5 2 3 0 1 \"\"", 7.5),
    ("7.5 2 1 0 1 \"\"", np.inf), ("7.5 2 2 0 1 \"\"", np.inf),
    ("7.5 2 9 0 1 \"\"", np.inf)])
def test_a_fixed_semi_diameter_is_a_clear_aperture(read, words, semi_mm):
    """Surface 3 has a fixed one, surface 1 an automatic one; a pickup of its own value is not an aperture."""
    third = "DISZ 4.75E+1\n  DIAM 8.0 0", "DISZ 4.75E+1\n  DIAM 7.5 1"
    lens = read(("8.0 1 0 0 1 \"\"\n  FLAP 0 8.0 0", words), third, ("UNIT MM", "UNIT CM"))
    assert sizes(lens) == pytest.approx([np.inf, 10 * semi_mm, 75.0])
    count = 1 + int(np.isfinite(semi_mm))
    surfaces = f"{count} surface{'s' * (count > 1)}"
    assert f"The fixed semi-diameters, without CLAP or FLAP, of {surfaces} are used as clear apertures" in lens.notes


def test_semi_diameters_may_be_ignored(read, tmp_path):
    fixed = BARE[0], "7.5 1 0 0 1 \"\""
    read(fixed)
    lens = read_prescription(tmp_path / "lens.ZMX", ReadingOptions(semi_diameters="ignore"))
    assert sizes(lens) == 3 * [np.inf] and "of 1 surface are ignored." in lens.notes
    assert read(BARE).notes == "", "automatic ones need no word"
    with pytest.raises(LensError, match="--semi-diameters is maybe: expected aperture or ignore"):
        read_prescription(tmp_path / "lens.ZMX", ReadingOptions(semi_diameters="maybe"))


def test_an_aperture_takes_precedence_over_a_semi_diameter(read):
    lens = read(("FLAP 0 8.0 0", "CLAP 0 7.0 0"))
    assert sizes(lens) == [np.inf, 7.0, np.inf] and lens.notes == ""


def test_fixed_semi_diameters_vignette_like_apertures(read):
    """Vignetting by fixed semi-diameters; without them the edge is as bright as without vignetting."""
    fixed = "DISZ 4.75E+1\n  DIAM 8.0 0", "DISZ 4.75E+1\n  DIAM 2.6 1"
    aperture = "DISZ 4.75E+1\n  DIAM 8.0 0", "DISZ 4.75E+1\n  CLAP 0 2.6 0\n  DIAM 8.0 0"
    bright = [bake(read(BARE, *changes), quality="preview", heights=3, wavelengths_nm=[550.0],
                   samples=17, pitch_um=4.0).relative_illumination[0, -1] for changes in ([fixed], [aperture], [])]
    assert bright[0] == bright[1] < 0.95 * bright[2]


@pytest.mark.parametrize("figures", ["", "  PARM 1 0\n  PARM 2 0.0\n", "  PARM 5 30\n  PARM 6 1\n"])
def test_a_zero_coordinate_break_is_a_plane(read, figures):
    plane = f"SURF 3\n  TYPE COORDBRK\n{figures}  CURV 0\n  DISZ 2.5\nSURF 4\n"
    lens = read(("DISZ 4.0\n", "DISZ 1.5\n"), ("SURF 3\n", plane))
    assert lens.surfaces[2] == Surface(thickness_mm=2.5, glass="SCHOTT N-BK7")
    assert build_system(lens).efl_mm == pytest.approx(build_system(read()).efl_mm, rel=1e-12)


@pytest.mark.parametrize("air, reported", [("2.0E+1 1 0", False), ("20 1", False), ("50 1 0", True), ("20 0 0", True)])
def test_an_unusual_temperature_is_reported(read, air, reported):
    assert ("temperature and pressure" in read(("UNIT MM", f"ENVD {air}\nUNIT MM")).notes) == reported


@pytest.mark.parametrize("old, new, message", [
    (GLASS, "GLAS MIRROR 0 0 1.5 40", "mirrors is 1"),
    ("SURF 3\n", f"{BREAK.format('PARM 3 1e-3')}SURF 3\n", "image is tilted or decentred with the surfaces in front"),
    ("SURF 3\n", f"{BREAK.format('PARM 1 0.5')}SURF 3\n", "image is tilted or decentred with the surfaces in front"),
    ("SURF 3\n", f"{BREAK.format('PARM 3 95')}SURF 3\n", "image is tilted or decentred with the surfaces in front"),
    (GLASS, f"{GLASS}\n  SCBD 1 0 0 0 0 2.5 0 0", "surface 2 is tilted or decentred"),
    ("TYPE STANDARD\n  CURV 2.0E-2", "TYPE EVENASPH\n  PARM 9 1e-9\n  CURV 2.0E-2", "surface 2, PARM is 9: expected"),
    ("TYPE STANDARD\n  CURV 2.0E-2", "TYPE TOROIDAL\n  PARM 13 3\n  CURV 2.0E-2", "surface 2, PARM is 13: expected"),
    ("TYPE STANDARD\n  CURV 2.0E-2", "TYPE TOROIDAL\n  XDAT 1 3 0\n  CURV 2.0E-2", "surface 2, PARM is 13: expected"),
    ("TYPE STANDARD\n  CURV 2.0E-2", "TYPE BICONICX\n  PARM 3 1e-3\n  CURV 2.0E-2", "surface 2, PARM is 3: expected"),
    ("TYPE STANDARD\n  CURV 2.0E-2", "TYPE XANAMORPH\n  CURV 2.0E-2", "surface 2 is XANAMORPH: expected one of"),
    ("TYPE STANDARD\n  CURV 2.0E-2", "TYPE IRREGULA\n  CURV 2.0E-2", "surface 2 is IRREGULA: expected one of"),
    ("TYPE STANDARD\n  CURV 2.0E-2", "TYPE GRID_SAG\n  CURV 2.0E-2", "surface 2 is GRID_SAG: expected one of"),
    ("FLAP 0 8.0 0", "CLAP 0 8.0 0\n  OBDC 0 1.0", "surface 2, aperture is decentred: expected"),
    ("FLAP 0 8.0 0", "ELAP 4 3 0", "surface 2, aperture is ELAP: expected a circle, CLAP or FLAP, a rectangle"),
    ("FLAP 0 8.0 0", "SQAP 4 3 0\n  OBDC 1 0", "surface 2, aperture is decentred: expected a centred circle"),
    ("FLAP 0 8.0 0", "SQAP 4", "surface 2, half_widths_mm is (4.0,)"),
    ("FLAP 0 8.0 0", "OBSC 1 3 0", "surface 2, aperture is an obstruction in the shape of a ring: expected OBSC"),
    ("FLAP 0 8.0 0", "FLAP 0 x 0", "line 34 is FLAP 0 x 0: expected a number as word 3"),
    ("  STOP\n", "", "stop is at 0 surfaces"),
    ("SURF 3\n", "SURF 3\n  STOP\n", "stop is at 2 surfaces"),
    (GLASS, f"{GLASS}\nMODE NSC", "line 33 is MODE NSC: expected a sequential lens, MODE SEQ"),
    ("UNIT MM", "UNIT FT", "UNIT is FT: expected one of MM, CM, IN"),
    ("ENPD 5.0E+0\n", "", "aperture is missing: expected ENPD, FNUM, OBNA or FLOA"),
    ("ENPD 5.0E+0", "OBNA 5 1", "line 6 is OBNA 5 1: expected ENPD, FNUM, OBNA with 0"),
    ("ENPD 5.0E+0", "ENPD 0", "aperture, entrance_pupil_diameter_mm is 0.0"),
    ("FTYP 0 0", "FTYP 4 0", "field is of an unknown kind: give --field-angle or --field-height"),
    ("YFLN 0 1.4E+1", "YFLN 0 0", "field is only on the axis: give --field-angle"),
    ("FTYP 0 0", "FTYP 0 1", "FTYP is telecentric in object space"),
    ("FTYP 0 0", "FTYP 1 0", "field is object_height_mm: undefined for an object at infinity"),
    ("PWAV 2", "PWAV 7", "PWAV is 7: expected the number of one of the file's wavelengths"),
    ("DISZ INFINITY", "DISZ -5", "object_distance_mm is -5.0"),
    ("DISZ INFINITY", "DISZ nan", "object_distance_mm is nan"),
    ("DISZ INFINITY", "DISZ 9\n  GLAS SEAWATER 0 0", "object is in SEAWATER: expected air"),
    (LAST, f"{LAST}  GLAS F2 0 0\n", "surface 3, glass is SCHOTT F2: expected air before the image plane"),
    ("CURV 0.0 0 0 0 0 \"\"\n  DISZ 0", "CURV 0.01\n  DISZ 0", "image is not a plane: expected a flat object"),
    ("CURV 2.0E-2 0 0 0 0 \"\"\n", "", "surface 2 is without CURV or DISZ: the file may be cut off"),
    ("CURV 2.0E-2", "CURV nan", "surface 2, radius_mm is nan")])
def test_untraceable_lenses_are_errors_with_their_location(read, old, new, message):
    with pytest.raises(LensError) as error:
        read((old, new))
    assert f"lens.ZMX: {message}" in str(error.value)


@pytest.mark.parametrize("marker", ["SURF 4", "SURF 3", "SURF 2", "  DISZ 0\n  DIAM 1.2E+1", "SURF 1", "SURF 0"])
def test_a_truncated_file_is_not_read_as_a_shorter_lens(read, marker):
    with pytest.raises(LensError):
        read((ZEMAX[ZEMAX.index(marker):], ""))


@pytest.mark.parametrize("old, new, name", [
    (FRONT, "TYPE EVENASPH\n  XDAT 1 2\n  XDAT 3 1e-6\n  CURV 2.0E-2", "XDAT of surface 2"),
    (FRONT, "TYPE STANDARD\n  XDAT 3 1e-6 0\n  CURV 2.0E-2", "XDAT of surface 2"),
    (FRONT, "TYPE STANDARD\n  PARM 2 1e-6\n  CURV 2.0E-2", "PARM of surface 2"),
    ("DISZ INFINITY", "DISZ INFINITY\n  CLAP 0 9 0", "CLAP of surface 0"),
    ("DISZ INFINITY", "DISZ INFINITY\n  SQAP 9 9 0", "SQAP of surface 0")])
def test_figures_that_a_surface_does_not_use_are_noted(read, old, new, name):
    assert read((old, new)).notes == unread_note(name.split(", "))


def test_extra_data_of_zero_are_not_noted(read):
    assert not read((FRONT, "TYPE EVENASPH\n  XDAT 1 0 0\n  PARM 1 0\n  CURV 2.0E-2")).notes


def extended(shape, *data):
    """Replacement of the front of the singlet by an extended asphere with these extra data."""
    lines = "".join(f"  XDAT {number} {value} 0 0 1 0 0 0\n" for number, value in enumerate(data, 1))
    return FRONT, f"TYPE {shape}\n{lines}  CURV 2.0E-2"


@pytest.mark.parametrize("change, terms", [
    (extended("XASPHERE", 2, 1, 0, 1e-6), dict(aspheric=(0.0, 1e-6))),
    (extended("XASPHERE", 3, 4, 0.5, 0, -0.25), dict(aspheric=(0.5 / 4**2, 0.0, -0.25 / 4**6))),
    (extended("XOSPHERE", 4, 4, 0, 0, 0.5, -0.25), dict(odd_aspheric=(0.0, 0.5 / 4**3), aspheric=(0.0, -0.25 / 4**4))),
    (extended("XOSPHERE", 2, 10, 0, 0.5), dict(aspheric=(0.5 / 10**2,))),
    (extended("XASPHERE", 0, 0), {})])
def test_extended_aspheres(read, change, terms):
    assert read(change).surfaces[1] == replace(SURFACES[1], **terms)
    assert not read(change).notes


def test_an_extended_asphere_has_more_powers_than_sixteen(read, tmp_path):
    """Its coefficients are in the unit of the file, and are written beyond r^40."""
    data = (25, 0.5, *(0.0,) * 24, 1e-3)
    lens = read(extended("XASPHERE", *data), ("UNIT MM", "UNIT CM"))
    assert lens.surfaces[1].aspheric == (*(0.0,) * 24, pytest.approx(1e-3 * 10 / 5**50, rel=1e-12))
    (tmp_path / "written.toml").write_text(write_prescription(lens))
    assert read_prescription(tmp_path / "written.toml").surfaces == lens.surfaces


def test_unused_extra_data_of_an_extended_asphere_are_noted(read):
    lens = read(extended("XASPHERE", 1, 4, 0.5, 1e-3))
    assert lens.surfaces[1].aspheric == (0.5 / 4**2,) and lens.notes == unread_note(["XDAT of surface 2"])


@pytest.mark.parametrize("data, message", [
    ((2, 0, 0, 1e-6), "surface 2, XDAT 2 is 0: expected a positive normalisation radius"),
    ((1.5, 1, 0), "surface 2, XDAT 1 is 1.5: expected 0 to 100 terms"),
    ((1e9, 1, 0), "surface 2, XDAT 1 is 1e"), (("nan", 1, 0), "surface 2, XDAT 1 is nan")])
def test_an_invalid_extended_asphere_is_an_error(read, data, message):
    with pytest.raises(LensError, match=message):
        read(extended("XOSPHERE", *data))


def test_a_rectangular_aperture_is_read(read):
    """A semi-diameter next to it is not an aperture."""
    expected = replace(SURFACES[1], semi_aperture_mm=np.inf, half_widths_mm=(4.0, 6.0))
    lens = read(("FLAP 0 8.0 0", "SQAP 4 6 0"))
    assert lens.surfaces[1] == expected and not lens.notes
    assert read(("FLAP 0 8.0 0", "SQAP .4 .6 0"), ("UNIT MM", "UNIT CM")).surfaces[1].half_widths_mm == (4.0, 6.0)


def test_rectangles_that_clip_the_beam_are_noted(read):
    """The beam on surface 2 has a radius of 2.5 mm."""
    assert "Apertures clip the axial beam to 80% of its radius (surface 2)." in read(("FLAP 0 8.0 0", "SQAP 2 6")).notes
    assert "to 60% of its radius (surface 2)." in read(("FLAP 0 8.0 0", "SQAP 4 1.5")).notes


def test_a_rectangle_turns_with_a_coordinate_break(read):
    """A quarter turn exchanges its sides."""
    breaks = BREAK.format("PARM 5 {}").replace("SURF 4\n", "SURF {}\n")
    lens = read(("FLAP 0 8.0 0", "SQAP 4 6"), ("SURF 2\n", breaks.format(2, 90) + "SURF 3\n"),
                ("SURF 3\n  TYPE STANDARD\n  CURV -2", breaks.format(4, -90) + "SURF 5\n  TYPE STANDARD\n  CURV -2"),
                ("SURF 4\n  TYPE STANDARD", "SURF 6\n  TYPE STANDARD"))
    assert lens.surfaces[2].half_widths_mm == (6.0, 4.0) and lens.surfaces[2].pose is None
