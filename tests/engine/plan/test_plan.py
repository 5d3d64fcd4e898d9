"""Options, and the plan that follows from their advanced options."""

import json
from dataclasses import FrozenInstanceError, fields

import numpy as np
import pytest

from lenses import gaussian_psf, make_lens
from lensfield.engine import ImageError, Options
from lensfield.engine.blur import METHODS
from lensfield.engine.blur.isoplanatic import Paper
from lensfield.engine.field.radial.field import RadialFieldMap
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.sampling import Sampling
from lensfield.engine.plan.choose import make_plan
from lensfield.engine.plan.plan import Plan
from lensfield.engine.runtime.errors import InputError

BLURRED = make_lens(gaussian_psf(4, 4, 1.0, 64), psf_pitch_um=1.0)


def picture(rows, columns, pitch_um, **facts):
    return Sampling(PixelGrid((rows, columns), pitch_um, **facts), (550.0,))


def test_options_cannot_be_changed():
    with pytest.raises(FrozenInstanceError):
        Options().accuracy = 1


def named_error(**options):
    with pytest.raises(InputError) as error:
        Options(**options)
    message = str(error.value)
    assert message.startswith(f"options: {error.value.field} is ") and "\n" not in message
    return error.value


@pytest.mark.parametrize("field, value", [
    ("section_size", 0), ("section_size", -3), ("section_size", 2.5), ("section_size", True), ("section_size", "16"),
    ("section_size", 16.0), ("section_size", np.nan), ("section_size", [16]),
    ("azimuths", 0), ("azimuths", 8.5), ("azimuths", True), ("azimuths", "8"),
    ("accuracy", 0), ("accuracy", -0.01), ("accuracy", 2), ("accuracy", np.nan), ("accuracy", np.inf),
    ("accuracy", "0.01"), ("accuracy", True), ("accuracy", [0.01]),
    ("psf_energy", 0), ("psf_energy", 1.01), ("psf_energy", np.nan), ("psf_energy", "all"), ("psf_energy", True),
    ("flat_tolerance", -0.1), ("flat_tolerance", 1), ("flat_tolerance", np.nan), ("flat_tolerance", "some"),
    ("method", "fast"), ("method", None), ("method", "Sections"), ("method", "polar"), ("method", "one PSF"),
    ("precision", "double"), ("precision", 32),
    ("out_of_field", "clamp"), ("out_of_field", None),
    ("fireflies", "keep"), ("fireflies", None),
])
def test_a_wrong_option_is_named(field, value):
    assert named_error(**{field: value}).field == field


@pytest.mark.parametrize("options", [
    {"section_size": 1}, {"section_size": np.int64(7)}, {"azimuths": 1}, {"accuracy": 1e-6}, {"accuracy": 1},
    {"accuracy": np.float32(0.25)}, {"psf_energy": 1}, {"psf_energy": 0.5}, {"flat_tolerance": 0},
    {"flat_tolerance": 0.999}, {"out_of_field": "vignette"}, {"fireflies": "clamp"}, {"precision": "auto"},
    {"precision": "float32"}, {"precision": "float64"}, {"method": "pixels", "azimuths": 8}, {"method": "paper"},
    {"method": "paper", "section_size": 8, "precision": "auto", "psf_energy": 0.99},
    {"method": "exact", "out_of_field": "vignette", "fireflies": "clamp"}, {"method": "sections", "accuracy": 0.1},
    {"method": "pixels", "accuracy": 0.1}, {"method": "sections", "section_size": 48, "azimuths": 16},
    {"accuracy": 0.1, "out_of_field": "vignette", "fireflies": "clamp"},
    {"section_size": 16, "azimuths": 4, "psf_energy": 0.99, "flat_tolerance": 0.01, "precision": "auto"},
], ids=str)
def test_compatible_options_are_accepted(options):
    taken = Options(**options)
    assert all(getattr(taken, field) == value for field, value in options.items())


@pytest.mark.parametrize("options, field, reason", [
    *(({"accuracy": 0.01, knob: value}, knob, "leave it out: the accuracy determines it") for knob, value in (
        ("section_size", 32), ("azimuths", 32), ("psf_energy", 0.99), ("flat_tolerance", 0.0), ("precision", "auto"))),
    *(({"accuracy": 0.01, "method": method}, "accuracy", f"the method {method!r} uses its own settings")
      for method in ("paper", "exact")),
    *(({"method": method, knob: value}, knob, f"leave it out: the method is {method!r}") for method, knob, value in (
        ("pixels", "section_size", 32), ("paper", "azimuths", 4), ("paper", "flat_tolerance", 1e-3),
        ("exact", "psf_energy", 1.0), ("exact", "azimuths", 32), ("exact", "flat_tolerance", 0.0))),
], ids=str)
def test_contradictory_options_are_named(options, field, reason):
    error = named_error(**options)
    assert error.field == field and error.value == options[field] and reason in str(error)


@pytest.mark.parametrize("options, by_result", [
    ({}, True), ({"accuracy": 0.1}, True), ({"method": "sections"}, True), ({"method": "pixels"}, True),
    ({"out_of_field": "vignette", "fireflies": "clamp"}, True), ({"section_size": 32}, False), ({"azimuths": 8}, False),
    ({"precision": "auto"}, False), ({"flat_tolerance": 0.0}, False), ({"method": "paper"}, False),
    ({"method": "exact"}, False)], ids=str)
def test_options_go_by_result_unless_a_knob_is_set(options, by_result):
    assert Options(**options).by_result == by_result


@pytest.mark.parametrize("value", [16, np.int64(16)])
def test_integers_of_any_type_are_accepted(value):
    assert make_plan(Options(section_size=value), BLURRED, picture(100, 100, 5.0)).method.section_size == 16


