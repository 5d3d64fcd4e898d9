"""Prescriptions: the value class, Lensfield's TOML, pbrt's and Optiland's files, and real files from other programs."""

import pickle
import re
from dataclasses import replace

import numpy as np
import pytest

from lens_texts import OPTBENCH, PBRT, SURFACES, TOML, changed
from lensfield.engine import LensError
from lensfield.engine.library import BUNDLED, bundled_names, prescription_of
from lensfield.engine.prescription.glasses import find_glass
from lensfield.engine.prescription.photographs import Agreement, Vignetting
from lensfield.engine.prescription.prescription import Prescription, Surface
from lensfield.engine.prescription.readers import SUFFIXES, ReadingOptions, read_prescription
from lensfield.engine.prescription.readers.toml import read_lensfield, write_prescription
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.focus import build_system
from lensfield.engine.rays.rays import HalfPupil, trace_pupil
from lensfield.engine.runtime.values import digest_of
from places import SHARED_DATA
from refusals import refused

FILES = SHARED_DATA / "prescriptions"
SINGLET = Prescription("singlet", SURFACES, ("entrance_pupil_diameter_mm", 5.0), ("angle_deg", 14.0))
needs_files = pytest.mark.skipif(not FILES.is_dir(), reason="the prescriptions of ../shared/data are not there")


@pytest.fixture
def read(tmp_path):
    """Read a text as a file of a given kind."""
    def read_text(text, kind=".toml", field=None):
        path = tmp_path / f"lens{kind}"
        path.write_text(text, encoding="utf-8")
        return read_prescription(path, ReadingOptions(field))

    return read_text


def test_every_field_of_a_toml_is_read(read):
    text = changed(TOML, ("version = 1", """version = 1
maker = "a maker"
story = "two\\n   lines"
source = "a patent"
notes = "assumed"
focus = "best"
object_distance_mm = 250
reference_wavelength_nm = 546.07
sensor_mm = [36, 24.0]"""), ("conic = -0.5", "conic = -0.5\naspheric = {4 = 1e-5, 8 = -2e-9}"))
    assert read(text) == Prescription(
        "singlet", (*SURFACES[:2], replace(SURFACES[2], aspheric=(0.0, 1e-5, 0.0, -2e-9))),
        ("entrance_pupil_diameter_mm", 5.0), ("angle_deg", 14.0), 250.0, (36.0, 24.0), 546.07, "best",
        "a maker", "two lines", "a patent", "assumed")


RINGS = """version = 1
title = "A Singlet 80 mm"
year = 1839
character = ["soft", "swirl"]
focal_length_mm = 49
closest_focus_mm = 700
highest_f_number = 16
focused_at_mm = [inf, 2000, 500]"""


def test_a_focus_ring_may_move_parts_of_the_lens(read):
    lens = read(changed(TOML, ("version = 1", RINGS), ("thickness_mm = 4.0", "thickness_mm = [4.0, 5.0, 6.5]")))
    assert (lens.title, lens.year, lens.character) == ("A Singlet 80 mm", 1839, ("soft", "swirl"))
    assert (lens.focal_length_mm, lens.closest_focus_mm, lens.highest_f_number) == (49, 700, 16)
    assert lens.focused_at_mm == (np.inf, 2000, 500) and np.isinf(lens.object_distance_mm)
    assert (lens.surfaces[1].thickness_mm, lens.surfaces[1].gaps_mm) == (4.0, (4.0, 5.0, 6.5))
    near = read(changed(TOML, ("version = 1", RINGS.replace("[inf, 2000, 500]", "[800, 700]")),
                        ("thickness_mm = 4.0", "thickness_mm = [4.0, 5.0]")))
    assert near.object_distance_mm == 800, "what a file has first is how it stands"


def test_scale_applies_to_surfaces_and_their_moves(read):
    half = read(changed(TOML, ("version = 1", RINGS.replace("= 49", "= 24.5") + "\nscale = 0.5\nsensor_mm = [36, 24]"),
                        ("thickness_mm = 4.0", "thickness_mm = [4.0, 5.0, 6.5]")))
    assert half.surfaces[1].gaps_mm == (2.0, 2.5, 3.25) and half.focused_at_mm == (np.inf, 1000, 250)
    assert (half.focal_length_mm, half.closest_focus_mm, half.sensor_mm) == (24.5, 700, (36, 24)), "as in the file"
    assert half.scaled(2).focal_length_mm == 49 and half.scaled(2).closest_focus_mm == 1400


