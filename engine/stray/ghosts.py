"""Ghosts: light of bright sources that two surfaces of a lens reflect, as it falls on the sensor.

Rays are traced on a grid across the light that enters the lens, through all surfaces up to the farther of the two, back
to the nearer one, and on to the sensor, and carry what Fresnel's law or the coatings leave of their light. The cells
between them are drawn as triangles, whose light is spread over their area (M. Hullin, E. Eisemann, H.-P. Seidel and
S. Lee, "Physically-based real-time lens flare rendering", 2011). Positions in the stop and heights on the surfaces are
interpolated between the rays, so that blades and rims cut ghosts at every pixel. Large and faint ghosts are drawn in
larger pixels, and enlarged; the brightest ones have more rays than others. Rays take the paths of four wavelengths, and
carry the light of those around each, because coatings change much more with the wavelength than paths do.
"""

from dataclasses import dataclass
from functools import reduce
from itertools import product

import numpy as np

from ..image.pixel_grid import PixelGrid
from ..image.sources import Sources
from ..kernels.ghost_meshes import Meshes
from ..kernels.ghosts import RIM, draw_ghosts, ghost_levels
from ..lens.iris import Opening
from ..prescription.prescription import Prescription
from ..prescription.system import system_of
from ..runtime.threads import thread_pool
from .ghost_bands import bands_of, halves_of
from .ghost_beams import beams_of, coatings_of, ghost_lens
from .ghost_nodes import ghost_nodes
from .ghost_rays import boxes_of, trace_ghosts
from .ghost_survey import brightest, direct_light_mm2, survey

