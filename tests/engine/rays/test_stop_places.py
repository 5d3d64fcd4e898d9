"""Places of the stop, and every fourth one of them."""

import numpy as np
import pytest
import scipy

from lensfield.engine.rays.stop_places import RAY_COUNTS, cell_size, stop_places

EVEN = 0.75  # mean distance of places from the nearest other one, in sides of cells: of random ones 0.5, of squares 1


@pytest.mark.parametrize("count", RAY_COUNTS)
def test_each_fourth_of_the_places_is_nearly_even(count):
    places = stop_places(count)
    assert len(np.unique(places, axis=1).T) == count and (places**2).sum(axis=0).max() < 1
    for first in range(4):
        fourth = places[:, first::4].T
        nearest = scipy.spatial.KDTree(fourth).query(fourth, k=2)[0][:, 1]
        assert nearest.mean() > EVEN * cell_size(len(fourth))