@pytest.mark.parametrize("old, new, message", [
    ("[inf, 2000, 500]", "[500, 2000, inf]", "focused_at_mm is (500.0, 2000.0, inf): expected positive distances, the"),
    ("[inf, 2000, 500]", "[inf, 2000]", "surface 2, gaps is 3 numbers: expected one for each of focused_at_mm, 2"),
    ("[4.0, 5.0, 6.5]", "4.0", "focused_at_mm is (inf, 2000.0, 500.0): no surface has a thickness for each of these"),
    ("[4.0, 5.0, 6.5]", "[4.0, inf, 6.5]", "surface 2, thickness_mm is (4.0, inf, 6.5): expected a number"),
    ("[4.0, 5.0, 6.5]", "[]", "surface 2, thickness_mm is []: expected a list of numbers in brackets"),
    ("year = 1839", 'year = "1839"', "year is 1839: expected a whole number"),
    ("year = 1839", f"year = 0x{'f' * 10**4}", "year is int too large to show: expected a whole number"),
    ("year = 1839", f"{'.'.join('a' * 30000)} = 1839", "a.a.: expected keys of at most 16 parts"),
    ("year = 1839", f"year.{'a . ' * 30000} b = 1839", "expected keys of at most 16 parts"),
    ("year = 1839", f"[{'.'.join(['x'] * 15 + ['y'])}.'quo ted'.\"é\"]", "expected keys of at most 16 parts"),
    ("year = 1839", f"year = {'[' * 10**5}", "TOML is not readable"),
    ('["soft", "swirl"]', '"soft"', "character is soft: expected a list of words"),
    ("focal_length_mm = 49", "focal_length_mm = -49", "focal_length_mm is -49.0: expected a positive number"),
    ("closest_focus_mm = 700", "closest_focus_mm = inf", "closest_focus_mm is inf: expected a positive number"),
    ("highest_f_number = 16", "highest_f_number = 0.1", "highest_f_number is 0.1: expected at least 0.5"),
])
def test_invalid_rings_in_a_toml_are_errors(read, old, new, message):
    text = changed(TOML, ("version = 1", RINGS), ("thickness_mm = 4.0", "thickness_mm = [4.0, 5.0, 6.5]"))
    with pytest.raises(LensError, match=re.escape(message)):
        read(changed(text, (old, new)))


def test_a_file_states_the_origin_of_its_figures(read):
    stated = 'provenance = { apertures = "estimated", figures = "patent" }'
    lens = read(changed(TOML, ("version = 1", f"version = 1\n{stated}")))
    assert lens.provenance == (("figures", "patent"), ("apertures", "estimated")), "in one order"
    assert lens.passport == "patent; apertures estimated" and read(TOML).passport == ""
    assert lens == read(TOML) and digest_of(lens) == digest_of(read(TOML)), "pictures and bakes stay valid"


@pytest.mark.parametrize("text, message", [
    ('"patent"', "provenance is patent: expected a table such as { figures"),
    ('{ barrel = "patent" }', "provenance, barrel is unknown: expected figures, surfaces, aspheres, glasses, stop, "),
    ('{ stop = "certain" }', "provenance, stop is certain: expected patent or published or estimated or guessed"),
    ("{ stop = 3 }", "provenance, stop is 3: expected patent or")])
def test_an_unknown_origin_is_an_error(read, text, message):
    with pytest.raises(LensError, match=re.escape(message)):
        read(changed(TOML, ("version = 1", f"version = 1\nprovenance = {text}")))


def test_a_file_states_its_agreement_with_photographs(read):
    stated = 'photographs = { source = "Lensfun: A B", date = "2026-11-29", illumination = 0.021, distortion_um = 11 }'
    lens = read(changed(TOML, ("version = 1", f"version = 1\n{stated}")))
    assert lens.photographs == Agreement("Lensfun: A B", "2026-11-29", 0.021, 11.0) and read(TOML).photographs is None
    assert str(lens.photographs) == (
        "compared with photographs of this lens: illumination ± 0.02, distortion ± 11 µm (Lensfun: A B)")
    assert lens == read(TOML) and digest_of(lens) == digest_of(read(TOML)), "pictures and bakes stay valid"