SHARE = 0.01  # of the light that may be neglected
PIXELS, LEAST_PIXELS, MOST_PIXELS = 6000.0, 1500.0, 300000.0  # of a ghost: on average, and limits
RAYS = ((81, 0.05), (57, 0.02), (41, 0.01), (29, 0.004), (21, 0.001), (13, 0.0))
"""Across, and up: of ghosts with more than this share of all their light. The error of a mesh falls with the square of
its rays, so that of all together is least if they rise with the fourth root of the light."""
SMALLEST_LEVEL_PX = 6  # the height of the coarsest level
OF_DIAMETER = 0.388  # pixels of this part of a disc's diameter blur a point as it does: their kernel has its variance
SQUARE_M = 1e-6  # a square mm


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
    """

    irradiance: np.ndarray
    wavelengths_nm: np.ndarray
    names: tuple[str, ...]
    pairs: np.ndarray
    light: np.ndarray
    neglected: np.ndarray


def ghosts(prescription: Prescription, sources: Sources, grid: PixelGrid, opening: Opening,
           share: float = SHARE) -> Ghosts:
    """Compute the ghosts of all pairs of surfaces.

    Parameters
    ----------
    prescription : Prescription
        Of a lens without moving parts, as from `turned`. Surfaces without a known coating reflect nothing.
    sources : Sources
        Those behind the front surface cause no ghosts.
    grid : PixelGrid
        Its frame is the frame of the sensor.
    opening : Opening
        Of the stop.
    share : float
        The faintest ghosts are neglected up to this share of the light of all.

    Raises
    ------
    LensError
        A wavelength outside the range of a glass or of a coating.
    """
    frame, nm = grid.frame(), sources.wavelengths_nm
    nodes = ghost_nodes(system_of(prescription), opening, tuple(nm))
    lens, coatings = nodes.lens, coatings_of(nodes.lens.system, tuple(nm))
    bands, halves = ([(band, coatings.of(band)) for band in each] for each in (bands_of(nm), halves_of(nm)))
    surveys, estimates = _surveyed(nodes, frame, halves, sources, share / 2)
    drawn = _drawn(surveys, estimates, share / 2)
    of_drawn = np.where(drawn, estimates.sum(axis=2), 0)
    pixels, by_rays = _pixels(of_drawn), list(_by_rays(of_drawn))
    irradiance = np.empty((len(nm), *frame.shape_px), np.float32)
    light = np.where(drawn[..., None], np.zeros(len(nm)), np.nan)
    px_per_mm, passing = 1e3 / frame.pitch_um, lens.glass_transmittance(nm, lens.pairs)

    def draw(band, coated):
        levels = ghost_levels(band.waves.size, frame.shape_px, _level_count(frame.shape_px))
        of_band = np.zeros((*drawn.shape, band.waves.size))
        for (number, found), (side, selected) in product(surveys.items(), by_rays):
            chosen = selected[number, found.bright]
            pairs = found.bright[chosen]
            if not pairs.size:
                continue
            rays, cells_mm2 = _fine_rays(lens, coated, found, chosen, side)
            diameters_px = 2 * sources.radius_rad[number] * px_per_mm * found.speed_mm[chosen]
            meshes = Meshes(rays, lens.crossings(lens.pairs[pairs]), cells_mm2, pixels[number, pairs],
                            (OF_DIAMETER * diameters_px)**2, lens.radial, found.azimuth_rad,
                            band.weights * (sources.irradiance[number] * passing[pairs])[:, band.waves])
            of_band[number, pairs] = SQUARE_M * draw_ghosts(meshes, lens.blades, frame.centre_px, px_per_mm, levels)
        return of_band, levels

    def join(wave):
        parts = [[level[np.flatnonzero(band.waves == wave)[0]] for level in levels]
                 for (band, _), (_, levels) in zip(bands, found, strict=True) if wave in band.waves]
        irradiance[wave] = _together([reduce(np.add, planes) for planes in zip(*parts, strict=True)])

    with thread_pool() as pool:
        found = list(pool.map(draw, *zip(*bands, strict=True)))
        list(pool.map(join, range(len(nm))))
    for (band, _), (of_band, _) in zip(bands, found, strict=True):
        light[..., band.waves] += of_band
    return Ghosts(irradiance, nm, sources.names, lens.pairs + 1, light,
                  np.where(drawn[..., None], 0, estimates).sum(axis=1))


def direct_light(prescription: Prescription, sources: Sources, opening: Opening) -> np.ndarray:
    """Light that reaches the sensor's plane without reflection, in W nm^-1: array (source, wavelength).

    Parameters and errors are as for `ghosts`.
    """
    nm, none = sources.wavelengths_nm, np.array([[-1, -1]])
    lens = ghost_lens(system_of(prescription), opening, nm)
    light_mm2, coatings = np.zeros((len(sources), len(nm))), coatings_of(lens.system, tuple(nm))
    bands = [(band, coatings.of(band)) for band in bands_of(nm)]
    for number, (beam, _) in beams_of(lens, sources).items():
        for band, coated in bands:
            light_mm2[number, band.waves] += band.weights * direct_light_mm2(lens, coated, beam)
    return SQUARE_M * sources.irradiance * light_mm2 * lens.glass_transmittance(nm, none)


def _surveyed(nodes, frame, halves, sources, share):
    """The surveys of sources by their numbers, except of the faintest ghosts up to this share of the light; and the
    light of ghosts from few rays: array (source, pair, wavelength)."""
    lens, nm = nodes.lens, sources.wavelengths_nm
    light, passing = np.zeros((len(sources), len(lens.pairs), len(nm))), lens.glass_transmittance(nm, lens.pairs)

    def surveyed(number):
        pairs = np.flatnonzero(bright[number])
        return survey(lens, frame, halves, searches[number], pairs, sources.radius_rad[number])

    def predicted(searches):
        for number, found in searches.items():
            light[number] = SQUARE_M * found.light_mm2[:, None] * passing * sources.irradiance[number]
        bright = brightest(light.sum(axis=2), share)
        return bright, [number for number in searches if bright[number].any()]

    with thread_pool() as pool:
        searches = nodes.searches(sources, frame, pool)
        _, numbers = predicted(searches)
        closer = pool.map(lambda number: nodes.closer(searches[number], frame), numbers)
        searches |= zip(numbers, closer, strict=True)
        bright, numbers = predicted(searches)
        surveys = dict(zip(numbers, pool.map(surveyed, numbers), strict=True))
    for number, found in surveys.items():
        light[number, found.bright] = SQUARE_M * found.light_mm2 * passing[found.bright] * sources.irradiance[number]
    return surveys, light


def _drawn(surveys, estimates, share):
    """Which ghosts (source, pair) are drawn."""
    light = np.zeros(estimates.shape[:2])
    for number, found in surveys.items():
        light[number, found.bright] = estimates[number, found.bright].sum(axis=1)
    return brightest(light, share)


def _fine_rays(lens, coated, found, chosen, side):
    """The rays of some of the surveyed ghosts, and the cross section of their cells."""
    pairs, limits_mm = lens.pairs[found.bright[chosen]], found.limits_mm[chosen]
    rays = trace_ghosts(lens, coated, found.beam, pairs, limits_mm, side)
    boxes, _ = boxes_of(lens, limits_mm, side)
    return rays, boxes[:, 1] * boxes[:, 3]


def _by_rays(light):
    """Pairs of a number of rays and the ghosts, (source, pair), that have so many, from their light."""
    most = np.inf
    for side, share in RAYS:
        yield side, (light > share * light.sum()) & (light <= most)
        most = share * light.sum()


def _pixels(light):
    """Pixels to spend on each ghost, (source, pair)."""
    mean = light.sum() / max(1, np.count_nonzero(light))
    return np.clip(PIXELS * light / (mean or 1.0), LEAST_PIXELS, MOST_PIXELS)


def _level_count(shape_px):
    return max(1, int(np.log2(min(shape_px) / SMALLEST_LEVEL_PX)) + 1)


def _together(levels):
    """The sum of pictures, arrays (row, column), of different resolution, without their rims. Each is enlarged by
    Chaikin's subdivision, which tends to quadratic B-splines and keeps the light."""
    total = levels[-1]
    for level in levels[-2::-1]:
        total = level + _doubled(total, level.shape)
    return total[RIM:-RIM, RIM:-RIM]


def _doubled(picture, shape):
    for axis, count in enumerate(shape):
        place = np.arange(-RIM, count - RIM)
        near, beyond = place // 2 + RIM, place // 2 + RIM + np.where(place % 2, 1, -1)
        weight = 0.75, 0.25
        picture = (np.float32(weight[0]) * picture.take(near, axis)
                   + np.float32(weight[1]) * picture.take(np.clip(beyond, 0, picture.shape[axis] - 1), axis))
    return picture
