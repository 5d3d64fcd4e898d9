"""Colours that multiply light many times: powers of spectra and of RGB, with few wavelengths."""

import numpy as np
import pytest

from lensfield.engine.spectral.colour_difference import ciede2000, lab_from_xyz
from lensfield.engine.spectral.repeated_colour import FINE_NM, RepeatedColour, rec709_of
from lensfield.engine.spectral.spectra import (
    colour_matching,
    library_names,
    load_spectrum,
    reflectance_basis,
    white_density,
)
from lensfield.engine.spectral.wavelength_choice import STANDARD_COLOUR_ERROR, SpectralOptions, choose_wavelengths

OUTPUT_NM = np.linspace(400, 700, 21)
CROSSINGS = np.arange(1.0, 13.0)
POWERS = np.array([1.0, 2, 3, 4, 5, 6, 7, 9, 10, 12])
SATURATED = {"green": (0.05, 0.6, 0.1), "bright green": (0.1, 0.8, 0.1), "red": (0.9, 0.1, 0.05),
             "blue": (0.05, 0.1, 0.9), "amber": (0.95, 0.6, 0.05), "bottle": (0.6, 0.9, 0.7)}
CHART = [load_spectrum(name).at for name in library_names("reflectance")]
PAINT = [lambda nm, colour=colour: reflectance_basis(nm) @ colour
         for colour in np.random.default_rng(3).random((30, 3)) * 0.7 + 0.1]
SLACK = 1.25  # for numbers of crossings between the tested ones
REC709_TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def glass(colour, powers=POWERS):
    colour = np.array(colour)
    return RepeatedColour(lambda nm: reflectance_basis(nm) @ colour, colour, powers)


def lab_of_rgb(rgb):
    return lab_from_xyz(np.asarray(rgb) @ REC709_TO_XYZ.T, REC709_TO_XYZ.sum(axis=1))


def errors(plan, colour):
    """CIEDE2000 of the estimate from a plan's wavelengths, after each number of crossings."""
    true, nodes = (glass(colour, CROSSINGS).transports(nm) for nm in (plan.output_nm, plan.nodes_nm))
    matching = white_density(plan.output_nm)[:, None] * colour_matching(plan.output_nm)
    white = matching.sum(axis=0)
    return ciede2000(lab_from_xyz(true @ matching, white),
                     lab_from_xyz(np.maximum(nodes @ plan.weights.T, 0) @ matching, white))


def test_powers_of_spectra_are_below_those_of_rgb_at_every_wavelength():
    """Jensen: s^n = (sum b_c c)^n <= sum b_c c^n, as the basis sums to 1 and is nowhere negative."""
    for colour in np.random.default_rng(1).random((50, 3)):
        spectrum = reflectance_basis(FINE_NM) @ colour
        for power in (2, 5, 12):
            assert np.all(spectrum**power <= reflectance_basis(FINE_NM) @ colour**power + 1e-12)


@pytest.mark.parametrize("level", [0.2, 0.9])
def test_grey_glass_is_the_same_in_rgb(level):
    assert glass((level,) * 3).rgb_difference()[0] < 1e-3


def test_a_cut_off_filter_is_unchanged_in_spectra_and_darkens_in_rgb():
    """It transmits all light above 550 nm, and none below: 1^n = 1 and 0^n = 0."""
    def cut(nm):
        return (nm > 550).astype(float)

    rgb = np.maximum(rec709_of(cut), 0)
    red, green, _ = rgb
    assert red > 0.9 > 0.5 > green > 0.3
    difference, power = RepeatedColour(cut, rec709_of(cut), np.array([1.0, 3.0])).rgb_difference()
    assert power == 3
    assert difference == pytest.approx(float(ciede2000(lab_of_rgb(rec709_of(cut)), lab_of_rgb(rec709_of(cut)**3))),
                                       rel=0.01)


@pytest.mark.parametrize("crossings, share", [(1, 1.0), (2, 0.947), (4, 0.873), (8, 0.804)])
def test_green_glass_after_a_few_crossings(crossings, share):
    """Green, summed over wavelengths with D65 and the colour-matching functions, relative to c^n."""
    colour = np.array(SATURATED["green"])
    light = (reflectance_basis(FINE_NM) @ colour)**crossings * white_density(FINE_NM)
    eye = white_density(FINE_NM) @ colour_matching(FINE_NM)
    green = (np.linalg.inv(REC709_TO_XYZ) @ (light @ colour_matching(FINE_NM) / eye[1]))[1]
    assert green == pytest.approx(share * colour[1]**crossings, rel=0.005)
    spectral = rec709_of(lambda nm: glass(colour, np.array([crossings])).transports(nm)[0])
    assert spectral[1] == pytest.approx(green, rel=0.005)


@pytest.mark.parametrize("name", SATURATED)
@pytest.mark.parametrize("others", [[], CHART, PAINT], ids=["alone", "chart", "paint"])
@pytest.mark.parametrize("tier", ["preview", "standard"])
def test_the_predicted_error_holds_after_many_crossings(name, others, tier):
    colour = SATURATED[name]
    plan = choose_wavelengths([glass(colour).curve, *others], [white_density], OUTPUT_NM, SpectralOptions(tier),
                              repeated=[glass(colour)])
    assert np.percentile(errors(plan, colour), 95) <= SLACK * plan.colour_error
    assert plan.colour_error <= STANDARD_COLOUR_ERROR or tier == "preview"


def test_without_repeated_colours_the_prediction_fails():
    """One glass among 30 paints is rarely sampled: predicted 0.2, actual 1.8."""
    colour = SATURATED["bright green"]
    plan = choose_wavelengths([glass(colour).curve, *PAINT], [white_density], OUTPUT_NM)
    assert plan.colour_error < 0.25 and errors(plan, colour).max() > 1.5


def test_grey_glass_changes_no_plan():
    without_glass, with_grey = (choose_wavelengths(PAINT, [white_density], OUTPUT_NM, repeated=repeated)
                                for repeated in ([], [glass((0.5, 0.5, 0.5))]))
    np.testing.assert_array_equal(without_glass.nodes_nm, with_grey.nodes_nm)
    assert without_glass.colour_error == pytest.approx(with_grey.colour_error, rel=1e-6)


def test_coloured_glass_makes_a_grey_scene_coloured():
    grey = choose_wavelengths([], [white_density], OUTPUT_NM)
    coloured = choose_wavelengths([], [white_density], OUTPUT_NM, repeated=[glass(SATURATED["red"])])
    assert grey.nodes_nm.size == 1 and coloured.nodes_nm.size >= 3
