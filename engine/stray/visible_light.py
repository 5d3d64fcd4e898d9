"""What the pinhole sees of a picture's light: flat, or in layers with their depths."""

from collections.abc import Callable

import numpy as np

from ..image.layers import LayeredRadiance, Radiance
from ..image.nonfinite import clamp_fireflies
from ..image.spectral_image import SpectralImage


def layers_within(layers: LayeredRadiance, radiance: SpectralImage) -> LayeredRadiance:
    """The layers on a radiance's grid. Their own may extend beyond it."""
    above, left = (more - n for more, n in zip(layers.grid.overscan_px, radiance.overscan_px, strict=True))
    return layers.cropped((above, left))


def composed(radiance: Radiance, light_of: Callable) -> np.ndarray:
    """What the pinhole sees of all layers' light, with NaN and infinite pixels replaced.

    Parameters
    ----------
    radiance : SpectralImage or LayeredRadiance
    light_of : callable (cube, depth_mm) -> array (row, column)
        A linear function of a cube. The depths of a flat picture are infinite.

    Returns
    -------
    array (row, column)
    """
    if isinstance(radiance, SpectralImage):
        return clamp_fireflies(light_of(radiance.cube, np.inf))[0]
    plane = np.zeros(radiance.grid.shape_px)
    for layer in reversed(radiance.layers):
        part = plane[layer.place]
        part *= 1 - layer.alpha
        depth_mm = np.where(layer.alpha > 0, layer.depth_mm, np.inf)
        part += clamp_fireflies(light_of(layer.cube, depth_mm))[0]
    return plane
