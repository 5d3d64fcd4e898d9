"""The rays of a lens as a table: from places of the sensor through places of the stop, out to the object.

A point of the scene at any depth is seen along these rays, so that depth and what near things hide follow from them.

The lens is one of revolution, so the table is one over the height of the sensor place and half of the stop. Between its
rays go cubic splines, of coefficients at even distances, for loops that read them. Heights and the stop's radii are
sines of even angles, as shares of the last: they lie closest where rays change most, towards the picture's corners and
the rim of a fast stop. Rays that do not get through are continued from those that do: splines see no edge.

Two rays may go from one place of the sensor through one place of the stop. Beyond what passes, the two come together
and there are none: where that is close, rays change as a square root does, and more radii are traced.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy import sparse
from scipy.ndimage import binary_dilation
from scipy.sparse.linalg import splu

from ..errors import LensError
from ..values import Value
from .aiming import aim_at_image
from .focus import build_system
from .prescription import Prescription
from .pupil import area_ratio
from .rays import HalfPupil, trace_pupil
from .system import System
from .trace import trace_both_ways
from .wavefront import polynomial_weights

WAVELENGTHS_NM = (400.0, 417.1, 469.5, 555.9, 653.2, 700.0)  # where polynomials over the wave number oscillate least
HEIGHTS, PUPIL = 33, HalfPupil(17, 33, close_at_rim=True)
FINER_PUPIL, FINE_UM = HalfPupil(33, 33, close_at_rim=True), 1.0  # and what splines may miss on the sensor without it
MISSED = 5 / 384  # of fourth differences, by cubic splines at most
TRUSTED = -0.3  # the margin of rays beyond what passes that still tell how it goes on; farther out they all but graze
LOST = -1.0  # the margin of a ray that does not reach the sensor, where it is not apertures that tell why
ORDER = 4  # of the differences that continued rays keep small, and cubic splines do not see
FAINT = 1e-5  # of first differences beside these, where too few rays are known
RIM_RADII, RIM_AZIMUTHS = 48, 64  # along which light is summed up over half of the stop
EVEN, ODD, FREE = (1, 0, -1), (1, 0, 1), (1, -4, 6, -4, 1)  # sums of coefficients at an end of splines that are 0


@dataclass(frozen=True, eq=False)
class SensorRays:
    """Rays from places of the sensor: arrays (..., ray), in the sensor's axes.

    Attributes
    ----------
    entrance_mm : array (2, ...)
        Where they cross the plane of the entrance pupil, through whose middle a camera without lens would see.
    direction : array (3, ...)
        Direction cosines before the lens, as the light goes: at a depth z before the plane a ray is at
        `entrance_mm - z * direction[:2] / direction[2]`.
    margin : array
        Positive where the ray passes: the least 1 - (r / semi-aperture)^2 over the surfaces and the stop.
    surface_margin : array
        That over the surfaces alone: smooth where the stop's rim takes turns with them.
    path_mm : array
        Optical path from the plane to the sensor, less that along the axis at this wavelength.
    weight : array
        Light: projected solid angle at the sensor of a unit of the stop's area, in squared semi-apertures. Summed up
        over what passes it is irradiance over radiance, but for the glass's transmittance.
    """

    entrance_mm: np.ndarray
    direction: np.ndarray
    margin: np.ndarray
    surface_margin: np.ndarray
    path_mm: np.ndarray
    weight: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class RayTable(Value):
    """Rays of a lens by wavelength, sensor place and stop place.

    Attributes
    ----------
    name : str
        The lens's.
    wavelengths_nm : array (wavelength,)
    last_height_mm : float
        From the axis to the last sensor place: the end of the lens's field.
    entrance_pupil_mm : float
        From the first surface to the plane of the entrance pupil, towards the image.
    coefficients : float32 array (wavelength, height, radius, azimuth, quantity)
        Of cubic B-splines at even distances, one more at either end than there are rays: over s = 2 / pi arcsin(share)
        from 0 to 1, of the last height and of the stop's radius, and over the azimuth from +y, where the sensor place
        is, by +x to -y. Quantities: the ray's place nearest to the middle of the entrance pupil (x, y), which unlike
        that on the plane stays close to it at any angle; p of its direction before the lens (x, y), whose cosines are
        (2 p, 1 - p^2) / (1 + p^2), as sure beside 90 degrees as on the axis; the margin at the surfaces; the optical
        path from that place; and the weight.
    """

    name: str
    wavelengths_nm: np.ndarray
    last_height_mm: float
    entrance_pupil_mm: float
    coefficients: np.ndarray

    def at(self, wavelengths_nm: Sequence[float] | np.ndarray) -> "RayTable":
        """The table at other wavelengths, by the polynomial over the wave number through those of this one.

        Raises
        ------
        LensError
            A wavelength beyond those of this one.
        """
        wavelengths_nm, (first, last) = np.asarray(wavelengths_nm, dtype=float), self.wavelengths_nm[[0, -1]]
        if np.any((wavelengths_nm < first) | (wavelengths_nm > last)):
            raise LensError(self.name, "wavelengths", wavelengths_nm.tolist(),
                            f"the table of rays holds for {first:g} to {last:g} nm: trace one for these")
        weights = polynomial_weights(1e3 / self.wavelengths_nm, 1e3 / wavelengths_nm).astype(np.float32)
        return replace(self, wavelengths_nm=wavelengths_nm, coefficients=np.tensordot(weights, self.coefficients, 1))

    def near(self, wavelengths_nm: Sequence[float] | np.ndarray) -> "RayTable":
        """As `at`, but beyond the table's wavelengths its last ones are held."""
        return self.at(np.clip(wavelengths_nm, *self.wavelengths_nm[[0, -1]]))

    def rays(self, wavelength: int | np.ndarray, place_mm: np.ndarray, stop: np.ndarray) -> SensorRays:
        """Rays from places of the sensor through places of the stop.

        Parameters
        ----------
        wavelength : int or array of int
            Which of the table's.
        place_mm : array (2, ...)
            On the sensor, x and y from the axis as the light has them: upside down.
        stop : array (2, ...)
            In semi-apertures of the stop, from the axis.

        Raises
        ------
        LensError
            A place beyond the table's last height.
        """
        (x_mm, y_mm), (stop_x, stop_y) = np.asarray(place_mm, dtype=float), np.asarray(stop, dtype=float)
        height_mm, turned, radius = np.hypot(x_mm, y_mm), np.arctan2(x_mm, y_mm), np.hypot(stop_x, stop_y)
        if np.any(height_mm > self.last_height_mm * (1 + 1e-9)):
            raise LensError(self.name, "sensor place", f"{height_mm.max():.4g} mm from the axis",
                            f"the lens's field ends at {self.last_height_mm:.4g} mm")
        azimuth = np.remainder(np.arctan2(stop_x, stop_y) - turned + np.pi, 2 * np.pi) - np.pi
        values = self._between(wavelength, _even(height_mm / self.last_height_mm), _even(radius),
                               np.abs(azimuth) / np.pi)
        return _sensor_rays(values, np.sign(azimuth), turned, radius)

    def bundles(self, heights_mm: np.ndarray, stop: np.ndarray) -> SensorRays:
        """Rays from places on +y of the sensor through the same places of the stop, at all wavelengths.

        As `rays`, in a small part of its time for many of them.

        Parameters
        ----------
        heights_mm : array (height,)
        stop : array (2, ray)

        Returns
        -------
        SensorRays
            Of arrays (wavelength, height, ray).
        """
        counts, (x, y) = self.coefficients.shape[1:4], stop
        radius, azimuth = np.hypot(x, y), np.arctan2(x, y)
        by_height, by_radius, by_azimuth = (
            _splines(share, count) for share, count in zip(
                (_even(heights_mm / self.last_height_mm), _even(radius), np.abs(azimuth) / np.pi), counts, strict=True))
        over_stop = sparse.csr_matrix(
            ((by_radius[1][:, :, None] * by_azimuth[1][:, None, :]).ravel(),
             (by_radius[0][:, :, None] * counts[2] + by_azimuth[0][:, None, :]).ravel(),
             np.arange(0, 16 * radius.size + 1, 16)), shape=(radius.size, counts[1] * counts[2]))
        values = np.empty((self.coefficients.shape[-1], len(self.wavelengths_nm), len(heights_mm), radius.size))
        for number, table in enumerate(self.coefficients):
            at_heights = np.einsum("ht,htraq->raqh", by_height[1], table[by_height[0]], optimize=True)
            found = over_stop @ at_heights.reshape(counts[1] * counts[2], -1)
            values[:, number] = found.reshape(radius.size, len(values), -1).transpose(1, 2, 0)
        return _sensor_rays(values, np.sign(azimuth), np.zeros_like(radius), radius)

    def irradiance_per_radiance(self, heights_mm: np.ndarray) -> np.ndarray:
        """Irradiance of places of the sensor in even radiance, but for the glass's transmittance.

        The light of all rays that pass: along radii of the stop, over the square of which their margin is nearly a
        straight line, so that its rim may lie between two of them.

        Parameters
        ----------
        heights_mm : array (height,)
            From the axis.

        Returns
        -------
        array (wavelength, height)
            In sr.
        """
        square, azimuth = np.linspace(0, 1, RIM_RADII + 1), np.pi * (np.arange(RIM_AZIMUTHS) + 0.5) / RIM_AZIMUTHS
        radius, azimuth = np.meshgrid(np.sqrt(square), azimuth, indexing="ij")
        found = self.bundles(heights_mm, np.stack([radius * np.sin(azimuth), radius * np.cos(azimuth)]).reshape(2, -1))
        margin, weight = (each.reshape(*each.shape[:2], *radius.shape) for each in (found.margin, found.weight))
        lit, both, light = (values[..., :-1, :] + values[..., 1:, :]
                            for values in (np.maximum(margin, 0), np.abs(margin), weight))
        return np.pi * (lit / np.maximum(both, 1e-30) * light / 2).mean(axis=(-2, -1))

    def _between(self, wavelength, *shares):
        """Quantities at shares of the even distances of height, radius and azimuth: array (quantity, ...)."""
        wavelength, *shares = np.broadcast_arrays(wavelength, *shares)
        first, weights = zip(*(_cubic(share * (count - 3), count) for share, count in
                               zip(shares, self.coefficients.shape[1:4], strict=True)), strict=True)
        total = np.zeros((*wavelength.shape, self.coefficients.shape[-1]))
        for taps in product(range(4), repeat=3):
            weight = np.prod([each[tap] for each, tap in zip(weights, taps, strict=True)], axis=0)
            places = tuple(each + tap for each, tap in zip(first, taps, strict=True))
            total += weight[..., None] * self.coefficients[wavelength, *places]
        return np.moveaxis(total, -1, 0)


