"""Sharpening: it subtracts a variance from blur, and neither adds light nor rims."""

import numpy as np
import pytest

from lensfield.engine.image.sharpening import MORE, STRIP, resampling_variance, sharpen

SHAPE = STRIP + 23, 2 * STRIP + 9  # several strips of both kinds


def gaussian(sigma_px, middle_px):
    """A spot of light: float32 array (row, column)."""
    rows, columns = (np.arange(n) - at for n, at in zip(SHAPE, middle_px, strict=True))
    return np.outer(*(np.exp(-each**2 / 2 / sigma_px**2) for each in (rows, columns))).astype(np.float32)


def variances(picture):
    """Variances of the light along both axes."""
    sums = picture.sum(axis=1, dtype=float), picture.sum(axis=0, dtype=float)
    means = [np.average(np.arange(each.size), weights=each) for each in sums]
    return [np.average((np.arange(each.size) - mean)**2, weights=each)
            for each, mean in zip(sums, means, strict=True)]


@pytest.mark.parametrize("middle_px", [(STRIP + 2.3, 61.8), (40.1, 2 * STRIP - 9.7)])
def test_it_subtracts_the_variance_of_each_axis(middle_px):
    picture = gaussian(3.0, middle_px)
    before, light = variances(picture), picture.sum(dtype=float)
    sharpen(picture, lambda axis, rows, columns: (0.1, 0.4)[axis])
    np.testing.assert_allclose(np.subtract(before, variances(picture)), [MORE * 0.1, MORE * 0.4], rtol=0.02)
    assert picture.sum(dtype=float) == pytest.approx(light, rel=1e-6) and picture.min() >= 0


def test_the_variance_is_that_between_the_pixels():
    """Rows and columns are those of the picture, with fractions along the axis."""
    places = {}

    def variance(axis, rows, columns):
        places.setdefault(axis, []).append((rows, columns))
        return np.zeros((rows.size, columns.size))

    sharpen(np.ones(SHAPE, np.float32), variance)
    for axis, along in ((0, SHAPE[0]), (1, SHAPE[1])):
        for place in places[axis]:
            np.testing.assert_array_equal(place[axis], np.arange(along - 1) + 0.5)
        across = np.sort(np.concatenate([place[1 - axis] for place in places[axis]]))
        np.testing.assert_array_equal(across, np.arange(SHAPE[1 - axis]))


def test_a_hard_edge_gets_no_rims():
    picture = np.ones(SHAPE, np.float32)
    picture[:, :100], picture[:50] = 0, 0
    picture[50, 100:], picture[51:, 100] = 0.5, 0.3
    edge = picture.copy()
    sharpen(picture, lambda axis, rows, columns: 0.5)
    assert picture.min() >= 0 and np.abs(picture[53:, 103:] - 1).max() == 0
    assert picture[52:, 101:].max() < 1.3 and np.all(picture[:50] == 0) and np.all(picture[:, :100] == 0)
    assert picture.sum(dtype=float) == pytest.approx(edge.sum(dtype=float), rel=1e-6)


def test_light_stays_positive_and_even_light_even():
    rng = np.random.default_rng(7)
    noisy = rng.gamma(0.2, 1, SHAPE).astype(np.float32)
    light = noisy.sum(dtype=float)
    sharpen(noisy, lambda axis, rows, columns: 0.5)
    assert noisy.min() >= 0 and noisy.sum(dtype=float) == pytest.approx(light, rel=1e-6)
    even = np.full(SHAPE, 0.7, np.float32)
    sharpen(even, lambda axis, rows, columns: 0.5)
    assert np.all(even == np.float32(0.7))


def test_resampling_adds_the_variance_of_the_mean_of_two_pixels():
    shift = np.array([-3.0, 0.0, 0.25, 0.5, 7.75])
    np.testing.assert_allclose(resampling_variance(shift), [0, 0, 0.1875, 0.25, 0.1875])
    for part, expected in zip(shift % 1, resampling_variance(shift), strict=True):
        assert np.average((np.array([0, 1]) - part)**2, weights=[1 - part, part]) == pytest.approx(expected)
