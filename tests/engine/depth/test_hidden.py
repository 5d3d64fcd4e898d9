"""Layers of a picture: visible areas stay unchanged, and hidden areas continue their surroundings."""

import numpy as np
import pytest

from flat_depth import flat_depth_mm
from lensfield.engine.depth.hidden import filled, layers_of_picture
from lensfield.engine.image.spectral_image import SpectralImage
from lensfield.engine.image.supersampling import split_pixels

NM = (450.0, 550.0, 650.0)


def radiance_of(cube):
    return SpectralImage(cube, NM[:len(cube)], pitch_um=10.0, overscan_px=(1, 2), focal_mm=50.0, exposure=2.0)


def random_picture(seed, shape=(23, 34), slabs=4):
    """Light, depth and slabs of overlapping blobs."""
    random = np.random.default_rng(seed)
    rows, columns = np.indices(shape)
    slab = np.full(shape, slabs - 1)
    for _ in range(8):
        row, column, radius, nearer = random.integers((2, 2, 2, 0), (*shape, 8, slabs))
        slab[(rows - row)**2 + (columns - column)**2 < radius**2] = nearer
    depth_mm = np.array([500.0, 900.0, 2000.0, np.inf])[slab] * random.uniform(1, 1.1, shape)
    return radiance_of(random.uniform(0.1, 1, (3, *shape)).astype(np.float32)), depth_mm, slab


def full_plane(layer, grid, what):
    """A plane of a layer, on the full picture."""
    plane = np.zeros(grid.shape_px)
    plane[layer.place] = what(layer)
    return plane


@pytest.mark.parametrize("seed", range(4))
def test_composited_layers_equal_the_picture(seed):
    radiance, depth_mm, slab = random_picture(seed)
    layered = layers_of_picture(radiance, depth_mm, slab, 4)
    flat = layered.flat()
    np.testing.assert_array_equal(flat.cube, radiance.cube)
    np.testing.assert_array_equal(flat_depth_mm(layered), depth_mm.astype(np.float32))
    assert flat.grid == radiance.grid and (flat.focal_mm, flat.exposure) == (50, 2)


@pytest.mark.parametrize("seed", range(4))
def test_the_last_layer_has_no_holes_and_depths_stay_in_their_slabs(seed):
    radiance, depth_mm, slab = random_picture(seed)
    layered = layers_of_picture(radiance, depth_mm, slab, 4)
    assert np.all(layered.layers[-1].alpha == 1) and layered.layers[-1].alpha.shape == slab.shape
    for number, layer in enumerate(layered.layers[:-1]):
        visible_mm, covered = depth_mm[slab == number], layer.alpha > 0
        if visible_mm.size:
            assert np.all(np.isin(layer.alpha, (0, 1)))
            assert layer.depth_mm[covered].min() >= visible_mm.min() * 0.999
            assert layer.depth_mm[covered].max() <= visible_mm.max() * 1.001
        else:
            assert not covered.any()


def test_a_layer_does_not_extend_over_visible_farther_pixels():
    radiance, depth_mm, slab = random_picture(2)
    for number, layer in enumerate(layers_of_picture(radiance, depth_mm, slab, 4).layers):
        alpha = full_plane(layer, radiance.grid, lambda each: each.alpha)
        assert not alpha[slab > number].any() and np.all(alpha[slab == number] == 1)


def card_before(background_depth_mm, light, size=8):
    """A black card at 500 mm in the middle of a background, in 3 slabs: up to 1 m, up to 5 m, and beyond."""
    depth_mm = np.broadcast_to(background_depth_mm, (40, 60)).astype(float).copy()
    cube = np.broadcast_to(light, (2, 40, 60)).astype(np.float32).copy()
    card = np.zeros((40, 60), bool)
    card[20 - size:20 + size, 30 - size:30 + size] = True
    depth_mm[card], cube[:, card] = 500, 0
    slab = np.searchsorted([1000, 5000], depth_mm)
    return layers_of_picture(radiance_of(cube), depth_mm, slab, 3), card


def test_a_wall_continues_behind_a_card_with_its_brightness_and_depth():
    layered, card = card_before(3000.0, np.reshape([0.25, 0.75], (2, 1, 1)))
    wall = layered.layers[1]
    assert np.all(wall.alpha == 1)
    np.testing.assert_allclose(wall.depth_mm, 3000, rtol=1e-5)
    np.testing.assert_allclose(wall.cube[:, card], np.repeat([[0.25], [0.75]], card.sum(), axis=1), rtol=1e-5)


