"""A table of the rays of a lens without rotational symmetry: from places (x, y) of the sensor through the full stop.

As `ray_table`, with places at sines of equal angles in x and y, and with azimuths around the stop. If the field has a
mirror, the table covers one side of it, and the other side's rays are the mirror images.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ..prescription.prescription import Prescription
from ..prescription.system import System
from ..runtime.errors import LensError
from ..runtime.values import Value
from .fields import aim_at_places, find_fields, view_of
from .focus import build_system
from .lost_rays import continued, without_lost
from .pupil import area_ratio
from .ray_table import (
    FINE_UM,
    MARGIN_TO_WEIGHT,
    PATH,
    WAVELENGTHS_NM,
    RayTable,
    SensorRays,
    TableByWavelength,
    light_within_rims,
    missed_um,
    sensor_rays,
    traced_quantities,
)
from .rays import Pupil
from .splines import EVEN, FREE, even_place, periodic_spline_matrix, spline_matrix, splines
from .trace import trace_both_ways

MARGIN = slice(4, 5)  # of the table's quantities
PLACES, AZIMUTHS = 9, 32  # places from the middle of the field to its end, in x and in y
RADII, FINER_RADII, SKETCHED_RADII = 17, 33, 13
SKETCHED_PLACES, SKETCHED_AZIMUTHS = 5, 24
RIM_RADII, RIM_AZIMUTHS = 32, 64  # samples for the integral of light over the stop
BEYOND = 2  # order of the differences that the continuation beyond the end of the field minimizes
MIRRORED = np.array([-1, 1, -1, 1, 1, 1, 1]), np.array([1, -1, 1, -1, 1, 1, 1])
"""Signs of the table's quantities in a mirror image along x, and along y."""


