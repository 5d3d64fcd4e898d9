"""Rules for every reader: each word is used, harmless or reported, and stated figures are compared with traced ones."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from lens_texts import (
    CODEV,
    DEEPLENS,
    DOT_LENS,
    LENTIL,
    OPTBENCH,
    PBRT,
    SAMPLES,
    SURFACES,
    TOML,
    ZEMAX,
    changed,
    optiland,
)
from lensfield.engine import LensError
from lensfield.engine.library import bundled_names, prescription_as_stated, prescription_of
from lensfield.engine.prescription.prescription import Prescription, Surface
from lensfield.engine.prescription.readers import ReadingOptions, read_prescription
from lensfield.engine.prescription.readers.reading import Reading, checked
from lensfield.engine.rays.focus import build_system
from lensfield.engine.runtime.unread import json_names, unread_names
from notes import unread
from refusals import refused

FIELD = ("image_height_mm", 12.0)
EFL_MM = 49.04  # of the singlet in all of these texts, traced; they state 49.0
ISET = "49.0\n" + PBRT


@pytest.fixture
def read(tmp_path):
    """Read a text, or JSON contents, as a file of a given kind."""
    def read_text(kind, text, **options):
        path = tmp_path / f"lens{kind}"
        path.write_text(text if isinstance(text, str) else json.dumps(text), encoding="utf-8")
        return read_prescription(path, ReadingOptions(FIELD, **options))

    return read_text


@pytest.mark.parametrize("kind, text, name", [
    (".zmx", changed(ZEMAX, ("ENPD 5.0E+0", "ENPD 5.0E+0\nWARP 1 2")), "WARP"),
    (".zmx", changed(ZEMAX, ("  CONI -0.5", "  CONI -0.5\n  BEND 3")), "BEND"),
    (".seq", changed(CODEV, ("DIM   M", "DIM   M\nWARP 3")), "WARP"),
    (".seq", changed(CODEV, ("  CON\n", "  CON\n  BND 3\n")), "BND"),
    (".zmx", changed(ZEMAX, ("  CURV 2.0E-2", "  COAT HEAR1\n  CURV 2.0E-2")), "COAT HEAR1"),
    (".lens", changed(DOT_LENS, ("focal_length: 49.00", "focal_length: 49.00\nsqueeze: 2.0")), "squeeze"),
    (".txt", changed(OPTBENCH, ("[figure]", "[toric data]\n3\t40\n[figure]")), "[toric data]"),
    (".txt", changed(OPTBENCH, ("Bf\t0\t0", "Bf\t0\t0\nSqueeze\t2")), "Squeeze"),
    (".txt", changed(OPTBENCH, ("[figure]", "9\t-50.0\t1\n[figure]")), "aspherical data of surface 9"),
    (".json", DEEPLENS | {"squeeze": 2.0}, "squeeze"),
    (".json", DEEPLENS | {"surfaces": [row | {"is_square": True} for row in DEEPLENS["surfaces"]]}, "is_square"),
    (".json", {"1": LENTIL["0001"] | {"squeeze": 2.0}}, "squeeze"),
    (".json", optiland() | {"apodization": {"sigma": 1}}, "apodization")])
def test_an_unknown_word_is_reported(read, kind, text, name):
    assert f"Not used from the file: {name}" in read(kind, text).notes


@pytest.mark.parametrize("kind, text", [*SAMPLES.items(), (".dat", ISET)])
def test_every_word_of_the_valid_samples_is_known(read, kind, text):
    assert not unread(read(kind, text).notes)


STATING = [(".lens", DOT_LENS, "focal_length: 49.00", "focal_length: {:g}"), (".dat", ISET, "49.0\n", "{:g}\n"),
           (".txt", OPTBENCH, "Focal Length\t49.0\t49.0", "Focal Length\t{:g}"),
           (".json", json.dumps(DEEPLENS), '"foclen": 49.0', '"foclen": {:g}'),
           (".json", json.dumps(LENTIL), '"focal-length-mm-patent": 49', '"focal-length-mm-patent": {:g}'),
           (".toml", TOML, "version = 1", "version = 1\nfocal_length_mm = {:g}")]
stating = pytest.mark.parametrize("kind, text, old, new", STATING, ids=[case[0] + case[2][:6] for case in STATING])


@stating
def test_a_focal_length_that_contradicts_the_surfaces_is_an_error(read, kind, text, old, new):
    for stated in (EFL_MM / 1.011, EFL_MM * 1.011, 25.0):
        with refused(LensError, field="focal length", value=re.compile(f"{stated:g} mm, .* 49[.]").match):
            read(kind, changed(text, (old, new.format(stated))))
    for stated in (EFL_MM / 1.008, EFL_MM * 1.008):
        assert read(kind, changed(text, (old, new.format(stated)))).focal_length_mm == pytest.approx(stated, rel=1e-5)


@stating
def test_a_wrong_focal_length_may_be_accepted_and_is_noted(read, tmp_path, kind, text, old, new):
    wrong = changed(text, (old, new.format(52.0)))
    lens = read(kind, wrong, allow_mismatch=True)
    assert lens.focal_length_mm is None
    assert "The file's focal length is 52 mm, and its surfaces give 49." in lens.notes
    assert prescription_as_stated(tmp_path / f"lens{kind}", ReadingOptions(FIELD)).focal_length_mm == 52.0


@pytest.mark.parametrize("f_number, wrong", [(9.8, False), (9.89, False), (9.95, True), (9.65, True), (85.0, True)])
def test_an_f_number_that_contradicts_the_stop_is_an_error(read, f_number, wrong):
    """49.04 mm divided by a stop of 5.0 mm in front of the lens."""
    contents = DEEPLENS | {"fnum": f_number}
    if not wrong:
        assert read(".json", contents).aperture == ("stop", 2.5)
        return
    with refused(LensError, field="f-number", value=re.compile(f"{f_number:g}, .* 9[.]80").match):
        read(".json", contents)
    notes = read(".json", contents, allow_mismatch=True).notes
    assert f"The file's f-number is {f_number:g}, and the diameter of its stop gives 9.80" in notes


@pytest.mark.parametrize("diameter, note", [
    ("5.0", ""), ("4.8", "The stop is set to f/9.8; the diameter in its row gives f/10.2"),
    ("5.3", "The stop is set to f/9.8; the diameter in its row gives f/9.25")])
def test_a_stop_adjusted_to_the_f_number_is_reported(read, diameter, note):
    lens = read(".txt", changed(OPTBENCH, ("1\tAS\t2.0\t\t5\n", f"1\tAS\t2.0\t\t{diameter}\n")))
    assert lens.aperture == ("f_number", 9.8)
    assert note in lens.notes and ("The stop is set" in lens.notes) == bool(note)


@pytest.mark.parametrize("diameter", ["4.3", "5.7"])
def test_a_stop_a_third_of_a_stop_off_the_f_number_is_an_error(read, diameter):
    with refused(LensError, field="f-number", value=re.compile("9.8, ").match, where="lens.txt"):
        read(".txt", changed(OPTBENCH, ("1\tAS\t2.0\t\t5\n", f"1\tAS\t2.0\t\t{diameter}\n")))


def singlet(**changes):
    """A stop and a lens behind it, in units other than the file's, and scaled."""
    front = Surface(50.0, 4.0, "1.5168/64.2", changes.pop("front_mm", 8.0))
    return Prescription("singlet", (Surface(thickness_mm=2.0, stop=True), front, Surface(-50.0, 47.5, "", 9.0)),
                        changes.pop("aperture", ("entrance_pupil_diameter_mm", 5.0)), FIELD, **changes)


