"""The layers that rays of a tile of pixels can meet, and the number of rays that the tile requires.

A tile requires zero rays without out-of-focus light and without out-of-focus surfaces in front of any light. The lookup
is in blocks of pixels, in an area slightly larger than necessary.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..field.field_map import CaptureView, RayReach, RaySample, Tiles
from ..image.pixel_grid import PixelGrid
from ..kernels.casting import MEETING
from ..rays.stop_places import RAY_COUNTS
from .levels import SOFTNESS_PX
from .prepared_layer import PreparedLayer

TILE_PX, BLOCK_PX = 16, 8
LAMP_PX = 4  # side of the squares whose light counts as a lamp: wider things have rims as soft as they are wide
QUANTITIES = {True: 8, False: 10}  # with extremes in the lookup: on a plane, and in a panorama
COUNTS = np.array(RAY_COUNTS)  # of rays
FINEST_OF_PARTS = 0.28  # of the smallest side of a ray's cell, if the light of the parts of pixels is known: the rays
# of lamps with sharp cores are closer together than a cell's
RAYS_IN_CELL = 2  # the most, in a square of the smallest side, for light without lamps
OVERLAP = 1.75  # side of a look-up in distances between rays: aberrations stretch the rays' pattern, and narrower
# look-ups show it in the discs of lamps
REACH = 1.5  # of a look-up, beyond its middle, in its sides
STEPS = np.array([1, 2, 4])  # distances between cast pixels
SMOOTH = 1.75  # least side of a tile's look-ups, in these distances: pixels between cast ones then differ from
# interpolated ones by a tenth of the rays' error, and lamps have all of their light
STEP = 0.05  # at the rim of a lamp's disc, relative to the light around it, from which the number of rays increases
OPAQUE = 0.998
EVEN_SHARE = 2e-3  # largest difference of focus shares in a tile whose rays all have the mean of both
AREA_ROWS = 8  # of tiles that are cast together, for which layers are divided into parts
BESIDE_PX = 96  # pixels around what the rays of such tiles reach: for the pixels of levels
LEAST_PX = 0.5  # side of a blur that whole pixels show
SLIGHT_PX, NARROW_PX = 3.0, 12.0  # largest blur of tiles whose rays look up parts of pixels: of any light; and of lamps
RISE = 1.0  # whose discs rise this much above the light around. Pixels misplace 0.04 of a disc as wide as NARROW_PX
STEPS_PX = (0.25, 1.0, 4.0)  # largest differences in blur for 0, 1 and 2 steps of the search; 3 beyond


@dataclass(frozen=True, eq=False)
class Meetings:
    """Arrays (tile row, tile column, layer) of MEETING, and (tile row, tile column) of the number of rays of a pixel
    and of the distance between the pixels that are cast.

    `through_parts` are the meetings of the tiles whose rays look up layers in the parts of pixels, None without any:
    these have no rays here. `bounds_px` are the top, bottom, left and right that rays reach in each layer: array
    (layer, 4, tile row, tile column).
    """

    kinds: np.ndarray
    counts: np.ndarray
    steps: np.ndarray
    bounds_px: np.ndarray
    through_parts: "Meetings | None" = None


def plan_meetings(layers: list[PreparedLayer], rays: RaySample, sensor: PixelGrid,
                  view: CaptureView, most_rays: int, most_of_lamps: int, finest_px: float, parts: int = 1) -> Meetings:
    """Find the layers that the tiles of a sensor meet.

    Parameters
    ----------
    layers : list of PreparedLayer
        The nearest first.
    rays : RaySample
        Rays at the wavelengths that differ most.
    sensor : PixelGrid
    view : CaptureView
        Where the capture shows rays.
    most_rays, most_of_lamps, finest_px : int, int, float
        See `cast`.
    parts : int
        Parts of a pixel, down and across, whose light is known.
    """
    tiles = _tiles(sensor)
    shape = tiles.right.shape
    meetings = np.zeros((*shape, len(layers)), MEETING)
    uncovered, focus_behind = np.ones((2, *shape), bool)  # not all covered; not all covered in focus
    blurs, even, bounds = [], np.zeros(shape), np.zeros((len(layers), 4, *shape))
    for here, layer, ends_px in zip(np.moveaxis(meetings, -1, 0), layers, bounds, strict=True):
        nearness = view.nearness(layer.depth[..., 0], layer.axis_px)
        blocks = _Blocks(layer, nearness)
        reach = rays.reach(nearness[layer.layer.alpha > 0], layer.axis_px, view, tiles)
        farthest, nearest = (np.full(shape, end) for end in (reach.least, reach.most))
        least, most = (end * reach.depth_per_nearness for end in (farthest, nearest))
        for _ in range(2):  # the first look narrows the range of depths for the second
            largest_px = np.maximum(reach.area_px(least), reach.area_px(most))
            ends_px[:] = reach.bounds_px(farthest, nearest, around_px(largest_px))
            look = blocks.look(*ends_px)
            farthest, nearest, least, most = look.farthest, look.nearest, look.least, look.most
        met = look.met & (uncovered | (focus_behind & (look.sharpest > 0)))
        here["inverse_depth"] = most
        here["share"] = (look.sharpest + look.dullest) / 2
        varied = (look.clearest < OPAQUE) | (look.sharpest - look.dullest > EVEN_SHARE)
        steps = np.maximum(np.searchsorted(STEPS_PX, reach.blur_px(most - least)), varied)
        here["steps"] = np.where(met, steps, -1)
        here["focused"] = met & (look.sharpest > 0)
        here["opaque"] = met & (look.clearest == 1)
        sharpest = np.clip(layer.in_focus_near(tiles.right, tiles.up), least, most)
        blurs.append(_Blur(met, reach, least, most, sharpest, look))
        even += np.where(met, look.mean_light, 0)
        uncovered &= ~met | (look.clearest < OPAQUE)
        focus_behind &= ~met | (look.clearest * look.dullest < OPAQUE)
    needed, lit_beyond, narrow = np.zeros((2, *shape)), np.zeros(shape, bool), np.zeros(shape, bool)
    for blur in reversed(blurs):
        matters = blur.met & ((blur.look.blurred > 0) | (blur.look.dullest < 1) & lit_beyond)
        narrow |= matters & blur.narrow(even) & (parts > 1)
        for of_size, size in zip(needed, (1, parts), strict=True):
            np.maximum(of_size, np.where(matters, blur.rays(even, most_rays, finest_px, size), 0), out=of_size)
        lit_beyond |= blur.met & (blur.look.lit > 0)
    whole, through_parts = (
        _meetings(meetings, blurs, bounds, np.where(where, of_size, 0), most_of_lamps, finest_px, size)
        for where, of_size, size in zip((~narrow, narrow), needed, (1, parts), strict=True))
    return replace(whole, through_parts=through_parts if narrow.any() else None)


def _meetings(kinds, blurs, bounds_px, needed, most_of_lamps, finest_px, parts):
    """Meetings of tiles that need these numbers of rays, which look up `parts` x `parts` parts of pixels."""
    counts = COUNTS[np.minimum(np.searchsorted(COUNTS, needed), np.searchsorted(COUNTS, most_of_lamps, "right") - 1)]
    counts, kinds, narrowest_px = np.where(needed > 0, counts, 0), kinds.copy(), np.full(needed.shape, np.inf)
    for here, blur in zip(np.moveaxis(kinds, -1, 0), blurs, strict=True):
        side_px = blur.side_px(np.maximum(counts, 1), _cell_px(finest_px, parts))
        here["level"], here["cells"] = blur.level(parts * side_px)
        narrowest_px = np.where(blur.met, np.minimum(narrowest_px, np.where(here["focused"], 0, side_px)), narrowest_px)
    return Meetings(kinds, counts, STEPS[np.searchsorted(STEPS[1:] * SMOOTH, narrowest_px, "right")], bounds_px)


@dataclass(frozen=True, eq=False)
class Area:
    """A rectangle of tiles, some of which have rays."""

    meetings: Meetings
    tiles: tuple[slice, slice]

    def met(self, layers: list[PreparedLayer]) -> tuple[Meetings, list[PreparedLayer], tuple[slice, slice]]:
        """The meetings of its tiles with the layers that they meet; these layers; and the region of the capture that
        the rays reach."""
        of_tiles, whole = self.meetings, (slice(None), *self.tiles)
        counts, kinds, bounds = of_tiles.counts[self.tiles], of_tiles.kinds[self.tiles], of_tiles.bounds_px[:, *whole]
        meet = (kinds["steps"] >= 0) & (counts > 0)[..., None]
        numbers = np.flatnonzero(meet.any(axis=(0, 1)))
        ends = np.array([_ends_px(bounds[n][:, meet[..., n]], layers[n].layer.origin_px) for n in numbers])
        region = tuple(slice(int(np.clip(first - BESIDE_PX, 0, n - 1)), int(np.clip(last + BESIDE_PX, 1, n)))
                       for first, last, n in zip(ends[:, 0].min(axis=0), ends[:, 1].max(axis=0),
                                                 layers[0].capture.shape_px, strict=True))
        part = Meetings(np.ascontiguousarray(kinds[..., numbers]), np.ascontiguousarray(counts),
                        np.ascontiguousarray(of_tiles.steps[self.tiles]), bounds[numbers])
        return part, [layers[n] for n in numbers], (region[0], region[1])

    def place(self, shape_px: tuple[int, int]) -> tuple[slice, slice]:
        """Its rows and columns on a sensor of this shape."""
        rows, columns = (slice(TILE_PX * side.start, min(TILE_PX * side.stop, n))
                         for side, n in zip(self.tiles, shape_px, strict=True))
        return rows, columns

    def pixels(self, shape_px: tuple[int, int]) -> np.ndarray:
        """Which of its pixels are in tiles with rays: bool array (row, column)."""
        rows, columns = self.place(shape_px)
        cast = (self.meetings.counts[self.tiles] > 0).repeat(TILE_PX, axis=0).repeat(TILE_PX, axis=1)
        return cast[:rows.stop - rows.start, :columns.stop - columns.start]


def _ends_px(bounds_px, origin_px):
    """The first and the last row and column of the capture within bounds in a layer: array (2, 2)."""
    top, bottom, left, right = bounds_px
    return np.array([(top.min(), left.min()), (bottom.max(), right.max())]) + origin_px


def areas_of(meetings: Meetings) -> Iterator[Area]:
    """Rectangles that contain all tiles with rays, of at most AREA_ROWS rows of tiles."""
    for first in range(0, len(meetings.counts), AREA_ROWS):
        rows = slice(first, min(first + AREA_ROWS, len(meetings.counts)))
        columns = np.flatnonzero(meetings.counts[rows].any(axis=0))
        if columns.size:
            yield Area(meetings, (rows, slice(int(columns[0]), int(columns[-1]) + 1)))


def around_px(area_px: np.ndarray) -> np.ndarray:
    """The farthest that a look-up reaches beyond a blur of this area, with the fewest rays."""
    return 1 + np.ceil(REACH * _look_up_px(area_px, COUNTS[0], LEAST_PX))


def _cell_px(finest_px, parts):
    """Smallest side of a ray's cell, if the light of these parts of pixels is known."""
    return finest_px if parts == 1 else FINEST_OF_PARTS * finest_px


