"""Slabs: at which depths a capture is cut, so that it holds what near things hide, too.

A capture sees one surface in each pixel. Where a near thing stands before a far one, the lens looks behind its edge:
what it sees there is known if the two lie in slabs that are captured apart. Blur is proportional to inverse depth, and
what is hidden is as wide as the blurs differ; so borders go where, in one look at depth, most blur jumps across them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..image.depth_range import (
    DepthCheck,
    blur_per_nearness_px,
    blur_px,
    check_depth,
    focus_nearness,
    focus_range_px,
    focus_share,
)
from ..image.pixel_grid import PLANE, PixelGrid

if TYPE_CHECKING:
    from ..lens.lens import Lens

MOST_SLABS = 12
MOST_LOOKED = 200_000  # pixels: edges in fewer tell as much
CANDIDATES = 192  # for borders
JUMP_PX = 1.0  # of blur between neighbours, from which on it is an edge
SEAM_PX = 0.1  # of blur: as if it jumped by so much in each pixel CLOSE_PX[0] from a border, and less beyond
CLOSE_PX = 0.1, 0.3, 1.0, 3.0
OUTSIDE = 1e-3  # of its distance: how far off what is whole a border is
DEEP_PX = 12.0  # of blur from end to end of a body, beyond which it may be cut
MOST_WEIGHT = 50.0  # of an edge by its light, where that of an even picture is 1
AT_EDGES = 0.1  # of the accuracy: what is wrong at edges lies close together, and shows
# Beside an edge whose two sides' blurs differ by 1 px, the light of so many pixels comes from behind the near side: the
# mean of max(x, 0) over a disc of diameter 1. The pixels along an edge, counted across and down, are 4 / pi too many.
BEHIND_PX = 2 / (3 * np.pi) / 2 * np.pi / 4


@dataclass(frozen=True)
class SlabPlan:
    """Into which slabs a capture is cut.

    Attributes
    ----------
    needed : bool
        Whether something is out of the depths for which the lens's data hold. Else there is one slab: a plain capture.
    borders_mm : tuple of float
        Between slabs, ascending, as a camera clips: depths of a plane capture, distances of a fisheye's. The first slab
        begins at the camera, the last has no end and holds the world.
    margins_px : tuple of (int, int)
        Of each slab, near to far: rows and columns that it needs beyond the frame.
    behind : float
        Fraction of the picture's light that comes from behind edges, where a pinhole does not see.
    hidden : float
        As much of it as stays hidden, because the edges are inside slabs.
    check : DepthCheck or None
        How much of the frame is out of the data's depth; None where no pixel has a depth.
    """

    needed: bool
    borders_mm: tuple[float, ...]
    margins_px: tuple[tuple[int, int], ...]
    behind: float
    hidden: float
    check: DepthCheck | None

    @property
    def slabs(self) -> int:
        """How many there are: as many renders are to be made."""
        return len(self.borders_mm) + 1

    @property
    def margin_px(self) -> tuple[int, int]:
        """Rows and columns that the capture needs beyond the frame."""
        rows, columns = np.max(self.margins_px, axis=0)
        return int(rows), int(columns)

    @property
    def slabs_text(self) -> str:
        """The slabs in words."""
        borders = ", ".join(f"{border_mm * 1e-3:.3g}" for border_mm in self.borders_mm)
        return f"{self.slabs} slabs, cut at {borders} m" if borders else "one slab"

    @property
    def cut_text(self) -> str:
        """The slabs, and what they leave, in words."""
        return f"{self.slabs_text}; {self.hidden:.2g} of the light comes from what stays hidden behind edges"

    @property
    def text(self) -> str:
        """One line for a report."""
        if not self.needed or self.check is None:
            return "the lens data hold for all depths of the scene"
        return f"{self.check.text}: {self.cut_text}"


def plan_slabs(depth_mm: ArrayLike, capture: PixelGrid, lens: "Lens", *, accuracy: float,
               overscan_px: Sequence[int], light: ArrayLike | None = None, others: Sequence["Lens"] = (),
               most_slabs: int = MOST_SLABS,
               whole_mm: Sequence[tuple[float, float]] = (),
               bodies_mm: Sequence[tuple[float, float]] = ()) -> SlabPlan:
    """Plan the slabs of a capture by one look at depth: as few as leave no more of it hidden than is allowed.

    Parameters
    ----------
    depth_mm : array (row, column)
        As `planar_depth_mm` gives it, for all of `capture`, of any resolution. NaN where there is none: such pixels do
        not count.
    capture : PixelGrid
        What was looked at; its overscan is the most that slabs are given.
    lens : Lens
    accuracy : float
        As in `Options`: so much of a point's light may be as if it were in focus, and AT_EDGES times as much of what
        comes from behind edges stay inside slabs.
    overscan_px : (int, int)
        Rows and columns that a capture needs beyond the frame where all is in focus, for distortion and PSFs.
    light : array (row, column), optional
        Of the same pixels, in any unit: edges of what is bright count more.
    others : sequence of Lens
        That are to see the same capture: the lens, turned to other distances and stops.
    most_slabs : int
    whole_mm : sequence of (near_mm, far_mm)
        No border lies between these, as a camera clips: volumes.
    bodies_mm : sequence of (near_mm, far_mm)
        Nor between these, where blur differs by no more than DEEP_PX across one: closed bodies, whose dark inside a
        border would show.

    Returns
    -------
    SlabPlan
    """
    lenses = lens, *others
    look = _look(depth_mm, light, capture, lenses, overscan_px)
    in_frame = look.planar_mm[np.all(look.beyond_px == 0, axis=0) & ~np.isnan(look.planar_mm)]
    check = check_depth(in_frame, lens, capture.pitch_um) if in_frame.size else None
    reaching_mm = look.planar_mm[look.reaching]
    shares = [focus_share(blur_px(one, capture.pitch_um, reaching_mm), focus_range_px(one, capture.pitch_um))
              for one in lenses]
    if np.all(np.array(shares) >= 1 - accuracy):
        return SlabPlan(False, (), (look.least_px,), 0.0, 0.0, check)
    whole = look.places(whole_mm) + [body for body in look.places(bodies_mm) if np.ptp(body) <= DEEP_PX]
    edges = _edges(look)
    borders, hidden = _cut(edges, whole, most_slabs, accuracy)
    behind = BEHIND_PX * edges.jump_px2.sum() / (edges.surfaces.size * edges.pixel_px2)
    ends = (np.inf, *borders, 0.0)
    margins = tuple(look.margin_px(near, far) for near, far in zip(ends[:-1], ends[1:], strict=True))
    return SlabPlan(True, tuple(look.scale / place for place in borders), margins, float(behind),
                    float(hidden * behind), check)


@dataclass(frozen=True, eq=False)
class _Look:
    """A look at depth: arrays (row, column), NaN where there is none.

    A distance has a *place*: its inverse, in pixels of blur beyond that of what is infinitely far.

    Attributes
    ----------
    planar_mm, light : array
    cosine : array
        Depth over distance; 1 for a camera that clips by depth.
    beyond_px : array (2, row, column)
        How far beyond the frame, down and across.
    step_px : array (2,)
        Rows and columns of the capture from one pixel to the next.
    scale : float
        Place times distance in mm.
    far_px : (float, float)
        Blur of what is infinitely far, at least and at most.
    least_px, most_px : (int, int)
        Beyond the frame where all is in focus, and in the look.
    """

    planar_mm: np.ndarray
    light: np.ndarray
    cosine: np.ndarray
    beyond_px: np.ndarray
    step_px: np.ndarray
    scale: float
    far_px: tuple[float, float]
    least_px: tuple[int, int]
    most_px: tuple[int, int]

    @property
    def place(self):
        """Of what is seen in each pixel."""
        return self.scale * self.cosine / self.planar_mm

    @property
    def reaching(self):
        """Which pixels' light may come into the frame."""
        return self.reaches(self.blur_px(self.place))

    def blur_px(self, place):
        """Diameter of the blur of places, at most, as the capture shows it: a fisheye's field is seen aslant, off the
        axis."""
        return np.maximum(*(np.abs(place + far_px * self.cosine) for far_px in self.far_px))

    def places(self, ranges_mm):
        """Of ranges of distance: [(near, far)]."""
        with np.errstate(divide="ignore"):
            return [tuple(self.scale / np.maximum(ends_mm, 0.0)) for ends_mm in ranges_mm]

    def reaches(self, blur_px):
        """Which pixels are so close to the frame that a blur of this diameter comes into it."""
        apart_px = np.maximum(0, self.beyond_px - np.reshape(self.least_px, (2, 1, 1)))
        return np.hypot(*apart_px) <= blur_px / 2

    def margin_px(self, near, far):
        """Rows and columns beyond the frame of a slab between two places.

        A pixel may hold anything behind what is seen in it, which counts as far as it blurs into the frame.
        """
        place = self.place
        blurs = [self.blur_px(end) for end in (np.minimum(place, near), far)]
        counts = (place >= far) & self.reaches(np.maximum(*blurs))
        beyond_px = np.max(self.beyond_px, axis=(1, 2), where=counts, initial=-np.inf) + self.step_px
        rows, columns = np.clip(np.ceil(beyond_px), self.least_px, np.maximum(self.most_px, self.least_px))
        return int(rows), int(columns)


