"""PSFs of points at any depth, from the paths of a table's rays: diffraction through focus.

The table has rays from places of the sensor, and light goes the same ways back and forth: of each place of the stop
that place of the sensor is looked for from where a ray goes to the point. Optical path changes along the sensor as much
as the ray's direction cosine there tells, which is so known from the table, too.
"""

from dataclasses import replace

import numpy as np

from ..errors import InputError
from ..lens.lens import Lens
from .aiming import broyden_steps
from .bake import LEAST_SAMPLES
from .diffraction import point_spread
from .quality import QUALITIES, Quality
from .ray_table import RayTable
from .rings import in_metres
from .wavefront import Wavefront, continued, light_density
from .window import pitch_for_um, width_um

FARTHEST_MM = 1e9  # to which infinity is brought: what is lost of a wave is a thousandth, with pupils of 100 mm
STEP = 1e-3  # of the last height, for derivatives
FOUND = 1e-6  # of it: by what rays miss that are found
BESIDE = 0.6  # of a window: its half, and a little for what diffraction does beyond the rays
MOST_HEIGHTS, MOST_WAVELENGTHS = 17, 7
STEEPEST = np.radians(85.0)  # of chief rays: beyond, hardly anything has a depth


def psf_at_depth(rays: RayTable, wavelength_nm: float, height_mm: float, depth_mm: float, pitch_um: float,
                 samples: int, *, quality: str = "standard") -> np.ndarray:
    """PSF of a point at a depth, by diffraction: Huygens' sum over the pupil with the lens's own paths.

    Parameters
    ----------
    rays : RayTable
        `lens_rays(lens)`.
    wavelength_nm : float
    height_mm : float
        Where the point's chief ray, which goes through the middle of the stop, lands on the sensor: from the axis.
    depth_mm : float
        Of the point, along the axis from the entrance pupil; inf for one infinitely far away.
    pitch_um : float
        Distance between samples; each is the mean over a square of this side.
    samples : int
        Along v and u; odd.
    quality : str
        One of `QUALITIES`: how finely the wavefront is taken.

    Returns
    -------
    array (v, u)
        Of unit sum, as the PSFs of lens data are: the chief ray at `samples // 2`, +v away from the axis.

    Raises
    ------
    InputError
        A depth that is no positive distance, or a place whose chief ray comes from beside the lens.
    LensError
        A height or wavelength beyond the table's, or a wavefront too wide or too rough to be summed up.
    """
    _check_depth(depth_mm)
    taken = QUALITIES[quality]
    wavefront, spread_mm = _wavefront(rays.at([wavelength_nm]), 0, height_mm, depth_mm, taken.pupil)
    psf = _summed(wavefront, spread_mm, pitch_um, samples, taken)
    light = psf.sum()
    if not light > 0:
        raise InputError("options", "height", f"{height_mm:g} mm", "no light gets through the lens to this place")
    return psf / light


def landings_mm(rays: RayTable, wavelength_nm: float, height_mm: float, depth_mm: float, stop: np.ndarray
                ) -> tuple[np.ndarray, np.ndarray]:
    """Where rays of a point land: its PSF by geometry.

    Parameters
    ----------
    rays, wavelength_nm, height_mm, depth_mm
        As of `psf_at_depth`.
    stop : array (2, ray)
        Places that rays go through, in semi-apertures of the stop; the sensor place is on the side of +y.

    Returns
    -------
    array (2, ray)
        x and y from the chief ray, +y away from the axis.
    bool array (ray,)
        Which rays pass.

    Raises
    ------
    InputError, LensError
        As `psf_at_depth`.
    """
    _check_depth(depth_mm)
    table = rays.at([wavelength_nm])
    landed_mm, _, lost = _landings_mm(table, 0, height_mm, min(depth_mm, FARTHEST_MM), stop)
    passing = table.rays(0, _inside(landed_mm, rays.last_height_mm), stop).margin > 0
    return landed_mm - [[0.0], [height_mm]], passing & ~lost


def lens_at_depth(lens: Lens, rays: RayTable, depth_mm: float) -> Lens:
    """A lens with the PSFs of points at a depth, in a window that holds their light: to be looked at.

    It has these at some of its heights and wavelengths alone. All else is as it is in the plane in focus.

    Parameters
    ----------
    lens : Lens
    rays : RayTable
        `lens_rays(lens)`.
    depth_mm : float
        As of `psf_at_depth`.

    Raises
    ------
    InputError, LensError
        As `psf_at_depth`.
    """
    _check_depth(depth_mm)
    taken = QUALITIES["standard"]
    heights, wavelengths = (np.unique(np.rint(np.linspace(0, size - 1, most)).astype(int)) for size, most in
                            ((lens.heights_mm.size, MOST_HEIGHTS), (lens.wavelengths_nm.size, MOST_WAVELENGTHS)))
    rays, tables = rays.at(lens.wavelengths_nm[wavelengths]), np.ix_(wavelengths, heights)
    real_mm = lens.real_height_mm[tables]
    found = [[_wavefront(rays, wavelength, min(height_mm, rays.last_height_mm), depth_mm, taken.pupil)
              for height_mm in row] for wavelength, row in enumerate(real_mm)]
    widest = max((one for row in found for one in row), key=lambda one: one[1])
    samples = max(lens.psf.shape[-1], LEAST_SAMPLES)
    pitch_um = pitch_for_um(width_um(widest[0], 2e3 * widest[1] + lens.psf_pitch_um, taken.sums), samples)
    psf = np.array([[_summed(wavefront, spread_mm, pitch_um, samples, taken) for wavefront, spread_mm in row]
                    for row in found])
    light = psf.sum(axis=(2, 3))
    return replace(lens, name=f"{lens.name}, points at {in_metres(depth_mm)}", heights_mm=lens.heights_mm[heights],
                   wavelengths_nm=lens.wavelengths_nm[wavelengths], real_height_mm=real_mm,
                   relative_illumination=lens.relative_illumination[tables], psf=psf / light[..., None, None],
                   psf_pitch_um=pitch_um, enclosed_energy=np.minimum(light, 1),
                   transmittance=lens.transmittance[wavelengths], point_flux=lens.point_flux[tables])


