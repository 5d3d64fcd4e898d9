"""Merging sources: neighbours become one source in the mean direction of their light."""

from dataclasses import replace

import numpy as np

from ..image.sources import Sources, widths_nm
from ..runtime.errors import listed

MOST_NAMED = 3


def merged_sources(sources: Sources, most: int) -> Sources:
    """Merge neighbouring sources until at most `most` remain, without loss of light: brightest first, and those without
    light left out."""
    light = sources.irradiance @ widths_nm(sources.wavelengths_nm)
    parts = [_merged(sources, group, light[group]) for group in grouped(sources.directions, light, most)]
    return Sources.together([sources.chosen(np.zeros(0, int)), *parts])


def grouped(directions: np.ndarray, light: np.ndarray, most: int, spread_rad: float = 0.0
            ) -> list[np.ndarray]:
    """Divide directions (source, 3) with this light (source,) into groups of neighbours: arrays of their indices,
    brightest first.

    The group whose light is farthest from its mean direction is halved, until the number is reached, or light is on
    average within `spread_rad` of its group's direction.
    """
    total = light.sum()
    groups = [np.flatnonzero(light > 0)] * bool(total > 0)
    spreads = [_spread(directions, light, group) for group in groups]
    while groups and len(groups) < most and sum(spreads) > spread_rad * total:
        widest = int(np.argmax(spreads))
        group = groups.pop(widest)
        if not spreads.pop(widest):
            return _sorted([*groups, group], light)
        for half in _halves(directions[group], group):
            groups.append(half)
            spreads.append(_spread(directions, light, half))
    return _sorted(groups, light)


def _sorted(groups, light):
    return sorted(groups, key=lambda group: (-light[group].sum(), group[0]))


def _halves(places, group):
    """A group's halves, to both sides of the middle of its longest extent."""
    axis = int(np.argmax(np.ptp(places, axis=0)))
    near = places[:, axis] <= (places[:, axis].min() + places[:, axis].max()) / 2
    return group[near], group[~near]


def _spread(directions, light, group):
    """The light of a group times its root-mean-square angle from the mean direction."""
    towards, weights = directions[group], light[group]
    if (towards == towards[0]).all():
        return 0.0
    total = weights.sum()
    apart = towards - weights @ towards / total
    return float(np.sqrt(total * (weights @ (apart * apart).sum(axis=1))))


def _merged(sources, group, light):
    """One source for a group of them, with this light."""
    if group.size == 1:
        return sources.chosen(group)
    vector = np.average(sources.directions[group], axis=0, weights=light)
    length = np.linalg.norm(vector)
    nearness = np.average(1 / sources.distance_mm[group], weights=light)
    variance = 2 * max(1 - length**2, 0) + np.average(np.square(sources.radius_rad[group]), weights=light)
    name = listed(dict.fromkeys(sources.names[index] for index in group), MOST_NAMED)
    return replace(sources, directions=(vector / max(length, np.finfo(float).tiny))[None],
                   distance_mm=np.array([1 / nearness if nearness else np.inf]),
                   irradiance=sources.irradiance[group].sum(axis=0)[None],
                   radius_rad=np.array([np.sqrt(variance)]), names=(name,))
