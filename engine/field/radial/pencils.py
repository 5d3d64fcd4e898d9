"""The rays of each pixel: even samples of the stop, from a number of distances from the axis."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d

from ...image.pixel_grid import PixelGrid
from ...kernels import SEQUENCES, rays_shape
from ...rays.ray_table import RayTable
from ...rays.stop_places import stop_places

HEIGHTS = 65  # with linear interpolation of rays between them
DEPTHS = 9  # with linear interpolation of the rays' reach between them: an upper limit, because rays are straight
LEAST_COSINE = 1e-3  # of rays to the axis: a depth along the axis does not define a point sideways of the camera


@dataclass(frozen=True, eq=False)
class Tiles:
    """Square tiles of a sensor's pixels.

    Attributes
    ----------
    right, up : arrays (tile row, tile column)
        Positions of their middles relative to the axis, in pixels.
    side_px : int
    """

    right: np.ndarray
    up: np.ndarray
    side_px: int


@dataclass(frozen=True, eq=False)
class Pencils:
    """One sequence of rays of pixels at evenly spaced distances from the axis, in the upwards direction.

    Attributes
    ----------
    last_px : float
        The last of these distances.
    stop : float32 array (2, ray)
        Positions in the stop, tangential and outwards, in semi-apertures.
    far_px, moved_px : float32 arrays (2, wavelength, height, ray)
        Outwards and tangential: their positions at infinity in the plane of an ideal image, in pixels; and the change
        of these with the inverse depth, in pixels times mm.
    margin, light : float32 arrays (wavelength, height, ray)
        A number that is positive for rays that pass; and their light.
    """

    last_px: float
    stop: np.ndarray
    far_px: np.ndarray
    moved_px: np.ndarray
    margin: np.ndarray
    light: np.ndarray

    @property
    def heights(self) -> int:
        return self.margin.shape[1]

    @property
    def heights_per_px(self) -> float:
        return (self.heights - 1) / self.last_px

    def fringe_px(self, nearness: float) -> int:
        """Largest distance between the wavelengths of a ray, up to an inverse depth."""
        far, moved = (np.hypot(*(each[:, -1] - each[:, 0])) for each in (self.far_px, self.moved_px))
        return int(np.ceil(((far + nearness * moved) * (self.margin.max(axis=0) > 0)).max()))

    def reach(self, nearness: np.ndarray, axis_px: tuple[float, float], per_focal: float, tiles: Tiles) -> "RayReach":
        """The reach of the rays of tiles in a layer of these inverse depths, with the axis at `axis_px`."""
        return RayReach(self, nearness, axis_px, per_focal, tiles)

    def packed(self) -> np.ndarray:
        """The rays for the loops: array (height, eight, 2 + 6 wavelengths, 8), see `kernels.Casting.rays`."""
        rays = np.concatenate([self.far_px, self.moved_px, self.margin[None], self.light[None]])
        quantities, wavelengths, heights, count = rays.shape
        rays = rays.transpose(2, 1, 0, 3).reshape(heights, wavelengths * quantities, count)
        rays = np.concatenate([np.broadcast_to(self.stop, (heights, *self.stop.shape)), rays], axis=1)
        return rays.reshape(heights, -1, count // 8, 8).swapaxes(1, 2)


class RayReach:
    """The reach of the rays of tiles in a layer: a middle and a radius around it.

    Parameters
    ----------
    rays : Pencils
    nearness : array
        Inverse depths of the layer.
    axis_px : (float, float)
        Row and column of the axis, in the layer's pixels.
    per_focal : float
        See `kernels.Casting`.
    tiles : Tiles
    """

    def __init__(self, rays: Pencils, nearness: np.ndarray, axis_px: tuple[float, float], per_focal: float,
                 tiles: Tiles) -> None:
        self.least, self.most = float(nearness.min()), float(nearness.max())
        self._row, self._column = axis_px
        right, up = tiles.right, tiles.up
        distance = np.hypot(right, up)
        self._right, self._up = (axis / np.maximum(distance, 1e-9) for axis in (right, up))
        self._at = np.minimum(distance * rays.heights_per_px, rays.heights - 1)
        middle, radius = _ends(rays, per_focal, np.linspace(self.least, self.most, DEPTHS))
        step_px = 1 / rays.heights_per_px
        slope = np.gradient(middle, step_px, axis=1).max()
        beyond = np.maximum(distance - rays.last_px, 0) * slope
        half_px = tiles.side_px / np.sqrt(2)
        self._margin = half_px * max(slope, 1) + 2 + beyond / 4
        self._beyond = beyond
        self._middle = middle
        self._radius = maximum_filter1d(radius, 2 * int(np.ceil(half_px / step_px)) + 1, axis=1)
        self._blur = 2 * (np.hypot(*rays.moved_px[:, 0]) * (rays.margin[0] > 0)).max(axis=-1)

    def radius_px(self, least: np.ndarray, most: np.ndarray) -> np.ndarray:
        """Largest radius of the blur between two inverse depths."""
        return np.maximum(*(self._between(self._radius, nearness) for nearness in (least, most)))

    def blur_px(self, difference: np.ndarray) -> np.ndarray:
        """Difference in blur for a difference in inverse depth."""
        return self._blur[self._at.astype(int)] * difference

    def bounds_px(self, least: np.ndarray, most: np.ndarray) -> list[np.ndarray]:
        """Top, bottom, left and right of the area that rays reach between two inverse depths, in the layer's pixels."""
        ends = []
        for nearness in (least, most):
            middle = self._between(self._middle, nearness) + self._beyond
            radius = self._between(self._radius, nearness) + self._margin
            row, column = self._row - middle * self._up, self._column + middle * self._right
            ends.append((row - radius, row + radius, column - radius, column + radius))
        return [bound(one, other) for bound, one, other in zip((np.minimum, np.maximum) * 2, *ends, strict=True)]

    def _between(self, table, nearness):
        """A table (depth, height) interpolated at the tiles' distances and at these inverse depths."""
        depth = np.clip((nearness - self.least) / max(self.most - self.least, 1e-30), 0, 1) * (DEPTHS - 1)
        i, j = np.minimum(depth.astype(int), DEPTHS - 2), np.minimum(self._at.astype(int), table.shape[1] - 2)
        u, v = depth - i, self._at - j
        return ((1 - u) * ((1 - v) * table[i, j] + v * table[i, j + 1])
                + u * ((1 - v) * table[i + 1, j] + v * table[i + 1, j + 1]))