@pytest.mark.parametrize("method", ["sections", "paper"])
@pytest.mark.parametrize("section_size", [1, 16, 33, 1000])
@pytest.mark.parametrize("pitch_um", [0.5, 5.0, 50.0])
def test_the_fft_space_holds_a_section_and_its_margins(section_size, pitch_um, method):
    plan = make_plan(Options(method=method, section_size=section_size), BLURRED, picture(100, 120, pitch_um))
    assert plan.method.space_px >= plan.method.section_size + 2 * plan.psf_radius_px


def test_an_untrimmed_psf_reaches_half_the_diagonal_of_its_window():
    plan = make_plan(Options(psf_energy=1), BLURRED, picture(100, 100, 4.0))
    assert np.sqrt(2) * 32 / 4 <= plan.psf_radius_px <= np.sqrt(2) * 32 / 4 + 3
    assert plan.psf_energy == 1


@pytest.mark.parametrize("energy", [0.9, 0.99, 0.9999])
def test_the_reach_of_a_trimmed_psf_follows_from_its_energy(energy):
    """A Gaussian keeps 1 - exp(-r^2 / 2 sigma^2) within r."""
    plan = make_plan(Options(psf_energy=energy), BLURRED, picture(100, 100, 1.0))
    radius_um = 4 * np.sqrt(-2 * np.log(1 - energy))
    assert radius_um - 1.5 <= plan.psf_radius_px <= radius_um + 5
    assert plan.psf_energy == energy and np.sqrt(plan.taps / np.pi) == pytest.approx(radius_um + 1, abs=1)


def test_a_psf_that_reaches_too_far_is_an_error_with_its_reach():
    with pytest.raises(ImageError, match="pitch_um is 0.01: a point spread function would reach .* px; at most 2048"):
        make_plan(Options(psf_energy=1), BLURRED, picture(100, 100, 0.01))


def test_the_papers_method_has_its_settings():
    plan = make_plan(Options(method="paper"), BLURRED, picture(576, 768, 6.25))
    assert plan.method == Paper(section_size=16, space_px=64)
    assert plan.precision == "float64" and plan.psf_energy == 1 and not plan.folded


def test_the_papers_method_with_other_sections_uses_the_least_space():
    plan = make_plan(Options(method="paper", section_size=4, precision="auto"), BLURRED, picture(576, 768, 6.25))
    assert plan.method.section_size == 4 and 4 + 2 * plan.psf_radius_px <= plan.method.space_px < 64
    assert plan.precision == "float32"


def test_a_section_larger_than_the_image_is_reduced():
    plan = make_plan(Options(section_size=5000), BLURRED, picture(30, 40, 5.0))
    assert 40 <= plan.method.section_size <= 40 + 2 * plan.psf_radius_px


@pytest.mark.parametrize("options, method", [
    ({"precision": "float64"}, "sections"), ({"azimuths": 8}, "sections"), ({"section_size": 8}, "sections"),
    ({"method": "pixels", "precision": "float64"}, "pixels"), ({"method": "exact"}, "exact")], ids=str)
def test_knobs_determine_the_method(options, method):
    plan = make_plan(Options(**options), BLURRED, picture(100, 100, 5.0))
    assert plan.method.name == method
    facts = plan.as_dict()
    assert all(facts[knob] == value for knob, value in options.items())


@pytest.mark.parametrize("name", METHODS)
def test_every_method_describes_itself_and_its_cost(name):
    plan = make_plan(Options(method=name), BLURRED, picture(100, 100, 5.0))
    assert plan.method.name == name
    assert plan.method.text in plan.text and f"{plan.precision == 'float64' and 'double' or 'single'}" in plan.text
    assert plan.seconds > 0 and plan.memory_mb > 0


def test_quadrants_are_folded_when_the_axis_is_centred():
    assert make_plan(Options(section_size=32), BLURRED, picture(100, 120, 5.0)).folded
    assert not make_plan(Options(section_size=32), BLURRED, picture(100, 120, 5.0, centre_px=(50, 59.5))).folded


@pytest.mark.parametrize("options", [Options(section_size=32), Options(accuracy=0.01)], ids=["knobs", "accuracy"])
def test_the_field_map_decides_whether_quadrants_are_folded(options, monkeypatch):
    assert make_plan(options, BLURRED, picture(100, 120, 5.0)).folded
    monkeypatch.setattr(RadialFieldMap, "mirror_symmetric", False)
    assert not make_plan(options, BLURRED, picture(100, 120, 5.0)).folded


@pytest.mark.parametrize("precision, picture_precision, single_range", [
    ("float32", "float32", np.inf), ("float64", "float64", 0.0), ("auto", "float32", 1e3)])
def test_precision_applies_to_planes_and_sections(precision, picture_precision, single_range):
    plan = make_plan(Options(precision=precision), BLURRED, picture(100, 100, 5.0))
    assert (plan.precision, plan.single_range) == (picture_precision, single_range)


def test_plans_by_knobs_have_no_error_bound():
    assert make_plan(Options(section_size=32), BLURRED, picture(100, 100, 5.0)).error_bound is None


def test_a_plan_converts_to_json():
    plan = make_plan(Options(section_size=32, out_of_field="vignette", precision="float32"), BLURRED,
                     picture(100, 100, 5.0))
    facts = json.loads(json.dumps(plan.as_dict()))
    names = {field.name for field in fields(Plan)} | {field.name for field in fields(plan.method)}
    assert facts.keys() == names
    assert facts["method"] == "sections" and facts["out_of_field"] == "vignette" and facts["single_range"] is None
