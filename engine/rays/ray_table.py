"""A table of a lens's rays, from points of the sensor through points of the stop, out to the object.

The sensor sees points of the scene at any depth along these rays, which determines blur by depth and occlusion by near
objects.

The lens is rotationally symmetric, so the table covers the height of the sensor point and half of the stop. Cubic
splines, with coefficients at equal distances for the compiled loops, interpolate between its rays. Heights and stop
radii are sines of equal angles, relative to the last: they are densest where rays change most, towards the picture's
corners and the rim of a fast stop. Lost rays are extrapolated from the traced ones, so splines have no edge.

Two rays may connect one point of the sensor with one point of the stop. Beyond the rays that pass, the two merge and
vanish: close to this, rays change like a square root, and more radii are traced.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Self

import numpy as np
import scipy

from ..prescription.prescription import Prescription
from ..prescription.system import System
from ..runtime.errors import LensError
from ..runtime.values import Value
from .aiming import aim_at_image, farthest_aim_mm
from .focus import build_system
from .light_end import light_end
from .lost_rays import without_lost
from .pupil import area_ratio, polynomial_weights
from .rays import HalfPupil, trace_pupil
from .splines import EVEN, FREE, ODD, cubic, even_place, spline_matrix, splines
from .trace import BothWays, trace_both_ways

WAVELENGTHS_NM = (400.0, 417.1, 469.5, 555.9, 653.2, 700.0)  # least oscillation of polynomials over the wave number
HEIGHTS, PUPIL = 33, HalfPupil(17, 33, close_at_rim=True)
SKETCHED_HEIGHTS, SKETCHED_PUPIL = 17, HalfPupil(17, 25, close_at_rim=True)  # for pixels of a 160th of the picture
FINER_PUPIL, FINE_UM = HalfPupil(33, 33, close_at_rim=True), 1.0  # used if the spline error on the sensor exceeds this
MISSED = 5 / 384  # largest error of cubic splines, relative to fourth differences
MARGIN_TO_WEIGHT = slice(4, 7)  # of the table's quantities
PATH = 4  # the optical path among `traced_quantities`
RIM_RADII, RIM_AZIMUTHS = 48, 64  # samples for the integral of light over half of the stop,
RIM_PER_RAY = 3, 2  # but at most this many between two rays


@dataclass(frozen=True, eq=False)
class SensorRays:
    """Rays from points of the sensor: arrays (..., ray), in the sensor's axes.

    Attributes
    ----------
    entrance_mm : array (2, ...)
        Position on the plane of the entrance pupil, whose centre is the pinhole of a camera without the lens.
    direction : array (3, ...)
        Direction cosines in front of the lens, along the light: at a depth z in front of the plane a ray is at
        `entrance_mm - z * direction[:2] / direction[2]`.
    margin : array
        Positive if the ray passes: the least 1 - (r / semi-aperture)^2 over the surfaces and the stop, or 1 - limit of
        a central obstruction (`System.limits`).
    surface_margin : array
        The margin over the surfaces without the stop: smooth where the limit changes between the stop's rim and a
        surface.
    path_mm : array
        Optical path from the plane to the sensor, minus the path along the axis at this wavelength.
    weight : array
        Light: projected solid angle at the sensor per unit of the stop's area, in squared semi-apertures. Its sum over
        the passing rays is irradiance over radiance, without the glass's transmittance.
    """

    entrance_mm: np.ndarray
    direction: np.ndarray
    margin: np.ndarray
    surface_margin: np.ndarray
    path_mm: np.ndarray
    weight: np.ndarray


class TableByWavelength:
    """What tables of rays, dataclasses with these fields, have in common: other wavelengths than the traced ones."""

    name: str
    wavelengths_nm: np.ndarray
    coefficients: np.ndarray

    def at(self, wavelengths_nm: Sequence[float] | np.ndarray) -> Self:
        """The table at other wavelengths, interpolated by a polynomial over the wave number.

        Raises
        ------
        LensError
            A wavelength outside the table's range.
        """
        wavelengths_nm, (first, last) = np.asarray(wavelengths_nm, dtype=float), self.wavelengths_nm[[0, -1]]
        if np.any((wavelengths_nm < first) | (wavelengths_nm > last)):
            raise LensError(self.name, "wavelengths", wavelengths_nm.tolist(),
                            f"the ray table covers {first:g} to {last:g} nm: trace a table for these wavelengths")
        weights = polynomial_weights(1e3 / self.wavelengths_nm, 1e3 / wavelengths_nm).astype(np.float32)
        coefficients = np.tensordot(weights, self.coefficients, 1)
        return replace(self, wavelengths_nm=wavelengths_nm, coefficients=coefficients)  # type: ignore[type-var]

    def near(self, wavelengths_nm: Sequence[float] | np.ndarray) -> Self:
        """As `at`, but holds the table's first and last wavelengths outside its range."""
        return self.at(np.clip(wavelengths_nm, *self.wavelengths_nm[[0, -1]]))


