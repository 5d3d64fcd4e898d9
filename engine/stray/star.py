"""Stars: light that the edges of the stop diffract beyond the windows of the PSFs.

Far from its middle, the diffraction pattern of an opening is the light of its edges (Born and Wolf, Principles of
Optics, 8.5). With lengths in semi-apertures, at k = pi r / (wavelength N) and the azimuth f, a straight edge of the
length L with a normal at the azimuth g contributes the amplitude L cos(f - g) sinc(k L sin(f - g) / 2) / k. Its light,
without the fringes that are finer than a pixel, is 2 pi L W(f - g) / k^3: W is a Lorentzian with the area and the tails
of sinc^2, of the half width 1 / (k L), wrapped to the period pi, as both directions of the normal are alike. The sum of
the wrapped tails of a regular polygon's edges also contains the interference of edges that share a corner, which is not
a fringe. The edge of a rounded blade has normals of many azimuths, and W is their mean. For a circle, the sum is the
Airy pattern's 4 pi / k^3. Divided by 4 pi^2 times the area, pi, this is the share of all light (Parseval).

Out of focus, the light of an edge comes from its image in the rim of the blur. A star is spread over an even disc of
the blur's variance instead: its spikes are as wide, and none begins in the middle.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from ..image.pixel_grid import PixelGrid
from ..lens import Lens
from ..lens.iris import Opening
from .arrivals import CELL_PX, Arrivals
from .cells import FineCells, spread_in_cells, transformed

MOST_SPOTS = 40  # with spikes as fine as the pixels
HIGHLIGHT = 16  # times the light of a typical spot: others have coarse spikes
FINE_PX = 16.0  # radius of the largest spots with fine spikes
DISC_STEP = np.sqrt(2)  # between the radii of larger discs
COARSE_PX = CELL_PX * np.sqrt(8 / 3)  # radius of a disc with the variance that cells give to light
NEAR_PX = 64  # around a spot, stars are computed for each pixel
STEP_PX = 0.05  # of tables across spikes
LEAST_PX = 0.05  # width of a box
DISC_BOXES = np.pi / 2, np.sqrt(3 - np.pi**2 / 4)  # with a disc's variance and its peak, in its radii
PIXEL_PX = 1 / np.sqrt(3)  # radius of a disc with a pixel's variance
FALLOFF_PLACES, FALLOFF_CIRCLES, FAR_RADII = 160, 48, 12.0  # for light near a spot, to so many of its radii away
SHORTEST = 1e-6  # edge, in semi-apertures
LEAST_K = 20.0  # closer to the middle, edges interfere
SQUARE = 2 * np.sqrt(2) / np.pi  # diffracted light outside a square relative to light outside a circle of its width


@dataclass(frozen=True)
class Edge:
    """Edges of an opening, in semi-apertures, with the same normals except for their sign.

    Attributes
    ----------
    azimuth_rad : float
        Of the normal in the middle, anticlockwise from the right.
    half_angle_rad : float
        Between the normals in the middle and at an end: 0 for a straight edge.
    length : float
        Of one edge.
    count : float
        Their number, relative to the share of the opening that no central obstruction blocks.
    """

    azimuth_rad: float
    half_angle_rad: float
    length: float
    count: float


def edges_of(opening: Opening, obstruction: float = 0.0) -> list[Edge]:
    """The edges of an opening: its blades, the parts of the lens's rim between them, and the circle of a central
    obstruction with this radius."""
    edges = [*_outer_edges(opening), *([Edge(0.0, np.pi / 2, np.pi * obstruction, 2)] if obstruction else [])]
    return [replace(edge, count=edge.count / (1 - obstruction**2)) for edge in edges]


def _outer_edges(opening):
    iris, blades = opening.iris, opening.iris.blades
    if not blades:
        return [Edge(0.0, np.pi / 2, np.pi, 2)]
    half, (along, across) = np.pi / blades, _blade_end(opening)
    radius = opening.corner / iris.roundness if iris.roundness else np.inf
    bent = np.arcsin(min(across / radius, 1.0))
    of_rim = half - np.arctan2(across, along)
    parts = [(0.0, bent, 2 * radius * bent if iris.roundness else 2 * across),
             (half, of_rim, 2 * opening.reach * of_rim)]
    count = 1 if blades % 2 else 2
    return [Edge(np.radians(iris.rotation_deg) + 2 * half * blade + turn, angle, length, count)
            for turn, angle, length in parts if length > SHORTEST for blade in range(blades // count)]


def _blade_end(opening):
    """The end of a blade's edge, from the axis: along the normal of its middle, and across."""
    half, roundness, rim = np.pi / opening.iris.blades, opening.iris.roundness, opening.reach
    along, across = opening.corner * np.cos(half), opening.corner * np.sin(half)
    if opening.corner <= rim:
        return along, across
    if roundness:
        radius = opening.corner / roundness
        middle = along - np.sqrt(radius**2 - across**2)  # of the edge's arc
        along = (rim**2 + middle**2 - radius**2) / (2 * middle) if middle else rim
    along = min(along, rim)
    return along, np.sqrt(rim**2 - along**2)


