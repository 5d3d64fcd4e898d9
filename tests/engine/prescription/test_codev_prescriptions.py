"""Code V .seq prescriptions: the commands read, their units, and refused content."""

from dataclasses import replace

import numpy as np
import pytest

from lens_texts import CODEV, SURFACES, reader_of
from lensfield.engine import LensError
from lensfield.engine.prescription.glasses import find_glass
from lensfield.engine.prescription.prescription import Pose, Prescription, Surface
from lensfield.engine.rays.focus import build_system
from lensfield.engine.runtime.unread import unread_note
from notes import unread
from refusals import refused

SINGLET = Prescription("singlet", SURFACES, ("entrance_pupil_diameter_mm", 5.0), ("angle_deg", 14.0),
                       reference_wavelength_nm=587.5618, source="lens.seq (Code V)")
NEAR = ("SO    0.0 0.1e14", "SO    0.0 250.0")
REAR = "  CON\n  K   -0.5\n"
CURVATURES = [("RDM;", "RDM N;"), ("S     50.0", "S     0.02"), ("S     -50.0", "S     -0.02")]


@pytest.fixture
def read(tmp_path):
    """Read the singlet's file with parts of it changed."""
    return reader_of(tmp_path / "lens.seq", CODEV)


def same(lens):
    """The lens, its wavelength rounded as in the file."""
    return replace(lens, reference_wavelength_nm=round(lens.reference_wavelength_nm, 6))


def test_a_singlet(read):
    assert same(read()) == SINGLET


@pytest.mark.parametrize("encoding", ["utf-8-sig", "latin-1", "utf-16"])
def test_encodings(read, encoding):
    """With a byte order mark before its first command, RDM N was lost: curvatures were read as radii."""
    text = [*CURVATURES, ("'singlet'", "'Schärfe'"), ("\n", "\r\n")]
    lens = read(*text, encoding=encoding)
    assert lens.name == "Schärfe" and lens.surfaces == SURFACES


@pytest.mark.parametrize("word", ["N", "NO", "n"])
def test_curvatures(read, word):
    assert read(("RDM;", f"RDM {word};"), *CURVATURES[1:]).surfaces == SURFACES


def test_a_missing_rdm_command_is_an_error(read):
    with pytest.raises(LensError, match="RDM is missing: expected RDM, for radii, or RDM N, for curvatures"):
        read(("RDM;", ""))


@pytest.mark.parametrize("unit, mm", [("C", 10.0), ("I", 25.4), ("MM", 1.0), ("i", 25.4)])
def test_units(read, unit, mm):
    lens = read(("DIM   M", f"DIM   {unit}"), NEAR, ("YAN", "YOB"), ("XAN", "XOB"), ("CON\n", "ASP\n  A 2e-5\n"))
    front, back = lens.surfaces[1:]
    assert (front.radius_mm, front.thickness_mm, front.semi_aperture_mm) == pytest.approx((50 * mm, 4 * mm, 8 * mm))
    assert back.aspheric == pytest.approx((0, 2e-5 / mm**3)) and back.conic == -0.5
    assert lens.aperture == ("entrance_pupil_diameter_mm", pytest.approx(5 * mm))
    assert lens.field == ("object_height_mm", pytest.approx(14 * mm))
    assert lens.object_distance_mm == pytest.approx(250 * mm)


@pytest.mark.parametrize("line, aperture", [
    ("EPD 4", ("entrance_pupil_diameter_mm", 4.0)), ("FNO 4", ("working_f_number", 4.0)),
    ("NA 0.125", ("working_f_number", 4.0)), ("NAO 0.01", ("object_na", 0.01))])
def test_apertures(read, line, aperture):
    """FNO is the working f-number at the conjugates in use; for an object at infinity it is the f-number."""
    assert read(("EPD   5.0", line), NEAR).aperture == aperture


def test_the_f_number_at_infinity_is_focal_length_over_pupil(read):
    system = build_system(read(("EPD   5.0", "FNO 4")))
    assert system.stop_semi_aperture_mm == pytest.approx(system.efl_mm / 8, rel=1e-9)


