"""The exact operator against the plainest possible loop."""

import numpy as np
import pytest

from lensfield.engine.blur.exact import BLOCK_PIXELS, filter_exactly

RADIUS = 2


def own_psf(row, column):
    """A PSF that only this pixel has."""
    psf = 1 + np.arange(25.0).reshape(5, 5) * (row + 1) + (column % 3) * np.eye(5)
    return psf / psf.sum()


def own_psfs(rows, columns):
    return np.array([own_psf(row, column) for row, column in zip(rows, columns)])


@pytest.mark.parametrize("shape", [(1, 1), (1, 6), (5, 7)])
def test_every_pixel_spreads_by_its_own_psf(shape):
    plane = np.random.default_rng(0).random(shape)
    expected = np.zeros((shape[0] + 4, shape[1] + 4))
    for row, column in np.ndindex(shape):
        expected[row:row + 5, column:column + 5] += plane[row, column] * own_psf(row, column)
    np.testing.assert_allclose(filter_exactly(plane, RADIUS, own_psfs), expected, atol=1e-14)


def test_bands_of_rows_join_without_a_seam():
    plane = np.zeros((5, BLOCK_PIXELS // 2))  # two rows to a band
    plane[:, 10] = [1, 2, 3, 4, 5]
    expected = np.zeros((9, 5))
    for row in range(5):
        expected[row:row + 5] += plane[row, 10] * own_psf(row, 10)
    np.testing.assert_allclose(filter_exactly(plane, RADIUS, uniform_in_columns)[:, 10:15], expected, atol=1e-13)


def uniform_in_columns(rows, columns):
    by_row = {row: own_psf(row, 10) for row in np.unique(rows)}
    return np.array([by_row[row] for row in rows])


def test_result_is_a_scatter_by_the_psf_of_the_source():
    def one_right_or_stay(rows, columns):
        psfs = np.zeros((len(rows), 3, 3))
        psfs[np.arange(len(rows)), 1, np.where(np.asarray(columns) == 2, 2, 1)] = 1
        return psfs

    plane = np.array([[0.0, 0, 7, 1, 0]])
    np.testing.assert_array_equal(filter_exactly(plane, 1, one_right_or_stay)[1], [0, 0, 0, 0, 8, 0, 0])
