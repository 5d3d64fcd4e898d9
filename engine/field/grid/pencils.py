"""The rays of each pixel: even samples of the stop, from the nodes of an even mesh over the sensor."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ...image.pixel_grid import PixelGrid
from ...kernels.casting import MeshRays, rays_shape
from ...rays.grid_rays import GridRayTable
from ...rays.stop_places import RAY_COUNTS, cell_size, stop_places
from ..ray_blur import CaptureView, NodeRays, RayReach, Tiles, cells_inside, in_eights, packed_sets, tangents

STEPS = 20  # of the mesh from the axis to the farthest corner: rays are interpolated linearly between its nodes,
FINER = 5  # and chief rays between those of a mesh with this many times as many steps
MARGIN_PX = 2.0


@dataclass(frozen=True, eq=False)
class Mesh:
    """A mesh with nodes at even distances from the axis, in pixels.

    Attributes
    ----------
    up_px, right_px : arrays (row,) and (column,), ascending
    """

    up_px: np.ndarray
    right_px: np.ndarray

    @classmethod
    def of(cls, table: GridRayTable, sensor: PixelGrid, steps: int, *, folded: bool = False) -> "Mesh":
        """The mesh over a sensor, to the ends of its rays; `folded` leaves out its mirror images.

        Its nodes are as far apart across as upwards, on the sensor.
        """
        grid = sensor.on_sensor()
        step_px, (rows, columns), (row, column) = grid.farthest_px / steps, grid.shape_px, grid.centre_px
        sides = (row + 0.5 - rows, row + 0.5), (-column - 0.5, columns - 0.5 - column)
        up_px, right_px = (_nodes(*each, step_px, grid.pitch_um * 1e-3, folded) for each in
                           zip(sides, (table.y_mm, table.x_mm), table.mirrored, strict=True))
        return cls(up_px, right_px * sensor.across)

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.up_px), len(self.right_px)

    @property
    def per_px(self) -> tuple[float, float]:
        """Rows, and columns, in a pixel."""
        up, right = (float(1 / (axis[1] - axis[0])) for axis in (self.up_px, self.right_px))
        return up, right

    @property
    def first(self) -> tuple[float, float]:
        """Place of the first node, in rows and columns from the axis."""
        up, right = self.per_px
        return float(self.up_px[0] * up), float(self.right_px[0] * right)

    def finer(self, times: int) -> "Mesh":
        """The mesh with each step split."""
        return Mesh(*(np.linspace(axis[0], axis[-1], (axis.size - 1) * times + 1) for axis in
                      (self.up_px, self.right_px)))

    def within(self, right_px: np.ndarray, up_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The nearest places on the mesh."""
        return (np.clip(right_px, *self.right_px[[0, -1]]), np.clip(up_px, *self.up_px[[0, -1]]))

    def corners(self, right_px: np.ndarray, up_px: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """The four nodes around places on the mesh, as indices into its flattened nodes, and their weights."""
        (row, down), (column, left) = (_around(at, axis) for at, axis in
                                       ((up_px, self.up_px), (right_px, self.right_px)))
        for i, j in product((0, 1), repeat=2):
            yield (row + i) * len(self.right_px) + column + j, (down if i else 1 - down) * (left if j else 1 - left)

    def at(self, values: np.ndarray, right_px: np.ndarray, up_px: np.ndarray) -> np.ndarray:
        """Values (..., node), interpolated at places on the mesh: array (..., *place)."""
        return np.sum([weight * values[..., node] for node, weight in self.corners(right_px, up_px)], axis=0)


def _nodes(side_px, ends_mm, mirrored, step_px, pitch_mm, folded):
    """Nodes along an axis, over the part of a side that is within the ends of the rays."""
    first_mm, last_mm = (-ends_mm[1], ends_mm[1]) if mirrored else (-ends_mm[1], -ends_mm[0])  # the image is inverted
    first, last = np.clip(side_px, first_mm / pitch_mm, last_mm / pitch_mm)
    if mirrored:
        last = max(abs(first), abs(last))
        first = 0.0 if folded else -last
    count = max(int(np.ceil((last - first) / step_px)), 1) + 1
    return np.linspace(first, max(last, first + 1), count)


def _around(at_px, axis_px):
    """Index of the node before places, and their distance from it, in nodes."""
    place = (at_px - axis_px[0]) / (axis_px[1] - axis_px[0])
    before = np.clip(place.astype(int), 0, len(axis_px) - 2)
    return before, place - before


@dataclass(frozen=True, eq=False)
class Pencils(NodeRays):
    """The rays of pixels at the nodes of a mesh. Positions are to the right and up.

    Attributes
    ----------
    mesh : Mesh
    squeeze : float
        Width of a pixel in the plane of an ideal image over its height.
    """

    mesh: Mesh
    squeeze: float

    def known_places(self, right_px: np.ndarray, up_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The nearest places that the rays are known for: see `field_map.RaySample`."""
        return self.mesh.within(right_px, up_px)

    def bundles(self, right_px: np.ndarray,
                up_px: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The rays of the shortest wavelength at places relative to the axis: see `field_map.RaySample`."""
        places = self.mesh.within(right_px, up_px)

        def interpolated(values):
            return np.moveaxis(self.mesh.at(values.swapaxes(-1, -2), *places), 1, -1)

        far, moved = interpolated(self.far_px[:, 0]), interpolated(self.moved_px[:, 0])
        inside, light = interpolated(self.inside[:1]), interpolated(self.light[:1])
        stop = self.stop.reshape(2, *(1,) * np.ndim(right_px), -1)
        return (np.moveaxis(far, 0, -1), np.moveaxis(moved, 0, -1), light[0] * np.clip(inside[0] + 0.5, 0, 1),
                np.broadcast_to(stop, far.shape))

    def reach(self, nearness: np.ndarray, axis_px: tuple[float, float], view: CaptureView, tiles: Tiles) -> RayReach:
        """The reach of the rays of tiles in a layer that is as near as this, with the axis at `axis_px`."""
        return BoxReach(self, nearness, axis_px, view, tiles)

    def packed(self) -> np.ndarray:
        """The rays for the loops: array (node, eight, 2 + 6 wavelengths, 8), see `kernels.cast.MeshRays`."""
        return in_eights(self.stop[::-1], self.far_px, self.moved_px, self.inside, self.light)


class BoxReach(RayReach):
    """The reach of the rays of tiles in a layer: rectangles around the rays of a tile's corners."""

    def __init__(self, rays: Pencils, nearness: np.ndarray, axis_px: tuple[float, float], view: CaptureView,
                 tiles: Tiles) -> None:
        across, up = rays.far_px[:, 0].mean(axis=-1, dtype=float)
        super().__init__(rays, _nearest_nodes(rays.mesh, tiles), np.hypot(rays.squeeze * across, up), nearness,
                         axis_px, view)
        low, high = _ends(rays, view, self._nearness)
        half_px = tiles.side_px / 2
        corners = [rays.mesh.corners(tiles.right + across * half_px, tiles.up + up * half_px)
                   for across, up in product((-1, 1), repeat=2)]
        at_corners = [[sum(weight * each[..., node] for node, weight in around) for each in (low, high)]
                      for around in map(list, corners)]
        self._low = np.minimum.reduce([each for each, _ in at_corners])
        self._high = np.maximum.reduce([each for _, each in at_corners])
        self._margin = MARGIN_PX + _bend_px(rays.mesh, low, high, half_px)

    def radius_px(self, least: np.ndarray, most: np.ndarray) -> np.ndarray:
        ends = [np.hypot(*(self._between(self._high, nearness) - self._between(self._low, nearness))) / 2
                for nearness in (least, most)]
        return np.maximum(*ends)

    def bounds_px(self, least: np.ndarray, most: np.ndarray, around_px: np.ndarray) -> list[np.ndarray]:
        low, high = (bound(*(self._between(each, nearness) for nearness in (least, most)))
                     for bound, each in ((np.minimum, self._low), (np.maximum, self._high)))
        around_px = self._margin + around_px
        return [self._row - high[1] - around_px, self._row - low[1] + around_px,
                self._column + low[0] - around_px, self._column + high[0] + around_px]

    def _between(self, table, nearness):
        """A table (2, depth, tile row, tile column) at these values of nearness: array (2, tile row, tile column)."""
        before, share = self._place(nearness)
        low, high = (np.take_along_axis(table, (before + n)[None, None], axis=1)[:, 0] for n in (0, 1))
        return low + share * (high - low)


def _ends(rays, view, nearness):
    """Least and largest positions that rays reach at values of nearness: two arrays (2, depth, node), in pixels."""
    far, moved = rays.far_px[:, None], rays.moved_px[:, None]
    place = far + moved * view.inverse_depth(far, moved, nearness[:, None, None, None].astype(np.float32))
    place *= view.shrinkage(np.hypot(rays.squeeze * place[0], place[1]))
    passing = rays.inside > -0.5
    passing |= ~passing.any(axis=(0, 2))[None, :, None]
    return tuple(bound.reduce(place, axis=(2, 4), where=np.broadcast_to(passing, place.shape), initial=start)
                 for bound, start in ((np.minimum, np.inf), (np.maximum, -np.inf)))


def _bend_px(mesh, low, high, half_px):
    """The most by which positions bend between nodes, and by which a tile's exceed those at its corners."""
    ends = np.stack([low, high]).reshape(-1, *mesh.shape)
    return max(float(np.abs(np.diff(ends, 2, axis=axis)).max(initial=0)) * (1 / 8 + per_px * half_px / 2)
               for axis, per_px in zip((1, 2), mesh.per_px, strict=True))


def _nearest_nodes(mesh, tiles):
    """Flat indices of the nodes nearest to tiles."""
    right_px, up_px = mesh.within(tiles.right, tiles.up)
    row, column = (np.rint((at - axis[0]) / (axis[1] - axis[0])).astype(int)
                   for at, axis in ((up_px, mesh.up_px), (right_px, mesh.right_px)))
    return row * len(mesh.right_px) + column


def _pencils(table: GridRayTable, sensor: PixelGrid, mesh: Mesh, focal_mm: float, count: int, reach: float,
             part: slice = slice(None)) -> Pencils:
    """The rays of a sensor's pixels at the nodes of a mesh, at the table's wavelengths."""
    (x_mm, y_mm), stop = _places_mm(mesh, sensor), reach * stop_places(count)[:, part]
    bundles = table.bundles(x_mm, y_mm, stop)
    inside = cells_inside(lambda place: table.surface_margin(x_mm, y_mm, place), stop, bundles.surface_margin,
                          reach * cell_size(count))
    far_px, moved_px, inside, light = map(_flat, (
        _far_px(bundles, sensor, focal_mm), bundles.entrance_mm * _to_px(sensor, focal_mm), inside, bundles.weight))
    return Pencils(stop.astype(np.float32), far_px, moved_px, inside, light, mesh, sensor.squeeze)


def _places_mm(mesh, sensor):
    """x and y of a mesh's nodes in the image as formed by the lens, upside down."""
    pitch_mm = sensor.pitch_um * 1e-3
    return -pitch_mm / sensor.across * mesh.right_px, -pitch_mm * mesh.up_px


def _to_px(sensor, focal_mm):
    """Pixels to the right and up, in the plane of an ideal image, per tangent: array (2, 1, 1, 1, 1)."""
    return np.reshape([focal_mm / sensor.squeeze, focal_mm], (2, 1, 1, 1, 1)) / (sensor.pitch_um * 1e-3)


def _far_px(bundles, sensor, focal_mm):
    """Positions of rays at infinity in the plane of an ideal image, to the right and up."""
    return -tangents(bundles) * _to_px(sensor, focal_mm)


def _flat(values):
    """float32 array (..., node, ray) of values (..., row, column, ray)."""
    return values.reshape(*values.shape[:-3], -1, values.shape[-1]).astype(np.float32)


def packed_values(mirrored: tuple[bool, bool], count: int, wavelengths: int) -> int:
    """Maximum number of values in the rays that `PixelRays.packed` returns, for sets of up to this many rays."""
    half = STEPS / np.sqrt(2)  # of a square, which has the largest area of all sensors with its diagonal
    nodes = math.prod(math.ceil(half if of_axis else 2 * half) + 1 for of_axis in mirrored)
    return math.prod(rays_shape(nodes, sum(each for each in RAY_COUNTS if each <= count) // 8, wavelengths))


class PixelRays:
    """The rays of a lens from the pixels of a sensor: see `field_map`.

    Parameters
    ----------
    table : GridRayTable
    sensor : PixelGrid
        In columns of the capture.
    """

    def __init__(self, table: GridRayTable, sensor: PixelGrid) -> None:
        self._table, self._sensor = table, sensor

    def sample(self, wavelengths_nm: np.ndarray, focal_mm: float, count: int, reach: float) -> Pencils:
        """A number of rays at some wavelengths."""
        mesh = Mesh.of(self._table, self._sensor, STEPS)
        return _pencils(self._table.near(wavelengths_nm), self._sensor, mesh, focal_mm, count, reach)

    def packed(self, wavelengths_nm: np.ndarray, focal_mm: float, counts: Sequence[int], reach: float) -> MeshRays:
        """Sets of rays for the compiled loops."""
        near, mesh = self._table.near(wavelengths_nm), Mesh.of(self._table, self._sensor, STEPS, folded=True)
        chief, finest = (_far_px(near.bundles(x_mm, y_mm, np.zeros((2, 1))), self._sensor, focal_mm) for x_mm, y_mm in
                         (_places_mm(each, self._sensor) for each in (mesh, mesh.finer(FINER))))

        def portion(count, part):
            rays = _pencils(near, self._sensor, mesh, focal_mm, count, reach, part)
            return replace(rays, far_px=rays.far_px - _flat(chief)).packed()

        packed = packed_sets(portion, math.prod(mesh.shape), wavelengths_nm.size, counts)
        chief_px = np.ascontiguousarray(finest[..., 0].transpose(2, 3, 1, 0), np.float32)
        return MeshRays(packed.reshape(*mesh.shape, *packed.shape[1:]), chief_px, mesh.per_px, mesh.first,
                        self._table.mirrored)

    def irradiance_per_radiance(self, wavelength_nm: float) -> np.ndarray:
        """Irradiance per uniform radiance: float32 array (row, column), constant beyond the rays' ends."""
        mesh, (rows, columns) = Mesh.of(self._table, self._sensor, STEPS, folded=True), self._sensor.shape_px
        light, = self._table.near([wavelength_nm]).irradiance_per_radiance(*_places_mm(mesh, self._sensor))
        up_px, right_px = self._sensor.centre_px[0] - np.arange(rows), np.arange(columns) - self._sensor.centre_px[1]
        rows, columns = (_linear(np.abs(at_px) if mirrored else at_px, axis_px) for at_px, mirrored, axis_px in
                         zip((up_px, right_px), self._table.mirrored, (mesh.up_px, mesh.right_px), strict=True))
        return (rows @ light @ columns.T).astype(np.float32)


def _linear(at, nodes):
    """Matrix of linear interpolation between nodes: (place, node), constant beyond them."""
    return np.stack([np.interp(at, nodes, unit) for unit in np.eye(len(nodes))], axis=-1)