def star_share(lens: Lens, opening: Opening, wavelengths_nm: np.ndarray) -> np.ndarray:
    """The share of a point's light that a star has, and that its image therefore loses: array (wavelength,).

    It is the light outside a disc that diffraction at a round stop leaves as much as outside the PSFs' window.
    """
    perimeter = sum(edge.count * edge.length for edge in edges_of(opening, lens.central_obstruction))
    return perimeter / (np.pi**2 * _wave_numbers(lens, wavelengths_nm) * _window_mm(lens, wavelengths_nm))


def _wave_numbers(lens, wavelengths_nm):
    """k over r, in 1/mm: array (wavelength,)."""
    return np.pi / (np.asarray(wavelengths_nm) * 1e-6 * lens.rim_f_number)


def _window_mm(lens, wavelengths_nm):
    """Radius of the disc in place of the window: array (wavelength,)."""
    half_mm = lens.psf.shape[-1] * lens.psf_pitch_um * 1e-3 / 2
    return np.maximum(half_mm / SQUARE, LEAST_K / _wave_numbers(lens, wavelengths_nm))


def add_stars(cube: np.ndarray, lens: Lens, opening: Opening, frame: PixelGrid, light: Arrivals) -> np.ndarray:
    """Add the stars of all light to the irradiance of a sensor's frame.

    The brightest small spots have spikes as fine as the pixels. The others are spread in cells; so that stars neither
    appear nor vanish as lamps move, a spot's fine spikes show only its light in excess of the next spot's. Light of
    large spots is shared out linearly between discs of fixed sizes.

    Parameters
    ----------
    cube : float32 array (wavelength, row, column)
    lens : Lens
    opening : Opening
    frame : PixelGrid
    light : Arrivals

    Returns
    -------
    array (wavelength,)
        `star_share`, by which the lens image must be dimmed.
    """
    edges = edges_of(opening, lens.central_obstruction)
    radii_px, (small, *large) = _discs(light.radius_px, max(frame.shape_px) / 2)
    share = _fine_share(light, small)
    cells = FineCells(len(cube), frame.shape_px)
    discs = [(np.sqrt(max(radius_px**2 - COARSE_PX**2, 0)), part)
             for radius_px, part in zip(radii_px[1:], large, strict=True) if part.any()]
    cells.corners += _coarse_stars(lens, edges, frame, light, [(0.0, small - share), *discs])
    light = replace(light, radius_px=np.minimum(light.radius_px, FINE_PX))
    for spots in _lamps(share, light.cells):
        _add_star(cells, lens, edges, frame, _together(light, share, spots, frame.pitch_um * 1e-3))
    cells.add_all(cube)
    return star_share(lens, opening, light.wavelengths_nm)


