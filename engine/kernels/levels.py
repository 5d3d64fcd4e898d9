"""Levels of a layer, at several resolutions: their descriptions for all loops, and how numpy makes them."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce
from math import comb
from typing import NamedTuple

import numpy as np
import scipy

SHARPER = 1 / 12  # of differences; this subtracts a variance of 1/6, that of a pixel and of a cell as large as it
STRIP = 128  # rows or columns that are sharpened together, in the processor's cache
HALVING = 1, 4, 6, 4, 1  # sixteenths of pixels in one that is twice as large: a spline, whose parts have even sums
ROUNDING = 1e-6  # of alpha
VISIBLE = 1e-3  # smallest share of a level's pixel that counts as visible

Sides = tuple[tuple[bool, bool], tuple[bool, bool]]
"""Whether the last pixels continue beyond the first and last row, and beyond the first and last column."""
Place = tuple[tuple[int, int], tuple[int, int]]
"""First row and column of a plane, in its own pixels from the capture's first; and its rows and columns."""
EVERYWHERE: Sides = ((True, True), (True, True))


class LevelKind(NamedTuple):
    """How a level is made.

    Attributes
    ----------
    size : int
        Side of its pixels in those of the capture, a power of two.
    averages : int
        How often each was averaged with its neighbour after that.
    near_px : float
        Difference in blur up to which nearer surfaces hide pixels from all rays.
    """

    size: int
    averages: int
    near_px: float


@dataclass(frozen=True, eq=False)
class Nearer:
    """Layers in front of a layer.

    Attributes
    ----------
    cover : float32 array (row, column) of the capture
        Fraction of each pixel that they cover.
    apart_px : float32 array (row, column) of the capture
        Difference in blur between the farthest of their surfaces and the layer.
    closest_px : float
        The smallest of these differences.
    """

    cover: np.ndarray
    apart_px: np.ndarray
    closest_px: float

    def hides(self, kind: LevelKind) -> bool:
        """Whether they hide pixels of a level from all rays."""
        return self.closest_px <= kind.near_px


@dataclass(frozen=True, eq=False)
class LevelArrays:
    """A layer of a capture at one resolution.

    Attributes
    ----------
    light : float32 array (wavelength, row, column)
        Premultiplied by alpha; contiguous rows, at least 2 x 2 pixels.
    alpha : float32 array (row, column)
    axis_px : (float, float)
        Row and column of the axis, in this level's pixels.
    per_px : float
        This level's pixels in a pixel of the capture.
    bounds_px : (float, float, float, float)
        Top, bottom, left and right limits of the layer; infinite for sides at which the last pixels continue.
    """

    light: np.ndarray
    alpha: np.ndarray
    axis_px: tuple[float, float]
    per_px: float
    bounds_px: tuple[float, float, float, float]


@dataclass(frozen=True, eq=False)
class LayerPlanes:
    """A layer as captured, and its levels to be made.

    Attributes
    ----------
    light : float32 array (wavelength, row, column)
        Premultiplied by alpha.
    alpha : float32 array (row, column)
    scale : float
        Factor on light in the levels.
    sharp : bool
        Whether the first level, which has the capture's pixels, is sharpened.
    origin_px : (int, int)
        The layer's first row and column in the capture.
    axis_px : (float, float)
        Row and column of the axis in the capture.
    sides : Sides
        False where the layer ends within the capture.
    coarser : tuple of LevelKind or None
        The levels after the first; for None the first takes its place.
    nearer : Nearer or None
        None if nearer layers hide nothing.
    """

    light: np.ndarray
    alpha: np.ndarray
    scale: float
    sharp: bool
    origin_px: tuple[int, int]
    axis_px: tuple[float, float]
    sides: Sides
    coarser: tuple[LevelKind | None, ...] = ()
    nearer: Nearer | None = None

    @property
    def place(self) -> Place:
        return self.origin_px, self.alpha.shape

    @property
    def finest(self) -> tuple[tuple[float, float], float, tuple[float, float, float, float]]:
        """Axis, pixels in a pixel of the capture, and bounds of the first level: see `LevelArrays`."""
        (above, below), (before, behind) = self.sides
        rows, columns = self.alpha.shape
        axis = (self.axis_px[0] - self.origin_px[0], self.axis_px[1] - self.origin_px[1])
        return axis, 1.0, (-np.inf if above else -0.5, np.inf if below else rows - 0.5,
                           -np.inf if before else -0.5, np.inf if behind else columns - 0.5)

    def geometry(self, kind: LevelKind, first: tuple[int, int]) -> tuple[tuple[float, float], float,
                                                                          tuple[float, float, float, float]]:
        """The same of another level with this first row and column."""
        before = kind.averages % 2 / 2  # an odd number of averages ends half a pixel before
        axis = (self.axis_px[0] / kind.size - first[0] + before, self.axis_px[1] / kind.size - first[1] + before)
        return axis, 1 / kind.size, (-np.inf, np.inf, -np.inf, np.inf)


def halved_widths(place: Place) -> list[tuple[int, int]]:
    """Pixels to continue planes by at each side before they are halved: for rows and columns."""
    return [(at % 2 + 4, 5 - (at + n) % 2) for at, n in zip(*place, strict=True)]


def halved_first(first: tuple[int, int]) -> tuple[int, int]:
    """First row and column of planes with pixels twice as large, in the middle of every second one."""
    return first[0] // 2 - 1, first[1] // 2 - 1


