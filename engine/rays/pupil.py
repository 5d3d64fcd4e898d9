"""Functions over the stop, or one half of it, interpolated between rays by splines, as matrix products."""

from functools import lru_cache

import numpy as np
import scipy

from ..runtime.products import product
from .rays import Pupil

DEGREE = 5
MARGIN = 3  # azimuths continued on either side of the half or full circle, to avoid edges of the splines at its ends


class PupilSplines:
    """Splines through arrays (..., radius, azimuth) of a pupil, at the places (radius, azimuth) of another grid.

    Parameters
    ----------
    pupil : Pupil
    radii, azimuths : arrays
        Points at which values and slopes are evaluated.
    """

    def __init__(self, pupil: Pupil, radii: np.ndarray, azimuths: np.ndarray):
        radial = scipy.interpolate.make_interp_spline(pupil.radii, np.eye(pupil.radii.size),
                                                      k=min(DEGREE, pupil.radii.size - 1))
        step = pupil.azimuths[1]
        continued = np.concatenate([-step * np.arange(MARGIN, 0, -1), pupil.azimuths,
                                    pupil.azimuths[-1] + step * np.arange(1, MARGIN + 1)])
        around = scipy.interpolate.make_interp_spline(continued, np.eye(continued.size), k=DEGREE)
        self._radial = [radial(radii, nu=order) for order in (0, 1)]
        self._azimuthal = {odd: [(around(azimuths, nu=order) @ _continuation(pupil, -1 if odd else 1)).T
                                 for order in (0, 1)] for odd in (False, True)}

    def values(self, table: np.ndarray, odd: bool = False) -> np.ndarray:
        """Values of a quantity that is the same in the other half of a half pupil or, if odd, has the opposite sign."""
        return product(self._radial[0] @ table, self._azimuthal[odd][0])

    def jacobian(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Signed area in the coordinates (first, second) per unit of radius times azimuth.

        In a half pupil, the first is odd and the second even.
        """
        (radial, radial_slope), odd, even = self._radial, self._azimuthal[True], self._azimuthal[False]
        return (product(radial_slope @ first, odd[0]) * product(radial @ second, even[1])
                - product(radial @ first, odd[1]) * product(radial_slope @ second, even[0]))


def _continuation(pupil, sign):
    """Matrix that continues values over azimuths at both ends, by their mirror image or around the circle."""
    inner = np.eye(pupil.azimuths.size)
    if not pupil.mirrored:
        return np.vstack([inner[-MARGIN:], inner, inner[:MARGIN]])
    return np.vstack([sign * inner[MARGIN:0:-1], inner, sign * inner[-2:-2 - MARGIN:-1]])


def area_ratio(pupil: Pupil, coordinates: np.ndarray) -> np.ndarray:
    """Area in coordinates (2, ..., radius, azimuth) per unit area of the stop; negative where rays have crossed."""
    splines = _splines_to_rays(pupil)
    jacobian = splines.jacobian(*coordinates) / pupil.radii[1:, None]
    middle = np.broadcast_to(jacobian[..., :1, :].mean(axis=-1, keepdims=True), jacobian[..., :1, :].shape)
    jacobian = np.concatenate([middle, jacobian], axis=-2)
    return jacobian * np.sign(middle[..., :1])


@lru_cache(maxsize=8)
def _splines_to_rays(pupil):
    """Splines to the rays themselves, for slopes, except those of radius 0."""
    return PupilSplines(pupil, pupil.radii[1:], pupil.azimuths)


class PupilQuadrature:
    """Samples of the pupil: Gauss-Legendre over the radius, equal steps over the azimuth.

    Both converge exponentially for smooth functions. The edge of an aperture is blurred over the samples that it
    crosses, so that vignetting changes smoothly with the field. `azimuths` cover half a circle.
    """

    def __init__(self, pupil: Pupil, radii: int, azimuths: int):
        nodes, weights = gauss_legendre(radii)
        turn, azimuths = (np.pi, azimuths) if pupil.mirrored else (2 * np.pi, 2 * azimuths)
        places = (nodes + 1) / 2, (np.arange(azimuths) + 0.5) * turn / azimuths
        self.pupil, self.splines = pupil, PupilSplines(pupil, *places)
        around = pupil.azimuths if pupil.mirrored else np.append(pupil.azimuths, turn)
        radius, azimuth = (np.abs(rays[:, None] - each).argmin(axis=0)
                           for rays, each in zip((pupil.radii, around), places, strict=True))
        self._nearest = np.ix_(radius, azimuth % pupil.azimuths.size)
        self.cells = weights[:, None] / 2 * turn / azimuths

    def coverage(self, limits: np.ndarray) -> np.ndarray | float:
        """Share of each sample that passes all limits, arrays (limit, radius, azimuth): values up to 1 pass.

        Only samples at rays that pass, or next to them: splines overshoot among lost rays.
        """
        near = with_neighbours(self.pupil, np.all(limits <= 1, axis=0))
        limits = self.splines.values(limits[np.any(limits > 1, axis=(1, 2))])
        if self.pupil.mirrored:
            return covered(limits) * near[self._nearest]
        share = np.broadcast_to(covered(_closed(limits)), (self.cells.size, limits.shape[-1] + 2))
        return share[:, 1:-1] * near[self._nearest]


def with_neighbours(pupil: Pupil, passing: np.ndarray) -> np.ndarray:
    """Rays that pass, and the rays next to them: bool array (..., radius, azimuth)."""
    around = np.ones((*(1,) * (passing.ndim - 2), 3, 3))
    if pupil.mirrored:
        return scipy.ndimage.binary_dilation(passing, around)
    return scipy.ndimage.binary_dilation(_closed(passing), around)[..., 1:-1]


def _closed(values):
    """Values all around, with the last azimuth again before the first one, and the first one after the last."""
    return np.concatenate([values[..., -1:], values, values[..., :1]], axis=-1)


def covered(limits: np.ndarray) -> np.ndarray | float:
    """Share of each grid cell in which all limits (limit, ..., row, column) are below 1, smooth at edges."""
    if not len(limits):
        return 1.0
    tightest = np.max(limits, axis=0)
    change = np.empty_like(tightest)
    change[..., 1:-1, :] = np.abs(tightest[..., 2:, :] - tightest[..., :-2, :])
    change[..., 0, :], change[..., -1, :] = change[..., 1, :], change[..., -2, :]
    change[..., 1:-1] += np.abs(tightest[..., 2:] - tightest[..., :-2])
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
