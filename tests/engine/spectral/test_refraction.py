"""Refractive indices: library, files of refractiveindex.info, and its nine formulas against sums by hand."""

from pathlib import Path

import numpy as np
import pytest

from lensfield.engine.runtime.errors import InputError
from lensfield.engine.spectral import refraction
from lensfield.engine.spectral.refraction import load_refraction, refraction_names
from refusals import refused

LIBRARY = Path(refraction.__file__).parent / "data" / "refraction"
NM_D, NM_SODIUM = 587.5618, 589.3
VISIBLE = np.linspace(400, 700, 31)
METALS = {"aluminium", "brass", "chromium", "cobalt", "copper", "gold", "iron", "lead", "mercury-metal", "molybdenum",
          "nickel", "palladium", "platinum", "silver", "titanium", "tungsten", "zinc"}


def formula(number, coefficients, first=0.3, last=2.0):
    return (f"REFERENCES: |\n  By hand\nDATA:\n  - type: formula {number}\n    wavelength_range: {first} {last}\n"
            f"    coefficients: {coefficients}\n")


def table(kind, rows):
    return f"  - type: tabulated {kind}\n    data: |\n" + "".join(f"      {row}\n" for row in rows)


def read(folder, contents, name="material.yml"):
    (folder / name).write_bytes(contents if isinstance(contents, bytes) else contents.encode())
    return load_refraction(name, folder)


# n_d or n_D from the makers and handbooks: Schott data sheets; CRC Handbook (quartz, calcite, sapphire, fluorite and
# rock salt: ordinary ray at the sodium line; water at 20 C; ice Ih; diamond)
@pytest.mark.parametrize("name, nm, n, within", [
    ("n-bk7", NM_D, 1.51680, 1e-5), ("f2", NM_D, 1.62004, 1e-5), ("sf10", NM_D, 1.72825, 1e-5),
    ("n-sf11", NM_D, 1.78472, 1e-5), ("n-fk51a", NM_D, 1.48656, 1e-5), ("fused-silica", NM_D, 1.45846, 1e-5),
    ("water", NM_SODIUM, 1.33299, 5e-4), ("ice", NM_SODIUM, 1.3091, 1e-3), ("quartz", NM_SODIUM, 1.5442, 2e-4),
    ("calcite", NM_SODIUM, 1.6583, 3e-4), ("sapphire", NM_SODIUM, 1.7681, 2e-4), ("diamond", NM_SODIUM, 2.4173, 5e-4),
    ("fluorite", NM_SODIUM, 1.4338, 2e-4), ("rock-salt", NM_SODIUM, 1.5443, 3e-4), ("acrylic", NM_D, 1.4914, 3e-3),
    ("polycarbonate", NM_D, 1.585, 8e-3), ("polystyrene", NM_D, 1.590, 5e-3), ("soda-lime-glass", NM_D, 1.52, 5e-3)])
def test_indices_of_well_known_materials(name, nm, n, within):
    assert load_refraction(name).n_at(nm) == pytest.approx(n, abs=within)


def test_n_bk7_has_the_abbe_number_of_its_data_sheet():
    n_d, n_f, n_c = load_refraction("n-bk7").n_at([NM_D, 486.1327, 656.2725])
    assert (n_d - 1) / (n_f - n_c) == pytest.approx(64.17, abs=0.01)


@pytest.mark.parametrize("name, ev, n, k", [("gold", 2.26, 0.43, 2.455), ("silver", 2.26, 0.06, 3.586),
                                            ("copper", 2.26, 1.02, 2.577), ("gold", 1.88, 0.14, 3.697)])
def test_the_noble_metals_match_johnson_and_christy(name, ev, n, k):
    metal, nm = load_refraction(name), 1239.84198 / ev  # table I of Phys. Rev. B 6, 4370 (1972)
    assert metal.n_at(nm) == pytest.approx(n, abs=0.01) and metal.k_at(nm) == pytest.approx(k, abs=0.01)


# American Institute of Physics Handbook (3rd ed., table 6g): reflectances of evaporated films, normal incidence
@pytest.mark.parametrize("name, nm, reflectance, within", [
    ("aluminium", 550, 0.915, 0.01), ("silver", 550, 0.980, 0.01), ("gold", 450, 0.388, 0.03),
    ("gold", 650, 0.955, 0.01), ("copper", 650, 0.940, 0.02), ("copper", 500, 0.600, 0.05)])
def test_reflectances_of_mirrors(name, nm, reflectance, within):
    assert load_refraction(name).reflectance_at(nm) == pytest.approx(reflectance, abs=within)