def _discs(radius_px, most_px):
    """Radii of discs, (disc,), of FINE_PX and of DISC_STEP times as much each; and the parts (disc, spot) of spots with
    these radii, or `most_px` if they are larger, that have the spots' variance together."""
    wanted = np.clip(radius_px, FINE_PX, max(most_px, FINE_PX))
    radii_px = FINE_PX * DISC_STEP ** np.arange(1 + np.ceil(np.log(wanted.max() / FINE_PX) / np.log(DISC_STEP)))
    return radii_px, [np.interp(wanted**2, radii_px**2, unit) for unit in np.eye(radii_px.size)]


def _fine_share(light, small):
    """The share of each spot's light that is spread finely; `small` is the one in small spots."""
    total = light.light.sum(axis=0)
    bright, sharp = HIGHLIGHT * np.median(total), small * total
    level = np.partition(sharp, -MOST_SPOTS - 1)[-MOST_SPOTS - 1] if sharp.size > MOST_SPOTS else 0.0
    more = sharp - max(level, bright)
    return np.divide(more, total, out=np.zeros_like(total), where=more > bright)


def _lamps(share, cells):
    """Spots that are spread finely, those of a lamp across the borders of cells together: arrays of indices."""
    labels, _ = scipy.ndimage.label((share[:np.prod(cells)] > 0).reshape(cells), np.ones((3, 3)))
    for number, box in enumerate(scipy.ndimage.find_objects(labels), 1):
        spots = np.ravel_multi_index(np.nonzero(labels == number), cells)
        yield from [spots] if max(part.stop - part.start for part in box) <= 2 else spots[:, None]
    yield from np.prod(cells) + np.flatnonzero(share[np.prod(cells):])[:, None]


def _together(light, share, spots, pitch_mm):
    """Some spots as one."""
    parts = share[spots] * light.light[:, spots]
    total = parts.sum(axis=1, keepdims=True)
    weights = np.divide(parts, total, out=np.full_like(parts, 1 / spots.size), where=total > 0)
    x_mm, y_mm = ((weights * each[:, spots]).sum(axis=1, keepdims=True) for each in (light.x_mm, light.y_mm))
    square_mm = (light.x_mm[:, spots] - x_mm) ** 2 + (light.y_mm[:, spots] - y_mm) ** 2
    square = (weights * (light.radius_px[spots] ** 2 + 2 * square_mm / pitch_mm**2)).sum(axis=1).mean()
    return Arrivals(light.wavelengths_nm, x_mm, y_mm, total, np.sqrt([square]), (1, 1))


def _coarse_stars(lens, edges, frame, light, discs):
    """The stars of parts of all spots, as in `spread_in_cells`, at the corners of cells: array (wavelength, row,
    column)."""
    return spread_in_cells(frame, light, [_coarse_spread(lens, edges, frame, light.wavelengths_nm)], discs)


def prepare_stars(lens: Lens, opening: Opening, frame: PixelGrid, wavelengths_nm: np.ndarray) -> None:
    """Compute what `add_stars` needs for any light."""
    _, spread = _coarse_spread(lens, edges_of(opening, lens.central_obstruction), frame, wavelengths_nm)
    transformed(frame.shape_px, spread)


def _coarse_spread(lens, edges, frame, wavelengths_nm):
    """Factors (wavelength,) and the Spread of stars at the corners of cells: by the middle one of the wavelengths."""
    numbers = _wave_numbers(lens, wavelengths_nm) * frame.pitch_um * 1e-3
    middle = numbers.size // 2
    window_px = _window_mm(lens, wavelengths_nm)[middle] / (frame.pitch_um * 1e-3)
    return 1 / numbers, _CoarseStar(tuple(edges), float(numbers[middle]), float(window_px))


@dataclass(frozen=True)
class _CoarseStar:
    """The Spread of edges around spots as large as a cell; the other attributes are as for `_Spikes`."""

    edges: tuple[Edge, ...]
    number: float
    window_px: float

    def __call__(self, right_px, up_px):
        return sum(spikes.exact(right_px, up_px) for spikes in self._spikes)

    @cached_property
    def _spikes(self):
        return [_Spikes(edge, self.number, self.window_px, CELL_PX) for edge in self.edges]