def _ends(rays, per_focal, nearness):
    """Middles and radii of the areas that rays reach at inverse depths: arrays (depth, height), in pixels."""
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


def pencils(rays: RayTable, wavelengths_nm: np.ndarray, sensor: PixelGrid, focal_mm: float, count: int,
            sequence: int = 0, reach: float = 1.0) -> Pencils:
    """The rays of a sensor's pixels.

    Parameters
    ----------
    rays : RayTable
        Outside its range of wavelengths, its first or last one applies.
    wavelengths_nm : array (wavelength,)
    sensor : PixelGrid
    focal_mm : float
        Focal length of the capture.
    count : int
        Number of rays, a power of two. Each sequence is evenly distributed, and so are its first 2^n rays.
    sequence : int
        Below SEQUENCES.
    reach : float
        Radius of the part of the stop's plane that they pass, in semi-apertures: 1 for a round stop, more for the
        corners of an iris; at most the table's reach.
    """
    pitch_mm = sensor.pitch_um * 1e-3
    last_px = min(sensor.farthest_px, rays.last_height_mm / pitch_mm)
    heights_mm = np.linspace(0, last_px * pitch_mm, HEIGHTS)
    stop = reach * stop_places(count, sequence)
    bundles = rays.near(wavelengths_nm).bundles(heights_mm, -stop)  # the image on the sensor is inverted
    tangent = bundles.direction[:2] / np.maximum(bundles.direction[2], LEAST_COSINE)
    to_px = focal_mm / pitch_mm
    margin = np.minimum(bundles.surface_margin, reach**2 - np.sum(stop**2, axis=0))
    quantities = stop, tangent[::-1] * to_px, -bundles.entrance_mm[::-1] * to_px, margin, bundles.weight
    return Pencils(last_px, *(each.astype(np.float32) for each in quantities))


def packed_pencils(rays: RayTable, wavelengths_nm: np.ndarray, sensor: PixelGrid, focal_mm: float,
                   count: int, reach: float) -> tuple[np.ndarray, float]:
    """All sequences of `pencils` for the loops: `kernels.Casting`'s rays and its heights per pixel."""
    packed = np.empty(rays_shape(HEIGHTS, count // 8, wavelengths_nm.size), np.float32)
    for sequence in range(SEQUENCES):  # one after another, because intermediate arrays are many times larger
        bundle = pencils(rays, wavelengths_nm, sensor, focal_mm, count, sequence, reach)
        packed[:, sequence] = bundle.packed()
    return packed, bundle.heights_per_px


def packed_values(count: int, wavelengths: int) -> int:
    """Number of values in the rays that `packed_pencils` returns."""
    return math.prod(rays_shape(HEIGHTS, count // 8, wavelengths))


class PixelRays:
    """The rays of a lens from the pixels of a sensor: see `field_map`.

    Parameters
    ----------
    table : RayTable
    sensor : PixelGrid
    """

    def __init__(self, table: RayTable, sensor: PixelGrid) -> None:
        self._table, self._sensor = table, sensor
        x_mm, y_mm = sensor.axes_mm()
        self._pixels_mm = np.hypot(x_mm.astype(np.float32), y_mm.astype(np.float32)[:, None])
        self._heights_mm = np.linspace(0, table.last_height_mm, HEIGHTS)

    def sample(self, wavelengths_nm: np.ndarray, focal_mm: float, count: int, reach: float) -> Pencils:
        """One sequence of the rays."""
        return pencils(self._table, wavelengths_nm, self._sensor, focal_mm, count, reach=reach)

    def packed(self, wavelengths_nm: np.ndarray, focal_mm: float, count: int,
               reach: float) -> tuple[np.ndarray, float]:
        """All sequences, for the compiled loops: the first two fields of `kernels.Casting`."""
        return packed_pencils(self._table, wavelengths_nm, self._sensor, focal_mm, count, reach)

    def irradiance_per_radiance(self, wavelength_nm: float) -> np.ndarray:
        """Irradiance per uniform radiance: float32 array (row, column), constant beyond the last height."""
        by_height = self._table.near([wavelength_nm]).irradiance_per_radiance(self._heights_mm)[0]
        return np.interp(self._pixels_mm, self._heights_mm, by_height).astype(np.float32)
