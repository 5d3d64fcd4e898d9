"""How much of each pixel's light comes from the areas of masks: alpha, or objects."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..image.layers import LayeredRadiance
from ..image.spectral_image import SpectralImage
from ..lens import Lens
from ..lens.iris import Iris
from ..plan.options import Options
from ..spectral.colour import REC709_LUMINANCE, rec709_weights
from .channel_cache import ChannelCache
from .simulate import simulate

WAVELENGTHS = 3  # of the capture: blur differs between wavelengths, but a share is a single number

Mask = np.ndarray | Sequence[np.ndarray]


def coverage(masks: Sequence[Mask], radiance: SpectralImage, lens: Lens, options: Options, *,
             layers: LayeredRadiance | None = None, iris: Iris | None = None) -> np.ndarray:
    """The fraction of each pixel's possible light that comes from the areas of masks.

    Masks go through the lens like light, so their edges blur like those of a picture premultiplied by them. A mask of
    1 everywhere has full coverage, however dark the lens's corners are. The result is the luminance-weighted mean of a
    few wavelengths.

    Parameters
    ----------
    masks : sequence of arrays (row, column), or with `layers` of sequences of these
        From 0 to 1, on the pixels of the radiance, or of each layer.
    radiance : SpectralImage
        The capture that they belong to: its grid and wavelengths.
    lens : Lens
    options : Options
    layers : LayeredRadiance, optional
        The capture's layers, if depth matters.
    iris : Iris, optional

    Returns
    -------
    array (mask, row, column)
        Of the frame, from 0 to 1.
    """
    nm, cache = _few(radiance.wavelengths_nm), ChannelCache()
    weights = np.maximum(rec709_weights(nm) @ REC709_LUMINANCE, np.finfo(float).tiny)

    def light(shining):
        return np.tensordot(weights / weights.sum(), simulate(shining, lens, options, iris=iris, cache=cache).cube, 1)

    total = light(SpectralImage(_at_all(np.ones(radiance.grid.shape_px, np.float32), nm), nm, radiance.grid))
    of_masks = [light(_shining(mask, nm, radiance, layers)) for mask in masks]
    return np.array([np.clip(np.divide(each, total, out=np.ones_like(total), where=total > 0), 0, 1)
                     for each in of_masks])


def _few(wavelengths_nm):
    """WAVELENGTHS evenly spaced ones, without the ends."""
    places = np.linspace(0, wavelengths_nm.size - 1, WAVELENGTHS + 2)[1:-1]
    return wavelengths_nm[np.unique(places.round().astype(int))]


def _at_all(plane, nm):
    return np.broadcast_to(plane, (nm.size, *plane.shape))


def _shining(mask, nm, radiance, layers):
    """Radiance of 1 in a mask, at these wavelengths."""
    if layers is None:
        return SpectralImage(_at_all(mask, nm), nm, radiance.grid)
    return replace(layers, wavelengths_nm=nm, layers=[
        replace(layer, cube=_at_all(plane, nm)) for layer, plane in zip(layers.layers, mask, strict=True)])
