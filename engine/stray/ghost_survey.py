"""Where the light of ghosts enters a lens, and about how much of it there is: found from few rays."""

from dataclasses import dataclass

import numpy as np

from ..image.pixel_grid import PixelGrid
from ..kernels.ghost_meshes import LIGHT, LIMIT, STOP
from ..kernels.ghosts import Beam, Coated
from .ghost_bands import Band
from .ghost_beams import GhostLens, entrance_mm
from .ghost_rays import boxes_of, trace_ghosts

FIRST, NEXT, DIRECT = 25, 17, 65  # rays across, and up: of the two searches, and of light that is not reflected
FIRST_CROOKED = 49  # of the first search without symmetry: the fronts of anamorphic lenses are many pupils wide
AGAIN_CROOKED = 2 * NEXT - 1  # of a search twice as wide as its result: strips of light are partly between the rays
LEAST_SQUARE = 9.0  # of the closest ray to an opening, over the opening's square: beyond it the search ends
MARGIN = 0.5  # cells of the second search, for light between its rays and wavelengths
TILT_RAD = 1e-4  # for derivatives with respect to a source's direction


@dataclass(frozen=True, eq=False)
class Search:
    """Where the light of one source's ghosts enters, from few rays at one wavelength.

    Attributes
    ----------
    beam : Beam
    azimuth_rad : float
        Angle by which to turn the rays.
    limits_mm : array (pair, 4)
        Left, right, lower and upper limit of the light's cross section that may pass, of each of the lens's pairs.
    light_mm2 : array (pair,)
        Light on the sensor's frame, over irradiance in front of the lens: the mean of few wavelengths.
    """

    beam: Beam
    azimuth_rad: float
    limits_mm: np.ndarray
    light_mm2: np.ndarray


@dataclass(frozen=True, eq=False)
class Survey:
    """Ghosts of one source.

    Attributes
    ----------
    beam, azimuth_rad
        As in `Search`.
    bright : int array (bright pair,)
        The pairs that are surveyed.
    light_mm2 : array (bright pair, wavelength)
        As in `Search`, at each wavelength.
    limits_mm : array (bright pair, 4)
        As in `Search`, for all wavelengths.
    speed_mm : array (bright pair,)
        How far the light moves on the sensor with the source's direction, in mm per radian.
    """

    beam: Beam
    azimuth_rad: float
    bright: np.ndarray
    light_mm2: np.ndarray
    limits_mm: np.ndarray
    speed_mm: np.ndarray


def search(lens: GhostLens, grid: PixelGrid, coated: Coated, beam: Beam, azimuth_rad: float) -> Search:
    """Search the light of all pairs."""
    limits_mm, rays, lit_mm2 = trace_everywhere(lens, coated, beam)
    return Search(beam, azimuth_rad, limits_mm, _light_mm2(lens, grid, rays, lit_mm2, azimuth_rad).mean(axis=1))


