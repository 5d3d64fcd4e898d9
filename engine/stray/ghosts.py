"""Ghosts: light of bright sources that two surfaces of a lens reflect, as it falls on the sensor.

Rays are traced on a grid across the light that enters the lens, through all surfaces up to the farther of the two, back
to the nearer one, and on to the sensor, and carry what Fresnel's law or the coatings leave of their light. The cells
between them are drawn as triangles, whose light is spread over their area (M. Hullin, E. Eisemann, H.-P. Seidel, S. Lee,
"Physically-based real-time lens flare rendering", 2011). Positions in the stop and heights on the surfaces are
interpolated between the rays, so that blades and rims cut ghosts at every pixel. Large and faint ghosts are drawn in
larger pixels, and enlarged.
"""

from dataclasses import dataclass

import numpy as np

from ..depth.iris import Opening
from ..image.pixel_grid import PixelGrid
from ..kernels.ghosts import RIM, Meshes, draw_ghosts, ghost_levels, ghost_rays
from ..prescription.prescription import Prescription
from ..prescription.system import System, system_of
from ..runtime.threads import thread_pool
from .ghost_beams import GhostLens, beam_of, enters, entrance_mm, ghost_lens
from .ghost_survey import Survey, boxes_of, cells_mm2, lit_share, open_square, survey
from .sources import Sources

SHARE = 0.01
RAYS = 25  # across, and up
PIXELS, LEAST_PIXELS, MOST_PIXELS = 6000.0, 1500.0, 300000.0
SMALLEST_LEVEL_PX = 24
KERNEL_SHARE = 0.433  # a disc has the variance of the pixels that it is drawn in if these are this part of its diameter


@dataclass(frozen=True, eq=False)
class Ghosts:
    """The ghosts of sources on a sensor.

    Attributes
    ----------
    irradiance : float32 array (wavelength, row, column)
        W m^-2 nm^-1 on the sensor's frame, upright.
    wavelengths_nm : array (wavelength,)
    names : tuple of str
        Of the sources.
    pairs : int array (pair, 2)
        Numbers of the surfaces that reflect, from 1; the one nearer to the object first.
    light : array (source, pair, wavelength)
        W nm^-1 of each ghost on the frame; NaN for neglected ones.
    neglected : array (source, wavelength)
        W nm^-1 of the ghosts that are not drawn, from few rays.
    image_light : array (source, wavelength)
        W nm^-1 of the light that reaches the sensor's plane without reflection.
    """

    irradiance: np.ndarray
    wavelengths_nm: np.ndarray
    names: tuple[str, ...]
    pairs: np.ndarray
    light: np.ndarray
    neglected: np.ndarray
    image_light: np.ndarray


