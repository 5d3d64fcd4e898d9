"""Captures extended beyond their edges by repeating their outermost pixels."""

from dataclasses import replace

import numpy as np

from ..runtime.scratch import zeros_stored_like
from .detail import Detail
from .layers import Layer, LayeredRadiance
from .pixel_grid import PixelGrid
from .spectral_image import SpectralImage


def extended_plane(plane: np.ndarray, margin_px: tuple[int, int]) -> np.ndarray:
    """A plane (row, column) with `margin_px` more rows and columns on each side."""
    return np.pad(plane, [(margin, margin) for margin in margin_px], mode="edge")


def extended_image(image: SpectralImage, margin_px: tuple[int, int]) -> SpectralImage:
    """A spectral image with more overscan: `margin_px` more rows and columns on each side."""
    grid = _with_margin(image.grid, margin_px)
    return replace(image, cube=_extended(image.cube, [(margin, margin) for margin in margin_px]), grid=grid,
                   detail=image.detail and _placed(image.detail, margin_px, grid.shape_px))


def extended_layers(layered: LayeredRadiance, margin_px: tuple[int, int]) -> LayeredRadiance:
    """Layers with more overscan: `margin_px` more rows and columns of the sensor on each side. Those that reach an edge
    of the capture are extended there."""
    margin = margin_px[0], margin_px[1] * layered.grid.across
    return replace(layered, grid=_with_margin(layered.grid, margin),
                   layers=tuple(_extended_layer(layer, layered.grid.shape_px, margin) for layer in layered.layers))


def _extended_layer(layer, capture_px, margin):
    sides = [(more * (place.start == 0), more * (place.stop == n))
             for more, place, n in zip(margin, layer.place, capture_px, strict=True)]
    cube = _extended(layer.cube, sides)
    (top, left), (above, beside) = layer.origin_px, (before for before, _ in sides)
    return Layer(cube, np.pad(layer.alpha, sides, mode="edge"), np.pad(layer.depth_mm, sides, mode="edge"),
                 (top + margin[0] - above, left + margin[1] - beside),
                 layer.detail and _placed(layer.detail, (above, beside), cube.shape[1:]))


def _placed(detail: Detail, origin_px: tuple[int, int], shape_px: tuple[int, int]) -> Detail:
    rows, columns = (slice(first, first + n) for first, n in zip(origin_px, detail.shape_px, strict=True))
    return detail.placed(rows, columns, shape_px)


def _with_margin(grid: PixelGrid, margin_px):
    return grid.with_overscan([own + more for own, more in zip(grid.overscan_px, margin_px, strict=True)])


def _extended(cube, sides):
    """A cube with the edges of its planes repeated, stored where the cube is."""
    shape = tuple(n + sum(side) for n, side in zip(cube.shape[1:], sides, strict=True))
    extended = zeros_stored_like(cube, (len(cube), *shape))
    for plane, source in zip(extended, cube, strict=True):
        plane[:] = np.pad(source, sides, mode="edge")
    return extended
