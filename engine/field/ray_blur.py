"""The rays of pixels: what the fields of all lenses have in common."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..image.projection import Projection
from ..kernels.casting import rays_shape
from ..rays.ray_table import SensorRays

DEPTHS = 9  # with linear interpolation of the rays' reach between them: an upper limit, because rays are straight
MOST_OPEN = 4.0  # cells from the rim: beyond this, a ray's distance does not matter
PORTION = 256  # rays that are packed together
FEW = 8  # rays: fewer do not show a shape
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
class CaptureView:
    """What a capture shows, in pixels from the axis.

    How near surfaces are is their inverse depth, or in a panorama their inverse distance: the depth along the axis of
    surfaces next to a fisheye is tiny, however distant they are, and rays from everywhere would seem to reach them.

    Attributes
    ----------
    projection : Projection
    per_px : float
        Focal lengths in a pixel.
    """

    projection: Projection
    per_px: float

    def shrinkage(self, radius_px: np.ndarray) -> np.ndarray:
        """Ratios of radii to these radii on a plane."""
        return self.projection.shrinkage(radius_px * self.per_px)

    def nearness(self, inverse_depth: np.ndarray, axis_px: tuple[float, float]) -> np.ndarray:
        """How near the surfaces of a part of the capture are, of these inverse depths (row, column); the axis is at
        `axis_px`."""
        if self.projection.is_plane:
            return inverse_depth
        rows, columns = (np.arange(n) - axis for n, axis in zip(inverse_depth.shape, axis_px, strict=True))
        cosine = np.cos(self.projection.angle_rad(np.hypot(rows[:, None], columns) * self.per_px))
        return inverse_depth * np.maximum(cosine, 0).astype(np.float32)

    def depth_per_nearness(self, radius_px: np.ndarray) -> np.ndarray:
        """Inverse depth of surfaces, in the direction of these radii on a plane, over how near they are."""
        return np.ones_like(radius_px) if self.projection.is_plane else np.hypot(1, radius_px * self.per_px)

    def inverse_depth(self, far_px: np.ndarray, moved_px: np.ndarray, nearness: np.ndarray) -> np.ndarray:
        """Inverse depths at which rays meet surfaces as near as this.

        Parameters
        ----------
        far_px, moved_px : float32 arrays (2, ...)
            See `NodeRays`.
        nearness : float32 array (...)
            At distances, the rays meet a sphere around the middle of the entrance pupil.
        """
        if self.projection.is_plane:
            return nearness
        along, start = far_px * self.per_px, moved_px * self.per_px
        square, side = 1 + (along**2).sum(axis=0), (along * start).sum(axis=0) * nearness
        inside = np.maximum(side**2 + square * (1 - (start**2).sum(axis=0) * nearness**2), 0)
        return nearness * square / np.maximum(np.sqrt(inside) - side, LEAST_COSINE)


@dataclass(frozen=True, eq=False)
class NodeRays:
    """The rays of pixels at nodes of the field: arrays with an axis of nodes.

    Attributes
    ----------
    stop : float32 array (2, ray)
        Positions in the stop, in semi-apertures. Each ray represents an equal part of the stop, its cell.
    far_px, moved_px : float32 arrays (2, wavelength, node, ray)
        Their positions at infinity in the plane of an ideal image, in pixels; and the change of these with the inverse
        depth, in pixels times mm.
    inside, light : float32 arrays (wavelength, node, ray)
        Distance from the rims that limit the rays, in cells, negative for blocked rays; and the light of a cell.
    """

    stop: np.ndarray
    far_px: np.ndarray
    moved_px: np.ndarray
    inside: np.ndarray
    light: np.ndarray

    def fringe_px(self, nearness: float) -> int:
        """Largest distance between the wavelengths of a ray, up to an inverse depth."""
        far, moved = (np.hypot(*(each[:, -1] - each[:, 0])) for each in (self.far_px, self.moved_px))
        return int(np.ceil(((far + nearness * moved) * (self.inside.max(axis=0) > -0.5)).max()))

    def area_px(self, nearness: float) -> float:
        """Largest area of the blur of the open stop at an inverse depth, in square pixels."""
        return float(area_px(self.blur_shapes, nearness).max())

    @cached_property
    def blur_shapes(self) -> np.ndarray:
        """`blur_shapes` of the nodes: array (3, node, 2, 2)."""
        return blur_shapes(self.far_px[:, 0], self.moved_px[:, 0], self.inside[0] > -0.5, self.stop)


class RayReach(ABC):
    """The positions in a layer of depth that rays of tiles reach: arrays (tile row, tile column).

    `least` and `most` are how near the layer is, and `depth_per_nearness` is that of the tiles, by `CaptureView`.

    Parameters
    ----------
    rays : NodeRays
    nodes : int array (tile row, tile column)
        The node whose blur a tile has.
    radius_px : array (node,)
        Distances of the nodes' rays from the axis at infinity, on a plane.
    nearness : array
        Of the layer, by the view.
    axis_px : (float, float)
        Row and column of the axis, in the layer's pixels.
    view : CaptureView
    """

    def __init__(self, rays: NodeRays, nodes: np.ndarray, radius_px: np.ndarray, nearness: np.ndarray,
                 axis_px: tuple[float, float], view: CaptureView) -> None:
        self.least, self.most = float(nearness.min()), float(nearness.max())
        self._row, self._column = axis_px
        self._nearness, self._nodes = np.linspace(self.least, self.most, DEPTHS), nodes
        self._blur = 2 * (np.hypot(*rays.moved_px[:, 0]) * (rays.inside[0] > -0.5)).max(axis=-1)
        self.depth_per_nearness = view.depth_per_nearness(radius_px)[nodes]
        along = (radius_px + 1) * view.shrinkage(radius_px + 1) - radius_px * view.shrinkage(radius_px)
        self._shapes = rays.blur_shapes * (along * view.shrinkage(radius_px))[:, None, None]  # in the capture's pixels

    @abstractmethod
    def radius_px(self, least: np.ndarray, most: np.ndarray) -> np.ndarray:
        """Largest radius of the blur between two inverse depths."""

    def blur_px(self, difference: np.ndarray) -> np.ndarray:
        """Difference in blur for a difference in inverse depth."""
        return self._blur[self._nodes] * difference

    def area_px(self, nearness: np.ndarray) -> np.ndarray:
        """Area of the blur of the open stop, without vignetting, at an inverse depth: in square pixels."""
        return area_px(self._shapes[:, self._nodes], nearness)

    @abstractmethod
    def bounds_px(self, least: np.ndarray, most: np.ndarray, around_px: np.ndarray) -> list[np.ndarray]:
        """Top, bottom, left and right of the area that rays reach between two values of nearness, in the layer's
        pixels, with a margin."""

    def _place(self, nearness):
        """Values of nearness among `_nearness`: the index of the one before, and the distance from it."""
        depth = np.clip((nearness - self.least) / max(self.most - self.least, 1e-30), 0, 1) * (DEPTHS - 1)
        before = np.minimum(depth.astype(int), DEPTHS - 2)
        return before, depth - before


def tangents(rays: SensorRays) -> np.ndarray:
    """Tangents of the rays' angles from the axis, along x and y: array (2, ...)."""
    return rays.direction[:2] / np.maximum(rays.direction[2], LEAST_COSINE)