@pytest.mark.parametrize("front_mm, clips", [(2.4, True), (2.45, False), (2.6, False)])
def test_apertures_that_clip_the_axial_beam_are_reported(tmp_path, front_mm, clips):
    """The beam of a distant point is 5 mm wide in front of the lens; patents round by 3 %."""
    notes = checked(tmp_path / "lens.txt", Reading(singlet(front_mm=front_mm))).notes
    assert notes == ("Apertures clip the axial beam to 96% of its radius (surface 2)." if clips else "")


def test_the_f_number_applies_to_a_distant_object(tmp_path):
    """Close up, the beam in front is narrower than the pupil, and the stated f-number does not apply."""
    near = singlet(aperture=("stop", 2.5), object_distance_mm=150.0, focal_length_mm=49.0, focus="best")
    assert checked(tmp_path / "lens.txt", Reading(near, f_number=9.8)).notes == ""


def test_an_unknown_glass_prevents_the_comparison_and_is_noted(tmp_path):
    lens = singlet(focal_length_mm=80.0).with_glasses({"1.5168/64.2": "NOGLASS"})
    assert "cannot be compared" in checked(tmp_path / "lens.txt", Reading(lens)).notes
    index_alone = lens.with_glasses({"NOGLASS": "1.5168"})
    with refused(LensError, field="focal length", value=re.compile("80 mm, .* 49[.]0").match):
        checked(tmp_path / "lens.txt", Reading(index_alone))


