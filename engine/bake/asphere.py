"""Aspheres as Optiland traces them, but for two things: see `Asphere`."""

import numpy as np
from optiland.coordinate_system import CoordinateSystem
from optiland.geometries.even_asphere import EvenAsphere
from optiland.rays import RealRays

from .prescription import Surface

STEPS = 100
CONVERGED_MM, GOOD_MM = 1e-13, 1e-9
LEAST_SQUARE_MM2 = 1e-24  # a term in r has no slope at the vertex, and a finite one next to it
LEAST_ROOT = 1e-6  # beyond the conic's end a ray may come by on its way to a place where there is a surface


class Asphere(EvenAsphere):
    """Conic and powers, whose `radius` is that at the vertex, and which rays look for from the vertex plane.

    Optiland's goes by the conic in both: its paraxial rays do not see a term in r^2, and it loses rays that pass by
    the conic though not by the asphere, as in steep lenses of phones.

    Parameters
    ----------
    coordinate_system : CoordinateSystem
        Optiland's, of the vertex.
    surface : Surface
    """

    def __init__(self, coordinate_system: CoordinateSystem, surface: Surface):
        self._curvature, self._conic = 1 / surface.radius_mm, surface.conic
        self._terms, self._odd_terms = np.array(surface.aspheric or (0.0,)), np.array(surface.odd_aspheric)
        at_vertex = self._curvature + 2 * self._terms[0]
        super().__init__(coordinate_system, 1 / at_vertex if at_vertex else np.inf, -1.0)

    def _sag_and_slope(self, square):
        """Sag, and its derivative by the squared distance from the axis."""
        root = np.sqrt(np.maximum(1 - (1 + self._conic) * self._curvature**2 * square, LEAST_ROOT**2))
        powers = np.arange(1, self._terms.size + 1)
        raised = square[..., None] ** (powers - 1)
        sag = self._curvature * square / (1 + root) + square * (raised @ self._terms)
        slope = self._curvature / (2 * root) + raised @ (powers * self._terms)
        if self._odd_terms.size:
            odd_powers = 2 * np.arange(self._odd_terms.size) + 1
            off_axis = np.maximum(square, LEAST_SQUARE_MM2)
            raised = np.sqrt(off_axis)[..., None] ** odd_powers
            sag = sag + raised @ self._odd_terms
            slope = slope + raised @ (odd_powers * self._odd_terms) / (2 * off_axis)
        return sag, slope

    def sag(self, x: np.ndarray | float = 0, y: np.ndarray | float = 0) -> np.ndarray:
        """Sag in mm at a place."""
        return self._sag_and_slope(np.asarray(x**2 + y**2, dtype=float))[0]

    def _surface_normal(self, x, y):
        slope = 2 * self._sag_and_slope(x**2 + y**2)[1]
        length = np.sqrt(1 + slope**2 * (x**2 + y**2))
        return slope * x / length, slope * y / length, -1 / length

    def distance(self, rays: RealRays, aperture: object = None) -> np.ndarray:
        """How far each ray has to go, by Newton's method; NaN where it never meets the surface."""
        distance = -rays.z / rays.N
        for _ in range(STEPS):
            x, y, z = (start + distance * along for start, along in
                       ((rays.x, rays.L), (rays.y, rays.M), (rays.z, rays.N)))
            sag, slope = self._sag_and_slope(x**2 + y**2)
            step = (sag - z) / (2 * slope * (x * rays.L + y * rays.M) - rays.N)
            distance = distance - step
            if not np.any(np.abs(step) > CONVERGED_MM):
                break
        return np.where(np.abs(step) < GOOD_MM, distance, np.nan)
