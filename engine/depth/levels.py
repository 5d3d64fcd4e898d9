"""Levels of layers, each softer than the previous one, for rays that represent a part of the pupil.

Such a ray looks up the mean over the blur of its part of the pupil, weighted with nearly a Gaussian: the look-ups of
rays that lie like a lattice then add up to an even disc, however far the lens's aberrations stretch the lattice. A
square would show it as rings. A level is the layer smoothed by a B-spline, at about half the distance between rays,
so that positions between its pixels can be interpolated. Light and alpha are smoothed together, so that surfaces do
not mix.

A surface that continues from a layer to the next one covers parts of a pixel in both. Rays that pass one part meet the
other, but the loops assume that alphas of different layers are independent, and would let light through. The pixels of
a level are therefore means over the part that nearer layers do not cover, if these are so close that rays meet both at
the same place: the loops' product of transmissions is then the mean of the product.
"""

from collections.abc import Sequence
from functools import reduce
from math import comb

import numpy as np
import scipy

from ..kernels.casting import LayerArrays, LevelArrays
from ..lens import Lens
from .depth_range import blur_per_nearness_px
from .prepared_layer import PreparedLayer

# Sides of the levels' pixels, powers of two, and how often each was averaged with its neighbour after that.
LEVELS = ((1, 0), (1, 1), (1, 2), (1, 4), (1, 8), (2, 2), (2, 4), (2, 8), (2, 14), (4, 4), (4, 8), (4, 14), (8, 4),
          (8, 8), (8, 14), (16, 4), (16, 8))
# Of a level: the side of pixels that are as soft when their positions are interpolated.
SOFTNESS_PX = tuple((2 * (size**2 - 1) + size**2 * (1 + 1.5 * averages)) ** 0.5 for size, averages in LEVELS)
HALVING = 1, 4, 6, 4, 1  # sixteenths of pixels in one that is twice as large: a spline, whose parts have even sums
SAME_PLACE = 1.0  # of a level's softness: the largest difference in blur; a ray's places differ by at most half of it
ROUNDING = 1e-6  # of alpha
VISIBLE = 1e-3  # smallest share of a level's pixel that counts as visible


def layer_arrays(layers: Sequence[PreparedLayer], lens: Lens, wavelengths: slice, used: Sequence[Sequence[int]],
                 scale: float) -> tuple[LayerArrays, ...]:
    """Layers for the loops, the nearest first, at some of the wavelengths.

    Parameters
    ----------
    layers : sequence of PreparedLayer
    lens : Lens
    wavelengths : slice
    used : sequence of sequences of int
        For each layer, the levels that rays look up, ascending indices in LEVELS. Any others are the capture's pixels.
    scale : float
        Factor on light.
    """
    arrays: list[LayerArrays] = []
    nearer = np.zeros((2, *layers[0].capture.shape_px), np.float32)  # the cover of nearer layers; the farthest's place
    for layer, levels in zip(layers, used, strict=True):
        finest, alpha = layer.finest(wavelengths, scale), layer.layer.alpha
        place = layer.depth[..., 0] * np.float32(blur_per_nearness_px(lens, layer.capture.pitch_um))
        light = layer.layer.cube[wavelengths]
        planes = [alpha, *(light if scale == 1 else light * np.float32(scale))]
        soft = _visible_levels(layer, planes, place, nearer, [level for level in levels if level])
        arrays.append(layer.of(finest, [soft.get(level, finest) for level in range(1, 1 + max(levels))]))
        cover, cover_place = nearer[:, *layer.layer.place]
        np.minimum(cover + alpha, 1, out=cover)
        np.copyto(cover_place, place, where=alpha > 0)
    return tuple(arrays)