@pytest.mark.parametrize("pairs, field", [
    ([], ("angle_deg", 14.0)), ([("YAN", "YIM"), ("XAN", "XIM")], ("image_height_mm", 14.0)),
    ([("YAN   0.0 14.0", "YIM 0.0 -14.0"), ("XAN   0.0 0.0\n", "")], ("image_height_mm", 14.0)),
    ([("YAN", "YIM"), ("XAN   0.0 0.0", "XIM -3 48")], ("image_height_mm", 50.0)),
    ([("YAN   0.0 14.0", "YAN 0.0 14.0 &\n 17.0"), ("XAN   0.0 0.0", "XAN 0 0 0")], ("angle_deg", 17.0)),
    ([("XAN   0.0 0.0", "XAN 0.0")], ("angle_deg", 14.0))])
def test_fields(read, pairs, field):
    assert read(*pairs).field == field


@pytest.mark.parametrize("token, glass", [
    ("NBK7_SCHOTT", "SCHOTT N-BK7"), ("N-BK7_SCHOTT", "SCHOTT N-BK7"), ("'nbk7_schott'", "SCHOTT N-BK7"),
    ("NBK7", "NBK7"), ("1.5168:64.17", "1.5168/64.17"), ("517642", "1.517/64.2"), ("517.642", "1.517/64.2"),
    ("516800.641673", "1.5168/64.1673"), ("003283", "2.003/28.3"), ("500.700", "1.5/70"),
    ("SLAL8_OHARA", "OHARA S-LAL8"), ("LAK10C_RXGLASS", "LAK10C"), ("SF10_HIKARI", "HIKARI SF10"), ("AIR", "")])
def test_glasses(read, token, glass):
    assert read(("NBK7_SCHOTT", token)).surfaces[1].glass == glass


def test_a_bare_name_matches_without_its_hyphen(read):
    named, full = (build_system(read(("NBK7_SCHOTT", token))).efl_mm for token in ("NBK7", "N-BK7_SCHOTT"))
    assert named == full


def with_private_glass(read, lines):
    return read(("SO ", f"PRV\n{lines}\nEND\nSO "), ("NBK7_SCHOTT", "'MyGlass'"))


def test_an_undefined_private_glass_is_an_error(read):
    with refused(LensError, field="surface 2, glass", value="MYGLASS", where="singlet"):
        build_system(read(("NBK7_SCHOTT", "MYGLASS")))


@pytest.mark.parametrize("nm", [(656.27, 587.56, 486.13), (700, 650, 600, 550, 500, 450, 400), (656.27, 486.13),
                                (1000, 700, 580, 480, 380)])
def test_indices_of_a_private_glass_are_fitted(read, nm):
    """The indices of N-BK7, to the four decimals that such tables give."""
    indices = find_glass("SCHOTT N-BK7", "", "").index_at(nm)
    words = " ".join(f"{value:.4f}" for value in indices)
    lens = with_private_glass(read, f" PWL {nm[0]}&\n {' '.join(map(str, nm[1:]))}\n 'MYGLASS' {words}")
    glass, = lens.glasses
    assert lens.surfaces[1].glass == glass.name == "MYGLASS"
    assert glass.index_at(nm) == pytest.approx(indices, abs=2e-4)
    assert ("extrapolated over the visible" in lens.notes) == (min(nm) > 380)
    assert build_system(lens).efl_mm == pytest.approx(build_system(read()).efl_mm, rel=5e-4)


def test_a_private_glass_may_be_a_laurent_series(read):
    """NOA61 as in a public file; its maker states 1.56 at the d line."""
    figures = "2.36390625 0.0 0.025493134 -0.000580235 -0.349933e-5 0.4e-7"
    lens = with_private_glass(read, f" PWL 550.0\n 'MYGLASS' LAU {figures}")
    um, (glass,) = 0.5876, lens.glasses
    by_hand = np.sqrt(2.36390625 + 0.025493134 / um**2 - 0.000580235 / um**4 - 0.349933e-5 / um**6 + 0.4e-7 / um**8)
    assert glass.index_at([587.6]) == pytest.approx([by_hand], rel=1e-12) and by_hand == pytest.approx(1.56, abs=2e-3)


