"""The denoiser of single pictures."""

import numpy as np
import pytest

from lensfield.addon.scene.denoise import denoised, guide_planes
from seed import SEED

LIGHT = np.array([0.9, 0.5, 0.3], np.float32)[:, None, None]
ROWS, COLUMNS = 40, 60
WAYS = np.indices((10 * ROWS, 10 * COLUMNS)) / 10  # in pixels


def disc(row, column, radius_px):
    """The share of each pixel that a disc covers."""
    inside = np.hypot(WAYS[0] - row, WAYS[1] - column) < radius_px
    return inside.reshape(ROWS, 10, COLUMNS, 10).mean(axis=(1, 3)).astype(np.float32)


def cleaned(scene, folder, picture, alpha):
    guides = np.broadcast_to(alpha, (len(guide_planes(scene)), *alpha.shape)).astype(np.float32)
    return denoised(scene, np.float32(picture), np.float32(alpha), guides, folder)


@pytest.mark.parametrize("radius_px", [1.2, 1.7, 6.0])
def test_small_lamps_on_a_transparent_film_keep_their_light(scene, tmp_path, radius_px):
    """The denoiser alone darkens the smallest by 30 %, and lights the pixels around."""
    alpha = disc(13.3, 41.7, radius_px)
    noise = np.random.default_rng(SEED).gamma(400, 1 / 400, (3, ROWS, COLUMNS))
    clean = cleaned(scene, tmp_path, 20 * LIGHT * alpha * noise, alpha)
    five_sigma = 5 / np.sqrt(400 * np.square(alpha.sum()) / np.square(alpha).sum())
    np.testing.assert_allclose(clean.sum(axis=(1, 2)), 20 * LIGHT[:, 0, 0] * alpha.sum(), rtol=0.003 + five_sigma)
    assert not clean[:, alpha == 0].any()


def test_light_that_nothing_covers_is_kept(scene, tmp_path):
    """As of a flame, where alpha is 0."""
    flame = disc(20, 18, 5.0)
    clean = cleaned(scene, tmp_path, LIGHT * flame, np.zeros_like(flame))
    np.testing.assert_allclose(clean.sum(axis=(1, 2)), LIGHT[:, 0, 0] * flame.sum(), rtol=0.05)


def test_black_stays_black(scene, tmp_path):
    nothing = np.zeros((ROWS, COLUMNS), np.float32)
    assert not cleaned(scene, tmp_path, LIGHT * nothing, nothing).any()