def ray_table(prescription: Prescription,
              wavelengths_nm: Sequence[float] | np.ndarray = WAVELENGTHS_NM) -> RayTable:
    """Trace the table of rays of a lens, at its focus and widest stop.

    A smaller stop has the same rays, at its share of these places.

    Parameters
    ----------
    prescription : Prescription
    wavelengths_nm : sequence of float
        Those that are traced; `RayTable.at` tells all others between them.

    Raises
    ------
    LensError
        A prescription that cannot be traced.
    """
    system, wavelengths_nm = build_system(prescription), np.asarray(wavelengths_nm, dtype=float)
    ends = trace_pupil(system, [system.last_height_mm], wavelengths_nm, HalfPupil(1, 1))
    last_height_mm = float(ends.chief_height_mm.max())
    heights_mm = last_height_mm * np.sin(np.pi / 2 * np.linspace(0, 1, HEIGHTS))
    values = _trace(system, heights_mm, wavelengths_nm, PUPIL)
    if _missed_um(values, system) > FINE_UM:
        values = _trace(system, heights_mm, wavelengths_nm, FINER_PUPIL)
    return RayTable(prescription.name, wavelengths_nm, last_height_mm, system.entrance_pupil_mm,
                    spline_coefficients(values).astype(np.float32))


def _trace(system: System, heights_mm, wavelengths_nm, pupil):
    """Quantities of the rays at the table's places: array (quantity, wavelength, height, radius, azimuth)."""
    indices = system.indices_at(wavelengths_nm)
    x_mm, y_mm = (system.stop_semi_aperture_mm * place.ravel() for place in (pupil.x, pupil.y))
    slope_x, slope_y, aimed = aim_at_image(system, indices, heights_mm, x_mm, y_mm)
    with np.errstate(invalid="ignore"):
        traced = trace_both_ways(system.prescription, indices[:, :, None, None], x_mm, y_mm, slope_x, slope_y)
        before, behind = traced.before, traced.direction
        about = traced.entry - np.reshape([0.0, 0.0, system.entrance_pupil_mm], (3, 1, 1, 1))
        from_foot_mm = np.sum(about * before, axis=0)
        path_mm = from_foot_mm + traced.path_mm
        margin = 1 - np.max([square / semi_mm**2 for square, semi_mm in
                             zip(traced.square_mm2, system.semi_apertures_mm, strict=True)], axis=0)
    known = aimed & np.isfinite(path_mm)
    _check_chief_rays(system, heights_mm, wavelengths_nm, known)
    values = np.stack([*(about - from_foot_mm * before)[:2], *before[:2] / (1 + before[2]),
                       path_mm - path_mm[:, :1, :1], *behind[:2]])
    shape = (*known.shape[:2], *pupil.shape)
    known, margin, values = known.reshape(shape), margin.reshape(shape), values.reshape(-1, *shape)
    *entrance, path_mm, cosine_x, cosine_y = _continued(values, _trusted(known, np.nan_to_num(margin)))
    beyond, = _continued(margin[None], known)
    margin = np.where(known, margin, np.where(beyond < 0, beyond, LOST))
    within = np.minimum.accumulate(margin, axis=-2)  # farther out than what is lost nothing comes to pass again
    margin = _bounded(np.where(known, margin, within))
    weight = np.abs(area_ratio(pupil, np.array([cosine_x, cosine_y])))
    return np.stack([*entrance, margin, path_mm, weight])


