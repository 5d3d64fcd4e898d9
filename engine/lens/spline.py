"""Splines through the tables of a lens, over wavelength or height."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

DEGREE = 3


@dataclass(frozen=True, eq=False)
class Spline:
    """A spline of third degree through values at ascending nodes; of lower degree for fewer than four nodes.

    Its third derivative changes only at the inner nodes, not at the two nodes at each end ("not-a-knot"), as for
    `scipy.interpolate.make_interp_spline`, which takes 0.3 s to import. Beyond the nodes, it continues the polynomials
    at its ends.

    Attributes
    ----------
    nodes : array (node,)
    coefficients : array (node, ...)
        Of 1, x, x² and x³, and of (x - k)³ beyond each inner node k, where x is 0 at the first node and 1 at the last.
    """

    nodes: np.ndarray
    coefficients: np.ndarray

    @classmethod
    def through(cls, nodes: np.ndarray, values: np.ndarray) -> "Spline":
        """The spline through values (node, ...)."""
        table = values.reshape(len(values), -1)
        return cls(nodes, np.linalg.solve(_powers(nodes, nodes), table).reshape(values.shape))

    def __call__(self, places: ArrayLike) -> np.ndarray:
        """Values at places: array (place ..., ...)."""
        return np.tensordot(_powers(self.nodes, np.asarray(places)), self.coefficients, 1)


def _powers(nodes, places):
    """The functions that the spline is a sum of, at places: array (place ..., function)."""
    first, extent = nodes[0], np.ptp(nodes) or 1.0
    x, knots = (places - first) / extent, (nodes[2:-2] - first) / extent
    degree = min(DEGREE, nodes.size - 1)
    return np.concatenate([x[..., None] ** np.arange(degree + 1), np.maximum(x[..., None] - knots, 0) ** DEGREE],
                          axis=-1)
