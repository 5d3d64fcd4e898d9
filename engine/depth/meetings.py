"""Which layers the rays of a tile of pixels can meet, and how many rays that takes.

A tile that meets nothing but what is in focus takes none. What tiles meet is looked up in blocks of pixels, a little
more widely than need be.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d

from ..image.pixel_grid import PixelGrid
from ..kernels import MEETING
from .pencils import Pencils
from .seen import Seen

TILE_PX, BLOCK_PX = 16, 8
QUANTITIES = 6  # of which extremes are looked up
FEWEST_RAYS = 32
STRIDE_PX = 1.0  # from ray to ray across a blur: what they miss is noise that all pictures of a scene share
BRIGHT, MOST_TIMES = 4, 8  # what stands out so much gets more rays, in proportion, up to so many times
OPAQUE = 0.998
DEPTHS = 9  # between which what rays reach is interpolated: that of straight rays is less than so
STEPS_PX = (0.25, 1.0, 4.0)  # up to which the blur may differ for 0, 1 and 2 steps of the search; 3 beyond


@dataclass(frozen=True, eq=False)
class Meetings:
    """Of each tile: arrays (tile row, tile column, layer) of MEETING, and (tile row, tile column) of eights of rays."""

    found: np.ndarray
    eights: np.ndarray


def plan_meetings(layers: list[Seen], rays: Pencils, sensor: PixelGrid, per_focal: float, most_rays: int,
                  most_of_lamps: int) -> Meetings:
    """What the tiles of a sensor meet.

    Parameters
    ----------
    layers : list of Seen
        The nearest first.
    rays : Pencils
        At the wavelengths that differ most.
    sensor : PixelGrid
    per_focal : float
        See `kernels.Casting`.
    most_rays, most_of_lamps : int
        See `cast`.
    """
    right, up = _tile_middles(sensor)
    found = np.zeros((*right.shape, len(layers)), MEETING)
    seen_through, focus_behind = np.ones((2, *right.shape), bool)  # not all covered; not all covered in focus
    blurred = np.zeros(right.shape, bool)
    spread, peak, even = (np.zeros(right.shape) for _ in range(3))
    for here, layer in zip(np.moveaxis(found, -1, 0), layers, strict=True):
        blocks, reach = _Blocks(layer), _Reach(layer, rays, per_focal, right, up)
        least, most = np.full(right.shape, reach.least), np.full(right.shape, reach.most)
        for _ in range(2):  # within what the first look leaves, depths differ less
            look = blocks.look(*reach.bounds_px(least, most))
            least, most = look.least, look.most
        met = look.met & (seen_through | (focus_behind & (look.sharpest > 0)))
        here["inverse_depth"] = (least + most) / 2
        here["share"] = (look.sharpest + look.dullest) / 2
        steps = np.maximum(np.searchsorted(STEPS_PX, reach.blur_px(most - least)), look.clearest < OPAQUE)
        here["steps"] = np.where(met, steps, -1)
        here["focused"] = met & (look.sharpest > 0)
        here["opaque"] = met & (look.clearest == 1)
        dull = met & (look.dullest < 1)
        blurred |= dull
        spread = np.maximum(spread, np.where(dull, 2 * reach.radius_px(least, most), 0))
        peak = np.maximum(peak, np.where(dull, look.brightest, 0))
        even += np.where(met, look.mean_light, 0)
        seen_through &= ~met | (look.clearest < OPAQUE)
        focus_behind &= ~met | (look.clearest * look.dullest < OPAQUE)
    count = 2 ** np.ceil(2 * np.log2(np.maximum(spread / STRIDE_PX, 1)))
    stands_out = np.clip(peak / np.maximum(even, 1e-30) / BRIGHT, 1, MOST_TIMES)
    count = np.clip(count, FEWEST_RAYS, most_rays) * 2 ** np.round(np.log2(stands_out))
    return Meetings(found, np.where(blurred, np.minimum(count, most_of_lamps) // 8, 0).astype(np.int64))


def _tile_middles(sensor):
    """To the right of the axis and upwards: arrays (tile row, tile column), in pixels."""
    rows, columns = (np.arange(0, n, TILE_PX) + (TILE_PX - 1) / 2 for n in sensor.shape_px)
    return np.meshgrid(columns - sensor.centre_px[1], sensor.centre_px[0] - rows)


class _Reach:
    """Where in a layer the rays of tiles arrive: about a middle, no farther off than a radius."""

    def __init__(self, layer, rays, per_focal, right, up):
        nearness = layer.depth[..., 0]
        self.least, self.most = float(nearness.min()), float(nearness.max())
        self._row, self._column = layer.axis_px
        distance = np.hypot(right, up)
        self._right, self._up = (axis / np.maximum(distance, 1e-9) for axis in (right, up))
        self._at = np.minimum(distance * rays.heights_per_px, rays.heights - 1)
        middle, radius = _ends(rays, per_focal, np.linspace(self.least, self.most, DEPTHS))
        step_px = 1 / rays.heights_per_px
        slope = np.gradient(middle, step_px, axis=1).max()
        beyond = np.maximum(distance - rays.last_px, 0) * slope
        half_px = TILE_PX / np.sqrt(2)
        self._margin = half_px * max(slope, 1) + 2 + beyond / 4
        self._beyond = beyond
        self._middle = middle
        self._radius = maximum_filter1d(radius, 2 * int(np.ceil(half_px / step_px)) + 1, axis=1)
        self._blur = 2 * (np.hypot(*rays.moved_px[:, 0]) * (rays.margin[0] > 0)).max(axis=-1)

    def radius_px(self, least, most):
        return np.maximum(*(self._between(self._radius, nearness) for nearness in (least, most)))

    def blur_px(self, difference):
        """By how much the blur differs where the inverse depth does."""
        return self._blur[self._at.astype(int)] * difference

    def bounds_px(self, least, most):
        """Top, bottom, left and right of what can be met between two inverse depths, in the layer's pixels."""
        ends = []
        for nearness in (least, most):
            middle = self._between(self._middle, nearness) + self._beyond
            radius = self._between(self._radius, nearness) + self._margin
            row, column = self._row - middle * self._up, self._column + middle * self._right
            ends.append((row - radius, row + radius, column - radius, column + radius))
        return [bound(one, other) for bound, one, other in zip((np.minimum, np.maximum) * 2, *ends, strict=True)]

    def _between(self, table, nearness):
        """A table (depth, height) at the tiles' distances, and at these inverse depths."""
        depth = np.clip((nearness - self.least) / max(self.most - self.least, 1e-30), 0, 1) * (DEPTHS - 1)
        i, j = np.minimum(depth.astype(int), DEPTHS - 2), np.minimum(self._at.astype(int), table.shape[1] - 2)
        u, v = depth - i, self._at - j
        return ((1 - u) * ((1 - v) * table[i, j] + v * table[i, j + 1])
                + u * ((1 - v) * table[i + 1, j] + v * table[i + 1, j + 1]))