def test_reflectance_of_a_dielectric_by_hand():
    assert load_refraction("water").reflectance_at(NM_SODIUM) == pytest.approx((0.333 / 2.333)**2, rel=5e-3)


@pytest.mark.parametrize("name", refraction_names())
def test_every_material_of_the_library_covers_visible_light_and_names_its_source(name):
    material = load_refraction(name)
    assert material.name == name and len(material.source) > 20 and "<" not in material.source
    assert np.all(material.n_at(VISIBLE) > 0) and np.all(material.k_at(VISIBLE) >= 0)
    assert 0 < material.reflectance_at(VISIBLE).min() and material.reflectance_at(VISIBLE).max() < 1
    assert material.dispersive
    assert "CC0" in (LIBRARY / f"{name}.yml").read_text(encoding="utf-8")


def test_metals_shine_and_the_others_do_not():
    shiny = {name for name in refraction_names() if np.all(load_refraction(name).k_at(VISIBLE) > 1)}
    assert shiny == METALS


# Each sum is computed by hand at 0.5 or 1 um, with coefficients that make it short.
@pytest.mark.parametrize("number, coefficients, um, n", [
    (1, "0 1 0.5", 1.0, (1 + 1 / 0.75)**0.5), (1, "0.5 1 0.5 3 2", 1.0, (1.5 + 1 / 0.75 - 1)**0.5),
    (2, "0 1 0.5", 1.0, 3**0.5), (2, "0.25 1 0.04 0.6 2", 0.5, (1.25 + 0.25 / 0.21 - 0.15 / 1.75)**0.5),
    (3, "2 0.5 2 0.01 -2", 0.5, (2 + 0.125 + 0.04)**0.5), (3, "2.25", 1.0, 1.5),
    (4, "2 0.5 2 0.1 2", 0.5, (2 + 0.125 / 0.24)**0.5),
    (4, "2 0.5 0 0.04 1 0.1 2 0.2 2 0.3 1 0.2 -1", 0.5, (2 + 0.5 / 0.21 + 0.025 / 0.21 + 0.15 + 0.4)**0.5),
    (5, "1.5 0.005 -2 0.0001 -4", 0.5, 1.5 + 0.02 + 0.0016),
    (6, "0 0.05 100 0.002 60", 0.5, 1 + 0.05 / 96 + 0.002 / 56),
    (7, "3 0.1 0.01 -0.2 0.3 0.05", 1.0, 3 + 0.1 / 0.972 + 0.01 / 0.972**2 - 0.2 + 0.3 + 0.05),
    (7, "2 0 0 1 1 1", 0.5, 2 + 0.25 + 0.0625 + 0.015625),
    (8, "0.25", 1.0, 2**0.5), (8, "0.2 0.1 0.5 0.05", 1.0, (1.9 / 0.55)**0.5),
    (9, "2.25 0.1 0.5 0.3 0.4 0.2", 1.0, (2.25 + 0.2 + 0.18 / 0.56)**0.5)])
def test_formulas_by_hand(tmp_path, number, coefficients, um, n):
    assert read(tmp_path, formula(number, coefficients)).n_at(um * 1000) == pytest.approx(n, rel=1e-12)


# Examples from the database, for rare formulas: silicon at 2.4373 um (Edwards and Ochoa 1980 measured 3.4434) and
# urea's extraordinary ray at 597 nm (Rosker 1985: 1.605)
@pytest.mark.parametrize("number, coefficients, span, nm, n", [
    (7, "3.41983 0.159906 -0.123109 1.26878E-6 -1.95104E-9", (2.4373, 25), 2437.3, 3.4434),
    (9, "2.51527 0.0240 0.0300 0.020 1.52 0.8771", (0.3, 1.06), 597, 1.605)])
def test_rare_formulas_match_measurements(tmp_path, number, coefficients, span, nm, n):
    assert read(tmp_path, formula(number, coefficients, *span)).n_at(nm) == pytest.approx(n, abs=4e-3)


def test_n_and_k_of_several_entries_are_combined(tmp_path):
    contents = formula(5, "1.5") + table("k", ["0.4 0.1", "0.6 0.3"]) + table("nk", ["0.4 9 9"])
    material = read(tmp_path, contents)
    assert material.n_at(500) == 1.5 and material.k_at(500) == pytest.approx(0.2)
    assert material.reflectance_at(500) == pytest.approx((0.25 + 0.04) / (6.25 + 0.04))
    assert material.range_nm == (300, 2000) and not material.dispersive