def smoothing(averages: int) -> tuple[int, np.ndarray]:
    """Empty pixels around smoothed planes, and the weights of neighbours."""
    return (averages + 1) // 2 + 1, np.array([comb(averages, n) for n in range(averages + 1)]) / 2**averages


def numpy_levels(layer: LayerPlanes) -> tuple[LevelArrays, ...]:
    """The levels of a layer."""
    light = layer.light if layer.scale == 1 else layer.light * np.float32(layer.scale)
    finest = LevelArrays(two_wide(sharpened(light) if layer.sharp else light), two_wide(layer.alpha), *layer.finest)
    kinds = [kind for kind in layer.coarser if kind]
    levels = {}
    for kind, (first, stack) in _levels(layer.origin_px, [layer.alpha, *light], layer.sides, kinds).items():
        if layer.nearer and layer.nearer.hides(kind):
            _leave_out_hidden(layer, [layer.alpha, *light], kind, first, stack)
        levels[kind] = LevelArrays(stack[1:], stack[0], *layer.geometry(kind, first))
    return finest, *(levels[kind] if kind else finest for kind in layer.coarser)


def sharpened(light: np.ndarray) -> np.ndarray:
    """Planes with light moved to brighter neighbours, by as much as look-ups spread it.

    A capture's pixel contains the mean over its area, and a look-up is the mean of pixels over a cell, so details would
    be spread twice. No pixel gives more than its light, so lamps have no dark rims.

    Parameters
    ----------
    light : float32 array (plane, row, column)
    """
    light = light.copy()
    for lines in (lines for plane in light for lines in (plane, plane.T)):
        for first in range(0, len(lines), STRIP):
            before, behind = lines[first:first + STRIP, :-1], lines[first:first + STRIP, 1:]
            moved = np.clip(SHARPER * (behind - before), np.abs(behind) / -2, np.abs(before) / 2)
            before -= moved
            behind += moved
    return light


def two_wide(pixels: np.ndarray, rows: int = -2) -> np.ndarray:
    """A contiguous array with at least two rows, along this axis, and columns, along the next, for interpolation."""
    short = [(0, 0)] * pixels.ndim
    for axis in (rows, rows + 1):
        short[axis] = 0, max(0, 2 - pixels.shape[axis])
    return np.ascontiguousarray(np.pad(pixels, short, mode="edge") if np.any(short) else pixels)


def _leave_out_hidden(layer, planes, kind, first, stack):
    """Replace partly hidden pixels of a level by means over their visible parts.

    In a pixel of the capture, surfaces at the same place cover different parts, as at the border between two slabs.
    """
    visible = 1 - layer.nearer.cover * (layer.nearer.apart_px <= kind.near_px)
    if visible.min() == 1:
        return
    own = visible[tuple(slice(at, at + n) for at, n in zip(*layer.place, strict=True))]
    parts = np.minimum(1, own / np.maximum(planes[0], ROUNDING))
    (start, shares), = _levels((0, 0), [visible], EVERYWHERE, [kind]).values()
    share = shares[0][tuple(slice(at - before, at - before + n)
                            for at, before, n in zip(first, start, stack.shape[1:], strict=True))]
    for plane, to in zip(planes, stack, strict=True):
        (_, (of_parts,)), = _levels(layer.origin_px, [plane * parts], layer.sides, [kind]).values()
        np.divide(of_parts, share, out=to, where=share > VISIBLE)


def _levels(origin_px: tuple[int, int], planes: Iterable[np.ndarray], sides: Sides,
            kinds: Iterable[LevelKind]) -> dict[LevelKind, tuple[tuple[int, int], np.ndarray]]:
    """For each level: row and column of the first pixel, and array (plane, row, column)."""
    stacks: dict[LevelKind, list[np.ndarray]] = {kind: [] for kind in kinds}
    firsts = {}
    for plane in planes:
        coarse = {1: (origin_px, plane)}
        for kind, stack in stacks.items():
            while kind.size not in coarse:
                coarse[2 * max(coarse)] = _halved(*coarse[max(coarse)], sides)
            firsts[kind], soft = _smoothed(*coarse[kind.size], kind.averages, sides)
            stack.append(soft)
    return {kind: (firsts[kind], np.stack(stack, dtype=np.float32)) for kind, stack in stacks.items()}


def _halved(first, plane, sides):
    """Row and column of the first pixel, and pixels twice as large."""
    plane = _continued(plane, halved_widths((first, plane.shape)), sides)
    for _ in range(2):
        count = (len(plane) - 3) // 2
        plane = reduce(np.add, [np.float32(part / 16) * plane[n:n + 2 * count:2] for n, part in enumerate(HALVING)]).T
    return halved_first(first), plane


def _smoothed(first, plane, averages, sides):
    """Row and column of the first pixel, and a plane averaged with its neighbours, with empty pixels around it."""
    width, parts = smoothing(averages)
    plane = _continued(plane, [(width, width)] * 2, sides).astype(np.float32, copy=False)
    for axis in (0, 1):
        plane = scipy.ndimage.correlate1d(plane, parts, axis, mode="nearest")
    return (first[0] - width, first[1] - width), plane


def _continued(plane, widths, sides):
    """A plane with more pixels at its sides: the last ones repeated where it goes on, otherwise 0."""
    for axis, (width, goes_on) in enumerate(zip(widths, sides, strict=True)):
        for side in (0, 1):
            padding = [(0, 0), (0, 0)]
            padding[axis] = (width[0], 0) if side == 0 else (0, width[1])
            plane = np.pad(plane, padding, mode="edge" if goes_on[side] else "constant")
    return plane