@pytest.mark.parametrize("lines, message", [
    (" PWL 650 450\n 'MYGLASS' 1.51", "PRV is 'MYGLASS' 1.51: expected LAU and coefficients, or an index above 1"),
    (" PWL 650\n 'MYGLASS' 1.51", "PRV is 'MYGLASS' 1.51: expected LAU"),
    (" PWL 650 450\n 'MYGLASS' 0.51 0.52", "PRV is 'MYGLASS' 0.51 0.52: expected LAU"),
    (" PWL 650 450\n 'MYGLASS' HAR 1 2", "PRV is 'MYGLASS' HAR 1 2: expected a number as word 2"),
    (" PWL 700 600 550 500 450 400\n 'MYGLASS' 1.51 1.512 1.7 1.516 1.52 1.525", "private glass MYGLASS is .* off")])
def test_an_invalid_private_glass_is_an_error(read, lines, message):
    with pytest.raises(LensError, match=message):
        with_private_glass(read, lines)


@pytest.mark.parametrize("token, glass", [("BK7_SCHOTT", "SCHOTT N-BK7"), ("SK16_SCHOTT", "SCHOTT N-SK16")])
def test_a_discontinued_glass_is_replaced_and_noted(read, token, glass):
    lens = read(("NBK7_SCHOTT", token))
    assert lens.surfaces[1].glass == glass
    assert lens.notes == f"{glass} is used for the discontinued glass SCHOTT {token.split('_')[0]}."


def test_a_glass_is_taken_only_from_the_files_catalogue(read):
    with refused(LensError, field="surface 2, glass", value="OHARA BK7", where="singlet"):
        build_system(read(("NBK7_SCHOTT", "BK7_OHARA")))


def test_zero_tilts_are_ignored(read):
    zeros = "  XDE 0.0; YDE 0.0; ZDE 0.0\n  ADE 0.0; BDE 0.0; CDE 0.0\n  DAR\n"
    assert same(read(("  CON\n", f"  CON\n{zeros}"))) == SINGLET


@pytest.mark.parametrize("pairs", [
    [("  STO\n", ""), ("SO ", "STO S1\nSO ")], [("  STO\n", ""), ("GO\n", "STO S1\n")], [("2.0\n  STO", "2.0 ; STO")],
    [("S     0.0 2.0\n", "S 0.0 &\n 2.0 ! the stop; S 9 9\n")], [("TITLE 'singlet'", 'tit "x; S 1 2"; title singlet')]],
    ids=["before", "after", "semicolon", "continued", "quoted"])
def test_equivalent_notations_give_the_same_lens(read, pairs):
    assert same(read(*pairs)) == SINGLET


def test_a_title_may_contain_a_semicolon(read):
    assert same(read(("'singlet'", "'one; STO; two'"))) == replace(SINGLET, name="one, STO, two")


@pytest.mark.parametrize("before", ["SI ", "GO\n"], ids=["after the last surface", "after the image"])
@pytest.mark.parametrize("commands", [
    "CON {0}\nASP {0}\nK {0} -0.4; A {0} 1e-5; B {0} -2e-7; D {0} 0.0; J {0} 1e-30",
    "CYL {0}; CUX {0} 0.0", "YTO {0}; RDX {0} -80.0; A {0} 2e-6", "XTO {0}; CUX {0} 0.01; K {0} -0.5; B {0} 1e-9",
    "AAS {0}; CUX {0} -0.0125; KX {0} 0.7; KY {0} -0.5; AR {0} 2e-6; AP {0} 0.1; DR {0} 1e-20; DP {0} 3.0",
    "DAR {0}; XDE {0} 0.3; YDE {0} -0.2; ADE {0} 2.0; CDE {0} 1.0", "CIR {0} 6.5", "CIR {0} CLR 6.5", "CIR CLR {0} 6.5",
    "CIR {0} EDG 6.5", "CIR {0} OBS 1.5; CIR {0} 6.5"])
def test_commands_may_name_their_surface(read, commands, before):
    """They were lost behind SI: an aspheric singlet was read as a sphere."""
    here = read((REAR, f"{commands.format('')}\n"))
    named = read((REAR, ""), (before, f"{commands.format('S3')}\n{before}"))
    assert named == here and not here.notes


def test_commands_may_name_several_surfaces(read):
    lens = read((REAR, ""), ("GO\n", "K S2..3 -0.4; K s3 0.2; CIR SI 9; K SO 1; STO S1\nGO\n"))
    assert [surface.conic for surface in lens.surfaces] == [0.0, -0.4, 0.2]
    assert lens.notes == unread_note(["K of SO", "CIR of SI"])


