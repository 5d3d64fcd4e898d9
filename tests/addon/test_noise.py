"""The measure of noise, against renders of the same picture with other seeds."""

import numpy as np
import pytest
from scipy.special import chdtri, ndtr

from cycles_pictures import picture
from noise import SIGMAS, assert_means, five_sigma
from small_scenes import material, set_world, wall

SEEDS = 64


@pytest.fixture
def half_a_sky(scene):
    """A white wall in front of a sky, half covered by a black screen behind the camera: paths reach each at random."""
    set_world(scene)
    wall(scene, material("White", "ShaderNodeBsdfDiffuse", (1, 1, 1))[0])
    wall(scene, material("Black", "ShaderNodeBsdfDiffuse", (0, 0, 0))[0], -1.0, 100.0).location.x = 50
    scene.camera.data.angle = 0.05  # all pixels are the same
    return scene


def test_pixel_variance_predicts_how_means_differ_between_seeds(half_a_sky, tmp_path):
    first = half_a_sky.cycles.seed
    means, by_pixels = [], []
    for half_a_sky.cycles.seed in range(first, first + SEEDS):
        red = picture(half_a_sky, tmp_path, samples=8)[0].astype(float)
        means.append(red.mean())
        by_pixels.append(red.var(ddof=1) / red.size)
    ratio = np.var(means, ddof=1) / np.mean(by_pixels)
    least, most = chdtri(SEEDS - 1, ndtr([SIGMAS, -SIGMAS])) / (SEEDS - 1)
    assert least < ratio < most


def test_an_error_above_the_noise_is_detected(half_a_sky, tmp_path):
    red = picture(half_a_sky, tmp_path, samples=256)[0].astype(float)
    noise = five_sigma(red)
    assert 0 < noise < 0.1 * red.mean()
    assert_means(red, red.mean() + 0.9 * noise, 0.0, noise=0.1)
    assert_means(red, 1.01 * red.mean(), 0.02, noise=0.1)
    with pytest.raises(AssertionError, match="off by"):
        assert_means(red, red.mean() + 1.1 * noise, 0.0, noise=0.1)
    with pytest.raises(AssertionError, match="5 sigma of noise"):
        assert_means(red, red.mean(), 1e-6)
