"""Levels of layers, each with larger pixels than the previous one, for rays that represent a part of the pupil.

Such a ray looks up the mean over the blur of its part of the pupil, a square that is at most as large as a pixel of
the level. The pixels of a level are means of light and of alpha, so that surfaces do not mix. Adjacent rays look up
adjacent squares, so that their parts merge.

A surface that continues from a layer to the next one covers parts of a pixel in both. Rays that pass one part meet the
other, but the loops assume that alphas of different layers are independent, and would let light through. The pixels of
a level are therefore means over the part that nearer layers do not cover, if these are so close that rays meet both at
the same place: the loops' product of transmissions is then the mean of the product.
"""

from collections.abc import Sequence
from functools import reduce

import numpy as np
import scipy

from ..kernels.cast import LayerArrays, LevelArrays
from ..lens import Lens
from .depth_range import blur_per_nearness_px
from .prepared_layer import PreparedLayer

# Sides of the levels' pixels: in finer steps than halves, look-ups spread less.
SIZES = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48)
BORDER = 2  # pixels around a level: one that stays empty, and one into which hidden surfaces continue
SAME_PLACE = 1.0  # of a level's pixels: the largest difference in blur; a ray's two places differ by at most half of it
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
        For each layer, the levels that rays look up, ascending indices in SIZES. Any others are the capture's pixels.
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
        coarse = _visible_levels(layer, planes, place, nearer, [SIZES[level] for level in levels if level])
        arrays.append(layer.of(finest, [coarse.get(size, finest) for size in SIZES[1:1 + max(levels)]]))
        cover, cover_place = nearer[:, *layer.layer.place]
        np.minimum(cover + alpha, 1, out=cover)
        np.copyto(cover_place, place, where=alpha > 0)
    return tuple(arrays)


def _visible_levels(layer, planes, place, nearer, sizes):
    """Levels of these sizes, without the parts that nearer layers hide from all rays.

    `nearer` is the cover of the nearer layers and the place of the farthest of them, in the capture's pixels.
    """
    coarse = _levels(layer.layer.origin_px, planes, layer.sides, sizes)
    cover, cover_place = nearer
    if sizes and cover.any():
        beyond = [(side.start, n - side.stop) for side, n in zip(layer.layer.place, cover.shape, strict=True)]
        apart = cover * np.abs(cover_place - np.pad(place, beyond, mode="edge"))
        covers = _levels((0, 0), [cover, apart], [(True, True)] * 2, sizes)
        for size, (first, stack) in coarse.items():
            window = tuple(slice(at + BORDER, at + BORDER + n) for at, n in zip(first, stack.shape[1:], strict=True))
            covered, distance = covers[size][1][:, *window]
            hidden = np.where(distance <= SAME_PLACE * size * covered, covered, 0)
            _leave_out_hidden(layer, planes, cover, hidden, size, first, stack)
            _fill_hidden(stack, hidden)
    return {size: _level_arrays(layer, size, *level) for size, level in coarse.items()}


def _leave_out_hidden(layer, planes, cover, hidden, size, first, stack):
    """Replace partly hidden pixels of a level by means over their visible parts.

    In a pixel of the capture, surfaces at the same place cover different parts, as at the border between two slabs.
    """
    partly = np.nonzero((hidden > 0) & (hidden < 1 - VISIBLE))
    inside, of_layer, of_capture = [], [], []
    for index, at, start, n, count in zip(partly, first, layer.layer.origin_px, planes[0].shape, cover.shape,
                                          strict=True):
        blocks = np.clip(at + index[:, None], 0, (count - 1) // size)
        pixels = np.minimum(blocks * size + np.arange(size), count - 1)
        of_capture.append(pixels)
        of_layer.append(np.clip(pixels - start, 0, n - 1))
        inside.append((pixels >= start) & (pixels < start + n))
    alpha, *_ = planes
    of_layer = np.s_[of_layer[0][:, :, None], of_layer[1][:, None]]
    visible = 1 - cover[of_capture[0][:, :, None], of_capture[1][:, None]]
    parts = np.minimum(1, visible / np.maximum(alpha[of_layer], ROUNDING)) * inside[0][:, :, None] * inside[1][:, None]
    parts /= visible.sum(axis=(1, 2), keepdims=True)
    for plane, level in zip(planes, stack, strict=True):
        level[partly] = np.einsum("nij,nij->n", parts, plane[of_layer])


def _fill_hidden(stack, hidden):
    """Continue the visible parts of a level by a pixel where it is hidden: rays between two pixels look up both."""
    visible = np.where(hidden < 1 - VISIBLE, 1 - hidden, 0)
    row, column = np.nonzero(((visible == 0) & (scipy.ndimage.maximum_filter(visible, 3) > 0))[1:-1, 1:-1])
    around = row[:, None] + np.repeat(range(3), 3), column[:, None] + np.tile(range(3), 3)
    parts = visible[around] / visible[around].sum(axis=1, keepdims=True)
    for level in stack:
        level[row + 1, column + 1] = (parts * level[around]).sum(axis=1)


def _levels(origin_px, planes, sides, sizes):
    """For each size: row and column of the first pixel, and array (plane, row, column); pixels are means over blocks of
    the capture's."""
    stacks = {size: [] for size in sizes}
    for plane in planes:
        coarse = {1: (origin_px, plane)}
        for size, stack in stacks.items():
            finer = size // 2 if size // 2 in coarse and size % 2 == 0 else 1
            coarse[size] = _coarser(*coarse[finer], size // finer, sides)
            stack.append(_continued(coarse[size][1], [(BORDER, BORDER)] * 2, sides))
    return {size: (tuple(at // size - BORDER for at in origin_px), np.stack(stack, dtype=np.float32))
            for size, stack in stacks.items()}


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


def _level_arrays(layer, size, first, stack):
    axis_px = tuple((axis + 0.5) / size - 0.5 - at for axis, at in zip(layer.capture.centre_px, first, strict=True))
    return LevelArrays(stack[1:], stack[0], axis_px, 1 / size, (-np.inf, np.inf) * 2)