def _check_depth(depth_mm):
    if not depth_mm > 0:
        raise InputError("options", "depth", depth_mm, "expected a distance in mm before the entrance pupil")


def _summed(wavefront, spread_mm, pitch_um, samples, taken: Quality):
    """PSF in shares of all light; its sum repeats itself beyond what comes into the window."""
    spread = spread_mm * 1e3 / (pitch_um * samples)
    return point_spread(wavefront, pitch_um, samples,
                        replace(taken.sums, repeat=max(taken.sums.repeat, spread + BESIDE)))


def _wavefront(rays, wavelength, height_mm, depth_mm, pupil):
    """The wavefront of a point at a depth, and how far from its chief ray its rays land, in mm."""
    depth_mm = min(depth_mm, FARTHEST_MM)
    stop = np.stack([pupil.x, pupil.y])
    landed_mm, point_mm, lost = _landings_mm(rays, wavelength, height_mm, depth_mm, stop)
    landed_mm = continued(landed_mm, lost)
    seen_mm = _inside(landed_mm, rays.last_height_mm)

    def path_mm(place_mm):
        """Optical path from the point to places of the sensor, its direction cosines at the point, and the rays."""
        traced = rays.rays(wavelength, place_mm, stop)
        to_point = np.stack([*(point_mm - traced.entrance_mm), np.full(pupil.shape, -depth_mm)])
        away_mm = np.sqrt(np.sum(to_point**2, axis=0))
        return traced.path_mm + away_mm, to_point[:2] / away_mm, traced

    total_mm, source, traced = path_mm(seen_mm)
    step_mm = STEP * rays.last_height_mm
    cosine = np.stack([path_mm(seen_mm + along)[0] - path_mm(seen_mm - along)[0]
                       for along in step_mm * np.eye(2)[:, :, None, None]]) / (2 * step_mm)
    chief_mm = np.reshape([0.0, height_mm], (2, 1, 1))
    total_mm = total_mm - np.sum(cosine * (seen_mm - chief_mm), axis=0)
    total_mm, source, cosine = (continued(each, lost) for each in (total_mm, source, cosine))
    limits = np.where(lost, 2.0, 1 - traced.surface_margin)[None]
    wavefront = Wavefront(pupil, float(rays.wavelengths_nm[wavelength]), total_mm - total_mm[0, 0], cosine,
                          light_density(pupil, source, cosine), limits[np.any(limits > 1, axis=(1, 2))])
    return wavefront, np.abs(landed_mm - chief_mm).max(axis=0)[wavefront.passing].max(initial=0.0)


def _landings_mm(rays, wavelength, height_mm, depth_mm, stop):
    """Where rays of a point through places of the stop land, the point's x and y, and which rays are not found.

    By Broyden's method, from the derivatives of where chief rays cross the point's plane.
    """
    step_mm = STEP * rays.last_height_mm
    heights_mm = np.array([height_mm, height_mm - step_mm, min(height_mm + step_mm, rays.last_height_mm)])
    chief = rays.rays(wavelength, np.stack([0 * heights_mm, heights_mm]), np.zeros((2, 1)))
    if chief.direction[2].min() < np.cos(STEEPEST):
        raise InputError("options", "height", f"{height_mm:g} mm", "its rays come from the side: nothing there has a "
                                                                   "depth; give a place nearer to the axis")
    here, before, after = _crossing_mm(chief, depth_mm)[1]
    along = (after - before) / (heights_mm[2] - heights_mm[1])
    across = here / height_mm if height_mm > step_mm else along
    chief_mm, point_mm, scale = (np.reshape(each, (2, *(1,) * (stop.ndim - 1))) for each in
                                 ((0.0, height_mm), (0.0, here), (across, along)))

    def missed(stop_x, stop_y, x, y):
        place_mm = rays.last_height_mm * np.stack([x, y])
        seen_mm = _inside(place_mm, rays.last_height_mm)
        crossing_mm = _crossing_mm(rays.rays(wavelength, seen_mm, np.stack([stop_x, stop_y])), depth_mm)
        return ((crossing_mm - point_mm.reshape(2, 1)) / scale.reshape(2, 1) + place_mm - seen_mm) / rays.last_height_mm

    flat = stop.reshape(2, -1)
    start = (chief_mm + 0 * stop).reshape(2, -1) / rays.last_height_mm
    found, off = broyden_steps(missed, tuple(flat), start, np.eye(2)[..., None] + 0 * flat[0])
    return (rays.last_height_mm * found).reshape(stop.shape), point_mm, (off > FOUND).reshape(stop.shape[1:])


def _crossing_mm(traced, depth_mm):
    """Where rays cross a plane before the entrance pupil: array (2, ...)."""
    return traced.entrance_mm - depth_mm * traced.direction[:2] / traced.direction[2]


def _inside(place_mm, last_height_mm):
    """Places, those beyond the field moved to its end: what rays do there is taken to go on."""
    return place_mm * np.minimum(1, (1 - 2 * STEP) * last_height_mm / np.maximum(np.hypot(*place_mm), 1e-12))