def _look(depth_mm, light, capture, lenses, overscan_px):
    """Of every so many pixels of a look, through the widest stop."""
    planar_mm = np.asarray(depth_mm, dtype=float)
    light = np.ones_like(planar_mm) if light is None else np.nan_to_num(np.asarray(light, dtype=float), posinf=0)
    every = int(np.ceil(np.sqrt(planar_mm.size / MOST_LOOKED)))
    step_px = np.divide(capture.shape_px, planar_mm.shape)
    rows, columns = ((np.arange(0, looked, every) + 0.5) * step - 0.5
                     for looked, step in zip(planar_mm.shape, step_px, strict=True))
    planar_mm, light = planar_mm[::every, ::every], np.maximum(light[::every, ::every], 0)
    planar_mm = np.where(planar_mm > 0, planar_mm, np.nan)
    beyond_px = [np.maximum(0, np.abs(places - (n - 1) / 2) - frame / 2) for places, n, frame in
                 zip((rows, columns), capture.shape_px, capture.frame_px, strict=True)]
    focal_mm = capture.focal_mm or lenses[0].capture_focal_length_mm
    cosine = np.ones_like(planar_mm)
    if capture.projection != PLANE:
        x_mm, y_mm = capture.position_mm(rows[:, None], columns)
        cosine = np.cos(np.hypot(x_mm, y_mm) / focal_mm)
        cosine = np.where(cosine > 0, cosine, np.nan)
    scale = max(blur_per_nearness_px(one, capture.pitch_um) * focal_mm / one.capture_focal_length_mm for one in lenses)
    far_px = [-scale * focus_nearness(one) for one in lenses]
    return _Look(planar_mm, light, cosine, np.array(np.meshgrid(*beyond_px, indexing="ij")), every * step_px, scale,
                 (min(far_px), max(far_px)), tuple(map(int, overscan_px)), capture.overscan_px)


