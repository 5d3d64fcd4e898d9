"""Film: exposures of its layers, with the made-up stock of docs/camera.md."""

import re
import textwrap
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy

from film_metamers import NM, daylight, made_up_film, metamers, on_film, to_the_eye
from lensfield.engine import ImageError, InputError, SpectralImage
from lensfield.engine.sensor.film import Film, film_density, film_exposure, read_film
from lensfield.engine.spectral.spectra import colour_matching
from places import DATA, ROOT
from refusals import refused
from seed import SEED

FINE_NM = np.arange(380.0, 720.01, 0.1)
stock = cache(made_up_film)


def exposure_of(light):
    """Exposures of the made-up layers to J m^-2 nm^-1 at FINE_NM, by hand."""
    log_s = np.stack([np.interp(FINE_NM, NM, each) for each in stock().log_sensitivity])
    return scipy.integrate.trapezoid(10**log_s * light, FINE_NM)


def image(spectra, nm=FINE_NM[::100], **changes):
    """Irradiance of one row of pixels with these spectra (pixel, wavelength)."""
    return SpectralImage(np.transpose(spectra)[:, None], nm, **{"pitch_um": 5.0, "quantity": "irradiance"} | changes)


def test_a_monochromatic_exposure_is_its_energy_times_the_sensitivity():
    """2 W m^-2 for 50 ms are 0.1 J m^-2, or 100 erg cm^-2."""
    exposure = film_exposure(image([[2.0], [0.0]], [440.0]), stock(), 0.05)
    assert exposure.shape == (3, 1, 2) and exposure.dtype == np.float32
    np.testing.assert_allclose(exposure[:, 0, 0], 0.1 * 10**stock().log_sensitivity[:, NM == 440][:, 0], rtol=1e-5)
    np.testing.assert_array_equal(exposure[:, 0, 1], 0)
    between = film_exposure(image([[2.0]], [447.0]), stock(), 0.05)[2, 0, 0]
    at_445, at_450 = (0.1 * 10**stock().log_sensitivity[2, NM == nm][0] for nm in (445, 450))
    assert between == pytest.approx(at_445**0.6 * at_450**0.4, rel=1e-5), "its logarithm is linear"


@pytest.mark.parametrize("step", [20, 50, 100])
def test_greys_under_daylight_expose_all_layers_evenly(step):
    """0.1 J m^-2 of D55 are the stock's reference exposure."""
    nm, greys = FINE_NM[::step], np.array([0.9, 0.18, 0.03])
    exposure = film_exposure(image(greys[:, None] * daylight(nm) * 0.4, nm), stock(), 0.25)[:, 0]
    np.testing.assert_allclose(exposure, np.tile(greys, (3, 1)), rtol=0.01)
    np.testing.assert_allclose(exposure[1:], exposure[:1].repeat(2, axis=0), rtol=1e-3)


def test_exposures_add_up():
    first, second = np.random.default_rng(SEED).random((2, 4, 35))
    parts = [film_exposure(image(each), stock(), seconds) for each, seconds in ((first, 0.1), (second, 0.3))]
    np.testing.assert_allclose(film_exposure(image(first + 3 * second), stock(), 0.1), sum(parts), rtol=1e-5)


def test_metamers_expose_film_differently():
    """Those in docs/camera.md: for the eye the same, for the red layer four times as much light from one of them."""
    pair = np.stack([np.interp(FINE_NM, NM, each) for each in metamers(stock())])
    seen = pair * daylight(FINE_NM) @ colour_matching(FINE_NM)
    np.testing.assert_allclose(seen[0], seen[1], rtol=2e-3)
    np.testing.assert_allclose(to_the_eye(metamers(stock())), 0.5, rtol=1e-9)
    exposure = film_exposure(image((pair * daylight(FINE_NM))[:, ::10], FINE_NM[::10]), stock(), 1.0)[:, 0].T
    true = np.stack([exposure_of(each * daylight(FINE_NM)) for each in pair])
    np.testing.assert_allclose(exposure, true, rtol=1e-4)
    assert exposure[0, 0] / exposure[1, 0] == pytest.approx(4, rel=0.05)
    np.testing.assert_allclose(on_film(metamers(stock()), stock()), true / exposure_of(daylight(FINE_NM)), rtol=2e-3)


def test_densities_are_those_of_the_characteristic_curves():
    film = replace(stock(), log_exposure=[-2, 0, 1], density=[[0.1, 0.8, 1.4], [0.2, 0.9, 1.5], [0.3, 1.0, 1.6]])
    exposure = np.array([1e-5, 0.1, 1, 10**0.5, 1e4, 0]).reshape(1, 2, 3) * np.ones((3, 1, 1))
    expected = np.array([0.1, 0.45, 0.8, 1.1, 1.4, 0.1]).reshape(2, 3)
    np.testing.assert_allclose(film_density(exposure, film), [expected, expected + 0.1, expected + 0.2], rtol=1e-6)
    with refused(InputError, field="density", value="missing", where="film made up"):
        film_density(exposure, stock())


def test_a_stock_is_read_from_a_file():
    film = read_film(DATA / "film.toml")
    assert film == Film("MINE", ("red", "blue"), [400, 500], [[1.5, 2], [3.25, 1]], [-2, 0, 1],
                        [[0.1, 0.8, 1.4], [0.3, 1.0, 1.6]])
    assert film_exposure(image([[2.0]], [400.0]), film, 0.05)[0, 0, 0] == pytest.approx(
        2 * 0.05 * 1e7 / 1e4 * 10**-1.5), "J m^-2 to erg cm^-2"


def test_the_stock_in_the_documents_is_read(tmp_path):
    page = (ROOT / "docs/camera.md").read_text(encoding="utf-8")
    example = re.search(r"(?m)^    format = .lensfield-film.\n(    .*\n)+", page)[0]
    (tmp_path / "mine.toml").write_text(textwrap.dedent(example))
    film = read_film(tmp_path / "mine.toml")
    assert film.layers == ("red", "green", "blue") and film.density.shape == (3, 4)


@pytest.mark.parametrize("old, new, message", [
    ("erg/cm2", "lux", "unit is lux"), ("[400, 500]", "[500, 400]", "ascending"),
    ("blue = [0.25, -2]", "blue = [0]", "log_sensitivity, blue is "),
    ("[-1.5, -1]", "[-1.5, -inf]", "log_sensitivity is out of range"), ("-film", "-camera", "format"),
    ("log_exposure = [-2, 0, 1]\n", "", "expected both or neither"),
    ("red = [0.1", "green = [0.1", "expected red, blue"),
    ("log_exposure", "log_exposures", "log_exposures is unknown"),
    ("[400, 500]", "[400, 500, 600]", "expected 3 for each layer")])
def test_damaged_files_are_refused(tmp_path, old, new, message):
    (tmp_path / "mine.toml").write_text((DATA / "film.toml").read_text(encoding="utf-8").replace(old, new))
    with pytest.raises(InputError, match=rf"mine\.toml: .*{message}"):
        read_film(tmp_path / "mine.toml")


def test_other_pictures_and_times_are_refused():
    with refused(ImageError, field="quantity", value="radiance", where="image"):
        film_exposure(image([[1.0]], [500.0], quantity="radiance"), stock(), 0.1)
    with pytest.raises(InputError, match="shutter_s is 0: expected a positive number"):
        film_exposure(image([[1.0]], [500.0]), stock(), 0)