def test_a_sphere_loses_its_asphere(read):
    assert read((REAR, ""), ("GO\n", "K S3 -0.5\nCYL S3; CUX S3 0.1; SPH S3\nGO\n")).surfaces[2].conic == 0.0


def test_a_stop_number_counts_from_the_first_surface(read):
    assert [surface.stop for surface in read(("  STO\n", ""), ("SO ", "STO S3\nSO ")).surfaces] == [False, False, True]


def test_an_asphere_begins_with_the_fourth_power(read):
    lens = read(("CON\n  K   -0.5", "ASP\n  K -0.5; IC Yes; CUF 0.0\n  A 0.1e-4; B -2e-7; C&\n 3e-9; D 0.0\n  J 1e-30"))
    assert lens.surfaces[2] == replace(SURFACES[2], aspheric=(0, 1e-5, -2e-7, 3e-9, 0, 0, 0, 0, 0, 1e-30))


def test_a_conic_constant_is_read(read):
    assert read().surfaces[2].conic == -0.5


def test_defocus_moves_the_image_plane(read):
    assert read(("SI    0.0 0.0", "SI    0.0 -0.4")).surfaces[2].thickness_mm == pytest.approx(47.1)


def test_clear_apertures_stop_light_and_edges_do_not(read):
    assert [surface.semi_aperture_mm for surface in read().surfaces] == [np.inf, 8.0, np.inf]
    assert read(("CIR 8.0\n", "CIR CLR 7.0\n")).surfaces[1] == replace(SURFACES[1], semi_aperture_mm=7.0)


def test_rectangular_apertures_stop_light(read):
    rectangle = replace(SURFACES[1], semi_aperture_mm=np.inf, half_widths_mm=(6.0, 7.5))
    for lines in ("REX 6.0; REY 7.5", "REY CLR 7.5\nREX CLR 6.0", "REX 6; REY 7.5; REX EDG 9; REY EDG 9"):
        lens = read(("CIR 8.0\n  CIR EDG 9.0\n", f"{lines}\n"), ("GO\n", "REX SI 9\nREY SI 9\nGO\n"))
        assert lens.surfaces[1] == rectangle and lens.notes == unread_note(["REX of SI", "REY of SI"])
    assert read(("DIM   M", "DIM   C"), ("CIR 8.0\n", "REX 0.6; REY 0.75\n")).surfaces[1].half_widths_mm == (6.0, 7.5)


def test_a_turned_rectangle_keeps_its_turn(read):
    lens = read(("CIR 8.0\n", "REX 6; REY 7; DAR; CDE 90\n"), (REAR, "  REX 2; REY 3; DAR; CDE 30\n"))
    assert lens.surfaces[1].half_widths_mm == (7.0, 6.0) and lens.surfaces[1].pose is None
    assert lens.surfaces[2].half_widths_mm == (2.0, 3.0) and lens.surfaces[2].pose == Pose(tilt_deg=(0.0, 0.0, 30.0))


def test_object_distances(read):
    assert np.isinf(read().object_distance_mm) and read(NEAR).object_distance_mm == 250.0
    assert np.isinf(read(("SO    0.0 0.1e14", "SO 0 inf")).object_distance_mm)


def test_unused_vignetting_factors_are_noted(read):
    assert "its apertures vignette" in read(("SO ", "VUY 0.0 0.2\nSO ")).notes
    assert "there is no vignetting" in read(("SO ", "VLY 0.0 0.2\nSO "), ("  CIR 8.0\n", "")).notes
    assert read(("SO ", "VUY 0.0 0.0\nSO ")).notes == ""


def test_the_first_of_several_zoom_positions_is_used(read):
    lens = read(("GO\n", "ZOO 3\nZOO THI S3 47.5 40.0 30.0\nGO\n"))
    assert lens.surfaces == SURFACES
    assert lens.notes == "The first of the file's 3 zoom positions is used."


