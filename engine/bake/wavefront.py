"""Wavefronts at the exit pupil: known from a few hundred rays, and between them by splines."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import BSpline, RectBivariateSpline
from scipy.ndimage import binary_dilation
from scipy.special import roots_legendre

from .rays import HalfPupil, trace_pupil
from .system import System

RADII, AZIMUTHS = 21, 25  # of the rays: twice as many change no PSF by more than 1e-5
MARGIN = 3  # azimuths beyond the half circle that splines see, mirrored, so that they have no edge there
DEGREE = 5
LONGEST_RADIUS = 1e3  # of the reference sphere in focal lengths, for telecentric lenses


@dataclass(frozen=True, eq=False)
class Wavefront:
    """What reaches one image point from a point of the object, as splines over the radius and azimuth of the stop.

    Attributes
    ----------
    wavelength_nm, chief_height_mm : float
        `chief_height_mm` is where the chief ray meets the image plane.
    knots : (array, array)
        Of all the splines, over radius and azimuth; the others are their coefficients.
    path : array
        Optical path difference against the sphere about the chief ray's image point, in wavelengths.
    cosine_x, cosine_y : arrays
        Direction cosines from the image point to the wavefront on that sphere.
    ray_x, ray_y : arrays
        Direction cosines of the rays at the image, which differ from those by the aberrations.
    source_x, source_y : arrays
        Coordinates in the object's beam, over whose area the source's light is spread evenly.
    limits : list of (array, float)
        Squared height of the rays at each surface that cuts some off, and its squared semi-aperture.
    """

    wavelength_nm: float
    chief_height_mm: float
    knots: tuple[np.ndarray, np.ndarray]
    path: np.ndarray
    cosine_x: np.ndarray
    cosine_y: np.ndarray
    ray_x: np.ndarray
    ray_y: np.ndarray
    source_x: np.ndarray
    source_y: np.ndarray
    limits: list[tuple[np.ndarray, float]]


@dataclass(frozen=True, eq=False)
class PupilSamples:
    """Quadrature over one half of the pupil, x > 0, as arrays (radius, azimuth); the other half is its mirror image.

    Attributes
    ----------
    path : in wavelengths
    cosine_x, cosine_y
    cosine_area, ray_area, source_area
        What each sample stands for, in direction cosines of both kinds and in the object's beam, as far as no aperture
        cuts it off.
    """

    path: np.ndarray
    cosine_x: np.ndarray
    cosine_y: np.ndarray
    cosine_area: np.ndarray
    ray_area: np.ndarray
    source_area: np.ndarray

    @property
    def largest_steps(self) -> tuple[float, float]:
        """Largest distance in direction cosines of samples that pass and are neighbours in radius, and in azimuth."""
        passing = self.cosine_area > 0
        x, y = np.where(passing, self.cosine_x, np.nan), np.where(passing, self.cosine_y, np.nan)
        return tuple(np.nanmax(np.hypot(np.diff(x, axis=axis), np.diff(y, axis=axis)), initial=0) for axis in (0, 1))

    @property
    def largest_sine(self) -> float:
        """Largest distance of a sample that passes from the middle of them, in direction cosines."""
        passing = self.cosine_area > 0
        x, y = self.cosine_x[passing], self.cosine_y[passing]
        return float(np.hypot(x, y - (y.max() + y.min()) / 2).max())


def trace_wavefronts(system: System, height_mm: float, wavelengths_nm: Sequence[float] | np.ndarray,
                     radii: int = RADII, azimuths: int = AZIMUTHS) -> list[Wavefront]:
    """Wavefronts of one field height at several wavelengths.

    Parameters
    ----------
    system : System
    height_mm : float
        Paraxial image height.
    wavelengths_nm : sequence of float
    radii, azimuths : int
        Rays over one half of the stop.

    Raises
    ------
    LensError
        The chief ray does not get through.
    """
    pupil = HalfPupil(radii, azimuths)
    return [_wavefront(system, rays, pupil) for rays in trace_pupil(system, height_mm, wavelengths_nm, pupil)]


def _wavefront(system, rays, pupil):
    """The traced rays' wavefront, as splines over the stop."""
    waves, cosines = _on_reference_sphere(system, rays)

    def spline(values, odd=False):
        return _spline(pupil, _continued(values, rays.lost), odd)[1]

    edges = [(_continued(square, rays.lost), semi_mm**2)
             for square, semi_mm in zip(rays.square_height_mm2, system.semi_apertures_mm, strict=True)]
    limits = [(_spline(pupil, values)[1], limit) for values, limit in _vignetting([*edges, (rays.lost * 1.0, 0.5)])]
    knots, path = _spline(pupil, _continued(waves, rays.lost))
    return Wavefront(rays.wavelength_nm, rays.chief_height_mm, knots, path,
                     spline(cosines[0], odd=True), spline(cosines[1]),
                     spline(rays.direction[0], odd=True), spline(rays.direction[1]),
                     spline(rays.source[0], odd=True), spline(rays.source[1]), limits)