def trace_everywhere(lens: GhostLens, coated: Coated, beam: Beam) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Trace the light of all pairs from everywhere on the first surface: limits as in `Search`; rays as from
    `trace_ghosts`; and the cross section around each ray that passes, in mm^2: array (pair, row, column)."""
    everywhere_mm = np.tile(entrance_mm(lens, beam), (len(lens.pairs), 1))
    return _searched(lens, coated, beam, lens.pairs, everywhere_mm, FIRST if lens.radial else FIRST_CROOKED)


def survey(lens: GhostLens, grid: PixelGrid, bands: list[tuple[Band, Coated]], found: Search, bright: np.ndarray,
           radius_rad: float) -> Survey:
    """Search the light of some pairs again, closer, with the paths of each band."""
    pairs, beam, limits_mm = lens.pairs[bright], found.beam, found.limits_mm[bright]
    (_, coated), waves = bands[-1], sum(band.waves.size for band, _ in bands)
    if not lens.radial:
        limits_mm, *_ = _searched(lens, coated, beam, pairs, _widened(lens, limits_mm, 0.5), AGAIN_CROOKED)
    light_mm2, closer = np.zeros((len(pairs), waves)), []
    for band, each in bands:
        closer_mm, rays, lit = _searched(lens, each, beam, pairs, limits_mm, NEXT)
        light_mm2[:, band.waves] = _light_mm2(lens, grid, rays, lit, found.azimuth_rad)
        closer.append(closer_mm)
    speed_mm = _speed_mm(lens, coated, beam, pairs, limits_mm, rays) if radius_rad > 0 else np.zeros(len(pairs))
    ends_mm = np.where([True, False, True, False], np.min(closer, axis=0), np.max(closer, axis=0))
    return Survey(beam, found.azimuth_rad, bright, light_mm2, _widened(lens, ends_mm, MARGIN / (NEXT - 1)), speed_mm)


def brightest(light: np.ndarray, share: float) -> np.ndarray:
    """Which ghosts, an array of any shape, are not among the faintest ones with at most this share of the light."""
    order = np.argsort(light, axis=None, kind="stable")
    faint = np.cumsum(light.ravel()[order]) <= share * light.sum()
    bright = np.zeros(light.size, bool)
    bright[order[~faint]] = True
    return bright.reshape(light.shape)


def open_square(lens: GhostLens, rays: np.ndarray) -> np.ndarray:
    """The largest square of a distance from the axis over an opening's, of rays: above 1 if blocked, inf if lost."""
    stop = rays[:, STOP:LIGHT:2]**2 + rays[:, STOP + 1:LIGHT:2]**2
    square = np.maximum(rays[:, LIMIT], stop.max(axis=1) / lens.opening.reach**2)
    return np.where(rays[:, LIGHT] >= 0, square, np.inf)


def lit_share(square: np.ndarray) -> np.ndarray:
    """The share of the cell around each ray that is not blocked, of `open_square`."""
    with np.errstate(invalid="ignore"):
        down, right = np.gradient(np.minimum(square, 2 * LEAST_SQUARE), axis=(-2, -1))
    return np.clip(0.5 + (1 - square) / np.maximum(np.hypot(down, right), 1e-9), 0, 1)


