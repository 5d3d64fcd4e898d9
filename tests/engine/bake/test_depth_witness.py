"""Blur discs out of focus, against a lens that Optiland reads and traces itself, if installed by `make test-bake`.

Small versions of `validation/depth_second_truth.py`, with the same limits.
"""

import pytest

pytest.importorskip("optiland", reason="the second truth of depth is Optiland's: make test-bake")

from depth_second_truth import CASES, NM, PRESCRIPTIONS, Judged, with_glasses  # noqa: E402
from depth_witness import ANAMORPHIC, MIRRORS, JudgedDesign  # noqa: E402
from foreign_lens import ForeignLens  # noqa: E402

SURFACES_CM = (
    (2.1413, 0.33, "N-SK4", 1.05), (None, 0.19, "", 1.05), (-7.42, 0.11, "N-BAF4", 1.05), (2.08, 0.3, "", 1.05),
    (None, 0.3, "STOP", None), (-11.13, 0.11, "N-KF9", 0.85), (2.52, 0.3, "N-SK4", 0.85), (-3.7113, 9.0907, "", 0.85))
"""Radius, thickness, glass, clear semi-diameter, in cm: Rudolph's Tessar, US 721,240, 100 mm, current Schott glasses.
"""
HEAD = """VERS 140124 258 36214
MODE SEQ
NAME Tessar in centimetres
UNIT CM X W X CM MR CPMM
FNUM {f_number:g} 0
GCAT SCHOTT
FTYP 0 0 2 1 0 0 0
XFLN 0 0 0 0 0 0 0 0 0 0 0 0
YFLN 0 25 0 0 0 0 0 0 0 0 0 0
FWGN 1 1 1 1 1 1 1 1 1 1 1 1
WAVM 1 0.589 1
PWAV 1
"""
FOCUS_MM, NEAR_MM, FAR_MM = 2500.0, 1100.0, 9000.0


def write_tessar(path, f_number=5.5):
    """The lens as a .zmx file."""
    lines = [HEAD.format(f_number=f_number), surface(0, None, "INFINITY", "", None)]
    lines += [surface(number, *each) for number, each in enumerate(SURFACES_CM, 1)]
    path.write_text("".join([*lines, surface(len(SURFACES_CM) + 1, None, 0, "", None)]))
    return path


def surface(number, radius_cm, thickness_cm, glass, semi_diameter_cm):
    curvature = 1 / radius_cm if radius_cm else 0.0
    lines = [f"SURF {number}"] + ["  STOP"] * (glass == "STOP") + [
        "  TYPE STANDARD", f"  CURV {curvature:.15E} 0 0 0 0 \"\"", f"  DISZ {thickness_cm}"]
    if glass not in ("", "STOP"):
        lines.append(f"  GLAS {glass} 0 0 1.5 40.0 0 0 0 0 0 0")
    if semi_diameter_cm:
        lines += [f"  DIAM {semi_diameter_cm} 1 0 0 1 \"\"", f"  FLAP 0 {semi_diameter_cm} 0"]
    return "\n".join(lines) + "\n"


@pytest.fixture(scope="module")
def tessar(tmp_path_factory):
    return Judged(write_tessar(tmp_path_factory.mktemp("tessar") / "tessar.zmx"), FOCUS_MM)


def test_both_read_the_same_lens_in_centimetres(tessar):
    assert tessar.foreign.efl_mm == pytest.approx(99.9, abs=0.5) == tessar.lens.efl_mm
    assert tessar.lens.efl_mm == pytest.approx(tessar.foreign.efl_mm, rel=1e-6)
    assert tessar.lens.entrance_pupil_mm == pytest.approx(tessar.foreign.entrance_pupil_mm, abs=1e-5)


@pytest.mark.parametrize("hidden", [False, True], ids=["free", "behind an edge"])
@pytest.mark.parametrize("depth_mm, tangent", [(NEAR_MM, 0.0), (NEAR_MM, 0.22), (FAR_MM, 0.4)])
def test_lamps_out_of_focus(tessar, depth_mm, tangent, hidden):
    deviation = tessar.lamp(depth_mm, tangent, hidden)
    assert not deviation.missed, deviation
    assert hidden or not tangent or deviation.oval < 0.96, "the lens cuts no cat's eye: nothing is tested of vignetting"


@pytest.mark.parametrize("depth_mm, tangent", [(NEAR_MM, 0.22), (FAR_MM, 0.4)])
def test_psfs_at_a_depth(tessar, depth_mm, tangent):
    deviation = tessar.psf(depth_mm, tangent)
    assert not deviation.missed, deviation


@pytest.mark.parametrize("f_number, focus_mm", [(5.55, FOCUS_MM), (5.5, 1.02 * FOCUS_MM)])
def test_a_slightly_different_lens_is_detected(tessar, tmp_path, monkeypatch, f_number, focus_mm):
    """A stop 1 % smaller, and a focus 2 % farther away."""
    other = ForeignLens(write_tessar(tmp_path / "other.zmx", f_number), NM, focus_mm)
    monkeypatch.setattr(tessar, "foreign", other)
    assert tessar.lamp(NEAR_MM, 0.0).missed


@pytest.mark.parametrize("case", CASES, ids=[case.file for case in CASES])
def test_real_lenses(case, tmp_path):
    path = PRESCRIPTIONS / case.file
    if not path.is_file():
        pytest.skip(f"{path} is not there: real prescriptions are not the project's to give")
    judged = Judged(with_glasses(path, case.glasses, tmp_path), case.focus_mm, case.stop_mm)
    deviation = judged.lamp(case.depths_mm[0], case.tangents[1])
    assert not deviation.missed, deviation


def test_lamps_through_an_anamorphic_lens():
    """Near the axis behind an edge, and far off the axis."""
    judged = JudgedDesign(*ANAMORPHIC)
    for lamp in ((1000.0, 0.0, True), (8000.0, 0.25, False)):
        deviation = judged.lamp(*lamp)
        assert not deviation.missed, deviation
        assert deviation.oval < 0.85, "the disc is round: nothing is tested of the squeeze"


def test_lamps_through_a_mirror_lens():
    """Near the axis behind an edge, and in a corner. An even disc without the hole would be 12 % narrower."""
    judged = JudgedDesign(*MIRRORS)
    for lamp in ((5000.0, 0.0, True), (30000.0, 0.04, False)):
        deviation = judged.lamp(*lamp)
        assert not deviation.missed, deviation
