"""Depth of all content of a slab's light, also where the one ray of a pixel's depth misses it."""

import numpy as np
import scipy

from lensfield.engine.image.layers import BACKGROUND_MM

from ..scene.units import M_TO_MM
from .emitters import SAME_DEPTH

EDGE_PX = 2.0
LEAST_LIGHT = 1e-3  # of the mean, for content without alpha: the denoiser spreads a little light everywhere
MOST_OF_LIGHT = 0.5  # least share of a pixel's light for an emitter's depth to be the pixel's


def known_depth_m(light, sightings, sky, cosine):
    """Depths of a slab's pixels, as a camera clips, in metres: float32 array (row, column).

    Known emitters have their own depth; other content that the rays miss has the depth of the nearest pixel.

    Parameters
    ----------
    light : GatheredLight
    sightings : Sightings
        The emitters in the capture that the slab is a part of.
    sky : bool
        Whether the world is visible where the film is opaque.
    cosine : array (row, column)
        Depth along the axis over depth as the camera clips, at the capture's pixels.
    """
    slab, depth_m = light.slab, light.depth_m.copy()
    lit = light.cube.mean(axis=0)
    shines = np.abs(lit) > LEAST_LIGHT * np.abs(lit).mean()
    missed = _is_background(depth_m) & (shines | (slab.transparent & (light.alpha > 0)))
    if sky and not slab.transparent:
        missed[:] = False
    sighted = _sighted_m(sightings, slab, missed, lit)
    nearer = sighted < (1 - SAME_DEPTH) * depth_m
    if (nearer & missed).any():  # a known neighbour at the same depth is more accurate
        nearer &= ~(missed & (np.abs(sighted / _continued(depth_m) - 1) < SAME_DEPTH))
    depth_m[nearer] = sighted[nearer]
    missed &= ~nearer
    if missed.any():
        _fill(depth_m, missed, slab, np.isinf(sightings.clip_mm).any(), cosine[slab.region])
    return depth_m


def _continued(depth_m):
    """Depths with the nearest known one in unknown pixels."""
    unknown = _is_background(depth_m)
    if unknown.all():
        return depth_m
    return depth_m[tuple(scipy.ndimage.distance_transform_edt(unknown, return_distances=False, return_indices=True))]


def _fill(depth_m, missed, slab, suns, cosine):
    """Give missed pixels the nearest known depth; in an opaque slab that may show suns, only at edges."""
    unknown = _is_background(depth_m)
    if not unknown.all():
        away_px, nearest = scipy.ndimage.distance_transform_edt(unknown, return_indices=True)
        filled = missed & (slab.transparent | (not suns) | (away_px < EDGE_PX))
        of = tuple(nearest[:, filled])
        ratio = cosine[of] / cosine[filled]
        depth_m[filled] = depth_m[of] * np.where(ratio > 0, ratio, 1)  # NaN: a fisheye that sees sideways and back
    elif slab.transparent:  # only content that the depth pass ignores
        depth_m[missed] = 2 / (1 / slab.near_m + 1 / slab.far_m)


def _is_background(depth_m):
    return depth_m >= BACKGROUND_MM / M_TO_MM


def _sighted_m(sightings, slab, missed, lit):
    """Depth of the nearest emitter in each pixel that rays have missed or that gets most of its light, by a plane of
    it, from the emitter, in metres; inf without one."""
    shape_px = lit.shape
    row, column = (at - side.start for at, side in zip((sightings.row, sightings.column), slab.region, strict=True))
    clip_m = sightings.clip_mm / M_TO_MM
    inside = (row >= 0) & (row < shape_px[0]) & (column >= 0) & (column < shape_px[1]) & np.isfinite(clip_m)
    chosen = np.flatnonzero(inside & (clip_m >= slab.near_m) & (clip_m < slab.far_m))
    at, light, sighted_m = (row[chosen], column[chosen]), sightings.light[chosen], np.full(shape_px, np.inf, np.float32)
    bright = missed[at] | (light >= MOST_OF_LIGHT * lit[at])
    np.minimum.at(sighted_m, tuple(each[bright] for each in at), clip_m[chosen][bright].astype(np.float32))
    return sighted_m