def cells_mm2(lens: GhostLens, boxes: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Cross section of the light around each ray, with the mirror image's: array (pair, 1, column)."""
    times = np.where(np.arange(shape[1]) > 0, 2.0, 1.0) if lens.radial else np.ones(shape[1])
    return (boxes[:, 1] * boxes[:, 3])[:, None, None] * times


def direct_light_mm2(lens: GhostLens, coated: Coated, beam: Beam) -> np.ndarray:
    """Light that reaches the sensor's plane without reflection, over irradiance in front of the lens: array (wave,)."""
    limits_mm, none = entrance_mm(lens, beam)[None], np.array([[-1, -1]])
    limits_mm, *_ = _searched(lens, coated, beam, none, limits_mm, FIRST)
    rays = trace_ghosts(lens, coated, beam, none, limits_mm, DIRECT, LEAST_SQUARE)
    boxes, shape = boxes_of(lens, limits_mm, DIRECT)
    return _summed(rays, lit_share(open_square(lens, rays)) * cells_mm2(lens, boxes, shape))[0]


def _searched(lens, coated, beam, pairs, limits_mm, side):
    """Closer limits, with a cell more on each side; rays; and the cross section around each that passes, in mm^2."""
    boxes, shape = boxes_of(lens, limits_mm, side)
    rays = trace_ghosts(lens, coated, beam, pairs, limits_mm, side, LEAST_SQUARE)
    square = open_square(lens, rays)
    closer = []
    for axis, count in ((0, shape[1]), (1, shape[0])):
        first, step = boxes[:, 2 * axis], boxes[:, 2 * axis + 1]
        start, end = _span(square.min(axis=axis + 1))
        closer += [first + step * np.clip(place, 0, count - 1) for place in (start - 1, end + 1)]
    return np.stack(closer, axis=1), rays, lit_share(square) * cells_mm2(lens, boxes, shape)


def _span(square):
    """Where the least squares along an axis (pair, place) are below 1, as fractions of a step: first and last.

    If none is, the place of the least one, around which rays between two places may pass.
    """
    least = square.min(axis=1, keepdims=True)
    passes = (square < 1) | ((square == least) & (least < LEAST_SQUARE))
    count, pair = square.shape[1], np.arange(len(square))
    ends = []
    for passing, sign in ((passes, -1), (passes[:, ::-1], 1)):
        end = np.argmax(passing, axis=1)
        end = end if sign < 0 else count - 1 - end
        beyond = np.clip(end + sign, 0, count - 1)
        inner, outer = square[pair, end], square[pair, beyond]
        with np.errstate(invalid="ignore"):
            crossing = (1 - inner) / np.maximum(outer - inner, 1e-9)
        part = np.where((outer > 1) & np.isfinite(outer) & (inner < 1), crossing, 1.0)
        ends.append(end + sign * part)
    lost = ~passes.any(axis=1)
    return np.where(lost, 0, ends[0]), np.where(lost, 0, ends[1])


def _widened(lens, limits_mm, share):
    """Limits with more on each side, as a share of their distance."""
    left, right, lower, upper = limits_mm.T
    across, up = share * (right - left), share * (upper - lower)
    return np.stack([left if lens.radial else left - across, right + across, lower - up, upper + up], axis=1)


def _light_mm2(lens, grid, rays, lit_mm2, azimuth_rad):
    """Light on the frame over irradiance: array (pair, wave)."""
    return _summed(rays, on_frame(lens, grid, rays[:, 0], rays[:, 1], azimuth_rad) * lit_mm2)


def on_frame(lens: GhostLens, grid: PixelGrid, x_mm: np.ndarray, y_mm: np.ndarray, azimuth_rad: float) -> np.ndarray:
    """Whether places are on the frame after a turn by an azimuth: 1 or 0, or for radial lenses the mean of a place and
    its mirror image."""
    cosine, sine = np.cos(azimuth_rad), np.sin(azimuth_rad)
    left, lower, right, upper = grid.edges_mm
    share = np.zeros_like(x_mm)
    for x, part in [(x_mm, 0.5), (-x_mm, 0.5)] if lens.radial else [(x_mm, 1.0)]:
        across, up = x * cosine - y_mm * sine, x * sine + y_mm * cosine
        share = share + part * ((across > left) & (across < right) & (up > lower) & (up < upper))
    return share


def _summed(rays, weights):
    """Sums of the light of rays times weights (pair, row, column): array (pair, wave)."""
    return np.einsum("pwrc,prc->pw", np.nan_to_num(rays[:, LIGHT:]), weights)


def _speed_mm(lens, coated, beam, pairs, limits_mm, rays):
    """`Survey.speed_mm`: the root mean square over every second one of the rays, and over directions."""
    rays = rays[:, :, ::2, ::2]
    lit = open_square(lens, rays) < 1
    squares = []
    for axis in (0, 1):
        moved = trace_ghosts(lens, coated, _tilted(beam, axis), pairs, limits_mm, (NEXT + 1) // 2)
        square = np.nan_to_num(np.sum((moved[:, :2] - rays[:, :2])**2, axis=1)) / TILT_RAD**2
        squares.append(np.where(lit, square, 0).sum(axis=(1, 2)) / np.maximum(lit.sum(axis=(1, 2)), 1))
    return np.sqrt(np.mean(squares, axis=0))


def _tilted(beam, axis):
    """The beam of a source that is moved along an axis of the cross section."""
    along = beam.axes[2] + TILT_RAD * beam.axes[axis]
    source_mm = beam.source_mm
    if np.isfinite(beam.distance_mm):
        source_mm = source_mm - TILT_RAD * beam.distance_mm * beam.axes[axis]
    return Beam(np.stack([*beam.axes[:2], along]), source_mm, beam.distance_mm)