@pytest.mark.parametrize("text, message", [
    ('"Lensfun"', "photographs is Lensfun: expected a table such as { source"),
    ('{ source = "a", mtf = 0.1 }', "photographs, mtf is unknown: expected source, date, illumination, "),
    ("{ illumination = 0.1 }", "photographs, source is missing: expected a string"),
    ('{ source = "a", illumination = "good" }', "photographs, illumination is good: expected a number"),
    ('{ source = "a", distortion_um = -1 }', "distortion_um is -1.0: expected a number from 0")])
def test_a_damaged_agreement_is_an_error(read, text, message):
    with pytest.raises(LensError, match=re.escape(message)):
        read(changed(TOML, ("version = 1", f"version = 1\nphotographs = {text}")))


LIGHT = """
[[photographs.light]]
f_number = 2.8
focus_mm = 1500
heights_mm = [3, 9.5, 20]
light = [0.98, 0.9, 0.55]
"""


@pytest.mark.parametrize("changes, message", [
    (("f_number = 2.8", "f_number = 0"), "photographs, light 1, f_number is 0: expected a positive number"),
    (("focus_mm = 1500", "focus_mm = -1"), "photographs, light 1, focus_mm is -1: expected a positive number"),
    (("9.5", "2.5"), "photographs, light 1, heights_mm is [3, 2.5, 20]: expected ascending numbers above 0"),
    (("[3, 9.5, 20]", "[3, 9.5, inf]"), "heights_mm is [3, 9.5, inf]: expected ascending numbers above 0"),
    (("[0.98, ", "["), "photographs, light 1, light is [0.9, 0.55]: expected 3 numbers in brackets"),
    (("0.55", "55"), "photographs, light 1, light is [0.98, 0.9, 55]: expected numbers from 0 to 1.2"),
    (("light = [", "colour = ["), "photographs, light 1, colour is unknown: expected f_number, focus_mm, heights_mm"),
    (("[[photographs.light]]", "[photographs.light]"), "light is ")])
def test_damaged_light_is_an_error(read, changes, message):
    stated = changed(TOML, ("version = 1", 'version = 1\nphotographs.source = "mine"')) + LIGHT
    light, = read(stated).photographs.light
    assert light == Vignetting(2.8, 1500.0, np.array([3, 9.5, 20]), np.array([0.98, 0.9, 0.55]))
    with pytest.raises(LensError, match=re.escape(message)):
        read(changed(stated, changes))


def test_the_light_of_a_lens_at_its_settings_is_that_of_the_nearest_photograph():
    curves = [Vignetting(f_number, focus_mm, np.array([5.0, 20.0]), np.array([0.9, 0.5]))
              for f_number in (1.8, 2.0, 2.8) for focus_mm in (np.inf, 2000.0, 500.0)]
    agreement = Agreement("mine", light=tuple(curves))
    for settings, expected in (((2.05, np.inf), (2.0, np.inf)), ((1.85, 700.0), (1.8, 500.0)),
                               ((2.9, 5000.0), (2.8, np.inf)), ((2.8, 3000.0), (2.8, 2000.0))):
        light, = agreement.at(*settings).light
        assert (light.f_number, light.focus_mm) == expected
    assert agreement.at(2.4, np.inf).light == () and agreement.at(2.4, np.inf).source == "mine"


AWKWARD = Prescription(
    'Ein "Petzval" \\ 85 mm', (
        Surface(-2e-6, 1 / 3, "SCHOTT N-BK7", 8.25, conic=-1.5, aspheric=(0.0, 1e-5, 0.0), odd_aspheric=(0.0, -2e-22)),
        Surface(thickness_mm=3.0, stop=True, gaps_mm=(3.0, 4.0)), Surface(50.0, 47.0, "", 1e6)),
    ("f_number", 1.9), ("image_height_mm", 21.6), 1e3, (36.0, 24.0), 546.07, "best", "Voigtländer, Wien",
    "It swirls. " * 20 + "\\", 'by """hand"""', "1.5 < n", "A Petzval", 1840, ("soft", "swirl"), 85.0,
    (1e3, 500.0), 400.0, 11.0, provenance=(("figures", "published"), ("stop", "guessed")),
    photographs=Agreement('Lensfun: "A B"', "2026-11-29", 0.021, None, 3.5, (
        Vignetting(2.0, np.inf, np.linspace(1, 21, 30), np.linspace(1.001, 1 / 3, 30)),
        Vignetting(8.0, 1 / 3, np.array([1.0]), np.array([1.2])))))


