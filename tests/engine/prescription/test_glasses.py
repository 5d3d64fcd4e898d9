"""Glasses by name: the right data, and no invented data."""

import numpy as np
import pytest

from lensfield.engine import LensError
from lensfield.engine.prescription.glasses import CATALOGUE, Glass, best_name, find_glass
from lensfield.engine.prescription.prescription import Prescription, Surface
from lensfield.engine.prescription.system import system_of
from lensfield.engine.spectral.refraction import Formula

NAMES = [line.partition(",")[0] for line in CATALOGUE.read_text(encoding="utf-8").splitlines()]


def index_and_abbe(name):
    material = find_glass(name, "lens", "surface 1, glass")
    blue, yellow, red = material.index_at([486.1327, 587.5618, 656.2725])
    return yellow, (yellow - 1) / (blue - red)


@pytest.mark.parametrize("name, index, abbe", [
    ("N-BK7", 1.51680, 64.17), ("SCHOTT N-BK7", 1.51680, 64.17), ("schott nbk7", 1.51680, 64.17),
    ("SF5", 1.67270, 32.21), ("SF10", 1.72825, 28.41), ("SF11", 1.78472, 25.76), ("N-SF5", 1.67271, 32.25),
    ("N-SF10", 1.72828, 28.53), ("N-SF11", 1.78472, 25.68), ("F2", 1.62004, 36.37), ("OHARA S-LAL8", 1.71300, 53.87)])
def test_index_and_abbe_number_match_the_data_sheets(name, index, abbe):
    """From the makers' data sheets; a search by similarity finds N-SF11 for SF11."""
    result = index_and_abbe(name)
    assert result[0] == pytest.approx(index, abs=1.5e-5) and result[1] == pytest.approx(abbe, abs=0.015)


@pytest.mark.parametrize("model, name", [("1.5168/64.17", "N-BK7"), ("1.62004/36.37", "F2"), ("1.72825/28.41", "SF10"),
                                         ("1.713/53.87", "OHARA S-LAL8")])
def test_index_and_abbe_number_approximate_a_glass(model, name):
    """To a hundredth of the glass's dispersion."""
    model, glass = (find_glass(text, "lens", "glass") for text in (model, name))
    for nm, error in ((400, 3e-4), (486.1, 5e-5), (587.6, 1e-5), (656.3, 5e-5), (700, 1e-4)):
        assert float(model.index_at(nm)) == pytest.approx(float(glass.index_at(nm)), abs=error)


def test_every_catalogue_glass_is_available_by_its_full_name():
    assert len(NAMES) > 1500
    for name in NAMES:
        glass = find_glass(name, "lens", "glass")
        first, last = glass.dispersion.range_nm
        index = glass.index_at(np.clip([480.0, 550.0, 640.0], first, last))
        assert glass.name.replace("-", "").upper() == name.replace("-", "").upper()
        assert np.all((1.3 < index) & (index < 4)) and np.all(np.diff(index) <= 0)
        assert np.all(glass.extinction_at([480.0, 550.0]) >= 0)


def test_outside_its_catalogue_range_a_glass_has_no_index():
    assert np.isnan(find_glass("N-BK7", "lens", "glass").index_at([250.0, 3000.0])).all()


def test_an_empty_name_is_air():
    assert float(find_glass("", "lens", "glass").index_at(550.0)) == 1.0


@pytest.mark.parametrize("name, message", [
    ("LAK10C", "in no glass catalogue: perhaps .*CDGM H-LAK10"), ("ZK9C", "perhaps CDGM H-ZK9A"),
    ("KF9", "perhaps SCHOTT N-KF9"), ("SCHOTT S-LAL8", "perhaps OHARA S-LAL8"), ("XYZZY-1", "catalogue: give another"),
    ("BK7", "perhaps SCHOTT N-BK7"),
    ("FOO N-BK7", "in no glass catalogue: perhaps SCHOTT N-BK7"), ("/ N-BK7", "in no glass catalogue"),
    (" ", "in no glass catalogue"),
    ("1.62", "an index without dispersion: give its Abbe number too, as 1.62/V"), ("2", "too, as 2/V"),
    ("1/60", "expected an index above 1 and an Abbe number from 10"), ("1.5/0", "expected an index above 1"),
    ("1.5/-3", "in no glass catalogue"), ("nan", "in no glass catalogue"), ("___BLANK", "in no glass catalogue")])
def test_an_unknown_glass_is_an_error_that_names_it(name, message):
    with pytest.raises(LensError, match=message) as error:
        find_glass(name, "lens", "surface 3, glass")
    assert str(error.value).startswith(f"lens: surface 3, glass is {name}: ")


@pytest.mark.parametrize("name, makers, expected", [
    ("NBK7", ["SCHOTT"], "SCHOTT N-BK7"), ("SF10", ["HIKARI", "SCHOTT"], "HIKARI SF10"), ("SF10", ["RXGLASS"], "SF10"),
    ("SF10", ["OHARA"], "SF10"), ("N-BK7", [], "N-BK7"), ("517642", ["SCHOTT"], "1.517/64.2"),
    ("516800.641673", [], "1.5168/64.1673"), ("003283", [], "2.003/28.3"), ("MYGLASS", ["SCHOTT"], "MYGLASS")])
def test_names_of_other_programs_are_translated(name, makers, expected):
    assert best_name(name, makers) == expected


def test_a_glass_without_extinction_absorbs_nothing():
    without = next(glass for name in NAMES if (glass := find_glass(name, "", "")).absorption is None)
    assert without.extinction_at(550.0) == 0
    flint = find_glass("SF11", "lens", "glass")
    assert flint.extinction_at(400.0) > flint.extinction_at(550.0) > 0


def one_glass(name, figures=""):
    return Prescription("condenser", (Surface(50.0, 3.0, name, stop=True, glass_figures=figures), Surface(-50.0, 47.0)),
                        ("f_number", 10.0), ("angle_deg", 5.0))


@pytest.mark.parametrize("name, figures, nm, message", [
    ("SCHOTT B270", "", 400.0, r"known from 435.83 to 656.27 nm only, not at 400 nm: .*n/V such as 1.523/58.76 \("),
    ("SCHOTT B270", "1.523/58.57", 700.0, r"to 656.27 nm only, not at 700 nm: .*n/V such as 1.523/58.57 \(--glass"),
    ("SCHOTT N-BK7", "", 200.0, "known from 300 to 2500 nm only, not at 200 nm: .*n/V such as 1.5168/64.17 ")])
def test_a_wavelength_beyond_a_glass_is_an_error_with_its_range(name, figures, nm, message):
    with pytest.raises(LensError, match=f"surface 1, glass is {name}: .*{message}"):
        system_of(one_glass(name, figures)).indices_at([550.0, nm])


def test_a_glass_that_is_unknown_at_the_spectral_lines_has_no_figures():
    infrared = Glass("IR", Formula(5, (3.4,), (1200.0, 9000.0)))
    assert not infrared.figures
