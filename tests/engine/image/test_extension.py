"""Captures extended by repeating their edges."""

import numpy as np
import pytest

from lensfield.engine.image.extension import extended_image, extended_layers
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.spectral_image import SpectralImage

NM = [450.0, 620.0]
GRID = PixelGrid((5, 8), 7.0, centre_px=(1.5, 4.25), overscan_px=(1, 2))
MARGIN = 2, 3


def ramp(shape_px):
    rows, columns = np.indices(shape_px)
    return np.stack([1 + rows + 10 * columns, 2 + 3 * rows + columns]).astype(np.float32)


def place_of(grid, row, column):
    """A pixel's place on the sensor, from the axis."""
    return (grid.centre_px[0] - row) * grid.pitch_um, (column - grid.centre_px[1]) * grid.pitch_um


def test_pixels_keep_their_place_and_edges_are_repeated():
    image = SpectralImage(ramp(GRID.shape_px), NM, GRID, focal_mm=31.0, exposure=2.0)
    extended = extended_image(image, MARGIN)
    assert extended.cube.shape == (2, 9, 14) and extended.overscan_px == (3, 5) and extended.frame_px == image.frame_px
    assert place_of(extended.grid, 4, 6) == pytest.approx(place_of(GRID, 2, 3))
    np.testing.assert_array_equal(extended.cube[:, 2:-2, 3:-3], image.cube)
    np.testing.assert_array_equal(extended.cube[:, 0], extended.cube[:, 2])
    np.testing.assert_array_equal(extended.cube[..., -1], extended.cube[..., -4])
    assert (extended.focal_mm, extended.exposure) == (31.0, 2.0)


@pytest.mark.parametrize("across", [1, 2])
def test_layers_are_extended_only_where_they_reach_the_edge(across):
    grid = GRID.finer_across(across)
    far = Layer(ramp(grid.shape_px), np.ones(grid.shape_px), np.full(grid.shape_px, np.inf))
    near = Layer(ramp((3, 2)), np.full((3, 2), 0.5), np.full((3, 2), 900.0), (0, 4))  # at the upper edge
    extended = extended_layers(LayeredRadiance((near, far), NM, grid, focal_mm=31.0), MARGIN)
    assert extended.grid.shape_px == (9, across * 14) and extended.grid.on_sensor().overscan_px == (3, 5)
    above, far = extended.layers
    assert far.origin_px == (0, 0) and far.alpha.shape == extended.grid.shape_px
    assert above.origin_px == (0, 4 + 3 * across) and above.alpha.shape == (5, 2)
    np.testing.assert_array_equal(above.cube[:, :2], near.cube[:, :1].repeat(2, axis=1))
    np.testing.assert_array_equal(above.cube[:, 2:], near.cube)
