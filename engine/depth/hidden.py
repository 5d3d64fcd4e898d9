"""Estimate hidden surfaces: convert a picture in slabs of depth to layers that continue behind nearer layers."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np
import scipy

from ..image.layers import Layer, LayeredRadiance, covered
from ..image.spectral_image import SpectralImage

VISIBLE_SHARE = 1e-3  # share of a layer that is visible through nearer layers; less counts as hidden
BRIGHT = 4.0  # times the median of a picture's light; brighter pixels count less
NEIGHBOURS = np.ones((3, 3), bool)


def layers_of_picture(radiance: SpectralImage, depth_mm: np.ndarray, slab: np.ndarray, slabs: int) -> LayeredRadiance:
    """Convert a picture with each pixel in one slab to layers.

    Parameters
    ----------
    radiance : SpectralImage
    depth_mm : array (row, column)
        Along the axis; inf for infinite distance.
    slab : int array (row, column)
        Index of each pixel's slab; 0 is the nearest.
    slabs : int

    Returns
    -------
    LayeredRadiance
        Its `flat()` is the picture.
    """
    masks = [slab == number for number in range(slabs)]
    return with_hidden(radiance, [each.astype(np.float32) for each in masks],
                       [np.where(each, depth_mm, np.inf) for each in masks],
                       lambda number: (plane * masks[number] for plane in radiance.cube))


def with_hidden(radiance: SpectralImage, alphas: Sequence[np.ndarray], depths_mm: Sequence[np.ndarray],
                light: Callable[[int], Iterable[np.ndarray]]) -> LayeredRadiance:
    """Layers that continue behind nearer layers, like the visible area around these if most of it is in the layer.

    The last layer is opaque, and infinitely far away where it is empty.

    Parameters
    ----------
    radiance : SpectralImage
        Radiance of all layers together, as a pinhole sees them.
    alphas, depths_mm : sequence of array (row, column)
        Alpha and depth of each layer, near to far.
    light : callable (number of the layer)
        Returns the layer's radiance, premultiplied, as a plane (row, column) for each wavelength.
    """
    usual = _usual_light(radiance)
    layers: list[Layer] = []
    clear = np.ones(radiance.grid.shape_px, np.float32)  # share that nearer layers do not cover
    for number, (alpha, depth_mm) in enumerate(zip(alphas, depths_mm, strict=True)):
        hidden = (clear <= VISIBLE_SHARE) & ~np.any([farther > 0 for farther in alphas[number:]], axis=0)
        if number == len(alphas) - 1:
            depth_mm = np.where(alpha > 0, depth_mm, np.inf)
            alpha = np.ones_like(alpha)
        layers.append(_continued(light(number), alpha, depth_mm, hidden, usual, radiance.detail))
        clear *= 1 - alphas[number]
    return LayeredRadiance(tuple(layers), radiance.wavelengths_nm, radiance.grid, radiance.focal_mm, radiance.exposure,
                           radiance.arbitrary)


def _usual_light(radiance):
    """Factor on each pixel's light for filling other pixels, to avoid enlarging a lamp at the edge of a near object."""
    light = sum(_finite(plane) for plane in radiance.cube) / np.float32(len(radiance.cube))
    usual = BRIGHT * np.median(light[light > 0]) if np.any(light > 0) else np.inf
    return np.divide(usual, light, out=np.ones_like(light), where=light > usual)


def _finite(plane):
    """A plane without fireflies, which are not copied to other pixels."""
    return np.nan_to_num(plane, posinf=0.0, neginf=0.0)


def _continued(light, alpha, depth_mm, hidden, usual, detail):
    """A layer that continues where it is hidden, cropped to the covered area."""
    dilated = scipy.ndimage.binary_dilation(hidden, NEIGHBOURS)  # colours at its edge are mixed with the nearer layer's
    weight = np.where(hidden if dilated.all() else dilated, 0, usual)
    into = hidden & bool(weight.any())
    if into.any():
        share = filled(alpha, weight)
        into &= share >= 0.5
        nearness = filled(alpha / depth_mm, weight)[into]
        alpha, depth_mm = np.where(into, 1, alpha), depth_mm.astype(np.float32)
        with np.errstate(divide="ignore"):
            depth_mm[into] = share[into] / nearness
    rows, columns = covered(alpha)
    if into.any():
        divisor = np.where(into, share, 1)
        light = (np.where(into, filled(_finite(plane) * usual, weight) / divisor, plane) for plane in light)
    planes = [plane[rows, columns] for plane in light]
    return Layer(np.array(planes), alpha[rows, columns].copy(), depth_mm[rows, columns].copy(),
                 (rows.start, columns.start), detail and detail.even_in(into).within(rows, columns))


def filled(plane: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Fill pixels of weight 0 in a plane (row, column) with weighted means of pixels nearby; weights are 0 to 1.

    Where all pixels nearby have weight 0, the plane is halved until one has not; the result is enlarged smoothly.
    """
    weight = weight.astype(np.float32)
    return _filled(plane * weight, weight)


def _filled(weighted, weight):
    if weight.size == 1:
        return weighted / np.maximum(weight, np.finfo(np.float32).tiny)
    if np.all(weight == 1):
        return weighted
    total = _halved(weight)
    share = np.minimum(total, 1)
    coarse = _filled(_halved(weighted) * np.divide(share, total, out=np.zeros_like(total), where=total > 0), share)
    rows, columns = weighted.shape
    return weighted + _doubled(_doubled(coarse).T).T[:rows, :columns] * (1 - weight)


def _halved(plane):
    """Sums over 2 x 2 pixels."""
    plane = np.pad(plane, [(0, n % 2) for n in plane.shape])
    return plane[::2, ::2] + plane[::2, 1::2] + plane[1::2, ::2] + plane[1::2, 1::2]


def _doubled(plane):
    """Two rows for each: three quarters of the row and a quarter of its neighbour."""
    wide = np.pad(plane, [(1, 1), (0, 0)], mode="edge")
    centre = np.float32(0.75) * plane
    return np.stack([centre + np.float32(0.25) * wide[:-2], centre + np.float32(0.25) * wide[2:]], axis=1).reshape(
        -1, plane.shape[1])
