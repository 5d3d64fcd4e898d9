"""The exact operator against the simplest possible loop."""

import numpy as np
import pytest

from blurring import blurred
from lensfield.engine.blur.exact import ExactSections

RADIUS = 2


def psf_at(row, column):
    """A PSF that is different for each pixel."""
    psf = 1 + np.arange(25.0).reshape(5, 5) * (row + 1) + (column % 3) * np.eye(5)
    return psf / psf.sum()


def psfs_at(rows, columns):
    return np.array([psf_at(row, column) for row, column in zip(rows, columns, strict=True)])


@pytest.mark.parametrize("section_size", [1, 3, 32])
@pytest.mark.parametrize("shape", [(1, 1), (1, 6), (5, 7)])
def test_each_pixel_is_spread_by_the_psf_at_its_position(shape, section_size):
    plane = np.random.default_rng(0).random(shape)
    expected = np.zeros((shape[0] + 4, shape[1] + 4))
    for row, column in np.ndindex(shape):
        expected[row:row + 5, column:column + 5] += plane[row, column] * psf_at(row, column)
    np.testing.assert_allclose(blurred(plane, ExactSections(section_size, RADIUS, psfs_at)), expected, atol=1e-14)


def test_psfs_are_computed_for_lit_pixels_only():
    requested = []

    def recording(rows, columns):
        requested.extend(zip(rows.tolist(), columns.tolist(), strict=True))
        return psfs_at(rows, columns)

    plane = np.zeros((9, 9))
    plane[2, 3] = plane[2, 7] = plane[8, 0] = 1
    blurred(plane, ExactSections(4, RADIUS, recording))
    assert sorted(requested) == [(2, 3), (2, 7), (8, 0)]


def test_light_is_scattered_by_the_psf_of_its_source_pixel():
    def one_right_or_stay(rows, columns):
        psfs = np.zeros((len(rows), 3, 3))
        psfs[np.arange(len(rows)), 1, np.where(np.asarray(columns) == 2, 2, 1)] = 1
        return psfs

    plane = np.array([[0.0, 0, 7, 1, 0]])
    np.testing.assert_array_equal(blurred(plane, ExactSections(32, 1, one_right_or_stay))[1], [0, 0, 0, 0, 8, 0, 0])
