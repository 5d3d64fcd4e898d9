"""The layers that rays of a tile of pixels can meet, and the number of rays that the tile requires.

A tile that meets only in-focus light requires zero rays. The lookup is in blocks of pixels, in an area slightly larger
than necessary.
"""

from dataclasses import dataclass

import numpy as np

from ..field.field_map import RaySample, Tiles
from ..image.pixel_grid import PixelGrid
from ..kernels import MEETING
from .prepared_layer import PreparedLayer

TILE_PX, BLOCK_PX = 16, 8
QUANTITIES = 6  # with extremes in the lookup
FEWEST_RAYS = 32
STRIDE_PX = 1.0  # from ray to ray across a blur; light between rays is noise that all pictures of a scene share
BRIGHT, MOST_TIMES = 4, 8  # contrast from which the number of rays increases in proportion, and the largest factor
OPAQUE = 0.998
STEPS_PX = (0.25, 1.0, 4.0)  # largest differences in blur for 0, 1 and 2 steps of the search; 3 beyond


@dataclass(frozen=True, eq=False)
class Meetings:
    """Arrays (tile row, tile column, layer) of MEETING, and (tile row, tile column) of the number of eights of rays."""

    kinds: np.ndarray
    eights: np.ndarray


def plan_meetings(layers: list[PreparedLayer], rays: RaySample, sensor: PixelGrid, per_focal: float, most_rays: int,
                  most_of_lamps: int) -> Meetings:
    """Find the layers that the tiles of a sensor meet.

    Parameters
    ----------
    layers : list of PreparedLayer
        The nearest first.
    rays : RaySample
        Rays at the wavelengths that differ most.
    sensor : PixelGrid
    per_focal : float
        See `kernels.Casting`.
    most_rays, most_of_lamps : int
        See `cast`.
    """
    tiles = _tiles(sensor)
    shape = tiles.right.shape
    meetings = np.zeros((*shape, len(layers)), MEETING)
    uncovered, focus_behind = np.ones((2, *shape), bool)  # not all covered; not all covered in focus
    blurred = np.zeros(shape, bool)
    spread, peak, even = (np.zeros(shape) for _ in range(3))
    for here, layer in zip(np.moveaxis(meetings, -1, 0), layers, strict=True):
        blocks, reach = _Blocks(layer), rays.reach(layer.depth[..., 0], layer.axis_px, per_focal, tiles)
        least, most = np.full(shape, reach.least), np.full(shape, reach.most)
        for _ in range(2):  # the first look narrows the range of depths for the second
            look = blocks.look(*reach.bounds_px(least, most))
            least, most = look.least, look.most
        met = look.met & (uncovered | (focus_behind & (look.sharpest > 0)))
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
        uncovered &= ~met | (look.clearest < OPAQUE)
        focus_behind &= ~met | (look.clearest * look.dullest < OPAQUE)
    count = 2 ** np.ceil(2 * np.log2(np.maximum(spread / STRIDE_PX, 1)))
    stands_out = np.clip(peak / np.maximum(even, 1e-30) / BRIGHT, 1, MOST_TIMES)
    count = np.clip(count, FEWEST_RAYS, most_rays) * 2 ** np.round(np.log2(stands_out))
    return Meetings(meetings, np.where(blurred, np.minimum(count, most_of_lamps) // 8, 0).astype(np.int64))


def _tiles(sensor):
    rows, columns = (np.arange(0, n, TILE_PX) + (TILE_PX - 1) / 2 for n in sensor.shape_px)
    return Tiles(*np.meshgrid(columns - sensor.centre_px[1], sensor.centre_px[0] - rows), TILE_PX)


@dataclass(frozen=True, eq=False)
class _Look:
    """Extremes in regions of a layer: arrays (tile row, tile column)."""

    met: np.ndarray  # whether the layer covers anything in the region
    least: np.ndarray  # inverse depth
    most: np.ndarray
    dullest: np.ndarray  # focus share
    sharpest: np.ndarray
    clearest: np.ndarray  # alpha
    brightest: np.ndarray  # pixel, averaged over three wavelengths
    mean_light: np.ndarray


class _Blocks:
    """Extremes of a layer in blocks of pixels, and in all areas of 2^n by 2^m blocks."""

    def __init__(self, layer):
        alpha, (nearness, share) = layer.layer.alpha, np.moveaxis(layer.depth, -1, 0)
        cube = layer.layer.cube
        light = cube[[0, len(cube) // 2, -1]].mean(axis=0, dtype=np.float64)  # sums of bright light overflow float32
        covered = alpha > 0
        lowest = -np.inf
        planes = [np.where(covered, each, lowest) for each in (nearness, -nearness, share, -share)]
        blocks = np.stack([_largest_in_blocks(plane, lowest) for plane in (*planes, -alpha, light)])
        self._goes_on, self._shape = layer.goes_on, alpha.shape
        self._levels = _over_powers_of_two(blocks)
        self._sums = np.zeros(np.add(blocks.shape[1:], 1))
        self._sums[1:, 1:] = _in_blocks(light, 0).sum(axis=(1, 3)).cumsum(axis=0).cumsum(axis=1)

    def look(self, *bounds_px):
        """The extremes between top, bottom, left and right: arrays (tile row, tile column)."""
        inside, contained, ends = True, True, []
        for first, last, on_before, on_behind, count in zip(bounds_px[::2], bounds_px[1::2], self._goes_on[::2],
                                                            self._goes_on[1::2], self._shape, strict=True):
            inside &= (on_before | (last > -1)) & (on_behind | (first < count))
            contained &= (on_before | (first >= 0)) & (on_behind | (last <= count - 1))
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
        return _Look(met, least, most, dullest, sharpest, np.where(contained, -minus_clearest, 0), brightest,
                     sums / ((bottom + 1 - top) * (right + 1 - left) * BLOCK_PX**2))


def values_of_blocks(pixels: int) -> float:
    """Number of single-precision values in the extremes of a layer with this number of pixels."""
    blocks = pixels / BLOCK_PX**2
    return QUANTITIES * blocks * (np.log2(max(blocks, 1)) / 2 + 1) ** 2


def _in_blocks(plane, beyond):
    """A plane divided into blocks, the last ones padded: array (block row, row, block column, column)."""
    rows, columns = (-(-n // BLOCK_PX) for n in plane.shape)
    padding = [(0, blocks * BLOCK_PX - n) for blocks, n in zip((rows, columns), plane.shape, strict=True)]
    return np.pad(plane, padding, constant_values=beyond).reshape(rows, BLOCK_PX, columns, BLOCK_PX)


def _largest_in_blocks(plane, beyond):
    return _in_blocks(plane, beyond).max(axis=(1, 3))


def _over_powers_of_two(blocks):
    """Maximum over areas that start at each block: array (log2 of rows, log2 of columns, quantity, row, column)."""
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
