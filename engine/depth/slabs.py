"""Slabs: the depths at which a capture is cut, to include surfaces that near objects hide.

A capture contains one surface in each pixel. Where a near object covers a far one, the lens looks behind its edge: this
light is known if the two are in slabs that are rendered separately. Blur is proportional to inverse depth, and the
hidden area is as wide as the difference in blur. Borders are therefore placed where, in one look at depth, the largest
jumps in blur cross them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..image.pixel_grid import PixelGrid
from ..lens.lens import Lens
from .depth_range import (
    DepthCheck,
    blur_per_nearness_px,
    blur_px,
    check_depth,
    focus_in_capture,
    focus_range_px,
    focus_share,
)

MOST_SLABS = 12
MOST_LOOKED = 200_000  # pixels, enough for the edges
CANDIDATES = 192  # for borders
JUMP_PX = 1.0  # smallest difference in blur between adjacent pixels that counts as an edge
SEAM_PX = 0.1  # cost of a border: of a jump by this in each pixel CLOSE_PX[0] away in blur, and less beyond
CLOSE_PX = 0.1, 0.3, 1.0, 3.0
OUTSIDE = 1e-3  # relative distance between a border and a range that must not be cut
DEEP_PX = 12.0  # of blur between the ends of a body; deeper bodies may be cut
MOST_WEIGHT = 50.0  # of an edge by its light; 1 in a uniform picture
LAMP = 4.0  # times the light of a pixel of the look: a brighter one next to it is not left out
AT_EDGES = 0.1  # of the accuracy, because errors at edges are concentrated and visible
# For each pixel along an edge between blurs that differ by 1 px, the light of this many pixels comes from behind the
# near side: the mean of max(x, 0) over a disc of diameter 1. Counting pixels along an edge both across and down
# overestimates its length by 4 / pi.
BEHIND_PX = 2 / (3 * np.pi) / 2 * np.pi / 4


@dataclass(frozen=True)
class SlabPlan:
    """The slabs of a capture.

    Attributes
    ----------
    needed : bool
        Whether the scene exceeds the depths for which the lens data are valid. Otherwise there is one slab, an ordinary
        capture.
    borders_mm : tuple of float
        Borders between slabs, ascending, as a camera clips: by depth for a plane capture, by distance for a panorama.
        The first slab starts at the camera; the last has no end and includes the world.
    margins_px : tuple of (int, int)
        Rows and columns that each slab, near to far, needs beyond the frame.
    behind : float
        Fraction of the picture's light that comes from behind edges, invisible to a pinhole.
    hidden : float
        The part of `behind` that remains hidden, because the edges are inside slabs.
    check : DepthCheck or None
        The frame's depths, compared with the range of the lens data; None if all pixels are NaN.
    """

    needed: bool
    borders_mm: tuple[float, ...]
    margins_px: tuple[tuple[int, int], ...]
    behind: float
    hidden: float
    check: DepthCheck | None

    @property
    def slabs(self) -> int:
        """Number of slabs, and of renders."""
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
        """The slabs, and the light that remains hidden, in words."""
        return f"{self.slabs_text}; {self.hidden:.2g} of the light comes from surfaces that remain hidden behind edges"

    @property
    def text(self) -> str:
        """One line for a report."""
        if not self.needed or self.check is None:
            return "the lens data apply to all depths of the scene"
        return f"{self.check.text}: {self.cut_text}"


def plan_slabs(depth_mm: ArrayLike, capture: PixelGrid, lens: Lens, *, accuracy: float,
               overscan_px: Sequence[int], light: ArrayLike | None = None, empty: ArrayLike = False,
               others: Sequence[Lens] = (), reach: float = 1.0, most_slabs: int = MOST_SLABS,
               uncut_mm: Sequence[tuple[float, float]] = (),
               bodies_mm: Sequence[tuple[float, float]] = ()) -> SlabPlan:
    """Plan the slabs of a capture from one look at depth: as few as keep the hidden light within the accuracy.

    Parameters
    ----------
    depth_mm : array (row, column)
        Depths from `planar_depth_mm`, for all of `capture`, at any resolution. Pixels with NaN do not count.
    capture : PixelGrid
        The grid of the look; its overscan is the maximum for slabs.
    lens : Lens
    accuracy : float
        As in `Options`: this fraction of a point's light may be treated as if in focus, and AT_EDGES times this
        fraction of the light from behind edges may remain hidden in slabs.
    overscan_px : (int, int)
        Rows and columns that a capture needs beyond the frame if everything is in focus, for distortion and PSFs.
    light : array (row, column), optional
        Light of the same pixels, in any unit: edges of bright surfaces count more.
    empty : bool array (row, column), optional
        Pixels of the background without light: the plan ignores them.
    others : sequence of Lens
        Other lenses for the same capture: the lens at other focus distances and f-stops.
    reach : float
        `Opening.reach` of the iris: the radius of the blur relative to a round stop.
    most_slabs : int
    uncut_mm : sequence of (near_mm, far_mm)
        Ranges without borders, as a camera clips: volumes.
    bodies_mm : sequence of (near_mm, far_mm)
        Further ranges without borders, if blur differs by at most DEEP_PX across one: closed bodies, whose dark inside
        would be visible at a border.

    Returns
    -------
    SlabPlan
    """
    # lenses       the lens and the others
    # look         the depths and the light, prepared: arrays (row, column)
    # in_frame     pixels of the look in the frame with a known depth or background: bool (row, column)
    # reaching_mm  depths whose light may reach the frame: (pixel,)
    # shares       share of these pixels' light that counts as in focus, for each lens: (pixel,), from 0 to 1
    # uncut        ranges without borders, as places (px of blur from that at infinity): pairs, near and far
    # edges        jumps in blur between pixels
    # borders      places of the borders, descending
    # hidden       share of the light from behind edges that remains hidden
    # behind       share of the picture's light that comes from behind edges

    # what the look shows, and whether everything is in focus
    lenses = lens, *others
    look = _look(depth_mm, light, empty, capture, lenses, overscan_px, reach)
    in_frame = np.all(look.beyond_px == 0, axis=0) & (look.empty | ~np.isnan(look.planar_mm))
    check = check_depth(np.where(look.empty, np.inf, look.planar_mm)[in_frame], lens, capture.pitch_um,
                        empty=look.empty[in_frame], in_focus=_within(look.in_focus[0], in_frame)
                        ) if in_frame.any() else None
    reaching_mm = look.planar_mm[look.reaching]
    shares = [focus_share(blur_px(one, capture.pitch_um, reaching_mm, _within(in_focus, look.reaching)),
                          focus_range_px(one, capture.pitch_um))
              for one, in_focus in zip(lenses, look.in_focus, strict=True)]
    if np.all(np.array(shares) >= 1 - accuracy):
        return SlabPlan(False, (), (look.least_px,), 0.0, 0.0, check)

    # the borders, and what they leave hidden
    uncut = look.places(uncut_mm) + [body for body in look.places(bodies_mm) if np.ptp(body) <= DEEP_PX]
    edges = _edges(look)
    borders, hidden = _cut(edges, uncut, most_slabs, accuracy)
    behind = BEHIND_PX * edges.jump_px2.sum() / (edges.surfaces.size * edges.pixel_px2)

    # the slabs between them
    ends = (np.inf, *borders, 0.0)
    margins = tuple(look.margin_px(near, far) for near, far in zip(ends[:-1], ends[1:], strict=True))
    return SlabPlan(True, tuple(look.scale / place for place in borders), margins, float(behind),
                    float(hidden * behind), check)


def borders_at_jumps(place: np.ndarray, light: np.ndarray, most: int, accuracy: float) -> list[float]:
    """Borders, descending, between at most so many parts of a picture that have no jumps in blur inside; none if little
    light comes from behind its jumps: AT_EDGES times the accuracy.

    Parameters
    ----------
    place : array (row, column)
        Of the visible surfaces, as in `_Look`; NaN without one.
    light : array (row, column)
    most : int
    accuracy : float
    """
    share = light / max(light.mean(), np.finfo(float).tiny)
    edges = _edges_between(place, ~np.isnan(place), share, (1.0, 1.0))
    if BEHIND_PX * edges.jump_px2.sum() <= AT_EDGES * accuracy * place.size:
        return []
    return _cut(edges, [], most, accuracy)[0]


def _within(in_focus, pixels):
    """Inverse depths in focus at some pixels; None if it is the same at all pixels."""
    return in_focus[pixels] if np.ndim(in_focus) else None


@dataclass(frozen=True, eq=False)
class _Look:
    """A look at depth: arrays (row, column), with NaN for pixels without depth.

    The *place* of a distance is proportional to its inverse: the difference to the blur at infinity, in pixels.

    Attributes
    ----------
    planar_mm, light : array
    empty : bool array
        Pixels of the background without light; their depth is NaN.
    cosine : array
        Depth over distance; 1 for a camera that clips by depth.
    stretch : array
        Scale of the capture along its larger axis, relative to the scale of a plane.
    beyond_px : array (2, row, column)
        Distance beyond the frame, down and across.
    step_px : array (2,)
        Rows and columns of the capture between adjacent pixels of the look.
    scale : float
        Place times distance in mm.
    in_focus : list of float or array
        Inverse depth in focus of each lens: arrays if the plane of focus leans.
    least_px, most_px : (int, int)
        Rows and columns beyond the frame: with everything in focus, and in the look.
    reach : float
        As in `plan_slabs`.
    """

    planar_mm: np.ndarray
    light: np.ndarray
    empty: np.ndarray
    cosine: np.ndarray
    stretch: np.ndarray
    beyond_px: np.ndarray
    step_px: np.ndarray
    scale: float
    in_focus: list[float | np.ndarray]
    least_px: tuple[int, int]
    most_px: tuple[int, int]
    reach: float

    @property
    def place(self):
        """Place of the surface in each pixel."""
        return self.scale * self.cosine / self.planar_mm

    @property
    def reaching(self):
        """The pixels whose light may reach the frame."""
        return self.reaches(self.blur_px(self.place))

    def blur_px(self, place):
        """Largest diameter of the blur of places, as the capture shows it."""
        far_px = [-self.scale * nearness for nearness in self.in_focus]  # the blur at infinity
        return self.stretch / self.cosine * np.maximum(*(np.abs(place + bound.reduce(far_px) * self.cosine)
                                                         for bound in (np.minimum, np.maximum)))

    def places(self, ranges_mm):
        """Places of ranges of distance: [(near, far)]."""
        with np.errstate(divide="ignore"):
            return [tuple(self.scale / np.maximum(ends_mm, 0.0)) for ends_mm in ranges_mm]

    def reaches(self, blur_px):
        """The pixels so close to the frame that a blur of this diameter reaches it."""
        apart_px = np.maximum(0, self.beyond_px - np.reshape(self.least_px, (2, 1, 1)))
        return np.hypot(*apart_px) <= self.reach * blur_px / 2

    def margin_px(self, near, far):
        """Rows and columns beyond the frame of a slab between two places.

        A pixel may contain anything behind its visible surface; this counts if its blur reaches the frame.
        """
        place = self.place
        blurs = [self.blur_px(end) for end in (np.minimum(place, near), far)]
        counts = (place >= far) & self.reaches(np.maximum(*blurs))
        beyond_px = np.max(self.beyond_px, axis=(1, 2), where=counts, initial=-np.inf) + self.step_px
        rows, columns = np.clip(np.ceil(beyond_px), self.least_px, np.maximum(self.most_px, self.least_px))
        return int(rows), int(columns)


def _look(depth_mm, light, empty, capture, lenses, overscan_px, reach):
    """A look at a subset of the pixels, with the blur of the widest stop."""
    planar_mm = np.asarray(depth_mm, dtype=float)
    empty = np.broadcast_to(empty, planar_mm.shape)
    light = np.ones_like(planar_mm) if light is None else np.nan_to_num(np.asarray(light, dtype=float), posinf=0)
    every = int(np.ceil(np.sqrt(planar_mm.size / MOST_LOOKED)))
    step_px = np.divide(capture.shape_px, planar_mm.shape)
    rows, columns = ((np.arange(0, looked, every) + 0.5) * step - 0.5
                     for looked, step in zip(planar_mm.shape, step_px, strict=True))
    planar_mm, light, empty = _subset(planar_mm, np.maximum(light, 0), empty, every)
    planar_mm = np.where((planar_mm > 0) & ~empty, planar_mm, np.nan)
    beyond_px = [np.maximum(0, np.abs(places - (n - 1) / 2) - frame / 2) for places, n, frame in
                 zip((rows, columns), capture.shape_px, capture.frame_px, strict=True)]
    focal_mm = capture.focal_mm or lenses[0].capture_focal_length_mm
    cosine = stretch = np.ones_like(planar_mm)
    if not capture.projection.is_plane:
        x_mm, y_mm = capture.position_mm(rows[:, None], columns)
        angle_rad = capture.projection.angle_rad(np.hypot(x_mm, y_mm) / focal_mm)
        angle_rad = np.where(angle_rad < np.pi / 2, angle_rad, np.nan)
        cosine, tangent = np.cos(angle_rad), np.tan(angle_rad)
        stretch = np.maximum(capture.projection.shrinkage(tangent), capture.projection.radius(tangent)[1])
    scale = max(blur_per_nearness_px(one, capture.pitch_um) * focal_mm / one.capture_focal_length_mm for one in lenses)
    in_focus = [focus_in_capture(one, capture, rows[:, None], columns) for one in lenses]
    beyond_px = np.array(np.meshgrid(*beyond_px, indexing="ij"))
    return _Look(planar_mm, light, empty, cosine, stretch, beyond_px, every * step_px, scale,
                 in_focus, tuple(map(int, overscan_px)), capture.overscan_px, reach)


def _subset(planar_mm, light, empty, every):
    """One of each `every` by `every` pixels: the first, or a lamp, which may be smaller than that."""
    chosen = [each[::every, ::every].copy() for each in (planar_mm, light, empty)]
    for down, across in np.ndindex(every, every):
        others = [each[down::every, across::every] for each in (planar_mm, light, empty)]
        rows, columns = others[0].shape
        parts = [each[:rows, :columns] for each in chosen]
        lamp = others[1] > LAMP * parts[1]
        for part, other in zip(parts, others, strict=True):
            np.copyto(part, other, where=lamp)
    return chosen


@dataclass(frozen=True, eq=False)
class _Edges:
    """Jumps in blur between adjacent pixels.

    Attributes
    ----------
    far, near : array (pair,)
        Places of the two pixels.
    jump_px2 : array (pair,)
        The jump in blur, times the length of edge that the pair represents, weighted by its light.
    surfaces : array, ascending
        Places of all pixels.
    pixel_px2 : float
        Area that each of these represents.
    """

    far: np.ndarray
    near: np.ndarray
    jump_px2: np.ndarray
    surfaces: np.ndarray
    pixel_px2: float


def _edges(look):
    place, reaching = look.place, look.reaching
    share = look.light / max(look.light[reaching].mean(), np.finfo(float).tiny)
    return _edges_between(place, reaching, np.minimum((1 + share) / 2, MOST_WEIGHT), tuple(look.step_px))


def _edges_between(place, reaching, weight, step_px):
    down_px, across_px = step_px
    pairs = [_jumps(place, reaching, weight, down_px), _jumps(place.T, reaching.T, weight.T, across_px)]
    far, near, jump_px2 = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    return _Edges(far, near, jump_px2, np.sort(place[reaching]), float(down_px * across_px))


def _jumps(place, reaching, weight, length_px):
    """Far and near ends of the jumps between adjacent pixels in rows, and the jumps times edge length and weight.

    The inverse depth of a plane is linear in the picture: a jump is the part of a step that linear extrapolation from
    neither side explains.
    """
    step = np.diff(place)
    straight = np.pad(step, ((0, 0), (1, 1)), constant_values=np.nan)
    jump = np.fmin(np.fmin(np.abs(step - straight[:, :-2]), np.abs(step - straight[:, 2:])), np.abs(step))
    is_jump = (jump > JUMP_PX) & (reaching[:, :-1] | reaching[:, 1:])
    ends = place[:, :-1][is_jump], place[:, 1:][is_jump]
    weight = (weight[:, :-1] + weight[:, 1:])[is_jump] / 2
    return np.minimum(*ends), np.maximum(*ends), jump[is_jump] * weight * length_px


def _cut(edges, uncut, most_slabs, accuracy):
    """Places of the borders, descending, and the fraction of the jumps that remains, including the cost of borders.

    By dynamic programming: the best cut up to a place into n slabs extends a best cut up to a farther place into n - 1.

    candidates    places where a border may be, px of blur: array (candidate,), ascending
    inside        jumps inside the slab between two nodes, px²: array (node, node); nodes are candidates and both ends
    close         cost of the surfaces close to a border at each candidate, px²: array (candidate,)
    step          `inside` with the cost of the border at the second node: array (node, node)
    cost          of the best cut up to each node into the current number of slabs: array (node,)
    ways          for each number of slabs, the node before each in its best cut: arrays (node,)
    totals        cost of the best complete cut, for each number of slabs
    nodes         of the chosen cut, from the near end to the far one
    """
    # the costs of borders and slabs
    candidates = _candidates(edges, uncut)
    inside, close = _costs(edges, candidates)
    for near, far in uncut:
        close[(far < candidates) & (candidates < near)] = np.inf
    step = inside + np.concatenate([[np.inf], close, [0.0]])

    # the best cut into each number of slabs
    cost = np.append(0.0, np.full(len(step) - 1, np.inf))
    ways, totals = [], []
    for _ in range(min(most_slabs, len(step) - 1)):
        by = cost[:, None] + step
        ways.append(np.argmin(by, axis=0))
        cost = by.min(axis=0)
        totals.append(cost[-1])

    # the fewest slabs that keep the hidden light within the accuracy
    slabs = 1 + int(np.argmax(np.array(totals) <= max(AT_EDGES * accuracy * totals[0], min(totals))))
    nodes = [len(step) - 1]
    for way in reversed(ways[:slabs]):
        nodes.append(int(way[nodes[-1]]))
    left = totals[slabs - 1] / totals[0] if totals[0] else 0.0
    return [float(candidates[node - 1]) for node in nodes[1:-1]], left


def _candidates(edges, uncut):
    """Candidates for borders, ascending: in the widest gaps between ends of jumps, in a geometric sequence, and at the
    ends of ranges that must not be cut."""
    ends = np.concatenate([edges.far, edges.near])
    order = np.argsort(ends)
    ends, weight = ends[order], np.cumsum(np.tile(edges.jump_px2, 2)[order])
    places = [np.multiply(span, (1 + OUTSIDE, 1 - OUTSIDE)) for span in uncut]
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
    """Jumps inside each slab between two candidates or ends, array (far, near), inf for impossible slabs; and the cost
    of surfaces close to each candidate."""
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