def _look_up_px(area_px, counts, finest_px):
    """Side of the squares that this number of rays look up in a blur of this area."""
    return np.maximum(OVERLAP * np.sqrt(area_px / counts), finest_px)


@dataclass(frozen=True, eq=False)
class _Blur:
    """The blur of a layer in tiles: arrays (tile row, tile column).

    `least` and `most` are the ends of the range of inverse depths, `sharpest` is the closest to the plane of focus.
    """

    met: np.ndarray
    reach: RayReach
    least: np.ndarray
    most: np.ndarray
    sharpest: np.ndarray
    look: "_Look"

    def rays(self, even, most_rays, finest_px, parts):
        """The number of rays that show the layer well, next to light of this mean.

        A lamp's disc rises above the light around it by its light over the disc's area. Its rim is as soft as a ray's
        cell is wide. The error of this softness, relative to the light around, shall not exceed the error of a
        disc that rises by STEP and is gathered by `most_rays` rays. No cell is smaller than `finest_px`,
        or than FINEST_OF_PARTS of it if rays look up `parts` x `parts` parts of pixels.
        """
        cell_px = _cell_px(finest_px, parts)
        areas = [np.maximum(self.reach.area_px(nearness), cell_px**2)
                 for nearness in (self.sharpest, self.least, self.most)]
        largest = np.maximum.reduce(areas)
        lamp = np.sqrt(most_rays) * np.divide(self.look.excess, STEP * even, out=np.zeros_like(even), where=even > 0)
        area = np.clip(np.cbrt(cell_px * lamp) ** 2, np.minimum.reduce(areas), largest)
        lamps = np.minimum((lamp / area) ** 2, area / cell_px**2)
        return np.maximum(lamps, np.minimum(most_rays, RAYS_IN_CELL * (parts / finest_px) ** 2 * largest))

    def narrow(self, even):
        """Whether the capture's pixels soften the blur noticeably, next to light of this mean."""
        area_px = np.minimum.reduce([self.reach.area_px(each) for each in (self.least, self.most)])
        rises = self.look.excess > RISE * even * np.maximum(area_px, LEAST_PX**2)
        return area_px < np.pi / 4 * np.where(rises, NARROW_PX, SLIGHT_PX) ** 2

    def side_px(self, counts, finest_px):
        """Side of the squares that this number of rays look up."""
        return _look_up_px(self.reach.area_px((self.least + self.most) / 2), counts, finest_px)

    def level(self, side_px):
        """The level of the layer's pixels that suits look-ups of this side, 0 for light in focus and for rays that miss
        the layer; and the number of look-ups along a side of its pixels, at least 1."""
        level = np.minimum(np.searchsorted(SOFTNESS_PX, side_px), len(SOFTNESS_PX) - 1)
        level = np.where(self.met & (self.look.sharpest <= 0), level, 0)
        return level, np.where(level == 0, np.maximum(1 / side_px, 1), 1)


