"""The rays of each pixel: even samples of the stop, from a number of distances from the axis."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ...image.pixel_grid import PixelGrid
from ...kernels.casting import HeightRays, rays_shape
from ...rays.ray_table import RayTable
from ...rays.stop_places import RAY_COUNTS, cell_size, stop_places
from ..ray_blur import CaptureView, NodeRays, RayReach, Tiles, cells_inside, in_eights, packed_sets, tangents

HEIGHTS = 65  # with linear interpolation of rays between them


@dataclass(frozen=True, eq=False)
class Pencils(NodeRays):
    """The rays of pixels at evenly spaced distances from the axis, in the upwards direction.

    The stop's positions are tangential and outwards, all others outwards and tangential.

    Attributes
    ----------
    last_px : float
        The last of these distances.
    """

    last_px: float

    @property
    def heights(self) -> int:
        return self.inside.shape[1]

    @property
    def heights_per_px(self) -> float:
        return (self.heights - 1) / self.last_px

    def known_places(self, right_px: np.ndarray, up_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The nearest places that the rays are known for: see `field_map.RaySample`."""
        shrink = self.last_px / np.maximum(np.hypot(right_px, up_px), self.last_px)
        return right_px * shrink, up_px * shrink

    def bundles(self, right_px: np.ndarray,
                up_px: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The rays of the shortest wavelength at places relative to the axis: see `field_map.RaySample`."""
        height_px = np.hypot(right_px, up_px)[..., None]
        on_axis = height_px == 0
        right, up = (np.where(on_axis, upwards, side[..., None] / np.where(on_axis, 1, height_px))
                     for side, upwards in ((right_px, 0.0), (up_px, 1.0)))
        at = np.minimum(height_px[..., 0] * self.heights_per_px, self.heights - 1)
        far, moved = _at_heights(self.far_px[:, 0], at), _at_heights(self.moved_px[:, 0], at)
        inside, light = _at_heights(self.inside[0], at), _at_heights(self.light[0], at)

        def turned(out, across):
            return out * right + across * up, out * up - across * right

        return (np.stack(turned(*far), axis=-1), np.stack(turned(*moved), axis=-1),
                light * np.clip(inside + 0.5, 0, 1), np.stack(turned(*self.stop[::-1])))

    def reach(self, nearness: np.ndarray, axis_px: tuple[float, float], view: CaptureView, tiles: Tiles) -> RayReach:
        """The reach of the rays of tiles in a layer that is as near as this, with the axis at `axis_px`."""
        return RoundReach(self, nearness, axis_px, view, tiles)

    def packed(self) -> np.ndarray:
        """The rays for the loops: array (height, eight, 2 + 6 wavelengths, 8), see `kernels.cast.HeightRays`."""
        return in_eights(self.stop, self.far_px, self.moved_px, self.inside, self.light)


class RoundReach(RayReach):
    """The reach of the rays of tiles in a layer: a middle and a radius around it."""

    def __init__(self, rays: Pencils, nearness: np.ndarray, axis_px: tuple[float, float], view: CaptureView,
                 tiles: Tiles) -> None:
        distance = np.hypot(tiles.right, tiles.up)
        self._right, self._up = (axis / np.maximum(distance, 1e-9) for axis in (tiles.right, tiles.up))
        self._at = np.minimum(distance * rays.heights_per_px, rays.heights - 1)
        super().__init__(rays, self._at.astype(int), np.hypot(*rays.far_px[:, 0], dtype=float).mean(axis=-1), nearness,
                         axis_px, view)
        middle, radius = _ends(rays, view, self._nearness)
        step_px = 1 / rays.heights_per_px
        slope = np.gradient(middle, step_px, axis=1).max()
        beyond = np.maximum(distance - rays.last_px, 0) * slope
        half_px = tiles.side_px / np.sqrt(2)
        self._margin = half_px * max(slope, 1) + 2 + beyond / 4
        self._beyond = beyond
        self._middle = middle
        self._radius = scipy.ndimage.maximum_filter1d(radius, 2 * int(np.ceil(half_px / step_px)) + 1, axis=1)

    def radius_px(self, least: np.ndarray, most: np.ndarray) -> np.ndarray:
        return np.maximum(*(self._between(self._radius, nearness) for nearness in (least, most)))

    def bounds_px(self, least: np.ndarray, most: np.ndarray, around_px: np.ndarray) -> list[np.ndarray]:
        ends = []
        for nearness in (least, most):
            middle = self._between(self._middle, nearness) + self._beyond
            radius = self._between(self._radius, nearness) + self._margin + around_px
            row, column = self._row - middle * self._up, self._column + middle * self._right
            ends.append((row - radius, row + radius, column - radius, column + radius))
        return [bound(one, other) for bound, one, other in zip((np.minimum, np.maximum) * 2, *ends, strict=True)]

    def _between(self, table, nearness):
        """A table (depth, height) interpolated at the tiles' distances and at these values of nearness."""
        i, u = self._place(nearness)
        j = np.minimum(self._nodes, table.shape[1] - 2)
        v = self._at - j
        return ((1 - u) * ((1 - v) * table[i, j] + v * table[i, j + 1])
                + u * ((1 - v) * table[i + 1, j] + v * table[i + 1, j + 1]))


def _at_heights(values, at):
    """Values (..., height, ray), interpolated at places among the heights: array (..., place, ray)."""
    before = np.minimum(at.astype(int), values.shape[-2] - 2)
    share = (at - before)[..., None]
    return (1 - share) * values[..., before, :] + share * values[..., before + 1, :]


def _ends(rays, view, nearness):
    """Middles and radii of the areas that rays reach at values of nearness: arrays (depth, height), in pixels."""
    far, moved, passing = rays.far_px, rays.moved_px, rays.inside > -0.5
    nearness = nearness[:, None, None, None].astype(np.float32)
    place = far[:, None] + moved[:, None] * view.inverse_depth(far[:, None], moved[:, None], nearness)
    place *= view.shrinkage(np.hypot(*place))
    lit = np.broadcast_to(passing, place.shape[1:])
    low, high = (bound.reduce(place[0], axis=(1, 3), where=lit, initial=start)
                 for bound, start in ((np.minimum, np.inf), (np.maximum, -np.inf)))
    middle = np.where(low <= high, (low + high) / 2, 0)
    distance = np.hypot(place[0] - middle[:, None, :, None], place[1])
    return middle, np.maximum.reduce(distance, axis=(1, 3), where=lit, initial=0)


def pencils(rays: RayTable, wavelengths_nm: np.ndarray, sensor: PixelGrid, focal_mm: float, count: int,
            reach: float = 1.0, part: slice = slice(None)) -> Pencils:
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
        Number of rays, one of `RAY_COUNTS`.
    reach : float
        Radius of the part of the stop's plane that they pass, in semi-apertures: 1 for a round stop, more for the
        corners of an iris; at most the table's reach.
    part : slice
        Of these rays.
    """
    pitch_mm, last_px = sensor.pitch_um * 1e-3, _last_px(rays, sensor)
    heights_mm = np.linspace(0, last_px * pitch_mm, HEIGHTS)
    stop, near = reach * stop_places(count)[:, part], rays.near(wavelengths_nm)
    bundles = near.bundles(heights_mm, -stop)  # the image on the sensor is inverted
    to_px = focal_mm / pitch_mm
    inside = cells_inside(lambda place: near.bundles(heights_mm, -place).surface_margin, stop, bundles.surface_margin,
                          reach * cell_size(count))
    far_px, moved_px = tangents(bundles)[::-1] * to_px, -bundles.entrance_mm[::-1] * to_px
    return Pencils(stop.astype(np.float32), far_px.astype(np.float32), moved_px.astype(np.float32),
                   inside.astype(np.float32), bundles.weight.astype(np.float32), last_px)


def _last_px(rays, sensor):
    """Distance from the axis to the last height."""
    return min(sensor.farthest_px, rays.last_height_mm / (sensor.pitch_um * 1e-3))


def packed_pencils(rays: RayTable, wavelengths_nm: np.ndarray, sensor: PixelGrid, focal_mm: float,
                   counts: Sequence[int], reach: float) -> HeightRays:
    """Several sets of `pencils`, by counts, for the loops."""
    def portion(count, part):
        return pencils(rays, wavelengths_nm, sensor, focal_mm, count, reach, part).packed()

    return HeightRays(packed_sets(portion, HEIGHTS, wavelengths_nm.size, counts),
                      (HEIGHTS - 1) / _last_px(rays, sensor))


def packed_values(count: int, wavelengths: int) -> int:
    """Maximum number of values in the rays that `packed_pencils` returns, for sets of up to this many rays."""
    return math.prod(rays_shape(HEIGHTS, sum(each for each in RAY_COUNTS if each <= count) // 8, wavelengths))


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
        """A number of rays at some wavelengths."""
        return pencils(self._table, wavelengths_nm, self._sensor, focal_mm, count, reach=reach)

    def packed(self, wavelengths_nm: np.ndarray, focal_mm: float, counts: Sequence[int],
               reach: float) -> HeightRays:
        """Sets of rays for the compiled loops."""
        return packed_pencils(self._table, wavelengths_nm, self._sensor, focal_mm, counts, reach)

    def irradiance_per_radiance(self, wavelength_nm: float) -> np.ndarray:
        """Irradiance per uniform radiance: float32 array (row, column); constant beyond the last height, or 0 if the
        light ends there."""
        by_height = self._table.near([wavelength_nm]).irradiance_per_radiance(self._heights_mm)[0]
        beyond = 0.0 if self._table.dark_beyond else None
        return np.interp(self._pixels_mm, self._heights_mm, by_height, right=beyond).astype(np.float32)
