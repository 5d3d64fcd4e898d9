"""Ordinary scenes agree with plain Cycles: a dozen of them, chosen by SEED, at 64 px; `make scenes` renders all.

They are rendered in a process of their own, so that a crash fails one scene.
"""

import pytest

from ordinary_scenes import run
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