def test_tables_are_linear_between_their_rows_in_any_order(tmp_path):
    material = read(tmp_path, "DATA:\n" + table("nk", ["0.6 1.6 0.2", "0.4 1.5 0.0", "0.4 7 7"]))
    np.testing.assert_allclose(material.n_at([400, 450, 600]), [1.5, 1.525, 1.6])
    np.testing.assert_allclose(material.k_at([400, 450, 600]), [0, 0.05, 0.2])
    assert material.dispersive and material.source == ""


def test_a_table_of_n_alone_has_no_extinction(tmp_path):
    material = read(tmp_path, "DATA:\n" + table("n", ["0.57 1.5", "0.6 1.6"]))
    np.testing.assert_array_equal(material.k_at([570, 600]), [0, 0])


def test_a_reference_loses_its_markup(tmp_path):
    reference = "A. Author,<br><a href='x'><i>Opt.</i> <b>1</b></a>"
    assert read(tmp_path, formula(3, "2.25").replace("By hand", reference)).source == "A. Author, Opt. 1"


@pytest.mark.parametrize("nm", [299, 2001, [500, 2500], np.nan])
def test_wavelengths_out_of_range_are_an_error_that_names_the_range(tmp_path, nm):
    material = read(tmp_path, formula(3, "2.25"))
    for of_wavelengths in (material.n_at, material.k_at, material.reflectance_at):
        with refused(InputError, field="wavelength of n", where="material", match="from 300 to 2000 nm"):
            of_wavelengths(nm)


def test_extinction_has_a_separate_range(tmp_path):
    material = read(tmp_path, formula(3, "2.25") + table("k", ["0.4 0.1", "0.6 0.3"]))
    assert material.n_at(700) == 1.5
    with refused(InputError, field="wavelength of k", where="material", match="400 to 600 nm"):
        material.k_at(700)


def test_an_undefined_value_of_a_formula_is_an_error_that_names_the_wavelength(tmp_path):
    material = read(tmp_path, formula(2, "0 1 0.25"))  # a pole at 500 nm, below which n^2 is negative
    assert material.n_at(1000) == pytest.approx((1 + 1 / 0.75)**0.5)
    with refused(InputError, field="n", where="material", match="450 nm"):
        material.n_at(450)


def nested(depth, entries=9):
    """YAML of a few hundred bytes that expands to entries to the power of depth items."""
    lines = ["a0: &a0 [x]"] + [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * entries)}]" for i in range(1, depth)]
    return "\n".join(lines) + f"\nREFERENCES: *a{depth - 1}\nDATA:\n  - type: *a{depth - 1}\n    data: *a{depth - 1}\n"


@pytest.mark.parametrize("contents", [
    "", "x", "- 1", "DATA:", "DATA: 3", "DATA: [1]", "DATA: []", "REFERENCES: x", "{", "a: b: c", "\x00",
    b"\xff\xfe\x00", "[" * 5000, "{a: " * 5000, "!!python/object/apply:os.getcwd []", nested(12),
    "DATA: [" + "[], " * 20000 + "]",
    "DATA:\n" + table("k", ["0.4 1"]), "DATA:\n" + table("n", []), "DATA:\n" + table("n", ["0.4 1 2"]),
    "DATA:\n" + table("nk", ["0.4 1"]), "DATA:\n" + table("n", ["0.4 red"]), "DATA:\n" + table("n", ["0 1"]),
    "DATA:\n" + table("n", ["-1 1"]), "DATA:\n" + table("n", ["0.4 nan"]), "DATA:\n" + table("n", ["0.4 inf"]),
    "DATA:\n" + table("x", ["0.4 1"]), "DATA:\n  - type: tabulated n\n", "DATA:\n  - data: 1 2\n",
    formula(0, "1"), formula(10, "1"), formula(1, ""), formula(1, "red"), formula(1, "9" * 5000),
    formula(8, "1 2 3 4 5"), formula(1, "1 " * 18), formula(1, "1", 2, 0.3), formula(1, "1", 0, 2),
    formula(1, "1", "nan"), formula(1, "1", "", ""), formula(1, "[1, 2]"), "DATA:\n  - type: formula 1\n"])
def test_a_bad_file_is_an_input_error_of_one_short_line(tmp_path, contents):
    with pytest.raises(InputError) as error:
        read(tmp_path, contents)
    assert "\n" not in str(error.value) and len(str(error.value)) < len(str(tmp_path)) + 200


def test_a_file_too_large_is_an_input_error(tmp_path):
    with refused(InputError, field="size", where="material.yml"):
        read(tmp_path, "#" * 2_000_000)


@pytest.mark.parametrize("text", ["", "no-such-glass", "missing/file.yml", "x" * 5000, "."])
def test_an_unknown_material_is_an_input_error(text):
    with pytest.raises(InputError):
        load_refraction(text)