@pytest.mark.sample(12)
@pytest.mark.parametrize("name", bundled_names())
def test_a_bundled_lens_round_trips(tmp_path, name):
    assert_reads_as_written(prescription_of(name), tmp_path)


@pytest.mark.parametrize("lens", [
    SINGLET, AWKWARD, replace(AWKWARD, object_distance_mm=np.inf), replace(AWKWARD, focused_at_mm=(np.inf, 1e3))],
    ids=lambda lens: lens.name)
def test_a_prescription_round_trips(tmp_path, lens):
    assert_reads_as_written(lens, tmp_path)


def assert_reads_as_written(lens, tmp_path):
    text = write_prescription(lens)
    tidy = replace(lens, story=" ".join(lens.story.split()))
    (tmp_path / "lens.toml").write_text(text, encoding="utf-8")
    read = read_lensfield(tmp_path / "lens.toml")
    assert read == tidy and read.provenance == lens.provenance and read.photographs == lens.photographs
    assert write_prescription(tidy) == text
    assert max(len(line) for line in text.splitlines() if not line.startswith("  {")) <= 120


def test_unprintable_characters_are_not_written(read):
    assert read(write_prescription(replace(SINGLET, notes="a\0b\x7f\ud800\u00a0c", title="\n"))).notes == "a b c"


def test_files_of_other_programs_can_be_written_as_toml(read):
    foreign = read(OPTBENCH, ".txt")
    assert read(write_prescription(foreign)) == foreign


N_BK7 = """
[glasses."MINE  1"]
formula = 2
coefficients = [0, 1.03961212, 0.00600069867, 0.231792344, 0.0200179144, 1.01046945, 103.560653]
range_nm = [300, 2500]
"""


def with_glass(text, glass=N_BK7):
    return changed(text, (f'glass = "{SURFACES[1].glass}"', 'glass = "MINE 1"')) + glass


def test_a_custom_glass_takes_precedence_over_catalogues(read):
    """Schott's coefficients for N-BK7 are also those in the catalogue."""
    lens, catalogue_glass = read(with_glass(TOML)), find_glass("SCHOTT N-BK7", "lens", "glass")
    glass, = lens.glasses
    nm = np.array([250.0, 400.0, 587.5618, 700.0])
    np.testing.assert_allclose(glass.index_at(nm), catalogue_glass.index_at(nm), rtol=1e-12)
    assert glass in system_of(lens).glasses and read(write_prescription(lens)) == lens
    renamed = replace(lens, glasses=(replace(glass, name="SCHOTT F2"),)).with_glasses({"MINE 1": "SCHOTT F2"})
    assert system_of(renamed).efl_mm == system_of(lens).efl_mm
    assert pickle.loads(pickle.dumps(lens)) == lens and digest_of(lens) != digest_of(renamed)


def test_a_glass_by_cauchys_formula_is_valid_at_any_wavelength(read):
    glass, = read(with_glass(TOML, '[glasses."MINE 1"]\nformula = 5\ncoefficients = [1.5, 0.004, -2]\n')).glasses
    np.testing.assert_allclose(glass.index_at([200.0, 500.0, 2000.0]), [1.6, 1.516, 1.501], rtol=1e-14)


@pytest.mark.parametrize("old, new, message", [
    ("formula = 2", "formula = 10", "glass MINE  1, formula is 10: expected 1 to 9"),
    ("formula = 2", "formula = 2.5", "formula is 2.5: expected 1 to 9"),
    ("formula = 2\n", "", "formula is missing: expected a number"),
    ("formula = 2", "formula = 8", "coefficients is .*: expected at most 4 for formula 8"),
    ("[300, 2500]", "[2500, 300]", "range_nm is .*: expected two ascending nanometres"),
    ("[300, 2500]", "[0.3, 2.5]", "glass MINE 1 is of index nan at 587.562 nm: expected 1 to 4: .* range nanometres"),
    ("1.03961212", "1e6", "glass MINE 1 is of index .*: expected 1 to 4: its coefficients take micrometres"),
    ("formula = 2", "formula = 2\nsource = 'x'", "glass MINE  1, source is unknown: expected formula"),
    ('[glasses."MINE  1"]', '[glasses." "]', "glasses is .*: expected tables by name"),
    ('[glasses."MINE  1"]', '[glasses]', "glasses is .*: expected tables by name"),
])
def test_an_invalid_glass_is_an_error(read, old, new, message):
    with pytest.raises(LensError, match=message):
        read(with_glass(TOML, changed(N_BK7, (old, new))))


