"""Matrix products in pieces."""

import numpy as np
import pytest

from lensfield.engine.runtime.products import product

RANDOM = np.random.default_rng(7)


@pytest.mark.parametrize("stack", [(), (3,), (0,), (2, 3)])
@pytest.mark.parametrize("rows, inner, columns", [(5, 7, 3), (97, 65, 256), (2, 600, 900)])
def test_products_equal_those_at_once(stack, rows, inner, columns):
    """Of one piece, of pieces that the rows do not fill, and of rows that are larger than a piece."""
    left, right = RANDOM.normal(size=(*stack, rows, inner)), RANDOM.normal(size=(inner, columns))
    assert product(left, right).shape == (*stack, rows, columns)
    np.testing.assert_allclose(product(left, right), left @ right, atol=1e-12 * inner)


def test_the_matrices_of_a_stack_have_separate_factors():
    left, right = RANDOM.normal(size=(4, 97, 65)), RANDOM.normal(size=(4, 65, 256))
    np.testing.assert_allclose(product(left, right), left @ right, atol=1e-10)