def _tiles(sensor):
    rows, columns = (np.arange(0, n, TILE_PX) + (TILE_PX - 1) / 2 for n in sensor.shape_px)
    return Tiles(*np.meshgrid(columns - sensor.centre_px[1], sensor.centre_px[0] - rows), TILE_PX)


@dataclass(frozen=True, eq=False)
class _Look:
    """Extremes in regions of a layer: arrays (tile row, tile column)."""

    met: np.ndarray  # whether the layer covers anything in the region
    least: np.ndarray  # inverse depth
    most: np.ndarray
    farthest: np.ndarray  # nearness, by `CaptureView`
    nearest: np.ndarray
    dullest: np.ndarray  # focus share
    sharpest: np.ndarray
    clearest: np.ndarray  # alpha
    brightest: np.ndarray  # absolute light of a square of LAMP_PX out of focus, averaged over it and three wavelengths
    lit: np.ndarray  # absolute light of a pixel
    blurred: np.ndarray  # the same out of focus
    mean_light: np.ndarray  # over the region, also where the layer ends

    @property
    def excess(self):
        """Light of the brightest square beyond the mean."""
        return LAMP_PX**2 * np.maximum(self.brightest - self.mean_light, 0)


class _Blocks:
    """Extremes of a layer in blocks of pixels, and in all areas of 2^n by 2^m blocks."""

    def __init__(self, layer, nearness):
        alpha, (inverse_depth, share) = layer.layer.alpha, np.moveaxis(layer.depth, -1, 0)
        covered = alpha > 0
        lowest = -np.inf
        ranges = [inverse_depth, share] + [nearness] * (not layer.capture.projection.is_plane)
        extremes = [np.where(covered, each, lowest) for plane in ranges for each in (plane, -plane)]
        light = _light(layer.layer.cube)
        means = _in_blocks(light, 0).mean(axis=(1, 3))
        blurred = light * (1 - np.maximum(share, 0))
        brightest = _largest_in_blocks(_means_of_squares(blurred), 0)
        planes = light, blurred, -alpha, *extremes
        blocks = np.stack([brightest, *(_largest_in_blocks(plane, lowest) for plane in planes)])
        self._goes_on, self._shape = layer.goes_on, alpha.shape
        self._levels = _over_powers_of_two(blocks)
        self._sums = np.zeros(np.add(blocks.shape[1:], 1))
        self._sums[1:, 1:] = means.cumsum(axis=0).cumsum(axis=1)

    def look(self, *bounds_px):
        """The extremes between top, bottom, left and right: arrays (tile row, tile column)."""
        inside, contained, ends, blocks = True, True, [], 1.0
        for first, last, on_before, on_behind, count in zip(bounds_px[::2], bounds_px[1::2], self._goes_on[::2],
                                                            self._goes_on[1::2], self._shape, strict=True):
            inside &= (on_before | (last > -1)) & (on_behind | (first < count))
            contained &= (on_before | (first >= 0)) & (on_behind | (last <= count - 1))
            ends += [np.clip(each, 0, count - 1).astype(int) // BLOCK_PX for each in (first, last)]
            blocks *= 1 + (np.minimum(last, count if on_behind else np.inf)
                           - np.maximum(first, 0 if on_before else -np.inf)) / BLOCK_PX
        top, bottom, left, right = ends
        tall, wide = (np.log2(last - first + 1).astype(int) for first, last in ((top, bottom), (left, right)))
        brightest, lit, blurred, minus_clearest, *extremes = np.maximum.reduce([
            self._levels[tall, wide, :, row, column] for row in (top, bottom + 1 - 2**tall)
            for column in (left, right + 1 - 2**wide)]).transpose(2, 0, 1)
        sums = (self._sums[bottom + 1, right + 1] - self._sums[top, right + 1] - self._sums[bottom + 1, left]
                + self._sums[top, left])
        met = inside & (extremes[0] > -np.inf)
        signed = zip(extremes, (1, -1) * 3, strict=False)
        most, least, sharpest, dullest, *of_panorama = (np.where(met, sign * each, 0) for each, sign in signed)
        nearest, farthest = of_panorama or (most, least)
        mean_light = sums / np.maximum(blocks, (bottom + 1 - top) * (right + 1 - left))
        return _Look(met, least, most, farthest, nearest, dullest, sharpest, np.where(contained, -minus_clearest, 0),
                     brightest.astype(float), lit, blurred, mean_light)


def _light(cube):
    """Absolute light of pixels, averaged over three wavelengths; positive if any wavelength is lit."""
    light = sum(np.abs(cube[n], dtype=np.float64) for n in (0, len(cube) // 2, -1)) / 3  # float32 would overflow
    dark = light == 0
    for plane in cube if dark.any() else ():
        light[dark] += np.abs(plane[dark])
    return light


def _means_of_squares(light):
    """Means over squares of LAMP_PX that start at each pixel; dark beyond the end."""
    sums = np.pad(light, (0, LAMP_PX - 1))
    for _ in range(2):
        sums = np.add.reduce([sums[n:len(sums) + n + 1 - LAMP_PX] for n in range(LAMP_PX)]).T
    return sums / LAMP_PX**2


def values_of_blocks(pixels: int, is_plane: bool) -> float:
    """Number of single-precision values in the extremes of a layer with this number of pixels."""
    blocks = pixels / BLOCK_PX**2
    return QUANTITIES[is_plane] * blocks * (np.log2(max(blocks, 1)) / 2 + 1) ** 2


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
