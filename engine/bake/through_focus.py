"""PSFs of points at any depth, from the optical paths of a ray table: diffraction through focus.

The table has rays from sensor points, and ray paths are reversible. For each stop point, the solver finds the sensor
point whose ray goes to the object point. The gradient of the optical path along the sensor is the ray's direction
cosine there, so the table yields it, too.
"""

from dataclasses import replace

import numpy as np

from ..lens import GridLens, Lens
from ..rays.aiming import broyden_steps
from ..rays.grid_rays import GridRayTable, LensRays
from ..rays.ray_table import RayTable
from ..rays.rings import in_metres
from ..runtime.errors import InputError
from .diffraction import point_spread
from .quality import QUALITIES, Quality
from .sampling import LEAST_SAMPLES
from .wavefront import Wavefront, continued, light_density
from .window import pitch_for_um, width_um

FARTHEST_MM = 1e9  # replaces infinity: an error of a thousandth of a wave for pupils of 100 mm
STEP = 1e-3  # relative to the last height, for derivatives
CONVERGED = 1e-6  # largest error of converged rays, relative to the last height
HALF_WINDOW = 0.6  # of a window, with a margin for diffraction beyond the rays
MOST_HEIGHTS, MOST_LINES, MOST_WAVELENGTHS = 17, 5, 7
INSIDE = 1 - 2 * STEP  # of the field: derivatives have places on both sides
STEEPEST = np.radians(85.0)  # of chief rays: points beyond hardly have a depth


def psf_at_depth(rays: RayTable, wavelength_nm: float, height_mm: float, depth_mm: float, pitch_um: float,
                 samples: int, *, quality: str = "standard") -> np.ndarray:
    """PSF of a point at a depth, by diffraction: Huygens' sum over the pupil with the lens's optical paths.

    Parameters
    ----------
    rays : RayTable
        `lens_rays(lens)` of a rotationally symmetric lens.
    wavelength_nm : float
    height_mm : float
        Height of the point's chief ray, which goes through the centre of the stop, on the sensor.
    depth_mm : float
        Depth of the point, along the axis from the entrance pupil; inf for a point at infinity.
    pitch_um : float
        Distance between samples; each is the mean over a square of this side.
    samples : int
        Along v and u; odd.
    quality : str
        One of `QUALITIES`: sampling of the wavefront.

    Returns
    -------
    array (v, u)
        Unit sum, as the PSFs of lens data: the chief ray at `samples // 2`, +v away from the axis.

    Raises
    ------
    InputError
        A depth that is not a positive distance, or a chief ray that enters the lens nearly sideways.
    LensError
        A height or wavelength outside the table, or a wavefront too wide or too rough to compute.

    Examples
    --------
    >>> from lensfield import lens_rays, load_lens, psf_at_depth
    >>> rays = lens_rays(load_lens("tessar-50mm", quality="preview", wavelengths_nm=[550]))
    >>> psf = psf_at_depth(rays, 550, height_mm=10.0, depth_mm=2000.0, pitch_um=10.0, samples=65)
    >>> psf.shape, round(psf.sum(), 3)
    ((65, 65), 1.0)
    """
    _check_depth(depth_mm)
    fineness = QUALITIES[quality]
    return _psf(rays.at([wavelength_nm]), (0.0, height_mm), depth_mm, pitch_um, samples, fineness, fineness.pupil)


def psf_at_place(rays: GridRayTable, wavelength_nm: float, place_mm: tuple[float, float], depth_mm: float,
                 pitch_um: float, samples: int, *, quality: str = "standard") -> np.ndarray:
    """PSF of a point at a depth through a lens without rotational symmetry, as `psf_at_depth`.

    Parameters
    ----------
    rays, wavelength_nm, depth_mm, pitch_um, samples, quality
        As in `psf_at_depth`.
    place_mm : (float, float)
        x and y of the sensor, in the upright picture, where the point's chief ray lands.

    Returns
    -------
    array (v, u)
        +v upwards, +u to the right.

    Raises
    ------
    InputError, LensError
        As `psf_at_depth`.
    """
    _check_depth(depth_mm)
    fineness, inverted_mm = QUALITIES[quality], (-place_mm[0], -place_mm[1])
    return _psf(rays.at([wavelength_nm]), inverted_mm, depth_mm, pitch_um, samples, fineness, fineness.full_pupil
                )[::-1, ::-1]