def test_odd_powers_of_a_toml_are_read(read):
    lens = read(changed(TOML, ("conic = -0.5", "aspheric = {3 = 2e-4, 6 = 1e-8, 5 = -1e-6}")))
    assert lens.surfaces[2] == Surface(-50.0, 47.5, aspheric=(0.0, 0.0, 1e-8), odd_aspheric=(0.0, 2e-4, -1e-6))
    half = lens.surfaces[2].scaled(0.5)
    assert half.odd_aspheric == (0.0, 8e-4, -1.6e-5)


def test_optional_fields_of_a_toml_have_defaults(read):
    assert read(TOML) == SINGLET
    assert read(changed(TOML, ('name = "singlet"', ""))).name == "lens"
    assert read("\ufeff" + TOML) == SINGLET, "Windows' editors put a mark before UTF-8"


@pytest.mark.parametrize("old, new, message", [
    ("radius_mm = 50.0", 'radius_mm = "50"', "surface 2, radius_mm is 50: expected a number"),
    ("radius_mm = 50.0", "radius_mm = true", "surface 2, radius_mm is True: expected a number"),
    ("radius_mm = 50.0", "radius_mm = nan", "surface 2, radius_mm is nan: expected a number"),
    ("radius_mm = 50.0", "radius_mm = 0", "surface 2, radius_mm is 0.0: expected a radius, or inf for a plane"),
    ("radius_mm = 50.0", "radius = 50.0", "surface 2, radius is unknown: expected radius_mm, "),
    ("thickness_mm = 4.0", "thickness_mm = inf", "surface 2, thickness_mm is inf: expected a number"),
    ("thickness_mm = 47.5\n", "", "surface 3, thickness_mm is 0: expected an image plane behind the lens"),
    ("thickness_mm = 47.5\n", "thickness_mm = 47.5\nglass = 'F2'\n", "surface 3, glass is F2: expected air before"),
    ("semi_aperture_mm = 8.0", "semi_aperture_mm = -8", "surface 2, semi_aperture_mm is -8.0: expected a positive"),
    ("glass = \"SCHOTT N-BK7\"", "glass = 1.5", "surface 2, glass is 1.5: expected a string"),
    ("stop = true", "stop = 1", "surface 1, stop is 1: expected true or false"),
    ("stop = true", "", "stop is at 0 surfaces: expected one"),
    ("conic = -0.5", "stop = true", "stop is at 2 surfaces: expected one"),
    ("conic = -0.5", "aspheric = {0 = 1.0}", "surface 3, aspheric is {'0': 1.0}: expected a table of powers"),
    ("conic = -0.5", "aspheric = {4 = 'x'}", "surface 3, aspheric, 4 is x: expected a number"),
    ("conic = -0.5", "aspheric = [0, 1]", "surface 3, aspheric is [0, 1]: expected a table of powers"),
    ("conic = -0.5", "aspheric = {4 = inf}", "surface 3, aspheric is "),
    ("[[surfaces]]", "[surfaces]", "TOML is not readable"),
    ('name = "singlet"', "scale = 0", "scale is 0: expected a positive number"),
    ('name = "singlet"', "scale = -1", "scale is -1: expected a positive number"),
    ('name = "singlet"', "sensor_mm = [36]", "sensor_mm is [36]: expected 2 numbers in brackets"),
    ('name = "singlet"', "sensor_mm = [36, 0]", "sensor_mm is (36.0, 0.0): expected a positive width and height"),
    ('name = "singlet"', "name = 5", "name is 5: expected a string"),
    ('name = "singlet"', "colour = 1", "colour is unknown: expected format, version, scale, "),
    ('name = "singlet"', 'focus = "sharp"', "focus is sharp: expected one of as given, paraxial, best, field"),
    ('name = "singlet"', "object_distance_mm = -3", "object_distance_mm is -3.0: expected a positive number, or inf"),
    ('name = "singlet"', "reference_wavelength_nm = 0.55", "reference_wavelength_nm is 0.55: expected nanometres"),
    ("{ angle_deg = 14.0 }", "{ angle_deg = 90 }", "field, angle_deg is 90.0: expected less than 90"),
    ("{ angle_deg = 14.0 }", "{ object_height_mm = 9 }", "field is object_height_mm: undefined for an object"),
    ("{ entrance_pupil_diameter_mm = 5.0 }", "{ object_na = 0.1 }", "aperture is object_na: undefined for an object"),
    ("{ entrance_pupil_diameter_mm = 5.0 }", "{ object_na = 1 }", "aperture, object_na is 1.0: expected less than 1"),
    ("{ angle_deg = 14.0 }", "{ angle_deg = 9, object_height_mm = 9 }", "field is {'angle_deg': 9, "),
    ("{ angle_deg = 14.0 }", "{ angle_deg = 0 }", "field, angle_deg is 0.0: expected a positive number"),
    ("field = { angle_deg = 14.0 }", "", "field is missing: expected a table with one of angle_deg, "),
    ("{ entrance_pupil_diameter_mm = 5.0 }", "5.0", "aperture is 5.0: expected a table with one of stop, "),
    ("{ entrance_pupil_diameter_mm = 5.0 }", "{ f_number = inf }", "aperture, f_number is inf: expected a positive"),
    ("version = 1", "version = 2", "version is 2: expected 1"),
    ('format = "lensfield-prescription"', "", "format is missing: expected lensfield-prescription"),
    ("version = 1", "version =", "TOML is not readable"),
    ("version = 1", "version = 1\n\0", "TOML is not readable")])
