"""Layers: their position in the capture, and the pinhole's view of them."""

from dataclasses import replace

import numpy as np
import pytest

from flat_depth import flat_depth_mm
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.runtime.errors import ImageError
from refusals import refused

GRID = PixelGrid((4, 6), 10.0, overscan_px=(1, 1))


def layer(alpha, light, depth_mm, origin_px=(0, 0)):
    alpha = np.asarray(alpha, float)
    return Layer(np.stack([light * alpha, 2 * light * alpha]), alpha, np.full(alpha.shape, depth_mm), origin_px)


def layered(*layers):
    return LayeredRadiance(layers, [500, 600], GRID, 50.0)


def test_a_pinhole_sees_the_nearest_layer_first():
    near = layer([[0, 0.25], [1, 1]], 8.0, 500.0, (1, 2))
    scene = layered(near, layer(np.ones(GRID.shape_px), 4.0, np.inf))
    expected = np.full(GRID.shape_px, 4.0)
    expected[1:3, 2:4] = [[4, 5], [8, 8]]
    assert np.array_equal(scene.flat().cube, np.stack([expected, 2 * expected]).astype(np.float32))
    assert np.array_equal(flat_depth_mm(scene)[1:3, 2:4], [[np.inf, 500], [500, 500]])
    assert np.all(scene.flat_alpha() == 1) and scene.flat().grid == GRID and scene.flat().focal_mm == 50.0
    assert np.array_equal(layered(near).flat_alpha()[1:3, 2:4], near.alpha)


def test_flat_pictures_and_the_sampling_have_the_grid_and_the_pinhole_of_the_layers():
    grid = PixelGrid((5, 8), 7.0, (1.0, 5.5), (1, 2))
    radiance = LayeredRadiance((layer(np.ones(grid.shape_px), 4.0, 900.0),), [500, 600], grid, 50.0, 0.25)
    flat, sampling = radiance.flat(), radiance.sampling
    assert flat.exposure == 0.25 and flat.focal_mm == sampling.grid.focal_mm == 50.0
    for picture in (flat, sampling):
        assert list(picture.wavelengths_nm) == [500, 600]
        assert picture.grid.shape_px == (5, 8) and picture.grid.centre_px == (1.0, 5.5)
        assert picture.grid.pitch_um == 7.0 and picture.grid.overscan_px == (1, 2)


def test_a_cropped_layer_gives_the_same_picture():
    alpha = np.zeros(GRID.shape_px)
    alpha[2, 1:4] = 0.5, 1, 0.5
    full = layer(alpha, 3.0, 700.0)
    cropped = full.cropped()
    assert cropped.alpha.shape == (1, 3) and cropped.origin_px == (2, 1)
    assert np.array_equal(layered(full).flat().cube, layered(cropped).flat().cube)


@pytest.mark.parametrize("margin_px", [(0, 0), (1, 0), (0, 1), (1, 1)])
def test_cropping_the_margin_keeps_the_rest_of_the_picture(margin_px):
    """Including layers that end in it or are completely inside it."""
    places = ((1, 1), (0, 0)), ((1, 6), (3, 0)), ((2, 2), (1, 2)), ((3, 2), (1, 4)), (GRID.shape_px, (0, 0))
    scene = layered(*(layer(np.full(shape_px, 0.5), light, 500.0 * light, origin_px)
                      for light, (shape_px, origin_px) in enumerate(places, 1)))
    rows, columns = (slice(margin, n - margin) for margin, n in zip(margin_px, GRID.shape_px, strict=True))
    cropped = scene.cropped(margin_px)
    assert cropped.grid == GRID.cropped(margin_px)
    assert np.array_equal(cropped.flat().cube, scene.flat().cube[:, rows, columns])
    assert np.array_equal(cropped.flat_alpha(), scene.flat_alpha()[rows, columns])
    assert layer(np.zeros(GRID.shape_px), 3.0, 700.0).cropped().alpha.shape == (1, 1)


def test_other_light_preserves_occlusion():
    scene = layered(layer([[0.5]], 8.0, 500.0, (1, 1)), layer(np.ones(GRID.shape_px), 4.0, np.inf))
    alphas = [np.stack([each.alpha] * 2) for each in scene.layers]
    assert np.allclose(scene.with_light(alphas).flat().cube, 1)


def test_layers_in_finer_columns_are_flat_in_the_pixels_of_the_sensor():
    """A half opaque column in front of a ramp."""
    fine = GRID.finer_across(4)
    alpha = np.zeros(fine.shape_px)
    alpha[:, 9] = 0.5
    ramp = np.broadcast_to(np.arange(24.0), fine.shape_px)
    scene = LayeredRadiance((layer(alpha, 8.0, 500.0), layer(np.ones(fine.shape_px), ramp, np.inf)), [500, 600], fine,
                            50.0)
    visible = ramp.copy()
    visible[:, 9] = (8 + 9) / 2
    expected = visible.reshape(4, 6, 4).mean(axis=-1)
    flat = scene.flat()
    assert flat.grid == GRID and scene.sampling.grid == replace(GRID, focal_mm=50.0)
    np.testing.assert_allclose(flat.cube, np.stack([expected, 2 * expected]), rtol=1e-6)
    assert np.all(scene.flat_alpha() == 1)
    cropped = scene.cropped((1, 1))
    assert cropped.grid == fine.cropped((1, 4))
    np.testing.assert_array_equal(cropped.flat().cube, flat.cropped((1, 1)).cube)


@pytest.mark.parametrize(("layers", "field"), [
    ((), "layers"),
    ((layer(np.ones((4, 6)), 1.0, 1.0, (1, 0)),), "layer 1"),
    ((layer([[1.0]], 1.0, 1.0, (-1, 0)),), "layer 1"),
    ((layer([[1.0]], 1.0, 1.0), Layer(np.ones((1, 1, 1)), np.ones((1, 1)), np.ones((1, 1)))), "layer 2")])
def test_layers_that_do_not_fit_are_refused(layers, field):
    with refused(ImageError, field=field, where="layers"):
        layered(*layers)


def test_planes_that_do_not_fit_are_refused():
    with refused(ImageError, field="planes", where="layer"):
        Layer(np.ones((2, 3, 3)), np.ones((3, 3)), np.ones((3, 2)))
