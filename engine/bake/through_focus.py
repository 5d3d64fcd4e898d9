"""PSFs of points at any depth, from the paths of a table's rays: diffraction through focus.

The table has rays from places of the sensor, and light goes the same ways back and forth: of each place of the stop
that place of the sensor is looked for from where a ray goes to the point. Optical path changes along the sensor as much
as the ray's direction cosine there tells, which is so known from the table, too.
"""

from dataclasses import replace

import numpy as np

from ..errors import InputError
from ..lens.lens import Lens
from .bake import LEAST_SAMPLES
from .diffraction import point_spread
from .quality import QUALITIES, Quality
from .ray_table import RayTable
from .rings import in_metres
from .wavefront import Wavefront, light_density
from .window import pitch_for_um, width_um

FARTHEST_MM = 1e9  # to which infinity is brought: what is lost of a wave is a thousandth, with pupils of 100 mm
STEP = 1e-3  # of the last height, for derivatives
STEPS = 5  # of Newton's method, with one derivative for all
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


def lens_at_depth(lens: Lens, rays: RayTable, depth_mm: float, *, quality: str = "standard") -> Lens:
    """A lens with the PSFs of points at a depth, in a window that holds their light: to be looked at.

    It has these at some of its heights and wavelengths alone. All else is as it is in the plane in focus.

    Parameters
    ----------
    lens : Lens
    rays : RayTable
        `lens_rays(lens)`.
    depth_mm : float
        As of `psf_at_depth`.
    quality : str

    Raises
    ------
    InputError, LensError
        As `psf_at_depth`.
    """
    _check_depth(depth_mm)
    taken = QUALITIES[quality]
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
                   transmittance=lens.transmittance[wavelengths])


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
    chief_mm = np.array([0.0, height_mm])
    point_mm, scale = _point(rays, wavelength, height_mm, depth_mm)
    stop = np.stack([pupil.x, pupil.y])
    landed_mm = np.broadcast_to(chief_mm[:, None, None], stop.shape)
    for _ in range(STEPS):
        traced = rays.rays(wavelength, landed_mm, stop)
        missed = traced.entrance_mm - depth_mm * traced.direction[:2] / traced.direction[2] - point_mm
        landed_mm = _inside(landed_mm - missed / scale, rays.last_height_mm)

    def path_mm(place_mm):
        """Optical path from the point to places of the sensor, its direction cosines at the point, and the rays."""
        traced = rays.rays(wavelength, place_mm, stop)
        to_point = np.stack([*(point_mm - traced.entrance_mm), np.full(stop.shape[1:], -depth_mm)])
        away_mm = np.sqrt(np.sum(to_point**2, axis=0))
        return traced.path_mm + away_mm, to_point[:2] / away_mm, traced

    total_mm, source, traced = path_mm(landed_mm)
    step_mm = STEP * rays.last_height_mm
    cosine = np.stack([path_mm(landed_mm + along)[0] - path_mm(landed_mm - along)[0]
                       for along in step_mm * np.eye(2)[:, :, None, None]]) / (2 * step_mm)
    from_chief_mm = landed_mm - np.reshape(chief_mm, (2, 1, 1))
    total_mm = total_mm - np.sum(cosine * from_chief_mm, axis=0)
    limits = 1 - traced.surface_margin[None]
    wavefront = Wavefront(pupil, float(rays.wavelengths_nm[wavelength]), total_mm - total_mm[0, 0], cosine,
                          light_density(pupil, source, cosine), limits[np.any(limits > 1, axis=(1, 2))])
    return wavefront, np.abs(from_chief_mm).max(axis=0)[wavefront.passing].max(initial=0.0)


def _point(rays, wavelength, height_mm, depth_mm):
    """Where the chief ray of a sensor place crosses the plane at a depth, and by how much, a mm on the sensor, its
    crossing moves across the field and along it: arrays (2, 1, 1)."""
    step_mm = STEP * rays.last_height_mm
    heights_mm = np.array([height_mm, height_mm - step_mm, min(height_mm + step_mm, rays.last_height_mm)])
    chief = rays.rays(wavelength, np.stack([0 * heights_mm, heights_mm]), np.zeros((2, 1)))
    if chief.direction[2].min() < np.cos(STEEPEST):
        raise InputError("options", "height", f"{height_mm:g} mm", "its rays come from the side: nothing there has a "
                                                                   "depth; give a place nearer to the axis")
    here, before, after = chief.entrance_mm[1] - depth_mm * chief.direction[1] / chief.direction[2]
    along = (after - before) / (heights_mm[2] - heights_mm[1])
    across = here / height_mm if height_mm > step_mm else along
    return np.reshape([0.0, here], (2, 1, 1)), np.reshape([across, along], (2, 1, 1))


def _inside(place_mm, last_height_mm):
    """Places, those beyond the field moved to its end: what rays do there goes on beyond."""
    return place_mm * np.minimum(1, (1 - 2 * STEP) * last_height_mm / np.maximum(np.hypot(*place_mm), 1e-12))