@pytest.mark.parametrize("old, new, message", [
    ("  STO\n", "  STO\n  ADE 1.0\n", "image is tilted or decentred with the surfaces in front of it"),
    ("  STO\n", "  STO\n  YDE 1.0; REV\n", "image is tilted or decentred with the surfaces in front of it"),
    ("  STO\n", "  STO\n  ADE 1.0; BEN\n", "surface 1 is BEN: expected tilts and decentres that return"),
    ("  STO\n", "  STO\n  ADE 1.0; RET S1\n", "surface 1 is RET S1: expected tilts and decentres that return"),
    ("  STO\n", "  STO\n  ADE 1.0; DAR; ZOD 2.0\n", "surface 1 is ZOD 2.0: expected tilts about the vertex"),
    ("0.1e14\n", "0.1e14\n  YDE 1.0\n", "SO is tilted or decentred: expected an object plane on the axis"),
    ("  CON\n", "  CYL; RDX 20.0\n", "surface 3 is K -0.5: expected one of CUX, RDX on a surface CYL"),
    ("  CON\n  K   -0.5\n", "  CYL; RDX 20.0\n", "surface 3 is S -50.0 47.5: expected a cylinder (CYL) to be curved"),
    ("  CON\n", "  RDX 20.0\n", "surface 3 is RDX 20.0: expected one of K, A, B"),
    ("  CON\n", "  YTO\n", "surface 3 is S -50.0 47.5: expected the curvature along x, CUX, of a surface YTO"),
    ("  CON\n", "  YTO; CUX 0; AR 1e-6\n", "surface 3 is AR 1e-6: expected one of K, A, B"),
    ("  CON\n", "  AAS; CUX 0; A 1e-6\n", "surface 3 is A 1e-6: expected one of K, KY, KX"),
    ("  CON\n", "  AAS; CUX S3 x\n", "surface 3 is CUX x: expected a number as word 2"),
    ("GO\n", "REX S1 OBS 6\nGO\n", "surface 1 is REX OBS 6: expected REX and the half-width of a clear aperture"),
    ("GO\n", "K S4..5 0.1\nGO\n", "command is K S4..5 0.1: expected one surface, S0 to S4, or several such as S1..3"),
    ("GO\n", "K SA 0.1\nGO\n", "command is K SA 0.1: expected one surface"),
    ("GO\n", "K S1 S2 0.1\nGO\n", "command is K S1 S2 0.1: expected one surface"),
    ("GO\n", "K S3..2 0.1\nGO\n", "command is K S3..2 0.1: expected one surface"),
    ("GO\n", "K S2 Z2 0.1\nGO\n", "surface 2 is K Z2 0.1: expected one number"),
    ("GO\n", "DAR S2 0.1\nGO\n", "surface 2 is DAR 0.1: expected no number"),
    ("GO\n", "GLA S1 SF6_SCHOTT\nGO\n", "surface 1 is GLA S1 SF6_SCHOTT: expected radius, thickness and glass"),
    ("  CON\n", "  GLA SF6\n", "surface 3 is GLA SF6: expected radius, thickness and glass"),
    ("  CON\n", "  SPS SXX\n", "surface 3 is SPS SXX: expected a conic or an asphere"),
    ("GO\n", "UDS S2\nGO\n", "surface 2 is UDS S2: expected a conic or an asphere"),
    ("S     -50.0 47.5", "S -50.0 47.5 AIR REFL", "surface 3 is S -50.0 47.5 AIR REFL: expected a radius or curvature"),
    ("GO\n", "A 1e-6\nGO\n", "SI is not a plane in air: expected a flat object and a flat image"),
    ("GO\n", "A SI 1e-6\nGO\n", "SI is not a plane in air: expected a flat object and a flat image"),
    ("GO\n", "CYL SO; CUX SO 0.1\nGO\n", "SO is not a plane in air: expected a flat object and a flat image"),
    ("  CON\n", "  UDS\n", "surface 3 is UDS: expected a conic or an asphere"),
    ("NBK7_SCHOTT", "REFL", "mirrors is 1"),
    ("  CON\n", "  SPS ODD\n", "surface 3 is SPS ODD: expected a conic or an asphere"),
    ("  CON\n", "  DIF DOE\n", "surface 3 is DIF DOE: expected a conic or an asphere"),
    ("CIR 8.0\n", "CIR ABC 8.0\n", "surface 2 is CIR ABC 8.0: expected CIR and the radius of a clear aperture, or CIR"),
    ("CIR 8.0\n", "CIR\n", "surface 2 is CIR: expected CIR and the radius of a clear aperture"),
    ("CIR 8.0\n", "REX 8.0\n", "surface 2 is REX 8.0: expected both half-widths of a rectangular aperture"),
    ("CIR 8.0\n", "REX OBS 8.0\n", "surface 2 is REX OBS 8.0: expected REX and the half-width of a clear aperture"),
    ("CIR 8.0\n", "REX 0; REY 4\n", "surface 2, half_widths_mm is (0.0, 4.0)"),
    ("CIR 8.0\n", "ADY 1.0\n", "surface 2 is ADY 1.0: expected centred circular (CIR) or rectangular apertures"),
    ("CIR 8.0\n", "THI S1 5\n", "surface 1 is THI S1 5: expected radius, thickness and glass on the line of"),
    ("S     50.0 4.0", "S     5O.0 4.0", "surface 2 is S 5O.0 4.0 NBK7_SCHOTT: expected a radius"),
    ("S     50.0 4.0 NBK7", "S     50.0 NBK7", "surface 2 is S 50.0 NBK7_SCHOTT: expected a radius or curvature"),
    ("DIM   M", "DIM   F", "DIM is F: expected one of M, C, I"),
    ("EPD   5.0\n", "", "aperture is missing: expected one of EPD, FNO, NAO, NA"),
    ("EPD   5.0", "EPD   x", "command is EPD x: expected a number as word 2"),
    ("EPD   5.0", "EPD", "command is EPD: expected a number as word 2"),
    ("EPD   5.0", "NA 0", "aperture, working_f_number is 0.0"),
    ("REF   2", "REF   0", "REF is 0: expected the number of one of the file's wavelengths"),
    ("REF   2", "REF   4", "REF is 4: expected the number of one of the file's wavelengths"),
    ("WL    656.27 587.5618 486.13", "", "REF is 2: expected the number of one of the file's wavelengths"),
    ("XAN   0.0 0.0\nYAN   0.0 14.0", "YRI 0.0 14.0", "field is of an unknown kind: give --field-angle"),
    ("YAN   0.0 14.0", "YAN   0.0 0.0", "field is only on the axis: give --field-angle"),
    ("  STO\n", "", "stop is at 0 surfaces"),
    ("CIR EDG 9.0", "STO", "stop is at 2 surfaces"),
    ("SI    0.0 0.0\n", "", "surfaces is 4: expected SO, S ... and SI"),
    ("SI    0.0 0.0", "SI    -20.0 0.0", "SI is not a plane in air: expected a flat object and a flat image"),
    ("SO    0.0 0.1e14", "SO    0.0 nan", "surface 0 is SO 0.0 nan: expected a radius or curvature"),
    ("S     -50.0 47.5", "S     -50.0 47.5 F2", "surface 3, glass is F2: expected air before the image plane")])