@dataclass(frozen=True, eq=False, repr=False)
class RayTable(TableByWavelength, Value):
    """Rays of a lens by wavelength, sensor point and stop point.

    Attributes
    ----------
    name : str
        Name of the lens.
    wavelengths_nm : array (wavelength,)
    last_height_mm : float
        From the axis to the last sensor point: the end of the lens's field, or of the light.
    entrance_pupil_mm : float
        From the first surface to the plane of the entrance pupil, towards the image.
    reach : float
        From the axis to the outermost point in the plane of the stop, in semi-apertures: more than 1 for an iris whose
        corners exceed the round stop.
    coefficients : float32 array (wavelength, height, radius, azimuth, quantity)
        Coefficients of cubic B-splines at equal distances, with one more than the rays at either end. Variables:
        s = 2 / pi arcsin(share) from 0 to 1, for the shares of the last height and of the reach, and the azimuth from
        +y, the side of the sensor point, through +x to -y. Quantities: the foot (x, y), the ray's closest point to the
        centre of the entrance pupil, which unlike the crossing with the pupil plane stays close to it at any angle;
        p of the direction in front of the lens (x, y), whose cosines are (2 p, 1 - p^2) / (1 + p^2), as accurate near
        90 degrees as on the axis; the margin at the surfaces; the optical path from the foot; and the weight.
    dark_beyond : bool
        Whether no light arrives beyond the last sensor point.
    """

    name: str
    wavelengths_nm: np.ndarray
    last_height_mm: float
    entrance_pupil_mm: float
    coefficients: np.ndarray
    reach: float = 1.0
    dark_beyond: bool = False

    def inside(self, place_mm: np.ndarray, share: float) -> np.ndarray:
        """Places (2, ...) clamped to a share of the field."""
        return place_mm * np.minimum(1, share * self.last_height_mm / np.maximum(np.hypot(*place_mm), 1e-12))

    def rays(self, wavelength: int | np.ndarray, place_mm: np.ndarray, stop: np.ndarray) -> SensorRays:
        """Rays from points of the sensor through points of the stop.

        Parameters
        ----------
        wavelength : int or array of int
            Index into the table's wavelengths.
        place_mm : array (2, ...)
            Sensor points: x and y from the axis in the image as formed by the lens, upside down.
        stop : array (2, ...)
            Stop points: from the axis, in semi-apertures.

        Raises
        ------
        LensError
            A sensor point beyond the table's last height.
        """
        (x_mm, y_mm), (stop_x, stop_y) = np.asarray(place_mm, dtype=float), np.asarray(stop, dtype=float)
        height_mm, turned, radius = np.hypot(x_mm, y_mm), np.arctan2(x_mm, y_mm), np.hypot(stop_x, stop_y)
        if np.any(height_mm > self.last_height_mm * (1 + 1e-9)):
            raise LensError(self.name, "sensor position", f"{height_mm.max():.4g} mm from the axis",
                            f"the lens's field ends at {self.last_height_mm:.4g} mm")
        azimuth = np.remainder(np.arctan2(stop_x, stop_y) - turned + np.pi, 2 * np.pi) - np.pi
        values = self._between(wavelength, even_place(height_mm / self.last_height_mm), even_place(radius / self.reach),
                               np.abs(azimuth) / np.pi)
        return sensor_rays(values, np.sign(azimuth), turned, radius)

    def bundles(self, heights_mm: np.ndarray, stop: np.ndarray) -> SensorRays:
        """Rays from sensor points on +y through the same stop points, at all wavelengths.

        As `rays`, but much faster for many rays.

        Parameters
        ----------
        heights_mm : array (height,)
        stop : array (2, ray)

        Returns
        -------
        SensorRays
            Arrays (wavelength, height, ray).
        """
        radius, azimuth = np.hypot(*stop), np.arctan2(*stop)
        values = self._values(heights_mm, radius, azimuth, slice(None))
        return sensor_rays(values, np.sign(azimuth), np.zeros_like(radius), radius)

    def _values(self, heights_mm, radius, azimuth, quantities):
        """Quantities of the table, given as a slice, at sensor points on +y and stop points: array (quantity,
        wavelength, height, ray)."""
        counts = self.coefficients.shape[1:4]
        by_height, by_radius, by_azimuth = (
            splines(share, count) for share, count in zip(
                (even_place(heights_mm / self.last_height_mm), even_place(radius / self.reach),
                 np.abs(azimuth) / np.pi), counts, strict=True))
        over_stop = scipy.sparse.csr_matrix(
            ((by_radius[1][:, :, None] * by_azimuth[1][:, None, :]).ravel(),
             (by_radius[0][:, :, None] * counts[2] + by_azimuth[0][:, None, :]).ravel(),
             np.arange(0, 16 * radius.size + 1, 16)), shape=(radius.size, counts[1] * counts[2]))
        coefficients = self.coefficients[..., quantities]
        values = np.empty((coefficients.shape[-1], len(self.wavelengths_nm), len(heights_mm), radius.size))
        for number, table in enumerate(coefficients):
            at_heights = np.einsum("ht,htraq->raqh", by_height[1], table[by_height[0]], optimize=True)
            over_stop_values = over_stop @ at_heights.reshape(counts[1] * counts[2], -1)
            values[:, number] = over_stop_values.reshape(radius.size, len(values), -1).transpose(1, 2, 0)
        return values

    def irradiance_per_radiance(self, heights_mm: np.ndarray) -> np.ndarray:
        """Irradiance at sensor points under uniform radiance, without the glass's transmittance.

        Sums the light of all passing rays along radii of the stop. Their margin is nearly linear in the squared
        radius, so a rim between two samples is interpolated.

        Parameters
        ----------
        heights_mm : array (height,)
            From the axis.

        Returns
        -------
        array (wavelength, height)
            In sr.
        """
        radii, azimuths = (min(most, per_ray * (count - 3)) for most, per_ray, count in zip(
            (RIM_RADII, RIM_AZIMUTHS), RIM_PER_RAY, self.coefficients.shape[2:4], strict=True))
        square, azimuth = np.linspace(0, 1, radii + 1), np.pi * (np.arange(azimuths) + 0.5) / azimuths
        radius, azimuth = np.meshgrid(np.sqrt(square), azimuth, indexing="ij")
        values = self._values(heights_mm, radius.ravel(), azimuth.ravel(), MARGIN_TO_WEIGHT)
        margin, _, weight = values.reshape(*values.shape[:3], *radius.shape)
        return light_within_rims(np.minimum(margin, 1 - radius**2), weight)

    def _between(self, wavelength, *shares):
        """Quantities at positions from 0 to 1 of height, radius and azimuth: array (quantity, ...)."""
        wavelength, *shares = np.broadcast_arrays(wavelength, *shares)
        first, weights = zip(*(cubic(share * (count - 3), count) for share, count in
                               zip(shares, self.coefficients.shape[1:4], strict=True)), strict=True)
        total = np.zeros((*wavelength.shape, self.coefficients.shape[-1]))
        for taps in product(range(4), repeat=3):
            weight = np.prod([each[tap] for each, tap in zip(weights, taps, strict=True)], axis=0)
            places = tuple(each + tap for each, tap in zip(first, taps, strict=True))
            total += weight[..., None] * self.coefficients[wavelength, *places]
        return np.moveaxis(total, -1, 0)


