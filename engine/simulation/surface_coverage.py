"""How much of each pixel's light comes from each surface, through the lens's blur and through depth."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import scipy

from ..image.detail import Detail, merged
from ..image.layers import Layer, LayeredRadiance, Radiance
from ..image.spectral_image import SpectralImage
from ..lens import Lens
from ..lens.iris import Iris
from ..plan.options import Options
from ..runtime.scratch import SAMPLE_BYTES, zeros_stored_like
from .channel_cache import ChannelCache
from .simulate import simulate

TOGETHER_BYTES = 2**28  # of the layers of surfaces that go through the lens together, unless the radiance has more


def surface_coverage(shares: Sequence["scipy.sparse.csr_array"], radiance: SpectralImage, lens: Lens, options: Options,
                     wavelength_nm: float, *, layers: LayeredRadiance | None = None, iris: Iris | None = None,
                     progress: Callable[[float], None] = lambda fraction: None) -> np.ndarray:
    """The fractions of each pixel's possible light that come from surfaces, and from the background.

    Each surface, and the background, is put through the lens as if it alone had a radiance of 1, behind the nearer ones
    and blurred by its depth. The fraction is its light over the light of all, so they add up to 1. Pixels that no light
    can reach have 0.

    Parameters
    ----------
    shares : sequence of sparse arrays (surface + 1, part)
        Of each layer, or of the radiance: the share of its alpha that each surface has, and last the background. The
        parts are pixels, or pixels divided by the same number down and across, row by row.
    radiance : SpectralImage
        The capture.
    lens : Lens
    options : Options
    wavelength_nm : float
    layers : LayeredRadiance, optional
        The capture's layers, if depth matters. Behind the last, there is background.
    iris : Iris, optional
    progress : callable (fraction), optional

    Returns
    -------
    float32 array (surface + 1, row, column)
        Of the frame, from 0 to 1. The last is the background.
    """
    pinhole: Radiance = radiance
    if layers is not None:
        pinhole, shares = _with_background(layers, shares)
    count = shares[0].shape[0]
    plane_bytes = SAMPLE_BYTES * sum(of_layer.shape[1] for of_layer in shares)
    at_once = max(TOGETHER_BYTES // plane_bytes, radiance.wavelengths_nm.size, 2) - 1
    coverage, cache = zeros_stored_like(radiance.light, (count, *radiance.grid.frame_px)), _OneChannel()
    for first in range(0, count, at_once):
        part = slice(first, min(first + at_once, count))
        shining = _shining(pinhole, shares, part, wavelength_nm)
        coverage[part] = simulate(shining, lens, options, iris=iris, cache=cache).cube[1:]
        progress(part.stop / count)
    np.maximum(coverage, 0, out=coverage)  # rounding
    total = coverage.sum(axis=0, dtype=np.float64)
    coverage *= np.divide(1, total, out=np.zeros_like(total), where=total > 0).astype(np.float32)
    return coverage


def _with_background(layers: LayeredRadiance, shares: Sequence["scipy.sparse.csr_array"]
                     ) -> tuple[LayeredRadiance, list["scipy.sparse.csr_array"]]:
    """Layers with a background behind them, and the shares of their surfaces."""
    last, shape_px = layers.layers[-1], layers.grid.shape_px
    if last.alpha.shape == shape_px and last.alpha.min() == 1:
        return layers, [*shares]
    everywhere = np.ones(shape_px, np.float32)
    empty = zeros_stored_like(layers.light, (layers.wavelengths_nm.size, *shape_px))
    background = Layer(empty, everywhere, np.full_like(everywhere, np.inf))
    of_background = scipy.sparse.csr_array((shares[0].shape[0] - 1, everywhere.size), dtype=np.float32)
    of_background = scipy.sparse.vstack([of_background, everywhere.reshape(1, -1)], format="csr")
    return replace(layers, layers=(*layers.layers, background)), [*shares, of_background]


def _shining(radiance: Radiance, shares: Sequence["scipy.sparse.csr_array"], surfaces: slice, wavelength_nm: float
             ) -> Radiance:
    """Radiance of 1, first of everything, then of some of the surfaces. Each of these planes has a wavelength that
    differs from the others by rounding alone, because wavelengths ascend."""
    nm = wavelength_nm * (1 + np.finfo(float).eps * np.arange(surfaces.stop - surfaces.start + 1))
    if isinstance(radiance, SpectralImage):
        everywhere = np.ones(radiance.grid.shape_px, np.float32)
        cube, detail = _planes(shares[0][surfaces], everywhere, nm, radiance.light)
        return replace(radiance, cube=cube, wavelengths_nm=nm, detail=detail)
    of_layers = [(layer, *_planes(each[surfaces], layer.alpha, nm, layer.cube))
                 for layer, each in zip(radiance.layers, shares, strict=True)]
    return replace(radiance, wavelengths_nm=nm, layers=tuple(
        replace(layer, cube=cube, detail=detail) for layer, cube, detail in of_layers))


def _planes(shares, alpha, nm, like):
    """A layer's alpha, and the parts of it that surfaces have, stored like another array; and their Detail."""
    times = math.isqrt(shares.shape[1] // alpha.size)
    in_parts = np.ones((nm.size, *(times * n for n in alpha.shape)), np.float32)
    in_parts[1:] = shares.toarray().reshape(-1, *in_parts.shape[1:])
    planes = zeros_stored_like(like, (nm.size, *alpha.shape))
    np.multiply(merged(in_parts, times), alpha, out=planes)
    return planes, Detail.of(in_parts, nm, times) if times > 1 else None


def _first(radiance: Radiance) -> Radiance:
    """The radiance at its first wavelength."""
    nm = radiance.wavelengths_nm[:1]
    if isinstance(radiance, SpectralImage):
        return replace(radiance, cube=radiance.cube[:1], wavelengths_nm=nm)
    return replace(radiance, wavelengths_nm=nm,
                   layers=tuple(replace(layer, cube=layer.cube[:1]) for layer in radiance.layers))


class _OneChannel(ChannelCache):
    """Lets `simulate` put several pictures of the same wavelength through one channel."""

    def __init__(self):
        super().__init__(limit_mb=0)

    def plan(self, options, lens, radiance, in_place=False):
        return super().plan(options, lens, _first(radiance), in_place)

    def channels(self, lens, sampling, plan, across=1):
        one = replace(sampling, wavelengths_nm=sampling.wavelengths_nm[:1])
        for channel in super().channels(lens, one, plan, across):
            for _ in sampling.wavelengths_nm:
                yield channel
