"""The number of wavelengths for a scene: the linear estimate against light that bounces between known surfaces."""

from functools import cache

import numpy as np
import pytest

from lensfield.engine.runtime.errors import InputError
from lensfield.engine.spectral.colour_difference import ciede2000, lab_from_xyz
from lensfield.engine.spectral.spectra import (
    Spectrum,
    colour_matching,
    library_names,
    load_spectrum,
    reflectance_basis,
    white_density,
)
from lensfield.engine.spectral.wavelength_choice import (
    NOISE_SHARE,
    STANDARD_COLOUR_ERROR,
    SpectralOptions,
    choose_wavelengths,
)
from refusals import refused

OUTPUT_NM = np.linspace(400, 700, 31)
FINE_NM = np.linspace(400, 700, 301)
CHART = tuple(load_spectrum(name).at for name in library_names("reflectance") if name.startswith("chart"))
SLACK = 1.15  # for light other than the tested samples, and the quantile of 95 %
SUM_ROUNDING = OUTPUT_NM.size**2 * np.finfo(float).eps / NOISE_SHARE  # of the worst-conditioned solution
FEW = CHART[14], CHART[13], CHART[12]  # red, green, blue


def flat(nm):
    return np.full(np.shape(nm), 1 / 400)


def grey(level):
    return lambda nm: np.full(np.shape(nm), level)


def line(nm, width_nm=0.5):
    return Spectrum(np.array([nm - width_nm, nm, nm + width_nm]), np.array([0.0, 1.0, 0.0]))


@cache
def rooms(factors, count=80, surfaces=5, seed=1):
    """Light off the surfaces of random rooms, some open and some closed: radiosity, B = E + R F B, by wavelength."""
    rng = np.random.default_rng(seed)
    curves = np.array([factor(FINE_NM) for factor in factors])
    light = []
    for _ in range(count):
        reflectance = curves[rng.integers(0, len(curves), surfaces)]
        view_factors = rng.dirichlet(np.ones(surfaces), surfaces) * rng.random((surfaces, 1))
        white = rng.random(surfaces) * (rng.random(surfaces) < 0.5)
        system = np.eye(surfaces) - reflectance.T[:, :, None] * view_factors
        light.append(np.linalg.solve(system, (reflectance.T * white)[..., None])[..., 0].T)
    light = np.concatenate(light)
    return light[light.mean(axis=1) > 0.01 * light.max()]


def at(light, nm):
    return np.array([np.interp(nm, FINE_NM, curve) for curve in light])


def colour_errors(true, estimated, lamp, nm):
    """CIEDE2000 relative to a perfect white in the lamp's light."""
    matching = lamp(nm)[:, None] * colour_matching(nm)
    white = matching.sum(axis=0)
    return ciede2000(lab_from_xyz(true @ matching, white), lab_from_xyz(np.maximum(estimated, 0) @ matching, white))


def estimate_error(plan, light, lamp):
    """The 95th percentile of the colour errors of these lights, as estimated from the nodes of a plan."""
    nm = plan.output_nm
    errors = colour_errors(at(light, nm), at(light, plan.nodes_nm) @ plan.weights.T, lamp, nm)
    return np.percentile(errors, 95)


def test_grey_scene_takes_one_wavelength_and_stays_grey():
    plan = choose_wavelengths([grey(0.2), grey(0.8)], [white_density], OUTPUT_NM)
    assert plan.nodes_nm.size == 1 and "grey" in plan.reason
    np.testing.assert_allclose(plan.weights, 1, rtol=0, atol=1e-12)
    assert plan.colour_error == plan.sensor_error == plan.surprise(np.ones((1, 5))) == 0


def test_a_scene_without_surfaces_is_grey():
    assert choose_wavelengths([], [white_density], OUTPUT_NM).nodes_nm.size == 1


@pytest.mark.parametrize("strength", [1.0, 0.02])
def test_slightly_coloured_is_not_grey(strength):
    tinted = Spectrum(np.array([400.0, 700.0]), np.array([0.5, 0.505]) * strength).at
    plan = choose_wavelengths([tinted], [white_density], OUTPUT_NM)
    assert plan.nodes_nm.size == 3 and "grey" not in plan.reason
    assert estimate_error(plan, rooms((tinted,)), white_density) <= plan.colour_error < 0.5


@pytest.mark.parametrize("factors, options", [
    (FEW, SpectralOptions()), (CHART, SpectralOptions("preview")), (CHART, SpectralOptions(colour_error=0.05))])
def test_weights_keep_grey_grey(factors, options):
    plan = choose_wavelengths(factors, [white_density], OUTPUT_NM, options)
    assert 1 < plan.nodes_nm.size < OUTPUT_NM.size
    np.testing.assert_allclose(plan.weights.sum(axis=1), 1, rtol=0, atol=1e-12)