def _on_reference_sphere(system, rays):
    """Where rays cross the sphere through the exit pupil about the chief ray's image point.

    Returns
    -------
    waves : array (radius, azimuth)
        Optical path difference against the chief ray, in wavelengths.
    cosines : array (3, radius, azimuth)
        Direction cosines from the image point.
    """
    radius_mm = min(abs(system.exit_pupil_distance_mm), LONGEST_RADIUS * system.efl_mm)
    centre = rays.position_mm[:, :1, :1]
    radius_mm = np.hypot(radius_mm, centre[1, 0, 0])
    from_centre = rays.position_mm - centre
    along = np.sum(from_centre * rays.direction, axis=0)
    back_mm = along + np.sqrt(along**2 - np.sum(from_centre**2, axis=0) + radius_mm**2)
    path_mm = rays.path_mm - back_mm
    waves = (path_mm[0, 0] - path_mm) / (rays.wavelength_nm * 1e-6)
    return waves, (from_centre - back_mm * rays.direction) / radius_mm


def _vignetting(limits):
    """Of (values, limit), those that cut off rays which all the others let through, or nearly."""
    stopped = [values > limit for values, limit in limits]
    nearly = [binary_dilation(~stops, np.ones((3, 3))) for stops in stopped]
    return [limits[index] for index, stops in enumerate(stopped)
            if np.any(stops & np.all([passes for other, passes in enumerate(nearly) if other != index], axis=0))]


def _spline(pupil, values, odd=False):
    """Knots and coefficients of an array (radius, azimuth); `odd` where the mirror image has -values."""
    sign = -1 if odd else 1
    before, after = values[:, MARGIN:0:-1], values[:, -2:-2 - MARGIN:-1]
    beyond = pupil.azimuths[1] * np.arange(1, MARGIN + 1)
    azimuths = np.concatenate([-beyond[::-1], pupil.azimuths, np.pi + beyond])
    spline = RectBivariateSpline(pupil.radii, azimuths, np.hstack([sign * before, values, sign * after]),
                                 kx=DEGREE, ky=DEGREE)
    return tuple(spline.get_knots()), spline.get_coeffs().reshape(pupil.radii.size, azimuths.size)


def _continued(values, lost):
    """Values of lost rays, continued outwards in a straight line from those that were not."""
    if not lost.any():
        return values
    values = values.copy()
    for row in range(1, len(values)):
        bad = lost[row]
        values[row, bad] = (2 * values[row - 1] - values[max(row - 2, 0)])[bad]
    return values


def sample_pupil(wavefront: Wavefront, radii: int, azimuths: int) -> PupilSamples:
    """Quadrature samples of a wavefront: Gauss-Legendre over the radius, even steps over the azimuth.

    Both converge exponentially, for the integrand is smooth and periodic; an aperture's edge is blurred over the
    samples that it crosses, so that what it cuts off changes evenly with the field.
    """
    nodes, weights = _gauss_legendre(radii)
    azimuth = (np.arange(azimuths) + 0.5) * np.pi / azimuths
    basis = _Basis(wavefront.knots, (nodes + 1) / 2, azimuth)
    cell = weights[:, None] / 2 * np.pi / azimuths * _coverage(wavefront, basis)

    def area(first, second):
        return np.abs(basis.radial_slope(first) * basis.azimuthal_slope(second)
                      - basis.azimuthal_slope(first) * basis.radial_slope(second)) * cell

    return PupilSamples(basis.values(wavefront.path), basis.values(wavefront.cosine_x),
                        basis.values(wavefront.cosine_y), area(wavefront.cosine_x, wavefront.cosine_y),
                        area(wavefront.ray_x, wavefront.ray_y), area(wavefront.source_x, wavefront.source_y))


class _Basis:
    """B-splines at the samples: two products of matrices then evaluate any spline on their grid."""

    def __init__(self, knots, radius, azimuth):
        self._radial, self._azimuthal = (
            [BSpline(axis, np.eye(axis.size - DEGREE - 1), DEGREE)(places, nu=order) for order in (0, 1)]
            for axis, places in zip(knots, (radius, azimuth), strict=True))

    def values(self, coefficients):
        return self._radial[0] @ coefficients @ self._azimuthal[0].T

    def radial_slope(self, coefficients):
        return self._radial[1] @ coefficients @ self._azimuthal[0].T

    def azimuthal_slope(self, coefficients):
        return self._radial[0] @ coefficients @ self._azimuthal[1].T


@lru_cache(maxsize=64)
def _gauss_legendre(number):
    return roots_legendre(number)


def _coverage(wavefront, basis):
    """Which part of each sample's cell passes all apertures: array (radius, azimuth), or 1 where all does."""
    covered = 1.0
    for square, limit in wavefront.limits:
        clearance = limit - basis.values(square)
        change = sum(np.abs(np.gradient(clearance, axis=axis)) for axis in (0, 1))
        covered = covered * np.clip(0.5 + clearance / np.maximum(change, 1e-12 * limit), 0, 1)
    return covered
