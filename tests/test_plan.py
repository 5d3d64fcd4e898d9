"""Options and the plan made from them."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from lenses import gaussian_psf, make_lens
from lensfield.engine import Options
from lensfield.engine.errors import InputError
from lensfield.engine.plan import make_plan

BLURRED = make_lens(gaussian_psf(4, 4, 1.0, 64), psf_pitch_um=1.0)


def test_options_cannot_be_changed():
    with pytest.raises(FrozenInstanceError):
        Options().order = 1


@pytest.mark.parametrize("field, value", [
    ("section_size", 0), ("section_size", -3), ("section_size", 2.5), ("section_size", True), ("section_size", "16"),
    ("section_size", None), ("section_size", 16.0), ("order", True), ("section_size", np.nan), ("section_size", [16]),
    ("order", 0), ("order", 5), ("order", "2"), ("order", None), ("order", [1]),
    ("space_px", 0), ("space_px", 64.5), ("space_px", "64"), ("space_px", np.inf),
    ("out_of_field", "clamp"), ("out_of_field", None),
])
def test_a_wrong_option_is_named(field, value):
    with pytest.raises(InputError) as error:
        Options(**{field: value})
    assert error.value.field == field
    assert str(error.value).startswith("options: ")


@pytest.mark.parametrize("value", [16, np.int64(16)])
def test_whole_numbers_of_any_kind_are_taken(value):
    assert make_plan(Options(section_size=value), BLURRED, 5.0, (100, 100)).section_size == 16


@pytest.mark.parametrize("section_size", [1, 16, 33, 1000])
@pytest.mark.parametrize("space_px", [None, 1, 8, 64])
@pytest.mark.parametrize("pitch_um", [0.5, 5.0, 50.0])
def test_the_space_always_holds_the_section_and_what_reaches_out_of_it(section_size, space_px, pitch_um):
    plan = make_plan(Options(section_size=section_size, space_px=space_px), BLURRED, pitch_um, (100, 120))
    assert plan.space_px >= plan.section_size + 2 * plan.psf_radius_px
    assert plan.space_px >= (space_px or 0)


def test_a_psf_reaches_as_far_as_its_window_turned_by_45_degrees():
    radius = make_plan(Options(), BLURRED, 4.0, (100, 100)).psf_radius_px
    assert np.sqrt(2) * 32 / 4 <= radius <= np.sqrt(2) * 32 / 4 + 3


def test_the_space_of_the_paper_is_kept_where_it_suffices():
    plan = make_plan(Options(16, 1, 64), BLURRED, 6.25, (576, 768))
    assert (plan.section_size, plan.order, plan.space_px) == (16, 1, 64)


def test_a_section_larger_than_the_image_is_cut_down_to_it():
    plan = make_plan(Options(section_size=5000), BLURRED, 5.0, (30, 40))
    assert 40 <= plan.section_size <= 40 + 2 * plan.psf_radius_px


def test_a_plan_tells_itself_in_plain_values():
    plan = make_plan(Options(out_of_field="vignette"), BLURRED, 5.0, (100, 100)).as_dict()
    assert set(plan) == {"section_size", "order", "psf_radius_px", "space_px", "out_of_field", "method"}
    assert plan["out_of_field"] == "vignette"