def _bounded(margin):
    """Margins as they are down to half of LOST, and from there on to LOST at the least: splines between larger ones
    swing so far that rays come to pass which do not."""
    half = LOST / 2
    return np.where(margin < half, LOST - half**2 / np.minimum(margin, half), margin)


def _missed_um(values, system):
    """By what splines over the radius may miss rays that pass, as places of the sensor."""
    *_, p_x, p_y, margin, _, _ = values
    differences = np.hypot(*np.diff([p_x, p_y], 4, axis=-2))
    return MISSED * np.max(differences, where=margin[..., 2:-2, :] > 0, initial=0) * 2 * system.efl_mm * 1e3


def _trusted(known, margin):
    """Rays that tell how it goes on: those that pass, and beyond them neither those far out nor those beside lost ones.
    """
    beside = binary_dilation(~known, np.ones((1, 1, 3, 3)))
    return known & ((margin > 0) | (margin > TRUSTED) & ~beside)


def _check_chief_rays(system, heights_mm, wavelengths_nm, known):
    lost = np.argwhere(~known[:, :, 0])
    if lost.size:
        wavelength, height = lost[0]
        raise LensError(system.prescription.name, "sensor place", f"{heights_mm[height]:.4g} mm from the axis",
                        f"no ray gets there through the middle of the stop at {wavelengths_nm[wavelength]:g} nm: end "
                        "the field earlier")


