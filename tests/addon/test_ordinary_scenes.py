"""Ordinary scenes agree with plain Cycles: a dozen of them, chosen by SEED, at 64 px; `make scenes` renders all.

They are rendered in a process of their own, so that a crash fails one scene.
"""

import pytest

from ordinary_scenes import CRASHED, DIFFERENT, FAILED, PASSED, REFUSED, Outcome, chosen, run, table, verdict
from scenes import ORDINARY
from seed import SEED

COLUMNS, SAMPLES, DOZEN = 64, 32, 12


@pytest.fixture(scope="module")
def outcomes(request, tmp_path_factory):
    """The Outcomes of the scenes in this run, by name."""
    names = [item.callspec.params["name"] for item in request.session.items
             if item.originalname == test_scene_agrees_with_cycles.__name__]
    found = run(names, tmp_path_factory.mktemp("scenes"), COLUMNS, SAMPLES, SEED)
    return {outcome.name: outcome for outcome in found}


@pytest.mark.one_blender
@pytest.mark.sample(DOZEN)
@pytest.mark.parametrize("name", ORDINARY)
def test_scene_agrees_with_cycles(outcomes, name):
    outcome = outcomes[name]
    assert outcome.good, f"{outcome.title}: {outcome.status}: {outcome.words}"


@pytest.mark.one_blender
def test_names_and_themes_select_scenes():
    units = [name for name, scene in ORDINARY.items() if scene.theme == "units"]
    assert chosen(["hdri", "units"]) == [name for name in ORDINARY if name in ("hdri", *units)]
    assert chosen([]) == list(ORDINARY)
    with pytest.raises(SystemExit, match="umbrella: not a scene"):
        chosen(["hdri", "umbrella"])


@pytest.mark.one_blender
def test_a_seed_chooses_a_sample():
    first, same, other = (chosen([], DOZEN, seed) for seed in (3, 3, 4))
    assert first == same != other and len(set(first)) == DOZEN


@pytest.mark.one_blender
def test_report_states_every_result():
    outcomes = [Outcome(name, "lamps", "A lamp", status, words) for name, status, words in (
        ("sun", PASSED, ""), ("spot", FAILED, "too dark"), ("portal", CRASHED, "SIGSEGV"), ("ies", REFUSED, "no"),
        ("zoom", DIFFERENT, "sharp"))]
    assert [outcome.good for outcome in outcomes] == [True, False, False, True, True]
    assert verdict(outcomes).startswith(
        "1 passed, 2 failed (1 crashed), 1 refused as expected, 1 different as reported")
    text = "\n".join(table(outcomes))
    assert all(f"{each.name} " in text and each.words in text for each in outcomes)
