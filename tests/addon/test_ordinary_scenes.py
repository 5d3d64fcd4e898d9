"""Ordinary scenes agree with plain Cycles: a dozen of them, chosen by SEED, at 64 px; `make scenes` renders all.

They are rendered in a process of their own, so that a crash fails one scene.
"""

import numpy as np
import pytest

from lensfield.engine.spectral.colour import rec709_weights
from lensfield.engine.spectral.colour_difference import ciede2000, lab_from_xyz
from lensfield.engine.spectral.spectra import blackbody, reflectance_basis
from ordinary_scenes import CRASHED, DIFFERENT, FAILED, PASSED, REFUSED, Outcome, chosen, run, table, verdict
from scene_measure import XYZ
from scenes import ORDINARY
from scenes.kit import PAINTS
from seed import SEED

COLUMNS, SAMPLES, DOZEN = 64, 32, 12
WARM_K = 2800


@pytest.fixture(scope="module")
def outcomes(request, tmp_path_factory):
    """The Outcomes of the scenes in this run, by name."""
    names = [item.callspec.params["name"] for item in request.session.items
             if item.originalname == test_scene_agrees_with_cycles.__name__]
    found = run(names, tmp_path_factory.mktemp("scenes"), COLUMNS, SAMPLES, SEED)
    return {outcome.name: outcome for outcome in found}


@pytest.mark.sample(DOZEN)
@pytest.mark.parametrize("name", ORDINARY)
def test_scene_agrees_with_cycles(outcomes, name):
    outcome = outcomes[name]
    assert outcome.good, f"{outcome.title}: {outcome.status}: {outcome.words}"


def test_names_and_themes_select_scenes():
    units = [name for name, scene in ORDINARY.items() if scene.theme == "units"]
    assert chosen(["hdri", "units"]) == [name for name in ORDINARY if name in ("hdri", *units)]
    assert chosen([]) == list(ORDINARY)
    with pytest.raises(SystemExit, match="umbrella: not a scene"):
        chosen(["hdri", "umbrella"])


def test_a_seed_chooses_a_sample():
    first, same, other = (chosen([], DOZEN, seed) for seed in (3, 3, 4))
    assert first == same != other and len(set(first)) == DOZEN


def test_report_states_every_result():
    outcomes = [Outcome(name, "lamps", "A lamp", status, words) for name, status, words in (
        ("sun", PASSED, ""), ("spot", FAILED, "too dark"), ("portal", CRASHED, "SIGSEGV"), ("ies", REFUSED, "no"),
        ("zoom", DIFFERENT, "sharp"))]
    assert [outcome.good for outcome in outcomes] == [True, False, False, True, True]
    assert verdict(outcomes).startswith(
        "1 passed, 2 failed (1 crashed), 1 refused as expected, 1 different as reported")
    text = "\n".join(table(outcomes))
    assert all(f"{each.name} " in text and each.words in text for each in outcomes)


def test_paints_in_warm_light_differ_by_what_their_scenes_allow():
    """A spectral product against one of red, green and blue, on a table that is white."""
    nm = np.arange(380.0, 781.0, 2.0)
    lamp, channels = blackbody(WARM_K).density_at(nm), rec709_weights(nm)
    of_table, white = reflectance_basis(nm) @ PAINTS["Table"], XYZ.sum(axis=1)
    per_light = 1 / (XYZ[1] @ ((lamp * of_table) @ channels))
    labs = [[lab_from_xyz(XYZ @ np.maximum(per_light * rgb, 0), white) for rgb in (
        (lamp * (reflectance_basis(nm) @ paint)) @ channels, (lamp @ channels) * paint)] for paint in PAINTS.values()]
    worst = max(ciede2000(*pair) for pair in labs)
    for name in ("lamp_temperature", "lamp_blackbody"):
        assert ORDINARY[name].paint == pytest.approx(worst, abs=0.1)