def cells_inside(margin_at: Callable[[np.ndarray], np.ndarray], stop: np.ndarray, margin: np.ndarray, cell: float
                 ) -> np.ndarray:
    """Distance of rays from the surfaces' rims, in cells: the margin over its slope, from rays half a cell away.

    Parameters
    ----------
    margin_at : callable (stop)
        `SensorRays.surface_margin`, array (..., ray), of rays through these places of the stop.
    stop : array (2, ray)
    margin : array (..., ray)
        Theirs.
    cell : float
        Side of a ray's cell, in semi-apertures.
    """
    radius = np.hypot(*stop)
    share = cell / 2 / np.maximum(radius, cell)
    nearby = (1 - share) * stop, np.cos(share) * stop + np.sin(share) * np.stack([-stop[1], stop[0]])
    slope = np.hypot(*((margin_at(place) - margin) / np.hypot(*(place - stop)) for place in nearby))
    return np.clip(margin / np.maximum(slope * cell, 1e-9), -MOST_OPEN, MOST_OPEN)


def blur_shapes(far_px: np.ndarray, moved_px: np.ndarray, passing: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """The shape of the blur of the open stop as a function of the inverse depth q: array (3, node, 2, 2).

    The square root of the determinant of their sum, times 1, q and q^2, is the area at q: the covariances of the
    passing rays' positions, relative to the covariance of their places in the stop, times the stop's area.

    Parameters
    ----------
    far_px, moved_px : arrays (2, node, ray)
    passing : bool array (node, ray)
    stop : array (2, ray)
    """
    shapes = np.empty((3, len(passing), 2, 2))
    for node, of_node in enumerate(passing):
        chosen = of_node if of_node.sum() >= FEW else np.ones_like(of_node)
        far, moved = far_px[:, node, chosen].astype(float), moved_px[:, node, chosen].astype(float)
        places = stop[:, chosen].astype(float)
        both = np.cov(far, moved)
        area = np.pi * np.hypot(*stop).max() ** 2 / np.sqrt(np.linalg.det(np.cov(places)))
        shapes[:, node] = both[:2, :2] * area, (both[:2, 2:] + both[2:, :2]) * area, both[2:, 2:] * area
    return shapes


def area_px(shapes: np.ndarray, nearness: np.ndarray | float) -> np.ndarray:
    """Area of blurs of these `blur_shapes`, (3, ..., 2, 2), at inverse depths."""
    nearness = np.asarray(nearness, float)[..., None, None]
    return np.sqrt(np.maximum(np.linalg.det(shapes[0] + nearness * (shapes[1] + nearness * shapes[2])), 0))


def packed_sets(portion: Callable[[int, slice], np.ndarray], nodes: int, wavelengths: int, counts: Sequence[int]
                ) -> np.ndarray:
    """Sets of rays of these counts for the loops: array (node, eight, 2 + 6 wavelengths, 8).

    Parameters
    ----------
    portion : callable (count, slice)
        These of so many rays, as by `in_eights`, with flat nodes.
    """
    packed = np.empty(rays_shape(nodes, sum(counts) // 8, wavelengths), np.float32)
    first = 0
    for count in counts:
        for start in range(0, count, PORTION):  # intermediate arrays are many times larger
            eights = portion(count, slice(start, start + PORTION))
            packed[:, first:first + eights.shape[1]] = eights
            first += eights.shape[1]
    return packed


def in_eights(stop: np.ndarray, far_px: np.ndarray, moved_px: np.ndarray, inside: np.ndarray, light: np.ndarray
              ) -> np.ndarray:
    """Rays for the loops: array (*node, eight, 2 + 6 wavelengths, 8), see `kernels.cast.HeightRays`.

    Parameters
    ----------
    stop : array (2, ray)
    far_px, moved_px : arrays (2, wavelength, *node, ray)
    inside, light : arrays (wavelength, *node, ray)
    """
    rays = np.concatenate([far_px, moved_px, inside[None], light[None]])
    quantities, wavelengths, *nodes, count = rays.shape
    rays = np.moveaxis(rays, (0, 1), (-2, -3)).reshape(*nodes, wavelengths * quantities, count)
    rays = np.concatenate([np.broadcast_to(stop, (*nodes, *stop.shape)), rays], axis=-2)
    return rays.reshape(*nodes, -1, count // 8, 8).swapaxes(-3, -2)
