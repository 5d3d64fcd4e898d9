"""Layers: the light of all slabs, combined into one layered radiance."""

import numpy as np
import scipy

from lensfield.engine.depth.depth_range import blur_per_nearness_px, planar_depth_mm
from lensfield.engine.image.layers import Layer, LayeredRadiance

from ..scene.units import M_TO_MM

SEAM_PX = 2.0  # blur difference up to which the two sides of a border count as one surface


def layered_radiance(lights, lens, capture, wavelengths_nm, exposure, others=()):
    """The layers of the gathered light, one for each slab.

    If a border cuts a surface, each of the two slabs covers a part of a pixel there. These parts are side by side,
    unlike layers whose coverage is independent. So the farther layer is scaled to cover all that the nearer one leaves
    open, and is extended by a pixel behind it.

    Parameters
    ----------
    lights : sequence of GatheredLight
        From near to far, with the depth of all of their content.
    lens : Lens
    capture : PixelGrid
    wavelengths_nm : array
    exposure : float
    others : sequence of Lens
        The lens at other settings, for the same layers.

    Returns
    -------
    LayeredRadiance
    """
    parts = [_Part(light) for light in lights]
    seam_per_mm = SEAM_PX / max(blur_per_nearness_px(one, capture.pitch_um) for one in (lens, *others))
    for near, far in zip(parts[:-1], parts[1:], strict=True):
        if near.slab.far_m >= far.slab.near_m:
            _close_seam(near, far, seam_per_mm)
    return LayeredRadiance([part.layer(lens, capture) for part in parts], wavelengths_nm, capture,
                           lens.capture_focal_length_mm, exposure)


class _Part:
    """A layer under construction.

    Attributes
    ----------
    slab : Slab
    cube, alpha : arrays, modified in place
    detail : Detail or None
    clip_mm : array (row, column)
        Depths as the camera clips; known at every pixel with content.
    """

    def __init__(self, light):
        self.slab, self.cube, self.alpha, self.detail = light.slab, light.radiance(), light.alpha, light.detail
        self.clip_mm = light.depth_m * np.float32(M_TO_MM)

    def layer(self, lens, capture):
        """The finished Layer."""
        limit_mm = np.full(capture.shape_px, np.inf, np.float32)
        limit_mm[self.slab.region] = self.clip_mm
        depth_mm = planar_depth_mm(limit_mm, lens, capture)[self.slab.region]
        depth_mm = np.where(np.isnan(depth_mm), self.clip_mm, depth_mm)  # NaN: a fisheye that sees sideways and back
        return Layer(self.cube, self.alpha, depth_mm, tuple(side.start for side in self.slab.region), self.detail)


def _close_seam(near, far, seam_per_mm):
    """Extend the farther of two slabs behind the nearer, where the border between them cuts a surface."""
    common = [(max(one.start, other.start), min(one.stop, other.stop))
              for one, other in zip(near.slab.region, far.slab.region, strict=True)]
    if any(start >= stop for start, stop in common):
        return
    (near_alpha, near_mm), (alpha, clip_mm, cube) = (
        [plane[(..., *(slice(start - side.start, stop - side.start)
                       for (start, stop), side in zip(common, part.slab.region, strict=True)))] for plane in planes]
        for part, planes in ((near, (near.alpha, near.clip_mm)), (far, (far.alpha, far.clip_mm, far.cube))))
    border_mm = far.slab.near_m * M_TO_MM
    at_near, at_far = ((covered > 0) & (np.abs(1 / depth_mm - 1 / border_mm) < seam_per_mm)
                       for covered, depth_mm in ((near_alpha, near_mm), (alpha, clip_mm)))
    side_by_side = at_near & at_far & (near_alpha < 1)
    more = 1 / np.maximum(1 - near_alpha[side_by_side], alpha[side_by_side])
    alpha[side_by_side] *= more
    cube[:, side_by_side] *= more
    next_to_far = scipy.ndimage.binary_dilation(at_far, np.ones((3, 3)))
    rows, columns = np.nonzero(at_near & (near_alpha == 1) & (alpha == 0) & next_to_far)
    places = [(np.clip(rows + down, 0, alpha.shape[0] - 1), np.clip(columns + across, 0, alpha.shape[1] - 1))
              for down in (-1, 0, 1) for across in (-1, 0, 1)]
    weights = np.array([at_far[place] for place in places], np.float32)
    weights /= weights.sum(axis=0)
    behind = [sum(weight * plane[(..., *place)] for weight, place in zip(weights, places, strict=True))
              for plane in (alpha, clip_mm, cube)]
    for plane, value in zip((alpha, clip_mm, cube), behind, strict=True):
        plane[..., rows, columns] = value