@dataclass(frozen=True, eq=False)
class _Edges:
    """Where neighbours jump in blur.

    Attributes
    ----------
    far, near : array (pair,)
        Places of the two.
    jump_px2 : array (pair,)
        By how much blur jumps, times the length of edge that the pair stands for, and by its light.
    surfaces : array, ascending
        Places of all pixels.
    pixel_px2 : float
        What each of these stands for.
    """

    far: np.ndarray
    near: np.ndarray
    jump_px2: np.ndarray
    surfaces: np.ndarray
    pixel_px2: float


def _edges(look):
    place, reaching, (down_px, across_px) = look.place, look.reaching, look.step_px
    share = look.light / max(look.light[reaching].mean(), np.finfo(float).tiny)
    weight = np.minimum((1 + share) / 2, MOST_WEIGHT)
    pairs = [_jumps(place, reaching, weight, down_px), _jumps(place.T, reaching.T, weight.T, across_px)]
    far, near, jump_px2 = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    return _Edges(far, near, jump_px2, np.sort(place[reaching]), float(down_px * across_px))


def _jumps(place, reaching, weight, length_px):
    """Ends, far and near, of the jumps between neighbours in rows, and these times a length of edge and a weight.

    The inverse depth of a plane is linear over the picture: a jump is what neither side, going on straight, explains.
    """
    step = np.diff(place)
    straight = np.pad(step, ((0, 0), (1, 1)), constant_values=np.nan)
    jump = np.fmin(np.fmin(np.abs(step - straight[:, :-2]), np.abs(step - straight[:, 2:])), np.abs(step))
    there = (jump > JUMP_PX) & (reaching[:, :-1] | reaching[:, 1:])
    ends = place[:, :-1][there], place[:, 1:][there]
    weight = (weight[:, :-1] + weight[:, 1:])[there] / 2
    return np.minimum(*ends), np.maximum(*ends), jump[there] * weight * length_px