def _continued(values, known):
    """Values (quantity, ..., radius, azimuth) with those that are not known such that differences are least."""
    values = values.copy()
    differences = _differences(*known.shape[-2:])
    for place in np.argwhere(~known.all(axis=(-2, -1))):
        seen, there = known[*place].ravel(), (slice(None), *place)
        missing, given = differences[:, ~seen], differences[:, seen]
        rows = values[there].reshape(len(values), -1)
        rows[:, ~seen] = splu((missing.T @ missing).tocsc()).solve(-(missing.T @ (given @ rows[:, seen].T))).T
        values[there] = rows.reshape(len(values), *known.shape[-2:])
    return values


def _differences(radii, azimuths):
    """Sparse matrix of differences over radii and azimuths."""
    def over(count, order):
        return sparse.csr_matrix(np.diff(np.eye(count), order, axis=0))

    return sparse.vstack([faint * each for order, faint in ((ORDER, 1.0), (1, FAINT)) for each in
                          (sparse.kron(over(radii, order), sparse.eye(azimuths)),
                           sparse.kron(sparse.eye(radii), over(azimuths, order)))]).tocsc()


def spline_coefficients(values: np.ndarray) -> np.ndarray:
    """`RayTable.coefficients` of values (quantity, wavelength, height, radius, azimuth) at the table's places."""
    heights, radii, azimuths = values.shape[2:]
    by_height, by_radius = _spline(heights, FREE, FREE), _spline(radii, FREE, EVEN)
    around = {symmetry: _spline(azimuths, symmetry, symmetry) for symmetry in (EVEN, ODD)}
    return np.stack([np.einsum("ih,jr,ka,whra->wijk", by_height, by_radius, around[symmetry], each, optimize=True)
                     for each, symmetry in zip(values, (ODD, EVEN, ODD, EVEN, EVEN, EVEN, EVEN), strict=True)], axis=-1)


