"""Wavefronts as polynomials over direction cosines, fitted at the traced wavelengths and interpolated between them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..rays.pupil import polynomial_weights, with_neighbours
from .polynomials import fitted
from .wavefront import Wavefront

EDGE_DEGREE = 12  # of the polynomials of aperture edges and of density, which are smooth
RIM_DEGREE = 8  # of the polynomial of the stop's rim, which must also block the area beyond the rays
MARGIN = 1.02  # radius of the disc of cosines, relative to the disc around its rays


@dataclass(frozen=True, eq=False)
class PupilFit:
    """A wavefront as Chebyshev polynomials over an elliptical disc of direction cosines.

    Attributes
    ----------
    half_x, half_y, middle_y : float
        Half widths of the disc, and y of its centre.
    path_um : array (power of y, term of x)
        Optical path difference.
    edges : array (quantity, power of y, term of x)
        The density, the stop's rim and then the other limits.
    densities : (float, float)
        The least and the greatest density of passing rays.
    error_um : float
        RMS error of the path.
    even : bool
        Whether the polynomials are even in x, with a term for every second power.
    """

    half_x: float
    half_y: float
    middle_y: float
    path_um: np.ndarray
    edges: np.ndarray
    densities: tuple[float, float]
    error_um: float
    even: bool = True

    def fringes(self, wavelength_nm: float, distance_um: float) -> float:
        """Number of the finest fringes in a distance."""
        return 2e3 * max(self.half_x, self.half_y) * distance_um / wavelength_nm


def fit_pupils(traced: Sequence[Wavefront], degree: int, wavelengths_nm: Sequence[float] | np.ndarray
               ) -> list[PupilFit]:
    """Fit the wavefronts of a height, or of a place on the sensor, by least squares over their rays.

    Parameters
    ----------
    traced : sequence of Wavefront
        At several wavelengths; light passes at each of them.
    degree : int
        Of the path's polynomial.
    wavelengths_nm : sequence of float
        Polynomials over the wave number interpolate between the traced wavelengths.

    Returns
    -------
    list of PupilFit
        One for each of `wavelengths_nm`, over the same disc.
    """
    path_um = 1e3 * np.stack([one.path_mm for one in traced], axis=-3)
    density = np.stack([one.density for one in traced], axis=-3)
    x, y = np.stack([one.cosine for one in traced], axis=-3)
    limits, pupil = np.stack([one.limits for one in traced], axis=-3), traced[0].pupil
    passing = np.all(limits <= 1, axis=0)
    near = with_neighbours(pupil, passing)
    half_x, half_y, middle_x, middle_y = _disc(x[near], y[near], pupil.mirrored)
    x, y = (x - middle_x) / half_x, (y - middle_y) / half_y
    radius = np.broadcast_to(pupil.radii[:, None], x.shape)
    limits = limits[np.any(limits[:, near] > 1, axis=1)]

    fits = [_fit_one(x[at], y[at], near[at], path_um[at], density[at], radius[at], limits[:, at], degree,
                     pupil.mirrored) for at in range(len(traced))]
    path_um, edges, error_um = map(np.stack, zip(*fits, strict=True))
    densities = np.stack([density.min(axis=(1, 2), where=passing, initial=np.inf),
                          density.max(axis=(1, 2), where=passing, initial=-np.inf)], axis=1)
    weights = polynomial_weights(np.array([1e3 / one.wavelength_nm for one in traced]),
                                 1e3 / np.asarray(wavelengths_nm, dtype=float))
    path_um, edges = np.tensordot(weights, path_um, 1), np.tensordot(weights, edges, 1)
    densities = np.tensordot(weights, densities, 1)
    return [PupilFit(half_x, half_y, middle_y, path_um[at], edges[at], tuple(densities[at]), float(error_um.max()),
                     pupil.mirrored) for at in range(len(weights))]


def _fit_one(x, y, near, path_um, density, radius, limits, degree, even):
    """Polynomials of the path and of the edges at one wavelength, and the path's error."""
    inside = np.hypot(x, y) <= 1
    weight = np.sqrt(np.maximum(radius, radius[1, 0] / 4))  # light of a ring is proportional to its radius
    path_um, error_um = fitted(x[near], y[near], weight[near], path_um[None, near], degree, even)
    edges, _ = fitted(x[inside], y[inside], weight[inside],
                      np.stack([density, *map(_compressed, limits)])[:, inside], min(degree, EDGE_DEGREE), even)
    rim, _ = fitted(x[inside], y[inside], weight[inside], radius[None, inside]**2, RIM_DEGREE, even)
    rim = np.pad(rim, [(0, 0), *((0, more) for more in np.subtract(edges.shape[1:], rim.shape[1:]))])
    return path_um[0], np.concatenate([edges[:1], rim, edges[1:]]), error_um


def _disc(x, y, even):
    """Half widths along x and y of an elliptical disc around these cosines, and its centre."""
    half_x, half_y = np.abs(x).max() if even else np.ptp(x) / 2, np.ptp(y) / 2
    middle_x, middle_y = 0.0 if even else (x.max() + x.min()) / 2, (y.max() + y.min()) / 2
    grown = MARGIN * max(1.0, np.hypot((x - middle_x) / half_x, (y - middle_y) / half_y).max())
    return half_x * grown, half_y * grown, middle_x, middle_y


def _compressed(limits):
    """Limits compressed to less than 2, on the same side of 1: polynomials need not follow large values."""
    return 2 * limits / (1 + limits)