def ray_table(prescription: Prescription,
              wavelengths_nm: Sequence[float] | np.ndarray = WAVELENGTHS_NM, reach: float = 1.0, *,
              sketch: bool = False) -> RayTable:
    """Trace the ray table of a lens, at its focus and widest stop.

    A smaller stop has the same rays, at scaled stop points.

    Parameters
    ----------
    prescription : Prescription
    wavelengths_nm : sequence of float
        Wavelengths to trace; `RayTable.at` interpolates between them.
    reach : float
        `RayTable.reach`.
    sketch : bool
        Trace few rays, for coarse pixels.

    Raises
    ------
    LensError
        A prescription that cannot be traced.
    """
    heights, pupil = (SKETCHED_HEIGHTS, SKETCHED_PUPIL) if sketch else (HEIGHTS, PUPIL)
    system, wavelengths_nm = build_system(prescription), np.asarray(wavelengths_nm, dtype=float)
    end = light_end(system, tuple(wavelengths_nm[[0, -1]].tolist()))
    ends = trace_pupil(system, [end.height_mm], wavelengths_nm, HalfPupil(1, 1))
    last_height_mm = float(ends.chief_height_mm.max())
    if end.dark:
        last_height_mm = min(float(ends.chief_height_mm.min()),
                             farthest_aim_mm(system, system.indices_at(wavelengths_nm)))
    heights_mm = last_height_mm * np.sin(np.pi / 2 * np.linspace(0, 1, heights))
    values = _trace(system, heights_mm, wavelengths_nm, pupil, reach)
    if not sketch and missed_um(values, system) > FINE_UM:
        values = _trace(system, heights_mm, wavelengths_nm, FINER_PUPIL, reach)
    return RayTable(prescription.name, wavelengths_nm, last_height_mm, system.entrance_pupil_mm,
                    spline_coefficients(values).astype(np.float32), reach, end.dark)


