"""Folding onto a quadrant: the picture comes back, and the blur is that of the whole plane."""

import numpy as np
import pytest
from lenses import gaussian_psf, make_lens, marked_psf
from lensfield.engine import Options, SpectralImage, simulate
from lensfield.engine.folding import fold, mirror_symmetric, unfold

SHAPES = [(1, 1), (4, 6), (5, 6), (4, 7), (5, 7), (1, 4)]


def test_quadrants_have_the_axis_at_their_upper_left():
    plane = np.arange(16.0).reshape(4, 4)
    lower_right, upper_right, lower_left, upper_left = fold(plane)
    assert lower_right.tolist() == [[10, 11], [14, 15]]
    assert upper_right.tolist() == [[6, 7], [2, 3]]
    assert lower_left.tolist() == [[9, 8], [13, 12]]
    assert upper_left.tolist() == [[5, 4], [1, 0]]


def test_a_middle_line_is_folded_once():
    assert fold(np.ones((3, 3))).sum() == 9


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("radius", [0, 2])
def test_unfolding_gives_the_plane_back(shape, radius):
    plane = np.random.default_rng(2).random(shape)
    canvases = np.pad(fold(plane), ((0, 0), (radius, radius), (radius, radius)))
    np.testing.assert_array_equal(unfold(canvases, shape, radius), np.pad(plane, radius))


@pytest.mark.parametrize("window", [8, 9])
def test_a_lopsided_psf_is_left_alone(window):
    table = marked_psf(1, 2, window)[None]
    same, symmetric = mirror_symmetric(table)
    assert not symmetric and same is table


def test_noise_is_averaged_away():
    table = gaussian_psf(3, 2, 1.0, 16)[None]
    noisy = table + 1e-6 * np.random.default_rng(0).random(table.shape)
    mended, symmetric = mirror_symmetric(noisy)
    assert symmetric and mended.shape == (1, 17, 17)
    np.testing.assert_array_equal(mended, mended[..., ::-1])
    assert mended.sum() == pytest.approx(noisy.sum(), rel=1e-12)


@pytest.mark.parametrize("shape", [(40, 60), (41, 60), (40, 61), (41, 61)])
def test_folded_sections_are_the_exact_operator_when_they_are_single_pixels(shape):
    """Coma grows with the field, so that a quadrant flipped the wrong way would show."""
    table = np.stack([0.5 * gaussian_psf(4, 2 + h, 2.5, 25) + 0.5 * np.roll(gaussian_psf(2, 2, 2.5, 25), h, axis=0)
                      for h in range(6)])
    lens = make_lens(np.stack([table, table]), lambda nm, p: p * (1 - 0.02 * p), heights_mm=np.linspace(0, 2, 6))
    radiance = SpectralImage(np.random.default_rng(5).random((1, *shape)), [550], pitch_um=30.0)
    exact = simulate(radiance, lens, Options(method="exact")).cube
    np.testing.assert_allclose(simulate(radiance, lens, Options(1, 1)).cube, exact, rtol=2e-6)
    for options in (Options(8, 2), Options(16, 3)):
        np.testing.assert_allclose(simulate(radiance, lens, options).cube, exact, rtol=0.03)


def test_an_axis_off_the_middle_is_not_folded():
    lens = make_lens(gaussian_psf(4, 4, 2.5, 25))
    cube = np.random.default_rng(5).random((1, 30, 40))
    radiance = SpectralImage(cube, [550], pitch_um=30.0, centre_px=(10.0, 30.0))
    exact = simulate(radiance, lens, Options(method="exact")).cube
    np.testing.assert_allclose(simulate(radiance, lens, Options(8, 2)).cube, exact, atol=1e-3 * exact.max())