def test_untraceable_lenses_are_errors_with_their_location(read, old, new, message):
    with pytest.raises(LensError) as error:
        read((old, new))
    assert f"lens.seq: {message}" in str(error.value)


def test_a_surface_without_figures_is_a_plane(read):
    """A bare S is a plane of zero thickness."""
    lens = read(("S     -50.0 47.5", "S\nS     -50.0 47.5"))
    assert lens.surfaces[2] == Surface()


@pytest.mark.parametrize("lines, changes", [
    ("  CYL\n", dict(radius_x_mm=np.inf, conic=0.0)),
    ("  CYL; CUX 0.0\n", dict(radius_x_mm=np.inf, conic=0.0)),
    ("  YTO; RDX -80.0; K -0.5; A 2e-6; B 3e-9\n", dict(radius_x_mm=-80.0, profile="y", aspheric=(0.0, 2e-6, 3e-9))),
    ("  YTO; CUX -0.0125; K -0.5\n", dict(radius_x_mm=-80.0, profile="y")),
    ("  XTO; RDX 0.0; K -0.5; A 2e-6\n",
     dict(radius_x_mm=np.inf, profile="x", conic=0.0, conic_x=-0.5, aspheric=(0.0, 2e-6))),
    ("  AAS; CUX -0.0125; KX 0.7; KY -0.5; AR 2e-6; CR 1e-12; AP 0.1; BP 9.0; CP -0.2; DP 3.0\n",
     dict(radius_x_mm=-80.0, conic_x=0.7, aspheric=(0.0, 2e-6, 0.0, 1e-12), skews=(0.0, 0.1, 9.0, -0.2)))])