def test_an_invalid_toml_is_an_error_with_its_field(read, old, new, message):
    with pytest.raises(LensError) as error:
        read(TOML.replace(old, new, 1))
    assert f"lens.toml: {message}" in str(error.value) and "\n" not in str(error.value)


def test_newlines_in_a_value_do_not_split_the_error(read):
    with pytest.raises(LensError) as error:
        read(changed(TOML, ("radius_mm = 50.0", 'radius_mm = "a\\nb"'), ))
    assert "\n" not in str(error.value)


def test_scale_applies_to_the_file_but_not_to_a_given_field(read):
    text = changed(TOML, ("version = 1", "version = 1\nscale = 0.5"), ("angle_deg = 14.0", "image_height_mm = 20"),
                   ("conic = -0.5", "aspheric = {2 = 1e-3, 4 = 1e-5}"))
    half = read(text)
    assert half.surfaces == (Surface(thickness_mm=1.0, stop=True), Surface(25.0, 2.0, "SCHOTT N-BK7", 4.0),
                             Surface(-25.0, 23.75, aspheric=(2e-3, 8e-5)))
    assert half.aperture == ("entrance_pupil_diameter_mm", 2.5) and half.field == ("image_height_mm", 10.0)
    assert read(text, field=("image_height_mm", 20.0)).field == ("image_height_mm", 20.0)


def figures(prescription, angle_deg=10.0):
    """The focal length, and the distortion of a chief ray."""
    system = build_system(prescription)
    ideal_mm = system.efl_mm * np.tan(np.radians(angle_deg))
    rays = trace_pupil(system, [ideal_mm], [587.5618], HalfPupil(1, 1))
    return system.efl_mm, rays.chief_height_mm[0, 0] / ideal_mm


def test_a_lens_of_twice_the_size_has_twice_the_focal_length_and_the_same_distortion():
    bent = replace(SINGLET, surfaces=(*SURFACES[:2], replace(SURFACES[2], aspheric=(0.0, 2e-5, -1e-8))))
    (efl_mm, distortion), (large_mm, same) = figures(bent), figures(bent.scaled(2.0))
    assert large_mm == pytest.approx(2 * efl_mm, rel=1e-12)
    assert same == pytest.approx(distortion, rel=1e-9) and abs(distortion - 1) > 1e-3


def test_a_thick_lens_has_the_focal_length_of_the_lensmakers_formula():
    n, r, d = 1.5168, 50.0, 4.0
    surfaces = (SURFACES[0], replace(SURFACES[1], glass="1.5168/64.2"), SURFACES[2])
    power = (n - 1) * (2 / r - (n - 1) * d / (n * r * r))
    assert build_system(replace(SINGLET, surfaces=surfaces)).efl_mm == pytest.approx(1 / power, rel=1e-6)


def test_a_parabola_is_the_same_lens_as_a_conic_or_as_a_term_in_r2():
    conic = replace(SURFACES[2], conic=-1.0)
    power = Surface(np.inf, conic.thickness_mm, aspheric=(0.5 / conic.radius_mm,))
    lenses = [replace(SINGLET, surfaces=(*SURFACES[:2], last)) for last in (conic, power)]
    systems = [build_system(lens) for lens in lenses]
    assert systems[1].efl_mm == pytest.approx(systems[0].efl_mm, rel=1e-9)
    one, other = (trace_pupil(system, [8.0], [486.1, 656.3], HalfPupil(5, 7)) for system in systems)
    np.testing.assert_allclose(other.position_mm, one.position_mm, atol=1e-8)


