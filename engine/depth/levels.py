"""Levels of layers, each with larger pixels than the previous one, for rays that represent a part of the pupil.

Such a ray looks up the mean over the blur of its part of the pupil, a square that is at most as large as a pixel of
the level. The pixels of a level are means of light and of alpha, so that surfaces do not mix. Adjacent rays look up
adjacent squares, so that their parts merge.

A surface that continues from a layer to the next one covers parts of a pixel in both. Rays that pass one part meet the
other, but the loops assume that alphas of different layers are independent, and would let light through. The surface
is therefore continued in the farther layer, behind itself.
"""

from collections.abc import Sequence
from functools import reduce

import numpy as np

from ..kernels.cast import LayerArrays, LevelArrays
from ..lens import Lens
from .depth_range import blur_per_nearness_px
from .prepared_layer import PreparedLayer

SIZES = (1, 2, 3, 4, 6, 8, 12, 16, 24)  # sides of the levels' pixels: in finer steps than halves, look-ups spread less
BORDER = 3  # pixels around a level: one that stays empty, and two for surfaces of the nearer layer
SAME_SURFACE = 0.5  # of a level's pixels: the largest difference in blur between parts of one surface


def layer_arrays(layers: Sequence[PreparedLayer], lens: Lens, wavelengths: slice, levels: int,
                 scale: float) -> tuple[LayerArrays, ...]:
    """Layers for the loops, the nearest first, at some of the wavelengths.

    Parameters
    ----------
    layers : sequence of PreparedLayer
    lens : Lens
    wavelengths : slice
    levels : int
        Their number, 1 for the capture's pixels alone: the first of SIZES.
    scale : float
        Factor on light.
    """
    arrays: list[LayerArrays] = []
    nearer: list[tuple[tuple[int, int], np.ndarray]] = []
    for layer in layers:
        finest = layer.finest(wavelengths, scale)
        place = layer.depth[..., 0] * np.float32(blur_per_nearness_px(lens, layer.capture.pitch_um))
        light = (plane * np.float32(scale) for plane in layer.layer.cube[wavelengths])
        coarse, sizes = _levels(layer, [layer.layer.alpha, place, *light], levels), SIZES[1:levels]
        for size, near, far in zip(sizes, nearer, coarse, strict=False):
            _continue_surfaces(near, far, SAME_SURFACE * size)
        arrays.append(layer.of(finest, [_level_arrays(layer, *each) for each in zip(sizes, coarse, strict=True)]))
        nearer = coarse
    return tuple(arrays)


def _levels(layer, planes, levels):
    """For each level: row and column of its first pixel, and array (plane, row, column).

    The planes are alpha, place, which continues beyond the layer's end, and light; pixels are blocks of the capture's.
    """
    sides = list(zip(layer.goes_on[::2], layer.goes_on[1::2], strict=True))
    ends = [sides, [(True, True)] * 2, *[sides] * (len(planes) - 2)]
    stacks = {size: [] for size in SIZES[1:levels]}
    for plane, end in zip(planes, ends, strict=True):
        coarse = {1: (layer.layer.origin_px, plane)}
        for size, stack in stacks.items():
            finer = size // 2 if size // 2 in coarse and size % 2 == 0 else 1
            coarse[size] = _coarser(*coarse[finer], size // finer, end)
            stack.append(_continued(coarse[size][1], [(BORDER, BORDER)] * 2, end))
    result = []
    for size, stack in stacks.items():
        first = tuple(at // size - BORDER for at in layer.layer.origin_px)
        result.append((first, np.stack(stack, dtype=np.float32)))
        stack.clear()
    return result


def _coarser(first, plane, times, sides):
    """Row and column of the first pixel, and means over blocks of `times` x `times` pixels, from a plane's."""
    widths = [(at % times, -(at + n) % times) for at, n in zip(first, plane.shape, strict=True)]
    plane = _continued(plane, widths, sides)
    for _ in range(2):
        plane = reduce(np.add, [plane[n::times] for n in range(times)]).T
    return [at // times for at in first], plane * np.float32(1 / times**2)


def _continued(plane, widths, sides):
    """A plane with more pixels at its sides: the last ones repeated where it goes on, otherwise 0."""
    for axis, (width, goes_on) in enumerate(zip(widths, sides, strict=True)):
        for side in (0, 1):
            padding = [(0, 0), (0, 0)]
            padding[axis] = (width[0], 0) if side == 0 else (0, width[1])
            plane = np.pad(plane, padding, mode="edge" if goes_on[side] else "constant")
    return plane


def _continue_surfaces(near, far, same):
    """Add the surfaces of a nearer layer to the uncovered part of a farther one's pixels, where their places are the
    same up to this difference. The outermost pixels stay as they are."""
    parts = []
    for (first, stack), (other_first, other) in ((near, far), (far, near)):
        ahead = np.subtract(other_first, first)
        start = np.maximum(ahead, 0) + 1
        end = np.maximum(np.minimum(stack.shape[1:], ahead + other.shape[1:]) - 1, start)
        parts.append(stack[:, start[0]:end[0], start[1]:end[1]])
    (alpha, place, *light), (into, far_place, *into_light) = parts
    part = np.divide(np.minimum(alpha, 1 - into), alpha, out=np.zeros_like(alpha), where=alpha > 0)
    part[np.abs(place - far_place) > same] = 0
    into += part * alpha
    for plane, far_plane in zip(light, into_light, strict=True):
        far_plane += part * plane


def _level_arrays(layer, size, level):
    first, stack = level
    axis_px = tuple((axis + 0.5) / size - 0.5 - at for axis, at in zip(layer.capture.centre_px, first, strict=True))
    return LevelArrays(stack[2:], stack[0], axis_px, 1 / size, (-np.inf, np.inf) * 2)