def _cut(edges, whole, most_slabs, accuracy):
    """Places of the borders, descending, and the fraction of the jumps that they leave, and of what they cost.

    By dynamic programming: the best way to cut up to a place into n slabs goes by the best to a farther place in n - 1.
    """
    candidates = _candidates(edges, whole)
    inside, close = _costs(edges, candidates)
    for near, far in whole:
        close[(far < candidates) & (candidates < near)] = np.inf
    step = inside + np.concatenate([[np.inf], close, [0.0]])
    cost, ways, totals = np.append(0.0, np.full(len(step) - 1, np.inf)), [], []
    for _ in range(min(most_slabs, len(step) - 1)):
        by = cost[:, None] + step
        ways.append(np.argmin(by, axis=0))
        cost = by.min(axis=0)
        totals.append(cost[-1])
    slabs = 1 + int(np.argmax(np.array(totals) <= max(AT_EDGES * accuracy * totals[0], min(totals))))
    nodes = [len(step) - 1]
    for way in reversed(ways[:slabs]):
        nodes.append(int(way[nodes[-1]]))
    left = totals[slabs - 1] / totals[0] if totals[0] else 0.0
    return [float(candidates[node - 1]) for node in nodes[1:-1]], left


def _candidates(edges, whole):
    """Places where borders may be, ascending: in the widest gaps between so many ends of jumps, in even ratios, and at
    the ends of what is whole."""
    ends = np.concatenate([edges.far, edges.near])
    order = np.argsort(ends)
    ends, weight = ends[order], np.cumsum(np.tile(edges.jump_px2, 2)[order])
    places = [np.multiply(beside, (1 + OUTSIDE, 1 - OUTSIDE)) for beside in whole]
    if ends.size:
        gaps = np.diff(ends)
        windows = np.unique(np.searchsorted(weight[:-1], np.arange(CANDIDATES) / CANDIDATES * weight[-1]))
        windows = windows[windows < gaps.size]
        widest = np.array([first + np.argmax(window) for first, window in
                           zip(windows, np.split(gaps, windows[1:]), strict=True)])
        places += [(ends[widest] + ends[widest + 1]) / 2, np.geomspace(max(ends[0], JUMP_PX / 2), ends[-1], CANDIDATES)]
    places = np.unique(np.concatenate([[], *places]))
    return places[(places > 0) & np.isfinite(places)]


def _costs(edges, candidates):
    """Of all slabs from one candidate, or an end, to another, the jumps inside: array (far, near), inf where there is
    no slab; and of each candidate, what surfaces so close to it cost."""
    bins = len(candidates) + 1
    far, near = (np.searchsorted(candidates, place) for place in (edges.far, edges.near))
    total = np.zeros((bins + 1, bins + 1))
    total[1:, 1:] = np.bincount(far * bins + near, edges.jump_px2, bins**2).reshape(bins, bins).cumsum(0).cumsum(1)
    up_to = np.diag(total)
    inside = np.maximum(up_to[None] - total - total.T + up_to[:, None], 0)
    inside[np.tri(bins + 1, dtype=bool)] = np.inf
    about = [np.diff(np.searchsorted(edges.surfaces, [candidates - close, candidates + close]), axis=0)[0] / close
             for close in CLOSE_PX]
    return inside, SEAM_PX * edges.pixel_px2 * CLOSE_PX[0] * np.mean(about, axis=0)
