"""Jumps in depth within a layer: a layer with surfaces at several depths becomes several layers.

Rays find where they meet a layer from its nearest depth. Among surfaces at three or more depths, they miss some
of the small ones in the middle, with all of their light.
"""

from dataclasses import replace

import numpy as np
import scipy

from ..image.layers import Layer, LayeredRadiance, Radiance, covered
from ..lens import Lens
from ..runtime.scratch import zeros_stored_like
from .depth_range import blur_per_nearness_px
from .slabs import MOST_SLABS, borders_at_jumps

CONTRAST = 0.5  # between two surfaces, relative to the brighter one, from which mixed pixels at their edge are divided
AROUND = np.ones((3, 3), bool)


def without_jumps(radiance: Radiance, lens: Lens, accuracy: float) -> Radiance:
    """Layered radiance whose layers are divided at jumps in depth, if these matter for the accuracy. The pinhole's view
    of it stays the same. Flat radiance is returned as it is.

    Parameters
    ----------
    radiance : Radiance
    lens : Lens
        Its blur determines which jumps matter.
    accuracy : float
        As in `Options`.
    """
    if not isinstance(radiance, LayeredRadiance):
        return radiance
    room, layers = MOST_SLABS - len(radiance.layers), []
    for layer in radiance.layers:
        parts = _parts(layer, blur_per_nearness_px(lens, radiance.grid.pitch_um), room + 1, accuracy)
        room -= len(parts) - 1
        layers += parts
    return radiance if len(layers) == len(radiance.layers) else replace(radiance, layers=tuple(layers))


def _parts(layer, per_nearness_px, most, accuracy):
    """The layers, near to far, that a layer is divided into: at least one."""
    known = layer.alpha > 0
    if most < 2 or not known.any():
        return [layer]
    place = np.divide(per_nearness_px, layer.depth_mm, out=np.full(known.shape, np.nan), where=known)
    light = np.mean([layer.cube[n] for n in (0, len(layer.cube) // 2, -1)], axis=0, dtype=np.float64)
    light = np.nan_to_num(light, posinf=0.0)
    borders = borders_at_jumps(place, np.maximum(light, 0), most, accuracy)
    if not borders:
        return [layer]
    cube = zeros_stored_like(layer.cube, layer.cube.shape)
    cube[:] = layer.cube
    rest, parts = replace(layer, cube=cube, alpha=layer.alpha.copy(), depth_mm=layer.depth_mm.copy()), []
    for border in borders:
        nearness_px = np.divide(per_nearness_px, rest.depth_mm, out=np.zeros(known.shape), where=rest.alpha > 0)
        near = nearness_px > border
        if near.any():
            part, rest = _nearest(rest, near)
            parts.append(part)
    return [*parts, rest]


def _nearest(layer, near):
    """The nearest part of a layer, some of its pixels, and the rest of it, which changes in place: it continues behind
    the part, like its closest pixels that do not touch the part."""
    rim = scipy.ndimage.binary_dilation(near, AROUND) & ~near & (layer.alpha > 0)
    beyond = (layer.alpha > 0) & ~near & ~rim
    rows, columns = covered(near | rim)
    part = Layer(layer.cube[:, rows, columns] * near[rows, columns], layer.alpha[rows, columns] * near[rows, columns],
                 layer.depth_mm[rows, columns].copy(), (layer.origin_px[0] + rows.start,
                                                        layer.origin_px[1] + columns.start),
                 layer.detail and layer.detail.within(rows, columns))
    if not beyond.any():
        layer.cube[:, near], layer.alpha[near] = 0, 0
        return part, layer
    closest = _closest(beyond)
    _divide_rim(layer, part, (rows, columns), rim, near, closest)
    of, hidden = tuple(closest[:, near]), layer.alpha[near] == 1
    for plane in (*layer.cube, layer.alpha):
        plane[near] = plane[of] * hidden
    layer.depth_mm[near] = layer.depth_mm[of]
    return part, replace(layer, detail=layer.detail and layer.detail.even_in(near))


def _closest(pixels):
    """Row and column of the closest of some pixels: int array (2, row, column)."""
    return scipy.ndimage.distance_transform_edt(~pixels, return_distances=False, return_indices=True)


def _divide_rim(layer, part, region, rim, near, beyond):
    """Divide the light of opaque pixels at the edge between the nearest part and the surface beyond, if one
    is much brighter."""
    rows, columns = region
    at = np.nonzero(rim)
    inside = at[0] - rows.start, at[1] - columns.start
    of_near, of_beyond = tuple(_closest(near)[:, *at]), tuple(beyond[:, *at])
    here, bright, dark = (layer.cube[:, *pixels].mean(axis=0, dtype=np.float64) for pixels in (at, of_near, of_beyond))
    apart = np.abs(bright - dark) > CONTRAST * np.maximum(np.abs(bright), np.abs(dark))
    apart &= (layer.alpha[at] == 1) & (layer.alpha[of_beyond] == 1)
    share = np.divide(here - dark, bright - dark, out=np.zeros_like(here), where=apart)
    share = np.clip(np.nan_to_num(share), 0, 1).astype(np.float32)
    part.alpha[inside] = share
    part.depth_mm[inside] = layer.depth_mm[of_near]
    divided = share > 0
    for of_part, plane in zip(part.cube, layer.cube, strict=True):
        rest = np.where(divided, plane[of_beyond], plane[at])
        of_part[inside] = np.where(divided, plane[at] - (1 - share) * rest, 0)
        plane[at] = rest
