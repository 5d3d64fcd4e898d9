"""From spectra to colours: weights of wavelengths in Rec. 709, and the sRGB curve."""

import numpy as np
import pytest

from lensfield.engine.spectral.colour import decode_srgb, encode_srgb, rec709_weights
from lensfield.engine.spectral.spectra import emission_basis, load_spectrum, reflectance_basis, white_density
from lensfield.engine.spectral.wavelength_choice import SpectralOptions, choose_wavelengths

FINE_NM = np.arange(380.0, 781.0, 5.0)


def colour_of(spectrum, wavelengths_nm):
    return spectrum @ rec709_weights(np.asarray(wavelengths_nm, dtype=float))


@pytest.mark.parametrize("wavelengths_nm", [FINE_NM, np.linspace(400, 700, 31), [450, 550, 650], [400, 700], [550],
                                            [481.3, 512.0, 603.7, 699.9]])
def test_d65_is_white_at_any_choice_of_wavelengths(wavelengths_nm):
    wavelengths_nm = np.asarray(wavelengths_nm, dtype=float)
    np.testing.assert_allclose(colour_of(white_density(wavelengths_nm), wavelengths_nm), 1, rtol=1e-12)


@pytest.mark.parametrize("nm", [450.0, 550.0, 650.0])
def test_a_single_wavelength_makes_a_grey_picture(nm):
    colour = colour_of([0.37], [nm])
    np.testing.assert_allclose(colour, colour[0], rtol=1e-12)
    assert colour[0] > 0


@pytest.mark.parametrize("rgb", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.2, 0.5, 0.8), (5.0, 1.0, 0.3)])
def test_a_light_of_a_colour_has_that_colour(rgb):
    np.testing.assert_allclose(colour_of(emission_basis(FINE_NM) @ rgb, FINE_NM), rgb, atol=1e-2 * max(rgb))


@pytest.mark.parametrize("count, within", [(21, 0.011), (31, 0.005), (61, 0.0025)])
def test_more_wavelengths_reproduce_the_primaries_better(count, within):
    """As stated in the guide, under Spectra: they are on the edge of the gamut, and end up slightly beyond it."""
    nm = np.linspace(400, 700, count)
    colours = colour_of(emission_basis(nm).T, nm)
    np.testing.assert_allclose(colours, np.eye(3), atol=within)
    assert np.abs(colours - np.eye(3)).max() > within / 2 and -0.0025 < colours.min() < 0


def test_preview_reproduces_the_primaries_within_two_per_cent():
    nm = np.linspace(400, 700, 21)
    primaries = [lambda nm, channel=channel: reflectance_basis(nm)[:, channel] for channel in range(3)]
    choice = choose_wavelengths(primaries, [white_density], nm, SpectralOptions("preview"))
    colours = colour_of((choice.weights @ reflectance_basis(choice.nodes_nm)).T * white_density(nm), nm)
    np.testing.assert_allclose(colours, np.eye(3), atol=0.02)


@pytest.mark.parametrize("nm, order", [(620, "RGB"), (465, "BGR")])
def test_pure_light_has_the_hue_of_its_wavelength(nm, order):
    colour = colour_of(np.where(FINE_NM == nm, 1.0, 0.0), FINE_NM)
    strength = dict(zip("RGB", colour, strict=True))
    assert strength[order[0]] > max(strength[order[1]], strength[order[2]])


def test_pure_green_lies_outside_the_gamut():
    red, green, blue = colour_of(np.where(FINE_NM == 520, 1.0, 0.0), FINE_NM)
    assert green > 0 > red and blue < green


def test_illuminant_a_has_its_colour():
    # x = 0.44757, y = 0.40745: XYZ = (1.09847, 1, 0.35582); through the sRGB matrix (1.8450, 0.8261, 0.2333).
    colour = colour_of(load_spectrum("illuminant-a").at(FINE_NM), FINE_NM)
    luminance = colour @ [0.2126729, 0.7151522, 0.0721750]
    np.testing.assert_allclose(colour / luminance, [1.8450, 0.8261, 0.2333], atol=5e-3)


@pytest.mark.parametrize("linear, encoded", [(0.0, 0.0), (0.0031308, 0.0404499), (0.18, 0.4613561), (0.2140411, 0.5),
                                             (0.5, 0.7353570), (1.0, 1.0), (-1.0, 0.0), (7.0, 1.0), (0.001, 0.01292)])
def test_srgb_curve(linear, encoded):
    assert encode_srgb(np.array(linear)) == pytest.approx(encoded, abs=1e-6)
    assert decode_srgb(np.array(encoded)) == pytest.approx(np.clip(linear, 0, 1), abs=1e-6)


def test_infrared_is_invisible_and_finite():
    weights = rec709_weights(np.array([550.0, 650.0, 900.0]))
    assert np.isfinite(weights).all() and not weights[2].any()
    assert not rec709_weights(np.array([900.0])).any()
