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

import numpy as np

from ..kernels.casting import LayerArrays
from ..kernels.levels import LevelKind, Nearer, two_wide
from ..lens import Lens
from .depth_range import blur_per_nearness_px
from .prepared_layer import PreparedLayer

# Sides of the levels' pixels, powers of two, and how often each was averaged with its neighbour after that.
LEVELS = ((1, 0), (1, 1), (1, 2), (1, 4), (1, 8), (2, 2), (2, 4), (2, 8), (2, 14), (4, 4), (4, 8), (4, 14), (8, 4),
          (8, 8), (8, 14), (16, 4), (16, 8))
# Of a level: the side of pixels that are as soft when their positions are interpolated.
SOFTNESS_PX = tuple((2 * (size**2 - 1) + size**2 * (1 + 1.5 * averages)) ** 0.5 for size, averages in LEVELS)
SAME_PLACE = 1.0  # of a level's softness: the largest difference in blur; a ray's places differ by at most half of it
KINDS = tuple(LevelKind(*kind, SAME_PLACE * softness) for kind, softness in zip(LEVELS, SOFTNESS_PX, strict=True))


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
        place = layer.depth[..., 0] * np.float32(blur_per_nearness_px(lens, layer.capture.pitch_um))
        coarser = tuple(KINDS[level] if level in levels else None for level in range(1, 1 + max(levels)))
        planes = layer.planes(wavelengths, scale, coarser, _hiding(layer, place, nearer, coarser))
        arrays.append(LayerArrays(planes, two_wide(layer.depth, 0)))
        cover, cover_place = nearer[:, *layer.layer.place]
        np.minimum(cover + layer.layer.alpha, 1, out=cover)
        np.copyto(cover_place, place, where=layer.layer.alpha > 0)
    return tuple(arrays)


def _hiding(layer, place, nearer, coarser):
    """The Nearer, from their cover and place, if they hide any of the layer from all rays; otherwise None."""
    cover, cover_place = nearer
    softest = max((kind.near_px for kind in coarser if kind), default=0.0)
    if not softest or not cover.any():
        return None
    beyond = [(side.start, n - side.stop) for side, n in zip(layer.layer.place, cover.shape, strict=True)]
    apart = np.abs(cover_place - np.pad(place, beyond, mode="edge"))
    closest = float(apart.min(where=cover > 0, initial=np.inf))
    return Nearer(cover.copy(), apart, closest) if closest <= softest else None