def _psf(rays, place_mm, depth_mm, pitch_um, samples, fineness: Quality, pupil):
    """PSF of unit sum at the first wavelength of a table, as the lens forms it."""
    wavefront, spread_mm = _wavefront(rays, 0, place_mm, depth_mm, pupil)
    psf = _summed(wavefront, spread_mm, pitch_um, samples, fineness)
    light = psf.sum()
    if not light > 0:
        raise InputError("options", "height", _distance(place_mm), "no light reaches this height through the lens")
    return psf / light


def landings_mm(rays: RayTable, wavelength_nm: float, height_mm: float, depth_mm: float, stop: np.ndarray
                ) -> tuple[np.ndarray, np.ndarray]:
    """Positions of a point's rays on the sensor: its geometric PSF.

    Parameters
    ----------
    rays, wavelength_nm, height_mm, depth_mm
        As in `psf_at_depth`.
    stop : array (2, ray)
        Stop points of the rays, in semi-apertures; the sensor point is at +y.

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
    landed_mm, _, lost = _landings_mm(table, 0, (0.0, height_mm), min(depth_mm, FARTHEST_MM), stop)
    passing = table.rays(0, table.inside(landed_mm, INSIDE), stop).margin > 0
    return landed_mm - [[0.0], [height_mm]], passing & ~lost


def lens_at_depth(lens: Lens, rays: LensRays, depth_mm: float) -> Lens:
    """A lens with the PSFs of points at a depth, in a window that contains their light, for plots and curves.

    The result has only some of the lens's heights, or nodes, and wavelengths. Its other data are those of the plane in
    focus.

    Parameters
    ----------
    lens : Lens
    rays : LensRays
        `lens_rays(lens)`.
    depth_mm : float
        As in `psf_at_depth`.

    Raises
    ------
    InputError, LensError
        As `psf_at_depth`.
    """
    _check_depth(depth_mm)
    lens, fineness = _thinned(lens), QUALITIES["standard"]
    rays, samples = rays.at(lens.wavelengths_nm), max(lens.psf.shape[-1], LEAST_SAMPLES)
    pupil = fineness.full_pupil if isinstance(lens, GridLens) else fineness.pupil
    wavefronts = [[_wavefront(rays, wavelength, place_mm, depth_mm, pupil) for place_mm in row]
                  for wavelength, row in enumerate(_chief_places_mm(lens, rays))]
    widest = max((one for row in wavefronts for one in row), key=lambda one: one[1])
    pitch_um = pitch_for_um(width_um(widest[0], 2e3 * widest[1] + lens.psf_pitch_um), samples)
    psf = np.array([[_summed(wavefront, spread_mm, pitch_um, samples, fineness) for wavefront, spread_mm in row]
                    for row in wavefronts])
    light = psf.sum(axis=(2, 3))
    psf = (psf / light[..., None, None]).reshape(*lens.psf.shape[:-2], samples, samples)
    return replace(lens, name=f"{lens.name}, points at {in_metres(depth_mm)}", psf_pitch_um=pitch_um,
                   psf=psf[..., ::-1, ::-1] if isinstance(lens, GridLens) else psf,
                   enclosed_energy=np.minimum(light, 1).reshape(lens.psf.shape[:-2]))


def _thinned(lens):
    """A lens with only some of its wavelengths, and of its heights or nodes."""
    wavelengths = _some(lens.wavelengths_nm, MOST_WAVELENGTHS)
    places = [_some(getattr(lens, axis), MOST_HEIGHTS if len(lens.AXES) == 1 else MOST_LINES) for axis in lens.AXES]
    tables = np.ix_(wavelengths, *places)
    some = {name: getattr(lens, name)[tables] for name, shape in lens.shapes.items() if len(shape) >= len(tables)}
    some |= {axis: getattr(lens, axis)[index] for axis, index in zip(lens.AXES, places, strict=True)}
    if isinstance(lens, GridLens):
        some["within"] = lens.within[np.ix_(*places)]
    return replace(lens, wavelengths_nm=lens.wavelengths_nm[wavelengths], psf=lens.psf[tables],
                   transmittance=lens.transmittance[wavelengths], **some)


def _some(values, most):
    """Indices of a number of values, from the first to the last."""
    return np.unique(np.rint(np.linspace(0, values.size - 1, most)).astype(int))


def _chief_places_mm(lens, rays):
    """Places on the sensor that the PSFs of a lens belong to, in the image as formed by the lens: array (wavelength,
    place, 2)."""
    if isinstance(lens, GridLens):
        places_mm = -np.stack(np.meshgrid(lens.x_mm, lens.y_mm), axis=-1)
        places_mm = (places_mm / np.maximum(lens.within, 1)[..., None]).reshape(-1, 2)  # as nodes beyond it are baked
        return np.broadcast_to(places_mm, (lens.wavelengths_nm.size, *places_mm.shape))
    heights_mm = np.minimum(lens.real_height_mm, rays.last_height_mm)
    return np.stack([np.zeros_like(heights_mm), heights_mm], axis=-1)


def _check_depth(depth_mm):
    if not depth_mm > 0:
        raise InputError("options", "depth", depth_mm, "expected a distance in mm from the entrance pupil")


def _summed(wavefront, spread_mm, pitch_um, samples, fineness: Quality):
    """PSF as shares of all light; the period of its sum is long enough to keep copies out of the window."""
    spread = spread_mm * 1e3 / (pitch_um * samples)
    return point_spread(wavefront, pitch_um, samples,
                        replace(fineness.sums, repeat=max(fineness.sums.repeat, spread + HALF_WINDOW), beyond=0.0))


def _wavefront(rays, wavelength, place_mm, depth_mm, pupil):
    """The wavefront of a point at a depth, and the largest distance of its rays from the chief ray, in mm."""
    depth_mm = min(depth_mm, FARTHEST_MM)
    stop = np.stack([pupil.x, pupil.y])
    landed_mm, point_mm, lost = _landings_mm(rays, wavelength, place_mm, depth_mm, stop)
    landed_mm = continued(landed_mm, lost)
    clamped_mm = rays.inside(landed_mm, INSIDE)

    def path_mm(place_mm):
        """Optical path from the point to sensor points, its direction cosines at the point, and the rays."""
        traced = rays.rays(wavelength, place_mm, stop)
        to_point = np.stack([*(point_mm - traced.entrance_mm), np.full(pupil.shape, -depth_mm)])
        away_mm = np.sqrt(np.sum(to_point**2, axis=0))
        return traced.path_mm + away_mm, to_point[:2] / away_mm, traced

    total_mm, source, traced = path_mm(clamped_mm)
    step_mm = STEP * rays.last_height_mm
    cosine = np.stack([path_mm(clamped_mm + along)[0] - path_mm(clamped_mm - along)[0]
                       for along in step_mm * np.eye(2)[:, :, None, None]]) / (2 * step_mm)
    chief_mm = np.reshape(place_mm, (2, 1, 1))
    total_mm = total_mm - np.sum(cosine * (clamped_mm - chief_mm), axis=0)
    total_mm = continued(total_mm, lost)
    source, cosine = continued(source, lost), continued(cosine, lost)
    limits = np.where(lost, 2.0, 1 - traced.surface_margin)[None]
    wavefront = Wavefront(pupil, float(rays.wavelengths_nm[wavelength]), total_mm - total_mm[0, 0], cosine, source,
                          light_density(pupil, source, cosine), limits[np.any(limits > 1, axis=(1, 2))],
                          landed_mm - chief_mm)
    return wavefront, np.abs(landed_mm - chief_mm).max(axis=0)[wavefront.passing].max(initial=0.0)


def _landings_mm(rays, wavelength, place_mm, depth_mm, stop):
    """Sensor positions of a point's rays through stop points, the point's x and y, and rays that did not converge.

    Uses Broyden's method, starting with the derivatives of chief rays' crossings with the point's plane.
    """
    over_stop, (point_mm, scale) = (2, *(1,) * (stop.ndim - 1)), _chief_crossing(rays, wavelength, place_mm, depth_mm)
    chief_mm, point_mm = np.reshape(place_mm, over_stop), np.reshape(point_mm, over_stop)
    scale = np.reshape(scale, over_stop)

    def missed(stop_x, stop_y, x, y):
        place_mm = rays.last_height_mm * np.stack([x, y])
        clamped_mm = rays.inside(place_mm, INSIDE)
        crossing_mm = _crossing_mm(rays.rays(wavelength, clamped_mm, np.stack([stop_x, stop_y])), depth_mm)
        off_mm = (crossing_mm - point_mm.reshape(2, 1)) / scale.reshape(2, 1) + place_mm - clamped_mm
        return off_mm / rays.last_height_mm

    flat = stop.reshape(2, -1)
    start = (chief_mm + 0 * stop).reshape(2, -1) / rays.last_height_mm
    positions, error = broyden_steps(missed, tuple(flat), start, np.eye(2)[..., None] + 0 * flat[0])
    return (rays.last_height_mm * positions).reshape(stop.shape), point_mm, (error > CONVERGED).reshape(stop.shape[1:])


def _chief_crossing(rays, wavelength, place_mm, depth_mm):
    """x and y where the chief ray of a place crosses a plane in front of the entrance pupil, and their derivatives with
    respect to x and y of the place: two arrays (2,)."""
    step_mm, (_, height_mm) = STEP * rays.last_height_mm, place_mm
    if isinstance(rays, GridRayTable):
        middle_mm = rays.inside(np.array(place_mm), INSIDE)
        steps_mm = step_mm * np.array([[0, 1, -1, 0, 0], [0, 0, 0, 1, -1]])
        x_mm, y_mm = _chief_crossings_mm(rays, wavelength, middle_mm[:, None] + steps_mm, depth_mm)
        slopes = np.array([x_mm[1] - x_mm[2], y_mm[3] - y_mm[4]]) / (2 * step_mm)
        return np.array([x_mm[0], y_mm[0]]) + slopes * (place_mm - middle_mm), slopes
    heights_mm = np.array([height_mm, height_mm - step_mm, min(height_mm + step_mm, rays.last_height_mm)])
    here, before, after = _chief_crossings_mm(rays, wavelength, np.stack([0 * heights_mm, heights_mm]), depth_mm)[1]
    along = (after - before) / (heights_mm[2] - heights_mm[1])
    across = here / height_mm if height_mm > step_mm else along
    return np.array([0.0, here]), np.array([across, along])


def _chief_crossings_mm(rays, wavelength, places_mm, depth_mm):
    """`_crossing_mm` of the chief rays of places, the first of which is the point's."""
    chief = rays.rays(wavelength, places_mm, np.zeros((2, 1)))
    if chief.direction[2].min() < np.cos(STEEPEST):
        raise InputError("options", "height", _distance(places_mm[:, 0]), "its rays arrive from the side, where points "
                         "have no depth: set a height closer to the axis")
    return _crossing_mm(chief, depth_mm)


def _distance(place_mm):
    return f"{np.hypot(*place_mm):g} mm"


def _crossing_mm(traced, depth_mm):
    """Crossings of rays with a plane in front of the entrance pupil: array (2, ...)."""
    return traced.entrance_mm - depth_mm * traced.direction[:2] / traced.direction[2]
