"""Splines through tables, compared with scipy's."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from lensfield.engine.lens.spline import Spline


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 6, 31, 81])
def test_the_spline_equals_scipys(count):
    random = np.random.default_rng(count)
    nodes = 400 + 300 * np.sort((np.arange(count) + random.uniform(-0.4, 0.4, count)) / max(count - 1, 1))
    values = np.cos(nodes[:, None, None] * random.uniform(0, 0.05, (2, 3)) + random.uniform(0, 6, (2, 3)))
    places = np.linspace(nodes[0] - 5, nodes[-1] + 5, 90).reshape(9, 10) if count > 1 else np.full((9, 10), nodes)
    expected = make_interp_spline(nodes, values, k=min(3, count - 1))(places)
    spline = Spline.through(nodes, values)
    np.testing.assert_allclose(spline(places), expected, rtol=0, atol=1e-11)  # extrapolation magnifies rounding
    np.testing.assert_allclose(spline(nodes), values, rtol=0, atol=1e-12)
    assert spline(nodes[0]).shape == (2, 3)