def _add_star(cells, lens, edges, frame, light):
    """Add the star of one spot, computed at two wavelengths and interpolated: times k, it is nearly linear between."""
    nm = light.wavelengths_nm
    numbers = _wave_numbers(lens, nm) * frame.pitch_um * 1e-3
    window_px = _window_mm(lens, nm) / (frame.pitch_um * 1e-3)
    ends = sorted({0, nm.size - 1})
    for end, weight in zip(ends, np.eye(len(ends)), strict=True):
        factors = np.interp(nm, nm[ends], weight) * light.light[:, 0] / numbers
        place = frame.index_of(light.x_mm[end, 0], light.y_mm[end, 0])
        _add_edges(cells, factors, [_Spikes(edge, numbers[end], window_px[end], light.radius_px[0])
                                    for edge in edges], place)


def _add_edges(cells, factors, edges, place):
    """Add the light of edges around a place: near it, that of all together for each pixel."""
    row, column = place
    up, right = row - cells.corner_rows[:, None], cells.corner_columns - column
    middle_up, middle_right = up[:-1] - CELL_PX / 2, right[:-1] + CELL_PX / 2
    near = np.hypot(middle_right, middle_up) < NEAR_PX + edges[0].window_px
    together, corners = 0.0, 0.0
    for edge in edges:
        at_corners = edge.smooth(right, up)
        together, corners = together + edge.exact(*cells.pixels(near, place)), corners + at_corners
        sharp = edge.sharp(middle_right, middle_up) & ~near
        cells.add(factors, sharp, edge.exact(*cells.pixels(sharp, place)) - cells.interpolated(at_corners, sharp))
    cells.add(factors, near, together - cells.interpolated(corners, near))
    cells.corners += factors[:, None, None] * corners