def test_two_layers_behind_a_card_meet_halfway():
    """A wall at 3 m on the left, the world on the right: they meet near the middle of the card."""
    layered, card = card_before(np.where(np.arange(60) < 30, 3000.0, np.inf), 1.0)
    wall = full_plane(layered.layers[1], layered.grid, lambda each: each.alpha)
    behind = wall[20, 22:38]
    assert np.all(behind[:7] == 1) and np.all(behind[9:] == 0)
    assert np.all(layered.layers[2].depth_mm[:, 32:] == np.inf)


def test_a_slanted_floor_continues_at_its_slant():
    """The nearest edges of the card have the most weight, so the floor's depth rises from one edge to the other."""
    nearness = np.linspace(1 / 1200, 1 / 4000, 40)[:, None]
    layered, card = card_before(1 / nearness, 1.0)
    floor = 1 / layered.layers[1].depth_mm[:, 30]
    assert np.all(np.diff(floor[12:28]) < 0)
    np.testing.assert_allclose(floor[[12, 27]], nearness[[12, 27], 0], rtol=0.05)


def test_a_lamp_next_to_a_card_does_not_fill_the_hidden_area():
    light = np.ones((40, 60))
    light[18:22, 39:41] = 1000
    layered, card = card_before(3000.0, light)
    assert layered.layers[1].cube[:, card].max() < 10
    np.testing.assert_array_equal(layered.flat().cube[0, 20, 39], 1000)


def test_mixed_colours_at_an_edge_are_ignored():
    light = np.ones((40, 60))
    light[11:29, 21:39] = 0.3  # a margin of a pixel around the card
    layered, card = card_before(3000.0, light)
    np.testing.assert_allclose(layered.layers[1].cube[:, card], 1, rtol=1e-5)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 3)])
@pytest.mark.parametrize("number", [0, 1, 2])
def test_tiny_pictures_and_empty_slabs_are_supported(shape, number):
    radiance = SpectralImage(np.ones((1, *shape)), [550.0], pitch_um=10.0)
    depth_mm = np.full(shape, 700.0)
    layered = layers_of_picture(radiance, depth_mm, np.full(shape, number), 3)
    np.testing.assert_array_equal(layered.flat().cube, radiance.cube)
    assert np.all(layered.layers[-1].alpha == 1)
    np.testing.assert_array_equal(flat_depth_mm(layered), np.float32(depth_mm))


def test_a_black_picture_stays_black():
    radiance, depth_mm, slab = random_picture(1)
    layered = layers_of_picture(radiance_of(0 * radiance.cube), depth_mm, slab, 4)
    assert not layered.flat().cube.any()


@pytest.mark.parametrize("shape", [(1, 1), (1, 17), (16, 16), (33, 7)])
def test_filling_preserves_known_pixels_and_even_planes(shape):
    random = np.random.default_rng(1)
    plane, weight = random.uniform(1, 2, shape).astype(np.float32), random.integers(0, 2, shape)
    weight.flat[0] = 1
    full = filled(plane, weight)
    np.testing.assert_array_equal(full[weight == 1], plane[weight == 1])
    assert full.min() >= plane[weight == 1].min() * 0.99999 and full.max() <= plane[weight == 1].max() * 1.00001
    np.testing.assert_allclose(filled(np.full(shape, 3.0, np.float32), weight), 3, rtol=1e-5)


def test_filling_averages_by_weight():
    """One pixel with weight 1 and three with weight 1/3 around an unknown pixel."""
    plane = np.array([[1, 2], [2, 0]], np.float32)
    assert filled(plane, np.array([[1, 1 / 3], [1 / 3, 0]]))[1, 1] == pytest.approx((1 + 4 / 3) / (5 / 3))


def test_layers_have_the_detail_of_their_picture_where_it_is_visible():
    """A card in front of a wall, off-centre; the wall continues behind the card without the card's detail."""
    shape, times = (14, 19), 2
    slab = np.ones(shape, int)
    slab[3:8, 5:12] = 0
    fine = np.random.default_rng(3).gamma(2, 1, (1, *(times * n for n in shape))).astype(np.float32)
    picture = SpectralImage(fine, [550.0], pitch_um=2.0).coarser(times)
    card, wall = layers_of_picture(picture, np.where(slab == 0, 500.0, 4000.0), slab, 2).layers
    assert card.origin_px == (3, 5) and wall.origin_px == (0, 0)
    np.testing.assert_array_equal(card.detail.shares, picture.detail.shares[:, 6:16, 10:24])
    hidden = split_pixels(slab == 0, times)
    np.testing.assert_array_equal(wall.detail.shares[0][~hidden], picture.detail.shares[0][~hidden])
    assert np.all(wall.detail.shares[0][hidden] == 1)
