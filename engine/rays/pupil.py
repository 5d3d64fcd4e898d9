"""Functions over one half of the stop, interpolated between rays by splines, as matrix products."""

from functools import lru_cache

import numpy as np
import scipy

from ..runtime.products import product
from .rays import HalfPupil

DEGREE = 5
MARGIN = 3  # mirrored azimuths on either side of the half circle, to avoid edges of the splines at its ends


class PupilSplines:
    """Splines through arrays (..., radius, azimuth) of a half pupil, at the places (radius, azimuth) of another grid.

    Parameters
    ----------
    pupil : HalfPupil
    radii, azimuths : arrays
        Points at which values and slopes are evaluated.
    """

    def __init__(self, pupil: HalfPupil, radii: np.ndarray, azimuths: np.ndarray):
        radial = scipy.interpolate.make_interp_spline(pupil.radii, np.eye(pupil.radii.size),
                                                      k=min(DEGREE, pupil.radii.size - 1))
        step, count = pupil.azimuths[1], pupil.azimuths.size
        mirrored = np.concatenate([-step * np.arange(MARGIN, 0, -1), pupil.azimuths,
                                   np.pi + step * np.arange(1, MARGIN + 1)])
        around = scipy.interpolate.make_interp_spline(mirrored, np.eye(mirrored.size), k=DEGREE)
        self._radial = [radial(radii, nu=order) for order in (0, 1)]
        self._azimuthal = {odd: [(around(azimuths, nu=order) @ _mirroring(count, -1 if odd else 1)).T
                                 for order in (0, 1)] for odd in (False, True)}

    def values(self, table: np.ndarray, odd: bool = False) -> np.ndarray:
        """Values of a quantity that is the same in the other half of the pupil or, if odd, has the opposite sign."""
        return product(self._radial[0] @ table, self._azimuthal[odd][0])

    def jacobian(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Signed area in the coordinates (first, second), odd and even, per unit of radius times azimuth."""
        (radial, radial_slope), odd, even = self._radial, self._azimuthal[True], self._azimuthal[False]
        return (product(radial_slope @ first, odd[0]) * product(radial @ second, even[1])
                - product(radial @ first, odd[1]) * product(radial_slope @ second, even[0]))


def _mirroring(count, sign):
    """Matrix that extends values over azimuths at both ends by their mirror image."""
    inner = np.eye(count)
    return np.vstack([sign * inner[MARGIN:0:-1], inner, sign * inner[-2:-2 - MARGIN:-1]])


def area_ratio(pupil: HalfPupil, coordinates: np.ndarray) -> np.ndarray:
    """Area in coordinates (2, ..., radius, azimuth) per unit area of the stop; negative where rays have crossed."""
    splines = PupilSplines(pupil, pupil.radii[1:], pupil.azimuths)
    jacobian = splines.jacobian(*coordinates) / pupil.radii[1:, None]
    middle = np.broadcast_to(jacobian[..., :1, :].mean(axis=-1, keepdims=True), jacobian[..., :1, :].shape)
    jacobian = np.concatenate([middle, jacobian], axis=-2)
    return jacobian * np.sign(middle[..., :1])


class PupilQuadrature:
    """Samples of one half of the pupil: Gauss-Legendre over the radius, equal steps over the azimuth.

    Both converge exponentially for smooth functions. The edge of an aperture is blurred over the samples that it
    crosses, so that vignetting changes smoothly with the field.
    """

    def __init__(self, pupil: HalfPupil, radii: int, azimuths: int):
        nodes, weights = gauss_legendre(radii)
        places = (nodes + 1) / 2, (np.arange(azimuths) + 0.5) * np.pi / azimuths
        self.splines = PupilSplines(pupil, *places)
        self._nearest = np.ix_(*(np.abs(rays[:, None] - each).argmin(axis=0)
                                 for rays, each in zip((pupil.radii, pupil.azimuths), places, strict=True)))
        self.cells = weights[:, None] / 2 * np.pi / azimuths

    def coverage(self, limits: np.ndarray) -> np.ndarray | float:
        """Share of each sample that passes all limits, arrays (limit, radius, azimuth): values up to 1 pass.

        Only samples at rays that pass, or next to them: splines overshoot among lost rays.
        """
        near = scipy.ndimage.binary_dilation(np.all(limits <= 1, axis=0), np.ones((3, 3)))
        return covered(self.splines.values(limits[np.any(limits > 1, axis=(1, 2))])) * near[self._nearest]


def covered(limits: np.ndarray) -> np.ndarray | float:
    """Share of each grid cell in which all limits (limit, row, column) are below 1, smooth at edges."""
    if not len(limits):
        return 1.0
    tightest = np.max(limits, axis=0)
    change = np.empty_like(tightest)
    change[1:-1] = np.abs(tightest[2:] - tightest[:-2])
    change[0], change[-1] = change[1], change[-2]
    change[:, 1:-1] += np.abs(tightest[:, 2:] - tightest[:, :-2])
    share = 0.5 + 2 * (1 - tightest) / np.maximum(change, 1e-12)
    return np.clip(share, 0, 1, out=share)


@lru_cache(maxsize=16)
def gauss_legendre(number: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights of Gauss-Legendre quadrature from -1 to 1."""
    return scipy.special.roots_legendre(number)


def polynomial_weights(nodes: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Lagrange weights of the values at the nodes in the polynomial through them, at places: array (place, node)."""
    weights = np.ones((places.size, nodes.size))
    for node in range(nodes.size):
        others = np.delete(nodes, node)
        weights[:, node] = np.prod((places[:, None] - others) / (nodes[node] - others), axis=1)
    return weights