def test_a_lens_without_power_is_an_error_if_a_focal_length_is_stated(tmp_path):
    flat = replace(singlet(focal_length_mm=49.0), surfaces=(SURFACES[0], Surface(50.0, 4.0, "1.5168/64.2"),
                                                            Surface(40.0, 47.5)))
    with pytest.raises(LensError, match="lens.txt: focal length is -.* mm: expected a lens of positive power"):
        checked(tmp_path / "lens.txt", Reading(flat))
    assert checked(tmp_path / "lens.txt", Reading(replace(flat, focal_length_mm=None))).notes == ""


def test_json_names_skip_empty_values():
    contents = {"a": 0, "b": [{"c": 1, "d": None}, {"e": ""}], "f": {"g": {"h": 2}}, "i": False}
    assert list(json_names(contents)) == ["b", "c", "f", "g", "h"]
    assert list(json_names(contents, ("g",))) == ["b", "c", "f"]
    assert unread_names(["b", "z", "y", "z"], {"b"}) == ("z", "y")


def test_the_sample_singlet_has_its_traced_focal_length(read):
    assert build_system(read(".txt", OPTBENCH)).efl_mm == pytest.approx(EFL_MM, abs=0.005)


@pytest.mark.sample(12)
@pytest.mark.parametrize("name", bundled_names())
def test_bundled_lenses_have_their_stated_focal_lengths(name):
    lens = prescription_of(name)
    traced_mm = build_system(replace(lens, focus="paraxial")).efl_mm
    assert lens.focal_length_mm is None or np.isclose(traced_mm, lens.focal_length_mm, rtol=0.01)


@pytest.mark.parametrize("name, text", SAMPLES.items())
def test_the_stop_and_the_image_plane_may_be_given(tmp_path, name, text):
    path = tmp_path / f"lens.{name.lstrip('.')}"
    path.write_text(text)
    asked = ReadingOptions(FIELD, stop=2, image_plane="paraxial", sensor_mm=(9.0, 6.0), allow_mismatch=True)
    lens = read_prescription(path, asked)
    assert (lens.stop_index, lens.focus, lens.sensor_mm) == (1, "paraxial", (9.0, 6.0))
    assert read_prescription(path, ReadingOptions(FIELD)).stop_index == 0
    for wrong in (0, len(lens.surfaces) + 1):
        with pytest.raises(LensError, match=f"--stop is {wrong}: expected the number of a surface, 1 to [3-5]"):
            read_prescription(path, asked._replace(stop=wrong))


def test_files_without_a_stop_or_an_image_plane_behind_the_lens_can_be_completed(read):
    text = changed(ZEMAX, ("  STOP\n", ""))
    with refused(LensError, field="stop", value="at 0 surfaces", where="lens.zmx"):
        read(".zmx", text)
    assert read(".zmx", text, stop=1) == read(".zmx", ZEMAX)
    text = changed(TOML, ("thickness_mm = 47.5", "thickness_mm = 0.0"))
    with refused(LensError, field="surface 3, thickness_mm", value="0", where="lens.toml"):
        read(".toml", text)
    lens = build_system(read(".toml", text, image_plane="paraxial"))
    assert lens.prescription.surfaces[-1].thickness_mm == pytest.approx(47, abs=2)