class _Spikes:
    """The light of an edge around a spot of unit light, times k over r in 1/px, per pixel; positions are in pixels.

    Parameters
    ----------
    edge : Edge
    number : float
        k over r.
    window_px : float
    radius_px : float
        Of the spot.
    """

    def __init__(self, edge, number, window_px, radius_px):
        self.edge, self.window_px = edge, window_px
        self.normal = np.cos(edge.azimuth_rad), np.sin(edge.azimuth_rad)
        self.weight = edge.count * edge.length / (2 * np.pi**2)
        self.width_px = 1 / (number * edge.length)  # half width of a spike without the pixels
        self.angle = edge.half_angle_rad
        sides = np.sort(np.abs(self.normal))
        widths = np.maximum(np.hypot(sides, np.multiply(DISC_BOXES, radius_px)), LEAST_PX)
        self.reach_px = CELL_PX + 1 + sum(widths) / 2
        self.core_px = sum(widths) / (2 * np.pi)  # closer to the middle, both sides overlap, and W is even
        self.falloff = _falloff(window_px, np.hypot(radius_px, PIXEL_PX))
        self.places = np.arange(-self.reach_px, self.reach_px + STEP_PX, STEP_PX)
        self.table = _box_means(self.places, self.width_px, widths, bool(self.angle))

    def smooth(self, right, up):
        """The light at points, without its mean over pixels."""
        ahead, offset, radius = self._turned(right, up)
        return self._outside(radius) * self._density(ahead, offset, radius)

    def exact(self, right, up):
        """The light of pixels."""
        ahead, offset, radius = self._turned(right, up)
        distance = self._distance(ahead, offset, radius)
        sharp = self._sharp(distance, radius)
        density = np.empty_like(radius)
        density[sharp] = self._mean_density(distance[sharp], radius[sharp])
        density[~sharp] = self._density(ahead[~sharp], offset[~sharp], radius[~sharp])
        return self._outside(radius) * density

    def sharp(self, right, up):
        """Whether the light of cells around points must be computed for each pixel."""
        ahead, offset, radius = self._turned(right, up)
        return self._sharp(self._distance(ahead, offset, radius), radius)

    def _sharp(self, distance, radius):
        return np.abs(np.abs(distance) - radius * self.angle) < (0 if self.angle == np.pi / 2 else self.reach_px)

    def _turned(self, right, up):
        """Places along the normal and across it, and their distances, at least half a pixel."""
        across, along = self.normal
        radius = np.sqrt(np.maximum(right * right + up * up, 0.25))
        return right * across + up * along, up * across - right * along, radius

    def _distance(self, ahead, offset, radius):
        """Distance from the spike's middle along the circle through the point."""
        return radius * np.arctan(offset / np.where(ahead == 0, LEAST_PX, ahead))

    def _density(self, ahead, offset, radius):
        """W. For a bent edge, by the difference of the integrals at its ends, which are angles of complex numbers."""
        width = self.width_px / radius
        if not self.angle:
            return width / np.pi / ((offset / radius) ** 2 + width**2)
        twice, ends = (ahead**2 - offset**2) / radius**2, np.cos(2 * self.angle)
        return np.arctan2(2 * width * np.sin(2 * self.angle), width**2 * (ends + twice) + ends - twice) / (
            2 * np.pi * self.angle)

    def _mean_density(self, distance, radius):
        """W near the ends of a bent edge, or the middle of a straight one, averaged over pixels and the spot."""
        density = self._one_side(distance, radius)
        near = radius < self.reach_px
        for half_turn in np.pi * radius[near] * [[-1], [1]]:
            density[near] += self._one_side(distance[near] + half_turn, radius[near])
        density[radius < self.core_px] = 1 / np.pi
        return density

    def _one_side(self, distance, radius):
        if not self.angle:
            return radius * np.interp(distance, self.places, self.table, left=0, right=0)
        ahead, behind = (self._integral(distance + side * radius * self.angle) for side in (1, -1))
        return (ahead - behind) / (2 * self.angle)

    def _integral(self, place):
        far = np.sign(place) / 2 - self.width_px / np.pi / np.where(place == 0, LEAST_PX, place)
        near = np.abs(place) < self.reach_px
        far[near] = np.interp(place[near], self.places, self.table)
        return far

    def _outside(self, radius):
        """The mean of 1 / r^3 outside the window over the pixel and the spot."""
        places, means = self.falloff
        near, mean = radius < places[-1], 1 / (radius * radius * radius)
        mean[near] = np.interp(radius[near], places, means)
        return self.weight * mean


def _falloff(window_px, radius_px):
    """Means of 1 / r^3 outside the window over discs of this radius, by the distance of their middles: (place,) each.

    The share t / pi of a circle of the radius r is in a disc, so the sum over the disc is the integral of 2 t / r^2
    over r, or of 2 t over 1 / r.
    """
    places = np.linspace(max(window_px - radius_px, 0), window_px + FAR_RADII * radius_px, FALLOFF_PLACES)
    inverse_ends = 1 / (places + radius_px), 1 / np.maximum(places - radius_px, window_px)
    circles = 1 / np.linspace(*inverse_ends, 2 * FALLOFF_CIRCLES + 1)[1::2]
    cosine = (circles**2 + places**2 - radius_px**2) / (2 * circles * np.maximum(places, LEAST_PX))
    angle = np.arccos(np.clip(cosine, -1, 1)).mean(axis=0)
    return places, 2 * angle * (inverse_ends[1] - inverse_ends[0]) / (np.pi * radius_px**2)


def _box_means(x, width, boxes, integral):
    """Means over two boxes of a Lorentzian of this half width, or of its integral, around x."""
    def twice(x):
        return (x * np.arctan(x / width) - width / 2 * np.log(x**2 + width**2)) / np.pi

    def thrice(x):
        return ((x**2 - width**2) / 2 * np.arctan(x / width) - width * x / 2 * (np.log(x**2 + width**2) - 1)) / np.pi

    of, outer, inner = thrice if integral else twice, sum(boxes) / 2, (boxes[0] - boxes[1]) / 2
    return (of(x + outer) - of(x + inner) - of(x - inner) + of(x - outer)) / np.prod(boxes)
