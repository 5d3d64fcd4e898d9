"""Searches of ghosts at fixed angles, compared with searches for each source."""

from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.sources import Sources
from lensfield.engine.lens.iris import Iris, opening_within
from lensfield.engine.library import prescription_of
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.rings import Rings, turned
from lensfield.engine.runtime.threads import thread_pool
from lensfield.engine.stray import ghost_nodes as module
from lensfield.engine.stray.ghost_bands import sample_of
from lensfield.engine.stray.ghost_beams import beams_of, coatings_of
from lensfield.engine.stray.ghost_nodes import STEP_RAD, ghost_nodes
from lensfield.engine.stray.ghost_survey import search

FRAME = PixelGrid((210, 330), 80.0, centre_px=(140.25, 75.5))
NM = (450.0, 550.0, 650.0)
ROUND = opening_within(Iris(0), np.inf)


def nodes_of(name):
    bare = replace(prescription_of(name), coating="none")
    return ghost_nodes(system_of(turned(bare, Rings(f_number=4.0)).prescription), ROUND, NM)


def lamps(angles_deg, distance_mm=np.inf, azimuth_rad=0.7):
    angle = np.radians(angles_deg)
    directions = np.stack([np.sin(angle) * np.cos(azimuth_rad), np.sin(angle) * np.sin(azimuth_rad), np.cos(angle)], 1)
    count = len(angle)
    return Sources(directions, np.full(count, distance_mm), np.ones((count, 3)), np.array(NM), np.zeros(count),
                   tuple(f"{each:g}" for each in angles_deg))


def both(nodes, sources):
    """Searches by nodes, and for each source."""
    coated = coatings_of(nodes.lens.system, NM).of(sample_of(np.array(NM)))
    with thread_pool() as pool:
        by_nodes = nodes.searches(sources, FRAME, pool)
    return by_nodes, {number: search(nodes.lens, FRAME, coated, *beam)
                      for number, beam in beams_of(nodes.lens, sources).items()}


@pytest.mark.parametrize("name, distance_mm", [("tessar-50mm", np.inf), ("ricoh-gr-28mm", np.inf),
                                               ("ricoh-gr-28mm", 2500.0)])
def test_light_between_nodes_is_within_the_limits(name, distance_mm):
    """At least all but 2 % of the light of all pairs, by limits that are on average at most half a time wider."""
    nodes = nodes_of(name)
    by_nodes, direct = both(nodes, lamps(np.degrees(STEP_RAD) * np.array([0.3, 4.5, 9.2, 14.6]), distance_mm))
    assert by_nodes.keys() == direct.keys() == {0, 1, 2, 3}
    for number, one in direct.items():
        found, lit = by_nodes[number], one.light_mm2 > 1e-3 * one.light_mm2.max()
        inner, outer = one.limits_mm[lit], found.limits_mm[lit]
        cell_mm = np.ptp(one.limits_mm[:, 2:]) / 24
        within = (outer[:, ::2] <= inner[:, ::2] + cell_mm) & (outer[:, 1::2] >= inner[:, 1::2] - cell_mm)
        assert one.light_mm2[lit][within.all(axis=1)].sum() > 0.98 * one.light_mm2.sum()
        wider = np.diff(outer)[:, ::2] / np.diff(inner)[:, ::2]
        assert np.average(wider.mean(axis=1), weights=one.light_mm2[lit]) < 1.5
        np.testing.assert_allclose(found.light_mm2.sum(), one.light_mm2.sum(), rtol=0.1)


def test_a_search_at_a_node_is_the_direct_one():
    nodes = nodes_of("tessar-50mm")
    by_nodes, direct = both(nodes, lamps(np.degrees(STEP_RAD) * np.array([0, 7])))
    for number, one in direct.items():
        lit = one.light_mm2 > 0
        np.testing.assert_allclose(by_nodes[number].light_mm2, one.light_mm2, rtol=1e-4, atol=1e-9)
        assert lit.any() and np.all(by_nodes[number].limits_mm[lit][:, ::2] <= one.limits_mm[lit][:, ::2] + 1e-6)


@pytest.mark.parametrize("name, distance_mm", [("tessar-50mm", 14.0), ("cooke-42mm-2x", np.inf)])
def test_the_closest_sources_and_lenses_without_symmetry_are_searched_directly(name, distance_mm):
    nodes = nodes_of(name)
    by_nodes, direct = both(nodes, lamps([3.0, 11.0], distance_mm))
    for number, one in direct.items():
        np.testing.assert_array_equal(by_nodes[number].limits_mm, one.limits_mm)
        np.testing.assert_array_equal(by_nodes[number].light_mm2, one.light_mm2)


def test_nodes_predict_the_ghosts_of_close_sources():
    """Within a factor of two; a closer search then is the direct one."""
    nodes = nodes_of("nikkor-28mm")
    by_nodes, direct = both(nodes, lamps([9.0, 22.0], 300.0))
    for number, one in direct.items():
        predicted = by_nodes[number]
        assert not np.array_equal(predicted.limits_mm, one.limits_mm)
        assert 0.5 < predicted.light_mm2.sum() / one.light_mm2.sum() < 2
        closer = nodes.closer(predicted, FRAME)
        np.testing.assert_array_equal(closer.limits_mm, one.limits_mm)
        np.testing.assert_array_equal(closer.light_mm2, one.light_mm2)


def test_a_search_by_nodes_is_close_enough_for_far_sources():
    nodes = nodes_of("nikkor-28mm")
    by_nodes, _ = both(nodes, lamps([9.0], 2500.0))
    assert nodes.closer(by_nodes[0], FRAME) is by_nodes[0]


def test_prepared_nodes_are_not_searched_again(monkeypatch):
    nodes, (inside, outside) = nodes_of("pentax-50mm-f1.4"), (lamps([2.0, 18.0]), lamps([57.0], 3000.0))
    list(nodes.prepare(np.radians(20.0), outside))
    monkeypatch.setattr(module, "trace_everywhere", None)
    with thread_pool() as pool:
        assert len(nodes.searches(Sources.together([inside, outside]), FRAME, pool)) == 3