def _spline(count, start, end):
    """Matrix that makes coefficients (count + 2) of values at even distances, by what those at both ends add up to."""
    rows = np.zeros((count + 2, count + 2))
    for node in range(count):
        rows[node, node:node + 3] = 1 / 6, 4 / 6, 1 / 6
    rows[-2, :len(start)], rows[-1, -len(end):] = start, end
    return np.linalg.inv(rows)[:, :count]


def _even(share):
    """Where a share of the last height or radius lies between 0 and 1, at even distances of the table's."""
    return 2 / np.pi * np.arcsin(np.minimum(share, 1))


def _cubic(place, count):
    """First of the four coefficients that count at a place, in their distances from the second, and their weights."""
    first = np.clip(np.floor(place).astype(int), 0, count - 4)
    t = place - first
    return first, ((1 - t)**3 / 6, 2 / 3 - t**2 + t**3 / 2, 2 / 3 - (1 - t)**2 + (1 - t)**3 / 2, t**3 / 6)


def _splines(share, count):
    """The four coefficients that count at shares of the even distances, and their weights: arrays (place, 4)."""
    first, weights = _cubic(share * (count - 3), count)
    return first[:, None] + np.arange(4), np.stack(weights, axis=-1)


def _sensor_rays(values, side, turned, radius):
    """SensorRays of the table's quantities at places of the stop on this side of the plane of the sensor place, which
    is turned from +y."""
    foot_x, foot_y, p_x, p_y, margin, path_mm, weight = values
    foot_mm, p = _turned(foot_x * side, foot_y, turned), _turned(p_x * side, p_y, turned)
    square = np.sum(p**2, axis=0)
    direction = np.stack([*(2 * p), 1 - square]) / (1 + square)
    # from the foot, which is square to the ray, to the plane
    way_mm = np.sum(foot_mm * direction[:2], axis=0) / direction[2]**2
    return SensorRays(foot_mm + way_mm * direction[:2], direction, np.minimum(margin, 1 - radius**2), margin,
                      path_mm - way_mm, weight)


def _turned(x, y, azimuth):
    """Vectors (2, ...) that are known along the tangent and away from the axis, in the sensor's axes."""
    sine, cosine = np.sin(azimuth), np.cos(azimuth)
    return np.stack([x * cosine + y * sine, y * cosine - x * sine])