def test_cylinders_toroids_and_anamorphic_aspheres(read, lines, changes):
    """The line of the surface has the curvature along y; CUX and RDX are along x."""
    assert read((REAR, lines)).surfaces[2] == replace(SURFACES[2], **changes)
    assert not unread(read((REAR, lines)).notes)


def test_a_cylinder_may_be_curved_along_x(read):
    rear = read(("S     -50.0 47.5", "S     0.0 47.5"), (REAR, "  CYL; RDX -50.0\n")).surfaces[2]
    assert rear == replace(SURFACES[2], radius_mm=np.inf, radius_x_mm=-50.0, conic=0.0)


def test_an_anamorphic_asphere_is_scaled_to_mm(read):
    lens = read(("DIM   M", "DIM   C"), (REAR, "  AAS; RDX -80.0; AR 2e-5; AP 0.3\n  DAR; YDE 0.1; ADE 2.0\n"))
    rear = lens.surfaces[2]
    assert (rear.radius_x_mm, rear.aspheric, rear.skews) == (-800.0, (0.0, pytest.approx(2e-8)), (0.0, 0.3))
    assert rear.pose.offset_mm == pytest.approx((0, 1, 0)) and rear.pose.tilt_deg == (-2.0, 0.0, 0.0)


@pytest.mark.parametrize("lines, offset_mm, tilt_deg", [
    ("ADE 3.0", (0, 0, 0), (-3, 0, 0)), ("BDE 3.0", (0, 0, 0), (0, -3, 0)), ("CDE 3.0", (0, 0, 0), (0, 0, 3)),
    ("XDE 0.3; YDE -0.2", (0.3, -0.2, 0), (0, 0, 0))])
def test_a_surface_is_displaced_and_returns(read, lines, offset_mm, tilt_deg):
    """ADE and BDE are left-handed: for a positive ADE, the axis of the surface goes towards +y."""
    lens = read((REAR, f"  YTO; RDX -80.0; K -0.5\n  DAR; {lines}\n"))
    assert lens.surfaces[2] == replace(SURFACES[2], radius_x_mm=-80.0, profile="y", pose=Pose(offset_mm, tilt_deg))
    assert lens.image_pose is None


def test_the_axis_stays_displaced_until_it_is_reversed(read):
    """The lens turns about the vertex of its first surface; a plane there, reached backwards, returns."""
    lens = read(("  CIR 8.0\n", "  CIR 8.0\n  XDE 0.1; ADE 3.0\n"), ("-50.0 47.5", "-50.0 -4.0"),
                (REAR, f"{REAR}S 0.0 51.5\n  XDE 0.1; ADE 3.0; REV\n"))
    front, rear, plane = lens.surfaces[1:]
    lean = np.radians(3.0)
    assert front.pose == Pose((0.1, 0.0, 0.0), (-3.0, 0.0, 0.0))
    assert front.thickness_mm == pytest.approx(4 * np.cos(lean))
    assert rear.pose.offset_mm == pytest.approx((0.1, 4 * np.sin(lean), 0)) and rear.pose.tilt_deg == (-3.0, 0.0, 0.0)
    assert plane.pose == front.pose and plane.thickness_mm == 51.5 and lens.image_pose is None
    assert front.thickness_mm + rear.thickness_mm == pytest.approx(0.0, abs=1e-9)


def test_the_image_plane_may_be_displaced(read):
    lens = read(("SI    0.0 0.0", "SI    0.0 0.0\n  YDE 1.5; BDE 2.0"))
    assert lens.image_pose == Pose((0.0, 1.5, 0.0), (0.0, -2.0, 0.0)) and lens.surfaces == SURFACES


def test_a_shift_along_the_axis_changes_thicknesses(read):
    lens = read(NEAR, ("XAN   0.0 0.0\nYAN", "YOB"), ("  STO\n", "  STO\n  ZDE 0.5; DAR\n"))
    assert (lens.object_distance_mm, lens.surfaces[0].thickness_mm) == (250.5, 1.5)