def test_glasses_can_be_replaced_by_name():
    named = SINGLET.with_glasses({"SCHOTT N-BK7": "1.62/60.3", "F2": "SF2"})
    assert [surface.glass for surface in named.surfaces] == ["", "1.62/60.3", ""]
    assert SINGLET.with_glasses({}) == SINGLET


def test_pbrt(read):
    lens = read(PBRT, ".dat", ("angle_deg", 14.0))
    assert lens.surfaces == (Surface(np.inf, 2.0, "", 2.5, stop=True), Surface(50.0, 4.0, "1.5168", 8.0),
                             Surface(-50.0, 47.5, "", 8.0))
    assert lens.aperture == ("stop", 2.5) and lens.focus == "as given" and lens.name == "lens"
    assert read(changed(PBRT, ("47.5", "0")), ".dat", ("angle_deg", 14.0)).focus == "best"
    assert build_system(lens.with_glasses({"1.5168": "1.5168/64.2"})).efl_mm == pytest.approx(49.0, abs=0.1)


def test_the_error_for_an_index_without_dispersion_says_what_to_do(read):
    with refused(LensError, field="surface 2, glass", value="1.5168", match="1.5168/V"):
        build_system(read(PBRT, ".dat", ("angle_deg", 14.0)))


@pytest.mark.parametrize("old, new, message", [
    ("50 4 1.5168 16", "50 4 1.5168", "line 4 is 50 4 1.5168: expected radius, thickness, index, diameter"),
    ("50 4 1.5168 16", "50 4 x 16", "line 4 is 50 4 x 16: expected radius, thickness, index, diameter"),
    ("50 4 1.5168 16", "50 4 0.5 16", "line 4, index is 0.5: expected the index of a glass"),
    ("50 4 1.5168 16", "50 4 nan 16", "line 4, index is nan: expected the index of a glass"),
    ("50 4 1.5168 16", "nan 4 1.5 16", "surface 2, radius_mm is nan"),
    ("50 4 1.5168 16", "50 4 1.5168 0", "surface 2, semi_aperture_mm is 0.0"),
    ("0 2 0 5", "10 2 1 5", "stop is 0 rows: expected one row of radius 0"),
    ("0 2 0 5", "0 2 0 5\n0 2 1 5", "stop is 2 rows: expected one row of radius 0")])
def test_an_invalid_pbrt_file_is_an_error_with_its_line(read, old, new, message):
    text = changed(PBRT.replace("\t", " "), (old, new))
    with pytest.raises(LensError) as error:
        read(text, ".dat", ("angle_deg", 14.0))
    assert message in str(error.value)


AXPOS = """# radius\taxpos\tN\taperture
50\t0\t1.5168\t16
-50\t4\t1\t16
0\t2\t0\t5
"""


def test_a_pbrt_file_may_have_distances_before_their_surfaces(read):
    """The singlet reversed. Read in the wrong order, its lens would have zero thickness, and the stop would be lost."""
    expected = (Surface(50.0, 4.0, "1.5168", 8.0), Surface(-50.0, 2.0, "", 8.0),
                Surface(np.inf, 0.0, "", 2.5, stop=True))
    for text in (AXPOS, changed(AXPOS, ("axpos", "sep"))):
        lens = read(text, ".dat", ("angle_deg", 14.0))
        assert (lens.surfaces, lens.focus) == (expected, "best")
        assert "from the previous surface" in lens.notes


@pytest.mark.parametrize("header", ["sep", "axpos"])
def test_the_header_alone_does_not_move_a_pbrt_files_distances(read, header):
    """Newer files have the old header too; and a stop may be directly in front of a lens."""
    lens = read(changed(PBRT, ("sep", header)), ".dat", ("angle_deg", 14.0))
    assert lens.surfaces[1].thickness_mm == 4.0 and lens.notes == ""
    touching = read(changed(PBRT, ("0\t2\t0", "0\t0\t0"), ("47.5", "0"),
                            ("sep", header)), ".dat", ("angle_deg", 14.0))
    assert [surface.thickness_mm for surface in touching.surfaces] == [0.0, 4.0, 0.0]


