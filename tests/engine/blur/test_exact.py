"""The exact operator against the simplest possible loop."""

import numpy as np
import pytest

from blurring import blurred
from lensfield.engine.blur.exact import ExactSections

RADIUS = 2


def own_psf(row, column):
    """A PSF that is different for each pixel."""
    psf = 1 + np.arange(25.0).reshape(5, 5) * (row + 1) + (column % 3) * np.eye(5)
    return psf / psf.sum()


def own_psfs(rows, columns):
    return np.array([own_psf(row, column) for row, column in zip(rows, columns, strict=True)])


@pytest.mark.parametrize("section_size", [1, 3, 32])
@pytest.mark.parametrize("shape", [(1, 1), (1, 6), (5, 7)])
def test_every_pixel_spreads_by_its_own_psf(shape, section_size):
    plane = np.random.default_rng(0).random(shape)
    expected = np.zeros((shape[0] + 4, shape[1] + 4))
    for row, column in np.ndindex(shape):
        expected[row:row + 5, column:column + 5] += plane[row, column] * own_psf(row, column)
    np.testing.assert_allclose(blurred(plane, ExactSections(section_size, RADIUS, own_psfs)), expected, atol=1e-14)


def test_only_lit_pixels_are_asked_for_their_psfs():
    asked = []

    def noted(rows, columns):
        asked.extend(zip(rows.tolist(), columns.tolist(), strict=True))
        return own_psfs(rows, columns)

    plane = np.zeros((9, 9))
    plane[2, 3] = plane[2, 7] = plane[8, 0] = 1
    blurred(plane, ExactSections(4, RADIUS, noted))
    assert sorted(asked) == [(2, 3), (2, 7), (8, 0)]


def test_result_is_a_scatter_by_the_psf_of_the_source():
    def one_right_or_stay(rows, columns):
        psfs = np.zeros((len(rows), 3, 3))
        psfs[np.arange(len(rows)), 1, np.where(np.asarray(columns) == 2, 2, 1)] = 1
        return psfs

    plane = np.array([[0.0, 0, 7, 1, 0]])
    np.testing.assert_array_equal(blurred(plane, ExactSections(32, 1, one_right_or_stay))[1], [0, 0, 0, 0, 8, 0, 0])
