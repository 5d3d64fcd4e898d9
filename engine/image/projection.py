"""Projection: the angle from the optical axis that a capture shows at each distance from its middle."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial.polynomial import polyder, polyroots, polyval

from ..runtime.errors import ImageError

HIGHEST_POWER = 4  # of the polynomial of Blender's panoramic cameras
DECIMALS = 10  # of coefficients, which then do not depend on a machine's rounding
LARGEST = 1e9
INVERSE_SAMPLES = 8193  # linear interpolation between them is accurate to 1e-8 focal lengths
SHRINKAGE_STEPS = 2048  # linear interpolation between them is accurate to 2e-6


@dataclass(frozen=True)
class Projection:
    """The projection of a capture. A plane shows an angle t from the axis at the radius tan t; a panorama, where a
    polynomial of the radius equals t. Radii are in focal lengths.

    Attributes
    ----------
    angle_per_radius : tuple of float
        Coefficients of a panorama's angle in radians, for the powers 1 up to 4 of the radius; empty for a plane.

    Raises
    ------
    ImageError
        There are too many coefficients, one is not a number, or the first is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from lensfield import Projection
    >>> equidistant = Projection((1.0,))
    >>> equidistant.angle_rad(np.array([0.0, 0.5])).tolist()
    [0.0, 0.5]
    """

    angle_per_radius: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        coefficients = tuple(round(float(c), DECIMALS) for c in self.angle_per_radius)
        if len(coefficients) > HIGHEST_POWER or not all(abs(c) < LARGEST for c in coefficients) or any(
                first <= 0 for first in coefficients[:1]):
            raise ImageError("image", "projection", self.angle_per_radius,
                             f"expected at most {HIGHEST_POWER} numbers, the first above 0")
        object.__setattr__(self, "angle_per_radius", coefficients)

    @property
    def is_plane(self) -> bool:
        """Whether straight lines stay straight. The camera then clips by depth; a panorama's clips by distance."""
        return not self.angle_per_radius

    def angle_rad(self, radius: np.ndarray) -> np.ndarray:
        """Angles from the axis at radii."""
        return np.arctan(radius) if self.is_plane else polyval(radius, self._angle)

    def solid_angle(self, radius: np.ndarray) -> np.ndarray:
        """Solid angle per area of the capture at radii, in sr per squared focal length; 0 where the capture is folded
        or ends behind the camera."""
        slope = 1 / (1 + np.square(radius)) if self.is_plane else polyval(radius, polyder(self._angle))
        sine = np.sin(np.minimum(self.angle_rad(radius), np.pi))
        return np.maximum(slope * np.divide(sine, radius, out=np.array(slope, float), where=radius > 0), 0)

    def radius(self, tangent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Radii for tangents of angles below 90 degrees, and their derivative; linear beyond the largest angle."""
        if self.is_plane:
            return tangent, np.ones_like(tangent)
        radii, angles_rad = self._inverse
        angle_rad = np.arctan(tangent)
        beyond_rad, per_angle = np.maximum(angle_rad - angles_rad[-1], 0), radii[-1] / angles_rad[-1]
        radius = np.interp(angle_rad, angles_rad, radii)
        slope = polyval(radius, polyder(self._angle))
        slope = np.divide(1, slope, out=np.full_like(slope, per_angle), where=(beyond_rad == 0) & (slope > 0))
        return radius + beyond_rad * per_angle, slope / (1 + np.square(tangent))

    def shrinkage(self, tangent: np.ndarray) -> np.ndarray:
        """Ratios of the radii for tangents to the radii on a plane."""
        radius, slope = self.radius(tangent)
        return np.divide(radius, tangent, out=np.array(slope), where=tangent > 0)

    @cached_property
    def shrinkage_table(self) -> np.ndarray:
        """`shrinkage` of tangents t, at even steps from 0 to 1 of t / (1 + t): float32 array (step,)."""
        step = np.arange(SHRINKAGE_STEPS) / SHRINKAGE_STEPS
        return np.append(self.shrinkage(step / (1 - step)), 0).astype(np.float32)

    def increases(self, farthest: float) -> bool:
        """Whether a panorama's angle increases up to this radius, or up to 90 degrees."""
        turn, ninety = self._ends
        return min(farthest, ninety) < turn

    @property
    def _angle(self):
        return 0.0, *self.angle_per_radius

    @cached_property
    def _ends(self):
        """The radii at which the angle stops increasing, and at which it is 90 degrees; inf if neither happens."""
        polynomials = polyder(self._angle), np.subtract(self._angle, (np.pi / 2, *np.zeros(len(self._angle) - 1)))
        roots = [np.atleast_1d(polyroots(each)) for each in polynomials]
        return tuple(min((root.real for root in each if root.imag == 0 and root.real > 0), default=np.inf)
                     for each in roots)

    @cached_property
    def _inverse(self):
        """Radii, and their ascending angles."""
        radii = np.linspace(0, min(self._ends), INVERSE_SAMPLES)
        return radii, np.maximum.accumulate(self.angle_rad(radii))


PLANE = Projection()
FISHEYE = Projection((1.0,))
"""An equidistant fisheye."""


def fitted_projection(radius: np.ndarray, tangent: np.ndarray, farthest: float) -> Projection:
    """The panorama that shows tangents of angles closest to given radii.

    Parameters
    ----------
    radius, tangent : arrays (place,)
        Evenly spaced radii from 0, in focal lengths.
    farthest : float
        The angle must increase up to this radius, or up to 90 degrees.

    Returns
    -------
    Projection
        By the polynomial of the highest possible power. A straight line always increases.
    """
    angle_rad = np.arctan(tangent)
    per_angle = np.gradient(radius, angle_rad)  # makes errors distances in the picture
    for count in range(HIGHEST_POWER, 0, -1):
        scale = radius[-1] ** np.arange(1, count + 1)
        powers = radius[:, None] ** np.arange(1, count + 1) / scale
        solution = np.linalg.lstsq(powers * per_angle[:, None], angle_rad * per_angle, rcond=None)[0] / scale
        if solution[0] > 0 and (fitted := Projection(tuple(solution))).increases(farthest):
            return fitted
    raise ImageError("lens", "distortion", "folded", "expected angles that increase with the distance from the axis")