def _trace(system: System, heights_mm, wavelengths_nm, pupil, reach):
    """Quantities of the table's rays: array (quantity, wavelength, height, radius, azimuth)."""
    indices = system.indices_at(wavelengths_nm)
    x_mm, y_mm = (reach * system.stop_semi_aperture_mm * place.ravel() for place in (pupil.x, pupil.y))
    slope_x, slope_y, aimed = aim_at_image(system, indices, heights_mm, x_mm, y_mm)
    with np.errstate(invalid="ignore"):
        traced = trace_both_ways(system.prescription, indices[:, :, None, None], x_mm, y_mm, slope_x, slope_y)
    from_eye = traced.entry - np.reshape([0.0, 0.0, system.entrance_pupil_mm], (3, 1, 1, 1))
    values, margin = traced_quantities(system, traced, from_eye, traced.before)
    known = aimed & np.isfinite(values[PATH])
    _check_chief_rays(system, heights_mm, wavelengths_nm, known)
    shape = (*known.shape[:2], *pupil.shape)
    *quantities, cosine_x, cosine_y = without_lost(values.reshape(-1, *shape), margin.reshape(shape),
                                                   known.reshape(shape))
    weight = np.abs(area_ratio(pupil, np.array([cosine_x, cosine_y]))) / reach**2
    return np.stack([*quantities, weight])


