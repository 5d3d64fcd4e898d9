"""What the pinhole sees of a picture's light: flat, or in layers with their depths."""

from collections.abc import Callable

import numpy as np

from ..image.layers import LayeredRadiance, Radiance
from ..image.nonfinite import clamp_fireflies
from ..image.spectral_image import SpectralImage


def layers_within(layers: LayeredRadiance, radiance: SpectralImage) -> LayeredRadiance:
    """The layers on a radiance's grid, in their own columns. Their grid may extend beyond it."""
    above, left = (more - n for more, n in zip(layers.sampling.grid.overscan_px, radiance.overscan_px, strict=True))
    return layers.cropped((above, left))


def composed(radiance: Radiance, light_of: Callable) -> np.ndarray:
    """What the pinhole sees of all layers' light in the sensor's pixels, with NaN and infinite pixels replaced.

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
    return radiance.on_sensor(radiance.composite(lambda layer: clamp_fireflies(light_of(
        layer.cube, np.where(layer.alpha > 0, layer.depth_mm, np.inf)))[0], np.float64))