@pytest.mark.parametrize("options, dispersive", [(SpectralOptions("reference"), False), (SpectralOptions(), True),
                                                 (SpectralOptions("preview"), True)])
def test_every_rendered_wavelength_is_returned_unchanged(options, dispersive):
    plan = choose_wavelengths(CHART, [white_density], OUTPUT_NM, options, dispersive=dispersive)
    np.testing.assert_array_equal(plan.nodes_nm, OUTPUT_NM)
    np.testing.assert_array_equal(plan.weights, np.eye(31))
    assert plan.colour_error == plan.sensor_error == 0


def test_glass_in_view_counts_in_a_grey_scene_too():
    assert choose_wavelengths([grey(0.5)], [white_density], OUTPUT_NM, dispersive=True).nodes_nm.size == 31


def test_grey_counts_in_the_reference_too():
    assert choose_wavelengths([grey(0.5)], [white_density], OUTPUT_NM, SpectralOptions("reference")).nodes_nm.size == 1


@pytest.mark.parametrize("per_pass", [3, 1])
def test_preview_takes_three_wavelengths(per_pass):
    plan = choose_wavelengths(CHART, [white_density], OUTPUT_NM, SpectralOptions("preview"), per_pass=per_pass)
    assert plan.nodes_nm.size == 3
    assert plan.nodes_nm[0] < 490 < plan.nodes_nm[1] < 580 < plan.nodes_nm[2]  # one in each third of the visible range


@pytest.mark.parametrize("output_nm", [[550.0], [450.0, 650.0], [450.0, 550.0, 650.0]])
def test_wavelengths_that_fit_into_one_pass_are_all_rendered(output_nm):
    plan = choose_wavelengths(CHART, [white_density], output_nm, SpectralOptions("preview"))
    np.testing.assert_array_equal(plan.nodes_nm, output_nm)


@pytest.mark.parametrize("output_nm", [[550, 550.5, 551, 551.5], [450, 450.001, 450.002, 550, 550.001, 650],
                                       [400, 410, 420, 430, 700]])
def test_unevenly_spaced_wavelengths_are_estimated(output_nm):
    light = rooms(CHART)
    plan = choose_wavelengths(CHART, [white_density], output_nm, SpectralOptions(colour_error=1e-6))
    np.testing.assert_allclose(at(light, plan.nodes_nm) @ plan.weights.T, at(light, plan.output_nm), atol=1e-9)
    assert choose_wavelengths(CHART, [white_density], output_nm, SpectralOptions("preview")).nodes_nm.size <= 3


@pytest.mark.parametrize("factors", [CHART[14:15], CHART[2:3], FEW, CHART[12:18], CHART],
                         ids=["red", "blue", "three", "six", "chart"])
@pytest.mark.parametrize("lamp", [white_density, flat, load_spectrum("illuminant-a").density_at,
                                  load_spectrum("led-rgb1").band_means], ids=["D65", "flat", "A", "LED"])
def test_rooms_stay_within_the_predicted_error(factors, lamp):
    """Light that bounces in rooms of these colours, computed wavelength by wavelength."""
    plan = choose_wavelengths(factors, [lamp], OUTPUT_NM)
    assert plan.colour_error <= STANDARD_COLOUR_ERROR and plan.nodes_nm.size <= 12
    assert estimate_error(plan, rooms(factors), lamp) <= SLACK * plan.colour_error


@pytest.mark.parametrize("limit", [0.1, 0.5, 2.0])
def test_the_prediction_is_not_far_too_high(limit):
    """The prediction is useful: the measured error is at least a quarter of it."""
    plan = choose_wavelengths(CHART, [white_density], OUTPUT_NM, SpectralOptions(colour_error=limit))
    assert limit / 10 < plan.colour_error <= limit
    assert plan.colour_error / 4 < estimate_error(plan, rooms(CHART), white_density) <= plan.colour_error


def test_colours_of_textures_are_predicted():
    """Nodes compute colours that are unknown in advance: light bounces in rooms of random Rec. 709 colours."""
    painted = np.random.default_rng(8).random((40, 3))
    light = rooms(tuple(lambda nm, colour=colour: reflectance_basis(nm) @ colour for colour in painted))
    plan = choose_wavelengths([], [white_density], OUTPUT_NM, mixed_colours=True)
    assert estimate_error(plan, light, white_density) <= plan.colour_error <= STANDARD_COLOUR_ERROR
    blind = choose_wavelengths([grey(0.5)], [white_density], OUTPUT_NM)
    assert estimate_error(blind, light, white_density) > 10


def test_a_smaller_error_limit_takes_more_wavelengths_and_is_met():
    limits = [4.0, 1.0, 0.25, 0.06, 0.015]
    requests = [SpectralOptions(colour_error=limit) for limit in limits]
    plans = [choose_wavelengths(CHART, [white_density], OUTPUT_NM, options) for options in requests]
    counts = [plan.nodes_nm.size for plan in plans]
    assert counts == sorted(counts) and counts[-1] > counts[0]
    light = rooms(CHART)
    measured = [estimate_error(plan, light, white_density) for plan in plans]
    assert measured == sorted(measured, reverse=True) and measured[-1] < 0.015


