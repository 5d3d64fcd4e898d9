"""Folding onto a quadrant: the picture comes back, and the blur is that of the whole plane."""

import numpy as np
import pytest

from lenses import comatic_lens, gaussian_psf, lopsided_lens, make_lens, marked_psf
from lensfield.engine import Options, Report, SpectralImage, simulate
from lensfield.engine.field.mirror_symmetry import mirror_symmetric, quadrants, unfold, without_doubles

SHAPES = [(1, 1), (4, 6), (5, 6), (4, 7), (5, 7), (1, 4)]


def fold(plane):
    return without_doubles(quadrants(plane), plane.shape)


def test_quadrants_have_the_axis_at_their_upper_left():
    plane = np.arange(16.0).reshape(4, 4)
    lower_right, upper_right, lower_left, upper_left = fold(plane)
    assert lower_right.tolist() == [[10, 11], [14, 15]]
    assert upper_right.tolist() == [[6, 7], [2, 3]]
    assert lower_left.tolist() == [[9, 8], [13, 12]]
    assert upper_left.tolist() == [[5, 4], [1, 0]]


def test_a_middle_line_is_folded_once():
    assert fold(np.ones((3, 3))).sum() == 9


def test_a_middle_line_is_in_both_its_quadrants_until_doubles_are_taken_out():
    plane = np.arange(9.0).reshape(3, 3)
    assert [part.tolist() for part in quadrants(plane)] == [
        [[4, 5], [7, 8]], [[4, 5], [1, 2]], [[4, 3], [7, 6]], [[4, 3], [1, 0]]]
    assert [part.tolist() for part in fold(plane)] == [
        [[4, 5], [7, 8]], [[0, 0], [1, 2]], [[0, 3], [0, 6]], [[0, 0], [0, 0]]]


@pytest.mark.parametrize("shape", [(6, 8), (7, 8), (6, 9), (7, 9)])
def test_an_overlap_is_what_lies_beyond_the_axis(shape):
    plane = np.random.default_rng(1).random(shape)
    own, wide = quadrants(plane), quadrants(plane, 2)
    np.testing.assert_array_equal(wide[:, 2:, 2:], own)
    # Beyond the upper edge of the lower right quadrant lies the upper right one, upside down; middle lines but once.
    rows, columns = (n % 2 for n in shape)
    np.testing.assert_array_equal(wide[0, 1::-1, 2:], own[1, rows:2 + rows])
    np.testing.assert_array_equal(wide[0, 2:, 1::-1], own[2, :, columns:2 + columns])
    np.testing.assert_array_equal(wide[0, 1::-1, 1::-1], own[3, rows:2 + rows, columns:2 + columns])


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
    lens, report = comatic_lens(), Report()
    radiance = SpectralImage(np.random.default_rng(5).random((1, *shape)), [550], pitch_um=30.0)
    exact = simulate(radiance, lens, Options(method="exact")).cube
    single = Options(1, 1, psf_energy=1.0, precision="float64")
    np.testing.assert_allclose(simulate(radiance, lens, single, report=report).cube, exact, rtol=2e-6)
    assert report.facts["plan"]["folded"]
    for options in (Options(8, 2), Options(16, 3)):
        np.testing.assert_allclose(simulate(radiance, lens, options).cube, exact, rtol=0.03)


def test_an_axis_off_the_middle_is_not_folded():
    lens, report = make_lens(gaussian_psf(4, 4, 2.5, 25)), Report()
    cube = np.random.default_rng(5).random((1, 30, 40))
    radiance = SpectralImage(cube, [550], pitch_um=30.0, centre_px=(10.0, 30.0))
    exact = simulate(radiance, lens, Options(method="exact")).cube
    result = simulate(radiance, lens, Options(8, 2), report=report).cube
    np.testing.assert_allclose(result, exact, atol=1e-3 * exact.max())
    assert not report.facts["plan"]["folded"]


def test_a_lens_that_is_lopsided_is_not_folded():
    lens, report = lopsided_lens(), Report()
    radiance = SpectralImage(np.random.default_rng(5).random((1, 30, 41)), [550], pitch_um=30.0)
    exact = simulate(radiance, lens, Options(method="exact")).cube
    result = simulate(radiance, lens, Options(1, 1, psf_energy=1.0, precision="float64"), report=report).cube
    np.testing.assert_allclose(result, exact, rtol=2e-6)
    assert not report.facts["plan"]["folded"]


@pytest.mark.parametrize("shape", [(40, 60), (41, 60), (40, 61), (41, 61), (1, 1), (1, 8)])
def test_light_is_counted_once_though_middle_lines_are_in_two_quadrants(shape):
    report = Report()
    cube = np.random.default_rng(5).random((1, *shape)).astype(np.float32)
    simulate(SpectralImage(cube, [550], pitch_um=30.0), make_lens(), Options(8, 2, precision="float64"), report=report)
    light = np.pi / 16 * cube.sum(dtype=float) * (30e-6)**2
    assert report.facts["energy"]["in_w_per_nm"] == pytest.approx(light, rel=1e-7, abs=0)
    assert report.facts["energy"]["out_w_per_nm"] == pytest.approx(light, rel=1e-7, abs=0)