def _ends(rays, per_focal, nearness):
    """Middles and radii of what rays reach at inverse depths: arrays (depth, height), in pixels from the axis."""
    far, moved, passing = rays.far_px, rays.moved_px, rays.margin > 0
    place = far[:, None] + moved[:, None] * nearness[:, None, None, None].astype(np.float32)
    if per_focal:
        tangent = np.hypot(*place) * per_focal
        place *= np.arctan(tangent) / np.maximum(tangent, 1e-20)
    lit = np.broadcast_to(passing, place.shape[1:])
    low, high = (bound.reduce(place[0], axis=(1, 3), where=lit, initial=start)
                 for bound, start in ((np.minimum, np.inf), (np.maximum, -np.inf)))
    middle = np.where(low <= high, (low + high) / 2, 0)
    distance = np.hypot(place[0] - middle[:, None, :, None], place[1])
    return middle, np.maximum.reduce(distance, axis=(1, 3), where=lit, initial=0)


@dataclass(frozen=True, eq=False)
class _Look:
    """What lies in regions of a layer: arrays (tile row, tile column)."""

    met: np.ndarray  # whether it covers anything there
    least: np.ndarray  # inverse depth
    most: np.ndarray
    dullest: np.ndarray  # share of focus
    sharpest: np.ndarray
    clearest: np.ndarray  # alpha
    brightest: np.ndarray  # of a pixel, in the mean over some wavelengths
    mean_light: np.ndarray