def test_the_requested_sensor_error_is_met():
    plan = choose_wavelengths(CHART, [white_density], OUTPUT_NM, SpectralOptions(sensor_error=0.002))
    light, nm = rooms(CHART), OUTPUT_NM
    for centre_nm in (450, 540, 610):
        band = np.exp(-0.5 * ((nm - centre_nm) / 30)**2) * white_density(nm)
        true, estimated = at(light, nm) @ band, at(light, plan.nodes_nm) @ plan.weights.T @ band
        assert np.sqrt(np.mean((estimated - true)**2) / np.mean(true**2)) <= 0.002 * 1.15
    assert plan.sensor_error <= 0.002


@pytest.mark.parametrize("limits, errors, met", [
    ({}, (STANDARD_COLOUR_ERROR, 1), True), ({}, (1.01 * STANDARD_COLOUR_ERROR, 0), False),
    ({"colour_error": 1}, (0.99, 9), True),
    ({"sensor_error": 0.01}, (9, 0.01), True), ({"sensor_error": 0.01}, (0.1, 0.011), False),
    ({"colour_error": 1, "sensor_error": 0.01}, (1.1, 0), False),
    ({"colour_error": 1, "sensor_error": 0.01}, (1, 0.01), True)])
def test_only_the_requested_limits_must_be_met(limits, errors, met):
    assert SpectralOptions(**limits).met_by(errors) is met


@pytest.mark.parametrize("field, value", [
    ("tier", "best"), ("tier", None), ("colour_error", 0), ("colour_error", -1), ("colour_error", float("nan")),
    ("colour_error", float("inf")), ("colour_error", "0.5"), ("sensor_error", 0), ("sensor_error", [0.1])])
def test_bad_options_are_named_in_one_line(field, value):
    with refused(InputError, field=field):
        SpectralOptions(**{field: value})


@pytest.mark.parametrize("tier", ["preview", "reference"])
@pytest.mark.parametrize("field", ["colour_error", "sensor_error"])
def test_error_limits_apply_only_to_the_standard_tier(tier, field):
    with refused(InputError, field=field, value=0.1, match=tier):
        SpectralOptions(tier, **{field: 0.1})


def test_the_light_of_a_single_line_is_predicted_at_its_wavelength():
    """Sodium's pair is between the wavelengths of any grid: the estimate must be correct there and nowhere else."""
    lamp = line(589.3)
    plan = choose_wavelengths(CHART, [lamp.band_means], OUTPUT_NM)
    assert plan.nodes_nm.size == 3 and np.abs(plan.nodes_nm - 589.3).min() < 5
    assert estimate_error(plan, rooms(CHART), lamp.band_means) <= plan.colour_error + 0.01


def test_understood_scenes_hardly_surprise_and_foreign_ones_do():
    plan = choose_wavelengths(CHART, [white_density], OUTPUT_NM)
    assert plan.surprise(at(rooms(CHART), plan.nodes_nm).T) < 2
    comb = np.exp(-0.5 * ((FINE_NM - np.arange(410, 700, 13)[:, None]) / 8)**2)  # narrow-band dyes
    assert plan.surprise(at(comb, plan.nodes_nm).T) > 10
    one_in_ten = np.concatenate([at(rooms(CHART), plan.nodes_nm), at(comb, plan.nodes_nm)])
    assert plan.surprise(one_in_ten.T) > 3


def test_surprise_does_not_depend_on_brightness_or_shape():
    plan = choose_wavelengths(CHART, [white_density], OUTPUT_NM)
    planes = at(rooms(CHART), plan.nodes_nm).T[:, :24]
    once = plan.surprise(planes)
    assert plan.surprise(1e3 * planes.reshape(-1, 4, 6)) == pytest.approx(once, rel=1e-9)
    assert plan.surprise(np.zeros_like(planes)) == 0


def test_the_plan_is_the_same_each_time():
    """Except for the last digits: sums in a linear algebra library depend on the memory addresses of its arrays."""
    first, second = (choose_wavelengths(CHART, [white_density], OUTPUT_NM, mixed_colours=True) for _ in range(2))
    np.testing.assert_array_equal(first.nodes_nm, second.nodes_nm)
    np.testing.assert_allclose(first.weights, second.weights, atol=SUM_ROUNDING)
    assert first.colour_error == pytest.approx(second.colour_error, rel=SUM_ROUNDING)


def test_a_limit_that_cannot_be_met_takes_every_wavelength():
    output_nm = np.linspace(400, 700, 25)
    plan = choose_wavelengths(CHART, [white_density], output_nm, SpectralOptions(colour_error=1e-9))
    np.testing.assert_array_equal(plan.nodes_nm, output_nm)