@dataclass(frozen=True, eq=False, repr=False)
class GridRayTable(TableByWavelength, Value):
    """Rays of a lens by wavelength, place on the sensor and stop point.

    Attributes
    ----------
    name : str
        Name of the lens.
    wavelengths_nm : array (wavelength,)
    y_mm, x_mm : (float, float)
        Ends of the field, in the image as formed by the lens, upside down; the first is 0 along a mirrored axis.
    mirrored : (bool, bool)
        Whether the field's halves along y, and along x, are mirror images.
    entrance_pupil_mm : float
        From the first surface to the plane of the entrance pupil, towards the image.
    reach : float
        From the axis to the outermost point in the plane of the stop, in semi-apertures.
    coefficients : float32 array (wavelength, row, column, radius, azimuth, quantity)
        Coefficients of cubic B-splines at equal distances. Variables: 2 / pi arcsin of the place, from the middle of
        the table to its ends, and of the radius; and the azimuth from +y through +x around the stop. Quantities as in
        `RayTable`.
    """

    name: str
    wavelengths_nm: np.ndarray
    y_mm: tuple[float, float]
    x_mm: tuple[float, float]
    mirrored: tuple[bool, bool]
    entrance_pupil_mm: float
    coefficients: np.ndarray
    reach: float = 1.0

    @property
    def ends_mm(self) -> np.ndarray:
        """The first and the last place of the field along x, and along y: array (2, 2)."""
        return np.array([(-last, last) if of_axis else (first, last) for (first, last), of_axis in
                         zip((self.x_mm, self.y_mm), self.mirrored[::-1], strict=True)])

    @property
    def last_height_mm(self) -> float:
        """The largest distance along x or y from the axis to an end of the field."""
        return float(np.abs(self.ends_mm).max())

    def inside(self, place_mm: np.ndarray, share: float) -> np.ndarray:
        """Places (2, ...) clamped to a share of the field around its middle."""
        first_mm, last_mm = self.ends_mm.T.reshape(2, 2, *(1,) * (np.ndim(place_mm) - 1))
        middle_mm, half_mm = (first_mm + last_mm) / 2, share * (last_mm - first_mm) / 2
        return np.clip(place_mm, middle_mm - half_mm, middle_mm + half_mm)

    def rays(self, wavelength: int, place_mm: np.ndarray, stop: np.ndarray) -> SensorRays:
        """Rays from points of the sensor through points of the stop; as `RayTable.rays`.

        Places beyond the ends of the field have the rays of the ends.
        """
        x_mm, y_mm, stop_x, stop_y = np.broadcast_arrays(*place_mm, *stop)
        side_x, side_y = (np.where((at_mm < 0) & of_axis, -1.0, 1.0) for at_mm, of_axis in
                          zip((x_mm, y_mm), self.mirrored[::-1], strict=True))
        radius = np.hypot(stop_x, stop_y)
        values = _between(self.coefficients[wavelength], (
            _even_places(side_y * y_mm, self.y_mm, self.mirrored[0]),
            _even_places(side_x * x_mm, self.x_mm, self.mirrored[1]),
            even_place(radius / self.reach), _turns(side_x * stop_x, side_y * stop_y)))
        for side, images in zip((side_x, side_y), MIRRORED, strict=True):
            values = values * np.where(side < 0, images.reshape(-1, *(1,) * side.ndim), 1)
        return sensor_rays(values, 1.0, 0.0, radius)

    def bundles(self, x_mm: np.ndarray, y_mm: np.ndarray, stop: np.ndarray) -> SensorRays:
        """Rays from a mesh of places through the same stop points, at all wavelengths.

        Parameters
        ----------
        x_mm, y_mm : arrays (column,) and (row,)
            In the image as formed by the lens. Places beyond the ends of the field have the rays of the ends.
        stop : array (2, ray)
            From the axis, in semi-apertures.

        Returns
        -------
        SensorRays
            Arrays (wavelength, row, column, ray).
        """
        return sensor_rays(self._values(x_mm, y_mm, stop, slice(None)), 1.0, 0.0, np.hypot(*stop))

    def surface_margin(self, x_mm: np.ndarray, y_mm: np.ndarray, stop: np.ndarray) -> np.ndarray:
        """`SensorRays.surface_margin` of `bundles`, in a fraction of the time."""
        return self._values(x_mm, y_mm, stop, MARGIN)[0]

    def irradiance_per_radiance(self, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        """Irradiance at a mesh of places under uniform radiance: array (wavelength, row, column), in sr.

        As `RayTable.irradiance_per_radiance`.
        """
        azimuth = 2 * np.pi * (np.arange(RIM_AZIMUTHS) + 0.5) / RIM_AZIMUTHS
        radius, azimuth = np.meshgrid(np.sqrt(np.linspace(0, 1, RIM_RADII + 1)), azimuth, indexing="ij")
        stop = np.stack([radius * np.sin(azimuth), radius * np.cos(azimuth)])
        values = self._values(x_mm, y_mm, stop.reshape(2, -1), MARGIN_TO_WEIGHT)
        margin, _, weight = values.reshape(*values.shape[:4], *radius.shape)
        return light_within_rims(np.minimum(margin, 1 - radius**2), weight)

    def _values(self, x_mm, y_mm, stop, quantities):
        """Quantities of the table, given as a slice, at a mesh of places and stop points: array (quantity, wavelength,
        row, column, ray)."""
        values = np.empty((len(MIRRORED[0][quantities]), len(self.wavelengths_nm), len(y_mm), len(x_mm), stop.shape[1]))
        for rows, side_y in _sides(y_mm, self.mirrored[0]):
            for columns, side_x in _sides(x_mm, self.mirrored[1]):
                signs = np.where(side_x < 0, MIRRORED[0], 1) * np.where(side_y < 0, MIRRORED[1], 1)
                part = self._of_table(side_x * x_mm[columns], side_y * y_mm[rows],
                                      stop * np.reshape([side_x, side_y], (2, 1)), quantities)
                values[:, :, rows[:, None], columns] = part * np.reshape(signs[quantities], (-1, 1, 1, 1, 1))
        return values

    def _of_table(self, x_mm, y_mm, stop, quantities):
        """As `_values`, for places on the side that the table covers."""
        radii, azimuths = self.coefficients.shape[3:5]
        rows, columns = (_weights(_even_places(places_mm, ends_mm, mirrored), count) for places_mm, ends_mm, mirrored,
                         count in zip((y_mm, x_mm), (self.y_mm, self.x_mm), self.mirrored,
                                      self.coefficients.shape[1:3], strict=True))
        over_stop = _over_stop(np.hypot(*stop) / self.reach, _turns(*stop), radii, azimuths)
        values = []
        for table in self.coefficients[..., quantities]:
            of_rays = over_stop @ table.transpose(2, 3, 4, 0, 1).reshape(radii * azimuths, -1)
            at_rows = rows @ of_rays.reshape(stop.shape[1], -1, *table.shape[:2])
            values.append((at_rows @ columns.T).transpose(1, 2, 3, 0))
        return np.stack(values, axis=1)


def _sides(places_mm, mirrored):
    """Indices of the places on each side of an axis, and the sign that moves them to the table's side."""
    below = (places_mm < 0) & mirrored
    return [(np.flatnonzero(each), side) for each, side in ((~below, 1.0), (below, -1.0)) if each.any()]


def _even_places(places_mm, ends_mm, mirrored):
    """Positions from 0 to 1, linear in the table's index, of places between its ends."""
    first_mm, last_mm = ends_mm
    if mirrored:
        return even_place(places_mm / last_mm)
    return (1 + even_place((2 * places_mm - first_mm - last_mm) / (last_mm - first_mm))) / 2


def _weights(share, count):
    """Matrix of the coefficients' weights at positions from 0 to 1: array (place, count)."""
    matrix = np.zeros((share.size, count))
    np.put_along_axis(matrix, *splines(share, count), axis=1)
    return matrix


def _turns(stop_x, stop_y):
    """Azimuths of stop points, from 0 to 1."""
    return np.remainder(np.arctan2(stop_x, stop_y) / (2 * np.pi), 1)


def _between(coefficients, shares):
    """Quantities of one wavelength at positions from 0 to 1, arrays (...), of row, column, radius and azimuth: array
    (quantity, ...)."""
    shape = np.shape(shares[0])
    index, weight = np.zeros((shares[0].size, 1), int), np.ones((shares[0].size, 1))
    for share, count in zip(shares, coefficients.shape, strict=False):
        places, weights = splines(share.ravel(), count)
        index = (index[:, :, None] * count + places[:, None]).reshape(len(index), -1)
        weight = (weight[:, :, None] * weights[:, None]).reshape(index.shape)
    values = coefficients.reshape(-1, coefficients.shape[-1])[index]
    return np.einsum("rk,rkq->qr", weight, values, optimize=True).reshape(-1, *shape)


def _over_stop(radius, turns, radii, azimuths):
    """Sparse matrix of the coefficients' weights at stop points: (ray, radius * azimuth)."""
    by_radius = splines(even_place(radius), radii)
    by_azimuth = splines(turns, azimuths)
    return scipy.sparse.csr_matrix(
        ((by_radius[1][:, :, None] * by_azimuth[1][:, None, :]).ravel(),
         (by_radius[0][:, :, None] * azimuths + by_azimuth[0][:, None, :]).ravel(),
         np.arange(0, 16 * radius.size + 1, 16)), shape=(radius.size, radii * azimuths))


def grid_ray_table(prescription: Prescription, y_mm: tuple[float, float], x_mm: tuple[float, float],
                   mirrored: tuple[bool, bool], wavelengths_nm: Sequence[float] | np.ndarray = WAVELENGTHS_NM,
                   reach: float = 1.0, *, sketch: bool = False) -> GridRayTable:
    """Trace the ray table of a lens, at its focus and widest stop.

    Parameters
    ----------
    prescription : Prescription
    y_mm, x_mm : (float, float)
        Ends of the field, in the image as formed by the lens; 0 and the last along a mirrored axis.
    mirrored : (bool, bool)
        Whether the field's halves along y, and along x, are mirror images.
    wavelengths_nm : sequence of float
        Wavelengths to trace; `GridRayTable.at` interpolates between them.
    reach : float
        `GridRayTable.reach`.
    sketch : bool
        Trace few rays, for coarse pixels.

    Raises
    ------
    LensError
        A prescription that cannot be traced.
    """
    system, wavelengths_nm = build_system(prescription), np.asarray(wavelengths_nm, dtype=float)
    axes_mm = table_axes(y_mm, x_mm, mirrored, SKETCHED_PLACES if sketch else PLACES)
    values = _trace(system, axes_mm, wavelengths_nm,
                    table_pupil(SKETCHED_RADII, SKETCHED_AZIMUTHS) if sketch else table_pupil(), reach)
    if not sketch and missed_um(values, system) > FINE_UM:
        values = _trace(system, axes_mm, wavelengths_nm, table_pupil(FINER_RADII), reach)
    return GridRayTable(prescription.name, wavelengths_nm, y_mm, x_mm, mirrored, system.entrance_pupil_mm,
                        grid_coefficients(values, mirrored).astype(np.float32), reach)


def table_axes(y_mm: tuple[float, float], x_mm: tuple[float, float], mirrored: tuple[bool, bool],
               places: int = PLACES) -> list[np.ndarray]:
    """y (row,) and x (column,) of a table's places between the ends of the field."""
    return [_places_mm(*each, places) for each in zip((y_mm, x_mm), mirrored, strict=True)]


def table_pupil(radii: int = RADII, azimuths: int = AZIMUTHS) -> Pupil:
    """The rays of a place in a table."""
    return Pupil(np.sin(np.pi / 2 * np.linspace(0, 1, radii)), 2 * np.pi / azimuths * np.arange(azimuths))


def _places_mm(ends_mm, mirrored, count):
    """Places of a table from its middle, or its first end, to its last end."""
    first_mm, last_mm = ends_mm
    if mirrored:
        return last_mm * np.sin(np.pi / 2 * np.linspace(0, 1, count))
    across = np.sin(np.pi / 2 * np.linspace(-1, 1, 2 * count - 1))
    return (first_mm + last_mm) / 2 + (last_mm - first_mm) / 2 * across


def _trace(system: System, axes_mm, wavelengths_nm, pupil, reach):
    """Quantities of the table's rays: array (quantity, wavelength, row, column, radius, azimuth)."""
    x_mm, y_mm = (reach * system.stop_semi_aperture_mm * each.ravel() for each in (pupil.x, pupil.y))
    row_mm, column_mm = np.meshgrid(*axes_mm, indexing="ij")
    places_mm = np.stack([[0.0, *column_mm.ravel()], [0.0, *row_mm.ravel()]])  # the first is on the axis
    view = view_of(system)
    slope, aimed = aim_at_places(system, view, find_fields(system, view, places_mm, wavelengths_nm), places_mm, x_mm,
                                 y_mm)
    with np.errstate(invalid="ignore"):
        traced = trace_both_ways(system.prescription, system.indices_at(wavelengths_nm)[:, :, None, None], x_mm, y_mm,
                                 *slope)
    from_eye = view.turned(traced.entry - view.viewpoint_mm.reshape(3, 1, 1, 1))
    values, margin = traced_quantities(system, traced, from_eye, view.turned(traced.before))
    known = aimed & np.isfinite(values[PATH])
    _check_axis(system, known[:, 0, 0], wavelengths_nm)
    covered = np.flatnonzero(known[:, 1:, 0].all(axis=0))

    def of_covered(each):
        return each[..., covered + 1, :].reshape(*each.shape[:-2], covered.size, *pupil.shape)

    values, margin, known = of_covered(values), of_covered(margin), of_covered(known)
    *quantities, cosine_x, cosine_y = without_lost(values, margin, known, around=True)
    weight = np.abs(area_ratio(pupil, np.array([cosine_x, cosine_y]))) / reach**2
    return _beyond_field(np.stack([*quantities, weight]), covered, row_mm.shape)


def _check_axis(system, known, wavelengths_nm):
    if not known.all():
        raise LensError(system.prescription.name, "sensor position", "0 mm from the axis",
                        f"no ray through the middle of the stop reaches it at {wavelengths_nm[~known][0]:g} nm")


def _beyond_field(values, covered, shape):
    """Values (quantity, wavelength, place, radius, azimuth) of covered places on the complete mesh: array (quantity,
    wavelength, row, column, radius, azimuth), continued beyond the places that chief rays reach."""
    complete = np.zeros((*values.shape[:2], *values.shape[3:], np.prod(shape)))
    complete[..., covered] = np.moveaxis(values, 2, -1)
    known = np.isin(np.arange(complete.shape[-1]), covered).reshape(shape)
    complete = complete.reshape(*complete.shape[:-1], *shape)
    if not known.all():
        complete = continued(complete.reshape(-1, *shape), known, order=BEYOND).reshape(complete.shape)
    return np.moveaxis(complete, (-2, -1), (2, 3))


def grid_coefficients(values: np.ndarray, mirrored: tuple[bool, bool]) -> np.ndarray:
    """`GridRayTable.coefficients` of values (quantity, wavelength, row, column, radius, azimuth) at its rays."""
    radii, azimuths = values.shape[4:]
    azimuth = np.arange(azimuths)
    for axis, of_axis, images, signs in zip((2, 3), mirrored, (azimuths // 2 - azimuth, -azimuth), MIRRORED[::-1],
                                            strict=True):
        values = np.moveaxis(values, axis, 0)
        count = len(values)
        if of_axis:
            image = values[:0:-1].take(images, axis=-1, mode="wrap") * signs.reshape(-1, 1, 1, 1, 1)
            values = np.concatenate([image, values])
        over_places = spline_matrix(len(values), FREE, FREE)[len(values) - count:]
        values = np.moveaxis(np.tensordot(over_places, values, 1), 0, axis)
    return np.einsum("ks,la,qwijsa->wijklq", spline_matrix(radii, FREE, EVEN), periodic_spline_matrix(azimuths), values,
                     optimize=True)


LensRays = RayTable | GridRayTable
"""The table of a lens's rays."""
