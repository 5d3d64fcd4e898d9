"""Rays that two surfaces of a lens reflect: by the compiled loop, or in numpy."""

import numpy as np

from ..kernels.ghost_meshes import LIGHT
from ..kernels.ghosts import CROSSINGS, Beam, Coated, ghost_rays
from ..kernels.library import NUMPY, running
from ..prescription.surfaces import distance_to, from_surface_frame, refracted, to_surface_frame, unit_normal
from .ghost_beams import GhostLens


def trace_ghosts(lens: GhostLens, coated: Coated, beam: Beam, pairs: np.ndarray, limits_mm: np.ndarray, side: int,
                 farthest: float = np.inf) -> np.ndarray:
    """Trace `side` x `side` rays within limits (pair, 4) of the cross section; for radial lenses only the half of them
    from the middle to the right. Returns as `ghost_rays`, with positions from the middle of the picture."""
    boxes, shape = boxes_of(lens, limits_mm, side)
    if running() != NUMPY:
        rays = ghost_rays(lens.surfaces, coated, lens.openings, beam, pairs, boxes, shape, farthest)
    else:
        with np.errstate(all="ignore"):
            traced = [_traced(lens, coated, beam, pair, box, shape, farthest)
                      for pair, box in zip(pairs, boxes, strict=True)]
        rays = np.reshape(traced, (len(pairs), LIGHT + coated.waves, *shape))
    rays[:, :2] -= lens.view.origin_mm[:, None, None]
    return rays


def boxes_of(lens: GhostLens, limits_mm: np.ndarray, side: int) -> tuple[np.ndarray, tuple[int, int]]:
    """First places and steps of grids of `side` rays, or half of it across for radial lenses; and their shape."""
    columns = (side + 1) // 2 if lens.radial else side
    left, right, lower, upper = limits_mm.T
    boxes = np.stack([left, (right - left) / (columns - 1), lower, (upper - lower) / (side - 1)], axis=1)
    return boxes, (side, columns)


class _Passage:
    """Rays on their way through the surfaces: numpy's version of `passage` in ghosts.c."""

    def __init__(self, lens, coated, position, direction, light, farthest):
        self.lens, self.coated, self.farthest = lens, coated, farthest
        self.position, self.direction, self.light = position, direction, light
        self.limit, self.stops = np.zeros_like(light[0]), []

    def meet(self, number, reflecting, heading, before, behind):
        """To a surface, and reflected or refracted there; `heading` is the sign of the direction behind it."""
        prescription, indices = self.lens.system.prescription, self.coated.indices
        surface, ratio = prescription.surfaces[number], indices[before] / indices[behind]
        at, along = to_surface_frame(surface.pose, self.position, self.direction)
        at = at + distance_to(surface, at, along) * along
        scaled = at[:2] * self.lens.openings.per_semi_aperture[number]
        square = np.sum(scaled**2, axis=0)
        within = (at[:2] * self.lens.openings.per_half_width[number][:, None])**2
        self.limit = np.fmax(self.limit, within.max(axis=0))
        if number == prescription.stop_index:
            self.stops.append(scaled)
        else:
            self.limit = np.fmax(self.limit, square)
        normal = unit_normal(surface, at)
        cosine = np.sum(along * normal, axis=0)
        share = self._reflectance(number, indices[before]**2 * (1 - cosine**2))
        along = along - 2 * cosine * normal if reflecting else refracted(along, normal, ratio)
        self.position, self.direction = from_surface_frame(surface.pose, at, along)
        lives = (self.direction[2] * heading > 0) & (square < self.farthest)
        self.light = np.where(lives, self.light * (share if reflecting else 1 - share), np.nan)

    def move(self, along_mm):
        """Make places relative to a vertex that is `along_mm` behind the last one."""
        self.position = self.position - np.array([[0.0], [0.0], [along_mm]])

    def _reflectance(self, number, squares):
        places = np.nan_to_num(squares) * self.coated.steps_per_unit
        steps = np.arange(self.coated.reflectances.shape[1])
        tables = self.coated.reflectances[number].T[:self.coated.waves]
        return np.stack([np.interp(places, steps, table) for table in tables])


def _traced(lens, coated, beam, pair, box, shape, farthest):
    """Quantities (LIGHT + wave, ray) of the rays of a pair."""
    prescription, (near, far) = lens.system.prescription, pair
    gaps_mm = [surface.thickness_mm for surface in prescription.surfaces]
    position, direction, light = _started(beam, box, shape)
    passage = _Passage(lens, coated, position, direction, np.tile(light, (coated.waves, 1)), farthest)
    first = 0
    if far >= 0:
        _onwards(passage, gaps_mm, 0, far)
        passage.meet(far, True, -1, far, far)
        for number in range(far - 1, near, -1):
            passage.move(-gaps_mm[number])
            passage.meet(number, False, -1, number + 1, number)
        passage.move(-gaps_mm[near])
        passage.meet(near, True, 1, near + 1, near + 1)
        passage.move(gaps_mm[near])
        first = near + 1
    _onwards(passage, gaps_mm, first, len(gaps_mm))
    at, along = to_surface_frame(prescription.image_pose, passage.position, passage.direction)
    at = at - at[2] / along[2] * along
    stops = [*passage.stops, *passage.stops[-1:] * CROSSINGS][:CROSSINGS]
    return np.concatenate([at[:2], [passage.limit], *stops, passage.light])


def _onwards(passage, gaps_mm, first, end):
    for number in range(first, end):
        passage.meet(number, False, 1, number, number + 1)
        passage.move(gaps_mm[number])


def _started(beam, box, shape):
    """Position, direction and light of rays at places of the beam's cross section."""
    up, across = np.indices(shape).reshape(2, -1)
    position = beam.axes[:2].T @ np.stack([box[0] + across * box[1], box[2] + up * box[3]])
    direction = np.repeat(beam.axes[2][:, None], up.size, axis=1)
    if not np.isfinite(beam.distance_mm):
        return position, direction, np.ones(up.size)
    away = position - beam.source_mm[:, None]
    length = np.sqrt(np.sum(away**2, axis=0))
    return position, away / length, (beam.distance_mm / length)**2 * np.sum(away * direction, axis=0) / length