def _visible_levels(layer, planes, place, nearer, levels):
    """Levels by index, without the parts that nearer layers hide from all rays.

    `nearer` is the cover of the nearer layers and the place of the farthest of them, in the capture's pixels.
    """
    soft = _levels(layer.layer.origin_px, planes, layer.sides, levels)
    cover, cover_place = nearer
    if levels and cover.any():
        beyond = [(side.start, n - side.stop) for side, n in zip(layer.layer.place, cover.shape, strict=True)]
        apart = np.abs(cover_place - np.pad(place, beyond, mode="edge"))
        for level in levels:
            visible = 1 - cover * (apart <= SAME_PLACE * SOFTNESS_PX[level])
            if visible.min() < 1:
                _leave_out_hidden(layer, planes, visible, level, *soft[level])
    return {level: _level_arrays(layer, *LEVELS[level], *arrays) for level, arrays in soft.items()}


def _leave_out_hidden(layer, planes, visible, level, first, stack):
    """Replace partly hidden pixels of a level by means over their visible parts.

    In a pixel of the capture, surfaces at the same place cover different parts, as at the border between two slabs.
    """
    own = visible[layer.layer.place]
    parts = np.minimum(1, own / np.maximum(planes[0], ROUNDING))
    (start, shares), = _levels((0, 0), [visible], [(True, True)] * 2, [level]).values()
    share = shares[0][tuple(slice(at - before, at - before + n)
                            for at, before, n in zip(first, start, stack.shape[1:], strict=True))]
    for plane, to in zip(planes, stack, strict=True):
        (_, (of_parts,)), = _levels(layer.layer.origin_px, [plane * parts], layer.sides, [level]).values()
        np.divide(of_parts, share, out=to, where=share > VISIBLE)


def _levels(origin_px, planes, sides, levels):
    """For each level: row and column of the first pixel, and array (plane, row, column)."""
    stacks, firsts = {level: [] for level in levels}, {}
    for plane in planes:
        coarse = {1: (origin_px, plane)}
        for level, stack in stacks.items():
            size, averages = LEVELS[level]
            while size not in coarse:
                coarse[2 * max(coarse)] = _halved(*coarse[max(coarse)], sides)
            firsts[level], soft = _smoothed(*coarse[size], averages, sides)
            stack.append(soft)
    return {level: (firsts[level], np.stack(stacks.pop(level), dtype=np.float32)) for level in levels}


def _halved(first, plane, sides):
    """Row and column of the first pixel, and pixels twice as large, in the middle of every second one of a plane."""
    widths = [(at % 2 + 4, 5 - (at + n) % 2) for at, n in zip(first, plane.shape, strict=True)]
    plane = _continued(plane, widths, sides)
    for _ in range(2):
        count = (len(plane) - 3) // 2
        plane = reduce(np.add, [np.float32(part / 16) * plane[n:n + 2 * count:2] for n, part in enumerate(HALVING)]).T
    return [at // 2 - 1 for at in first], plane


def _smoothed(first, plane, averages, sides):
    """Row and column of the first pixel, and a plane averaged with its neighbours, with empty pixels around it."""
    width = (averages + 1) // 2 + 1
    plane = _continued(plane, [(width, width)] * 2, sides).astype(np.float32, copy=False)
    parts = np.array([comb(averages, n) for n in range(averages + 1)]) / 2**averages
    for axis in (0, 1):
        plane = scipy.ndimage.correlate1d(plane, parts, axis, mode="nearest")
    return [at - width for at in first], plane


def _continued(plane, widths, sides):
    """A plane with more pixels at its sides: the last ones repeated where it goes on, otherwise 0."""
    for axis, (width, goes_on) in enumerate(zip(widths, sides, strict=True)):
        for side in (0, 1):
            padding = [(0, 0), (0, 0)]
            padding[axis] = (width[0], 0) if side == 0 else (0, width[1])
            plane = np.pad(plane, padding, mode="edge" if goes_on[side] else "constant")
    return plane


def _level_arrays(layer, size, averages, first, stack):
    before = averages % 2 / 2  # an odd number of averages ends half a pixel before
    axis_px = tuple(axis / size - at + before for axis, at in zip(layer.capture.centre_px, first, strict=True))
    return LevelArrays(stack[1:], stack[0], axis_px, 1 / size, (-np.inf, np.inf) * 2)