def test_isets_focal_length_before_the_surfaces_is_not_a_surface(read):
    text = changed(PBRT, ("0\t2\t0\t5", "49.1\n0\t2\t0\t5"))
    assert read(text, ".dat", ("angle_deg", 14.0)).surfaces == read(PBRT, ".dat", ("angle_deg", 14.0)).surfaces


def test_a_pbrt_file_needs_a_field(read):
    with pytest.raises(LensError, match="field is missing: .*give --field-angle"):
        read(PBRT, ".dat")


def test_missing_files_folders_and_unknown_kinds_are_errors(tmp_path):
    for path, message in ((tmp_path / "no.toml", "prescription is missing: expected a file of kind .toml, .zmx"),
                          (tmp_path, "prescription is a folder")):
        with pytest.raises(LensError, match=message):
            read_prescription(path)
    (tmp_path / "lens.png").write_bytes(b"x")
    with pytest.raises(LensError, match="kind of file is .png: expected .toml"):
        read_prescription(tmp_path / "lens.png")


@pytest.mark.parametrize("contents", [b"", b"\xff\xfe\0", b"[" * 100000, b"{" * 100000], ids=["empty", "?", "[", "{"])
@pytest.mark.parametrize("kind", SUFFIXES)
def test_empty_or_garbled_files_are_lens_errors(tmp_path, kind, contents):
    (tmp_path / f"lens{kind}").write_bytes(contents)
    with pytest.raises(LensError, match=rf"lens\{kind}: "):
        read_prescription(tmp_path / f"lens{kind}", ReadingOptions(("angle_deg", 10.0)))


@needs_files
def test_edmunds_file_agrees_with_our_prescription():
    glasses = {"LAK10C": "CDGM H-LAK10", "LAF1C": "CDGM H-LAF1", "ZF7C": "CDGM ZF7", "ZK9C": "CDGM H-ZK9A",
               "LAK1C": "CDGM H-LAK1"}
    theirs = read_prescription(FILES / "EO54852.ZMX").with_glasses(glasses)
    ours = read_prescription(BUNDLED / "prescriptions" / "edmund-54852.toml")
    for field in ("object_distance_mm", "aperture", "field", "focus"):
        assert getattr(theirs, field) == getattr(ours, field)
    assert theirs.reference_wavelength_nm == pytest.approx(ours.reference_wavelength_nm)
    for one, other in zip(theirs.surfaces, ours.surfaces, strict=True):
        assert (one.glass, one.stop, one.conic) == (other.glass, other.stop, other.conic)
        np.testing.assert_allclose([one.radius_mm, one.thickness_mm, one.semi_aperture_mm],
                                   [other.radius_mm, other.thickness_mm, other.semi_aperture_mm], rtol=1e-7)
    assert build_system(theirs).efl_mm == pytest.approx(5.99997, abs=1e-4)
    assert "vignetting factors" in theirs.notes


@needs_files
@pytest.mark.parametrize("name, efl_mm, tolerance", [
    ("rayoptics_ag_dblgauss.seq", 100.003757028, 1e-6), ("Cooke_40_degree_field.zmx", 50.0, 1e-3),
    ("muller_US4525038_f25.25.optiland.json", 25.25, 1e-5), ("eo54852_cdgm.optiland.json", 5.99997, 1e-4)])
def test_focal_lengths_agree_with_other_programs(name, efl_mm, tolerance):
    assert build_system(read_prescription(FILES / name)).efl_mm == pytest.approx(efl_mm, abs=tolerance)


@needs_files
def test_the_error_for_an_unknown_glass_suggests_similar_ones():
    lens = read_prescription(FILES / "EO54852.ZMX")
    assert "LAK10C" in [surface.glass for surface in lens.surfaces]
    with refused(LensError, field="surface 1, glass", value="LAK10C", match="CDGM H-LAK10"):
        build_system(lens)


@needs_files
def test_pbrts_fisheye_has_the_focal_length_of_its_source():
    glasses = {"1.62": 60.3, "1.639": 44.9, "1.654": 33.7, "1.517": 64.2, "1.805": 25.4, "1.673": 32.2}
    lens = read_prescription(FILES / "pbrt_fisheye.10mm.dat", ReadingOptions(("angle_deg", 70.0)))
    system = build_system(lens.with_glasses({index: f"{index}/{abbe}" for index, abbe in glasses.items()}))
    assert system.efl_mm == pytest.approx(9.99, abs=0.005)
