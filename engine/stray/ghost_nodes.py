"""The first search of ghosts at fixed angles to the axis, the nodes, for all sources near these angles.

What a centred lens does to light from an angle depends neither on a picture's light nor on its azimuth. So the nodes
can be searched before the light is known, and serve all sources and frames. For sources so close to a lens that their
light enters at many angles, the nodes only predict whether any of their ghosts is bright; these are then searched
directly, and so are the sources of anamorphic lenses.
"""

from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..image.pixel_grid import PixelGrid
from ..image.sources import Sources
from ..kernels.ghost_meshes import LIGHT
from ..lens.iris import Opening
from ..prescription.system import System
from .ghost_bands import sample_of
from .ghost_beams import GhostLens, beam_of, beams_of, coatings_of, front_radius_mm, ghost_lens
from .ghost_survey import Search, on_frame, search, trace_everywhere

STEP_RAD = np.radians(1.5)
LAST = int(np.radians(88.5) / STEP_RAD)
MOST_NODES, MOST_PREDICTING = 6, 24  # for a source that is not searched directly, and for a prediction
MOST_LENSES = 4  # in memory, for the next frames


@dataclass(frozen=True, eq=False)
class Node:
    """The light of all pairs of surfaces from infinity, at one angle.

    Attributes
    ----------
    limits_mm : array (pair, 4)
        As in `Search`.
    arrives : bool array (pair,)
        Whether any ray reaches the sensor's plane.
    pair : int array (ray,)
        Of the rays that do, with light.
    x_mm, y_mm : float32 arrays (ray,)
        Where they land on the sensor's plane.
    light_mm2 : float32 array (ray,)
    """

    limits_mm: np.ndarray
    arrives: np.ndarray
    pair: np.ndarray
    x_mm: np.ndarray
    y_mm: np.ndarray
    light_mm2: np.ndarray

    def light_on(self, lens: GhostLens, grid: PixelGrid, azimuth_rad: float) -> np.ndarray:
        """Light on the frame over irradiance: array (pair,)."""
        light = on_frame(lens, grid, self.x_mm, self.y_mm, azimuth_rad) * self.light_mm2
        return np.bincount(self.pair, light, len(self.arrives))


class GhostNodes:
    """The nodes of a lens, each searched when it is first needed.

    Parameters
    ----------
    lens : GhostLens
    wavelengths_nm : tuple of float

    Attributes
    ----------
    lens
    """

    def __init__(self, lens: GhostLens, wavelengths_nm: tuple[float, ...]) -> None:
        self.lens = lens
        self._coated = coatings_of(lens.system, wavelengths_nm).of(sample_of(np.array(wavelengths_nm)))
        self._nodes: dict[int, Node] = {}

    def node(self, number: int) -> Node:
        """The node at this many steps from the axis."""
        if number not in self._nodes:
            self._nodes[number] = self._searched(number)
        return self._nodes[number]

    def prepare(self, farthest_rad: float, outside: Sources | None) -> Iterator[None]:
        """Search, step by step, the nodes for all sources up to an angle from the axis, and for these."""
        numbers = set(range(min(int(np.ceil(farthest_rad / STEP_RAD)), LAST) + 1)) if self.lens.radial else set()
        if outside is not None:
            numbers.update(number for beam, _ in beams_of(self.lens, outside).values() for number in self._near(beam))
        for number in sorted(numbers):
            yield
            self.node(number)

    def searches(self, sources: Sources, grid: PixelGrid, pool: Executor) -> dict[int, Search]:
        """The first search of sources by their numbers, of those whose light can enter. For sources close to the lens,
        it is a prediction."""
        beams = beams_of(self.lens, sources)
        near = {source: self._near(beam) for source, (beam, _) in beams.items()}
        list(pool.map(self.node, sorted({number for numbers in near.values() for number in numbers})))
        searches = pool.map(lambda source: self._search(*beams[source], grid, near[source]), beams)
        return dict(zip(beams, searches, strict=True))

    def closer(self, first: Search, grid: PixelGrid) -> Search:
        """The direct search of a source, if its first one is only a prediction; otherwise the first one."""
        if len(self._near(first.beam)) <= MOST_NODES:
            return first
        return search(self.lens, grid, self._coated, first.beam, first.azimuth_rad)

    def _near(self, beam):
        """The nodes around the angles at which a source's light enters: a range, empty if there are too many."""
        if not self.lens.radial:
            return range(0)
        angle, spread = _angle_rad(beam) / STEP_RAD, self._spread(beam)
        numbers = range(min(int(np.floor(angle - spread)), LAST), min(int(np.ceil(angle + spread)), LAST) + 1)
        return numbers if len(numbers) <= MOST_PREDICTING else range(0)

    def _spread(self, beam):
        """Between the angles at the middle and at the edge of the first surface, in steps."""
        return front_radius_mm(self.lens) / beam.distance_mm / STEP_RAD

    def _search(self, beam, azimuth_rad, grid, numbers):
        if not numbers:
            return search(self.lens, grid, self._coated, beam, azimuth_rad)
        nodes = [self.node(number) for number in numbers]
        limits_mm = np.array([np.where(each.arrives[:, None], each.limits_mm, np.nan) for each in nodes])
        limits_mm[:, ~np.any([each.arrives for each in nodes], axis=0)] = 0
        ends_mm = np.where([True, False, True, False], np.nanmin(limits_mm, axis=0), np.nanmax(limits_mm, axis=0))
        place = np.clip(_angle_rad(beam) / STEP_RAD, numbers[0], numbers[-1])
        weights = np.maximum(1 - np.abs(np.array(numbers) - place) / max(1.0, self._spread(beam)), 0)
        light_mm2 = sum(weight * node.light_on(self.lens, grid, azimuth_rad)
                        for weight, node in zip(weights / weights.sum(), nodes, strict=True))
        return Search(beam, azimuth_rad, ends_mm, light_mm2)

    def _searched(self, number):
        angle_rad = number * STEP_RAD
        beam, _ = beam_of(self.lens, np.array([0.0, np.sin(angle_rad), np.cos(angle_rad)]), np.inf)
        limits_mm, rays, lit_mm2 = trace_everywhere(self.lens, self._coated, beam)
        arriving = rays[:, LIGHT:].mean(axis=1)
        light_mm2 = np.nan_to_num(arriving) * lit_mm2
        pair, row, column = np.nonzero(light_mm2)
        return Node(limits_mm, np.isfinite(arriving).any(axis=(1, 2)), pair,
                    *(np.float32(each[pair, row, column]) for each in (rays[:, 0], rays[:, 1], light_mm2)))


def _angle_rad(beam):
    return float(np.arctan2(beam.axes[2, 1], beam.axes[2, 2]))


@lru_cache(maxsize=MOST_LENSES)
def ghost_nodes(system: System, opening: Opening, wavelengths_nm: tuple[float, ...]) -> GhostNodes:
    """The nodes of a lens with this opening."""
    return GhostNodes(ghost_lens(system, opening, np.array(wavelengths_nm)), wavelengths_nm)