def ghosts(prescription: Prescription, sources: Sources, grid: PixelGrid, opening: Opening, share: float = SHARE) -> Ghosts:
    """Compute the ghosts of all pairs of surfaces.

    Parameters
    ----------
    prescription : Prescription
        Of a lens without moving parts, as from `turned`. Surfaces without a known coating reflect nothing.
    sources : Sources
        Those behind the front surface cause no ghosts.
    grid : PixelGrid
        Its frame is the sensor's.
    opening : Opening
        Of the stop.
    share : float
        The faintest ghosts are neglected up to this share of the light of all.

    Raises
    ------
    LensError
        A wavelength outside the range of a glass or of a coating.
    """
    system, frame = system_of(prescription), grid.frame()
    nm = sources.wavelengths_nm
    lens = ghost_lens(system, opening, nm)
    coated = lens.coated(nm)
    few = sorted({0, len(nm) // 2, len(nm) - 1})
    inside = np.flatnonzero(enters(lens, sources))
    surveys = {number: survey(lens, frame, [coated[n] for n in few], sources.directions[number],
                              float(sources.distance_mm[number]), float(sources.radius_rad[number])) for number in inside}
    estimates = np.zeros((len(sources), len(lens.pairs), len(nm)))
    for number, each in surveys.items():
        between = np.stack([np.interp(nm, nm[few], light) for light in each.light_mm2])
        estimates[number] = between * sources.irradiance[number] * lens.glass_transmittance(nm, lens.pairs) * 1e-6
    drawn = _brightest(estimates.sum(axis=2), share)
    pixels = _pixels(np.where(drawn, estimates.sum(axis=2), 0))
    irradiance = np.zeros((len(nm), *frame.shape_px), np.float32)
    light = np.full(estimates.shape, np.nan)

    def draw(wavelength):
        levels = ghost_levels(frame.shape_px, _level_count(frame.shape_px))
        for number, each in surveys.items():
            chosen = np.flatnonzero(drawn[number])
            if chosen.size and sources.irradiance[number, wavelength] > 0:
                meshes = _meshes(lens, coated[wavelength], nm[wavelength], each, chosen)
                px_per_mm = 1e3 / frame.pitch_um
                blur = (KERNEL_SHARE * 2 * sources.radius_rad[number] * each.speed_mm[chosen] * px_per_mm) ** 2
                meshes = Meshes(*meshes, pixels[number, chosen], blur, lens.radial, each.azimuth_rad,
                                float(sources.irradiance[number, wavelength]))
                light[number, chosen, wavelength] = draw_ghosts(meshes, lens.blades, frame.centre_px, px_per_mm, levels) * 1e-6
        irradiance[wavelength] = _together(levels)

    with thread_pool() as pool:
        list(pool.map(draw, range(len(nm))))
    return Ghosts(irradiance, nm, sources.names, lens.pairs + 1, light, np.where(drawn[..., None], 0, estimates).sum(axis=1),
                  np.zeros((len(sources), len(nm))))


def _meshes(lens, coated, nm, found, chosen):
    boxes, shape = boxes_of(lens, found.limits_mm[chosen], RAYS)
    rays = ghost_rays(lens.surfaces, coated, lens.per_semi_aperture, found.beam, lens.pairs[chosen], boxes, shape)
    rays[:, 2] *= lens.glass_transmittance(np.array([nm]), lens.pairs[chosen])[:, :, None]
    return rays, lens.crossings[chosen], boxes[:, 1] * boxes[:, 3]


def _brightest(light, share):
    """Ghosts (source, pair) without the faintest ones, which have at most this share of the light."""
    order = np.argsort(light, axis=None, kind="stable")
    faint = np.cumsum(light.ravel()[order]) <= share * light.sum()
    drawn = np.zeros(light.size, bool)
    drawn[order[~faint]] = True
    return drawn.reshape(light.shape)


def _pixels(light):
    """Pixels to spend on each ghost, (source, pair)."""
    mean = light.sum() / max(1, np.count_nonzero(light))
    return np.clip(PIXELS * light / (mean or 1.0), LEAST_PIXELS, MOST_PIXELS)


def _level_count(shape_px):
    return max(1, int(np.log2(min(shape_px) / SMALLEST_LEVEL_PX)) + 1)


def _together(levels):
    """The sum of pictures of different resolution, without their rims. Each is enlarged by Chaikin's subdivision, which
    tends to quadratic B-splines and keeps the light."""
    total = levels[-1][0]
    for level in levels[-2::-1]:
        total = level[0] + _doubled(total, level.shape[1:])
    return total[RIM:-RIM, RIM:-RIM]


def _doubled(picture, shape):
    for axis, count in enumerate(shape):
        place = np.arange(-RIM, count - RIM)
        near, beyond = place // 2 + RIM, place // 2 + RIM + np.where(place % 2, 1, -1)
        weight = 0.75, 0.25
        picture = (np.float32(weight[0]) * picture.take(near, axis)
                   + np.float32(weight[1]) * picture.take(np.clip(beyond, 0, picture.shape[axis] - 1), axis))
    return picture
