"""Functions over one half of the stop, known at rays: between these by splines, as products of matrices."""

from functools import lru_cache

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.special import roots_legendre

from .rays import HalfPupil

DEGREE = 5
MARGIN = 3  # azimuths beyond the half circle that splines see, mirrored, so that they have no edge there


class PupilSplines:
    """Splines through arrays (..., radius, azimuth) of a half pupil, at the places (radius, azimuth) of another grid.

    Parameters
    ----------
    pupil : HalfPupil
    radii, azimuths : arrays
        Where values and slopes are asked for.
    """

    def __init__(self, pupil: HalfPupil, radii: np.ndarray, azimuths: np.ndarray):
        radial = make_interp_spline(pupil.radii, np.eye(pupil.radii.size), k=min(DEGREE, pupil.radii.size - 1))
        step, count = pupil.azimuths[1], pupil.azimuths.size
        mirrored = np.concatenate([-step * np.arange(MARGIN, 0, -1), pupil.azimuths,
                                   np.pi + step * np.arange(1, MARGIN + 1)])
        around = make_interp_spline(mirrored, np.eye(mirrored.size), k=DEGREE)
        self._radial = [radial(radii, nu=order) for order in (0, 1)]
        self._azimuthal = {odd: [(around(azimuths, nu=order) @ _mirroring(count, -1 if odd else 1)).T
                                 for order in (0, 1)] for odd in (False, True)}

    def values(self, table: np.ndarray) -> np.ndarray:
        """Values, of what the other half of the pupil has the same of."""
        return self._radial[0] @ table @ self._azimuthal[False][0]

    def jacobian(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Area over (first, second), odd and even, that a unit of radius times azimuth becomes; with its sign."""
        (radial, radial_slope), odd, even = self._radial, self._azimuthal[True], self._azimuthal[False]
        return ((radial_slope @ first @ odd[0]) * (radial @ second @ even[1])
                - (radial @ first @ odd[1]) * (radial_slope @ second @ even[0]))


def _mirroring(count, sign):
    """Matrix that continues values over azimuths beyond both ends, by the mirror image."""
    inner = np.eye(count)
    return np.vstack([sign * inner[MARGIN:0:-1], inner, sign * inner[-2:-2 - MARGIN:-1]])


def area_ratio(pupil: HalfPupil, coordinates: np.ndarray) -> np.ndarray:
    """Area over coordinates (2, ..., radius, azimuth) that a unit of the stop becomes; negative where rays crossed."""
    splines = PupilSplines(pupil, pupil.radii[1:], pupil.azimuths)
    jacobian = splines.jacobian(*coordinates) / pupil.radii[1:, None]
    middle = np.broadcast_to(jacobian[..., :1, :].mean(axis=-1, keepdims=True), jacobian[..., :1, :].shape)
    jacobian = np.concatenate([middle, jacobian], axis=-2)
    return jacobian * np.sign(middle[..., :1])


class PupilQuadrature:
    """Samples of one half of the pupil: Gauss-Legendre over the radius, even steps over the azimuth.

    Both converge exponentially for what is smooth; the edge of an aperture is blurred over the samples that it crosses,
    so that what it cuts off changes evenly with the field.
    """

    def __init__(self, pupil: HalfPupil, radii: int, azimuths: int):
        nodes, weights = gauss_legendre(radii)
        self.splines = PupilSplines(pupil, (nodes + 1) / 2, (np.arange(azimuths) + 0.5) * np.pi / azimuths)
        self.cells = weights[:, None] / 2 * np.pi / azimuths

    def coverage(self, limits: np.ndarray) -> np.ndarray | float:
        """Which part of each sample passes all limits, arrays (limit, radius, azimuth) of what passes up to 1."""
        return covered(self.splines.values(limits[np.any(limits > 1, axis=(1, 2))]))


def covered(limits: np.ndarray) -> np.ndarray | float:
    """Share of each cell of a grid in which all limits are below 1: of arrays (limit, row, column), smooth at edges."""
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
    """Places between -1 and 1, and weights of values there in their integral."""
    return roots_legendre(number)