def traced_quantities(system: System, traced: BothWays, from_eye: np.ndarray, before: np.ndarray
                      ) -> tuple[np.ndarray, np.ndarray]:
    """Quantities of rays through points of the stop.

    Parameters
    ----------
    system : System
    traced : BothWays
        Arrays (..., wavelength, place, ray). The first ray of the first place is along the axis.
    from_eye, before : arrays (3, wavelength, place, ray)
        Their entry relative to the viewpoint, and direction there, in the sensor's axes.

    Returns
    -------
    values : array (quantity, wavelength, place, ray)
        `RayTable.coefficients`' foot, p and path, and the direction cosines x and y at the sensor.
    margin : array (wavelength, place, ray)
    """
    with np.errstate(invalid="ignore"):
        from_foot_mm = np.sum(from_eye * before, axis=0)
        path_mm = from_foot_mm + traced.path_mm
        margin = 1 - np.max(system.limits(traced.square_mm2), axis=0)
        return np.stack([*(from_eye - from_foot_mm * before)[:2], *before[:2] / (1 + before[2]),
                         path_mm - path_mm[:, :1, :1], *traced.direction[:2]]), margin


def missed_um(values: np.ndarray, system: System) -> float:
    """Bound of the splines' error over the radius for passing rays, as a distance on the sensor."""
    *_, p_x, p_y, margin, _, _ = values
    differences = np.hypot(*np.diff([p_x, p_y], 4, axis=-2))
    return MISSED * np.max(differences, where=margin[..., 2:-2, :] > 0, initial=0) * 2 * system.efl_mm * 1e3


def _check_chief_rays(system, heights_mm, wavelengths_nm, known):
    lost = np.argwhere(~known[:, :, 0])
    if lost.size:
        wavelength, height = lost[0]
        raise LensError(system.prescription.name, "sensor position", f"{heights_mm[height]:.4g} mm from the axis",
                        f"no ray through the middle of the stop reaches it at {wavelengths_nm[wavelength]:g} nm: "
                        "reduce the field")


def spline_coefficients(values: np.ndarray) -> np.ndarray:
    """`RayTable.coefficients` of values (quantity, wavelength, height, radius, azimuth) at the table's rays."""
    heights, radii, azimuths = values.shape[2:]
    by_height, by_radius = spline_matrix(heights, FREE, FREE), spline_matrix(radii, FREE, EVEN)
    around = {symmetry: spline_matrix(azimuths, symmetry, symmetry) for symmetry in (EVEN, ODD)}
    return np.stack([np.einsum("ih,jr,ka,whra->wijk", by_height, by_radius, around[symmetry], each, optimize=True)
                     for each, symmetry in zip(values, (ODD, EVEN, ODD, EVEN, EVEN, EVEN, EVEN), strict=True)], axis=-1)


def light_within_rims(margin: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """The mean weight of the passing rays, times pi, of arrays (..., radius, azimuth) at even squares of the radius."""
    def of_both(values):
        return values[..., :-1, :] + values[..., 1:, :]

    lit, both = of_both(np.maximum(margin, 0)), of_both(np.abs(margin))
    light = of_both(weight)
    return np.pi * (lit / np.maximum(both, 1e-30) * light / 2).mean(axis=(-2, -1))


def sensor_rays(values: np.ndarray, side: np.ndarray | float, turned: np.ndarray | float,
                radius: np.ndarray) -> SensorRays:
    """SensorRays from the table's quantities.

    `side` is the sign of the stop point's side of the sensor point's meridional plane, which is turned from +y.
    """
    foot_x, foot_y, p_x, p_y, margin, path_mm, weight = values
    foot_mm, p = _turned(foot_x * side, foot_y, turned), _turned(p_x * side, p_y, turned)
    square = np.sum(p**2, axis=0)
    direction = np.stack([*(2 * p), 1 - square]) / (1 + square)
    # from the foot, which is perpendicular to the ray, to the plane
    way_mm = np.sum(foot_mm * direction[:2], axis=0) / direction[2]**2
    return SensorRays(foot_mm + way_mm * direction[:2], direction, np.minimum(margin, 1 - radius**2), margin,
                      path_mm - way_mm, weight)


def _turned(x, y, azimuth):
    """Vectors (2, ...) in the sensor's axes, from components along the tangent and away from the axis."""
    sine, cosine = np.sin(azimuth), np.cos(azimuth)
    return np.stack([x * cosine + y * sine, y * cosine - x * sine])