class _Blocks:
    """Extremes of a layer in blocks of pixels, and in all areas of two to the n by two to the m blocks."""

    def __init__(self, layer):
        alpha, (nearness, share) = layer.layer.alpha, np.moveaxis(layer.depth, -1, 0)
        cube = layer.layer.cube
        light = cube[[0, len(cube) // 2, -1]].mean(axis=0)
        covered = alpha > 0
        lowest = -np.inf
        planes = [np.where(covered, each, lowest) for each in (nearness, -nearness, share, -share)]
        blocks = np.stack([_largest_in_blocks(plane, lowest) for plane in (*planes, -alpha, light)])
        self._goes_on, self._shape = layer.goes_on, alpha.shape
        self._levels = _over_powers_of_two(blocks)
        self._sums = np.zeros(np.add(blocks.shape[1:], 1))
        self._sums[1:, 1:] = _in_blocks(light, 0).sum(axis=(1, 3)).cumsum(axis=0).cumsum(axis=1)

    def look(self, *bounds_px):
        """The extremes between top, bottom, left and right, arrays (tile row, tile column)."""
        inside, whole, ends = True, True, []
        for first, last, on_before, on_behind, count in zip(bounds_px[::2], bounds_px[1::2], self._goes_on[::2],
                                                            self._goes_on[1::2], self._shape, strict=True):
            inside &= (on_before | (last > -1)) & (on_behind | (first < count))
            whole &= (on_before | (first >= 0)) & (on_behind | (last <= count - 1))
            ends += [np.clip(each, 0, count - 1).astype(int) // BLOCK_PX for each in (first, last)]
        top, bottom, left, right = ends
        tall, wide = (np.log2(last - first + 1).astype(int) for first, last in ((top, bottom), (left, right)))
        most, minus_least, sharpest, minus_dullest, minus_clearest, brightest = np.maximum.reduce([
            self._levels[tall, wide, :, row, column] for row in (top, bottom + 1 - 2**tall)
            for column in (left, right + 1 - 2**wide)]).transpose(2, 0, 1)
        sums = (self._sums[bottom + 1, right + 1] - self._sums[top, right + 1] - self._sums[bottom + 1, left]
                + self._sums[top, left])
        met = inside & (most > -np.inf)
        least, most, dullest, sharpest = (np.where(met, each, 0)
                                          for each in (-minus_least, most, -minus_dullest, sharpest))
        return _Look(met, least, most, dullest, sharpest, np.where(whole, -minus_clearest, 0), brightest,
                     sums / ((bottom + 1 - top) * (right + 1 - left) * BLOCK_PX**2))


def values_of_blocks(pixels: int) -> float:
    """How many values, in single precision, the extremes of so large a layer take."""
    blocks = pixels / BLOCK_PX**2
    return QUANTITIES * blocks * (np.log2(max(blocks, 1)) / 2 + 1) ** 2


def _in_blocks(plane, beyond):
    """A plane cut into blocks, what is missing of the last ones made up: array (row, in it, column, in it)."""
    rows, columns = (-(-n // BLOCK_PX) for n in plane.shape)
    padding = [(0, blocks * BLOCK_PX - n) for blocks, n in zip((rows, columns), plane.shape, strict=True)]
    return np.pad(plane, padding, constant_values=beyond).reshape(rows, BLOCK_PX, columns, BLOCK_PX)


def _largest_in_blocks(plane, beyond):
    return _in_blocks(plane, beyond).max(axis=(1, 3))


def _over_powers_of_two(blocks):
    """The largest of areas that begin at each block: array (log2 of rows, log2 of columns, quantity, row, column)."""
    counts = [int(np.log2(n)) + 1 for n in blocks.shape[1:]]
    levels = np.empty((*counts, *blocks.shape), np.float32)
    levels[0, 0] = blocks
    for i in range(counts[0]):
        if i:
            levels[i, 0] = levels[i - 1, 0]
            half = 2 ** (i - 1)
            np.maximum(levels[i, 0, :, :-half], levels[i - 1, 0, :, half:], out=levels[i, 0, :, :-half])
        for j in range(1, counts[1]):
            half = 2 ** (j - 1)
            levels[i, j] = levels[i, j - 1]
            np.maximum(levels[i, j, :, :, :-half], levels[i, j - 1, :, :, half:], out=levels[i, j, :, :, :-half])
    return levels
