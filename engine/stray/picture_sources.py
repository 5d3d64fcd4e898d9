"""Sources of stray light in a picture: its lamps, and the parts of its windows and skies.

The picture is halved again and again, where its light is farthest from the middle of its part. Each part becomes a
source in the light-weighted mean direction of its pixels. No light is neglected, so a lamp that moves by less than a
pixel moves its source by as much, and the sum of all sources does not jump when the parts change.
"""

import heapq
from dataclasses import replace

import numpy as np

from ..image.directions import directions, places_of, solid_angles_sr
from ..image.layers import LayeredRadiance
from ..image.nonfinite import clamp_fireflies
from ..image.spectral_image import SpectralImage
from .sources import Sources, widths_nm

MOST_SOURCES = 64
SPREAD_RAD = 0.01
MOST_CELLS = 1024  # along a side of the picture: the smallest parts of larger pictures are cells of several pixels
STRIP_ROWS = 64
DARK = 1e-12  # of the light: rounding in sums over empty parts


def picture_sources(radiance: SpectralImage, focal_mm: float, layers: LayeredRadiance | None = None,
                    most: int = MOST_SOURCES, spread_rad: float = SPREAD_RAD) -> tuple[Sources, float]:
    """The sources in a picture, brightest first; together they give all of its irradiance at the entrance pupil.

    Parameters
    ----------
    radiance : SpectralImage
        With overscan.
    focal_mm : float
        Of the capturing pinhole, if the radiance does not state it.
    layers : LayeredRadiance, optional
        The same light in layers, which have its distances. Their grid may extend beyond the radiance's, whose edges
        limit the sources.
    most : int
        Largest number of sources.
    spread_rad : float
        The picture is divided until its light is on average this close to its source's direction.

    Returns
    -------
    Sources
        A flat picture's are at infinity, and the others at the mean inverse distance of their light. Empty for a
        black picture.
    float
        The average angle between the light and the direction of its source, in rad.
    """
    grid = replace(radiance.grid, focal_mm=radiance.focal_mm or radiance.grid.focal_mm or focal_mm)
    widths, seen = widths_nm(radiance.wavelengths_nm), _within(layers, radiance) if layers else radiance
    light = _composed(seen, lambda cube, _: np.tensordot(widths, cube, axes=1))
    nearness = _composed(seen, lambda cube, depth_mm: np.tensordot(widths, cube, axes=1) / depth_mm)
    cells = _Cells(grid)
    moments = cells.moments(light, nearness)
    parts, spread = _parts(moments[:4], most, spread_rad)
    labels = np.full(moments.shape[1:], -1)
    for index, (top, bottom, left, right) in enumerate(parts):
        labels[top:bottom, left:right] = index

    def summed(plane):
        return np.bincount(labels[labels >= 0], plane[labels >= 0], minlength=len(parts))

    irradiance = np.array([np.maximum(summed(cells.irradiance(_composed(seen, lambda cube, _, k=k: cube[k]))), 0)
                           for k in range(widths.size)]).reshape(widths.size, len(parts)).T
    return _sources(grid, radiance.wavelengths_nm, irradiance, np.array([summed(moment) for moment in moments])), spread


def _sources(grid, wavelengths_nm, irradiance, moments):
    """The Sources of parts, from their moments: array (moment, part), as in `_Cells.moments`."""
    light, vectors, nearness = moments[0], moments[1:4].T, moments[4]
    length = np.linalg.norm(vectors, axis=-1)
    variance = np.maximum(1 - np.square(length / light), 0)
    pixel_sr = solid_angles_sr(grid, *grid.centre_px)
    with np.errstate(divide="ignore"):
        distance_mm = np.where(nearness > 0, light / nearness, np.inf)
    towards = vectors / length[:, None]
    names = tuple(f"picture at {row:.0f}, {column:.0f} px"
                  for row, column in zip(*_frame_places(grid, towards), strict=True))
    return Sources(towards, distance_mm, irradiance, wavelengths_nm, np.sqrt(2 * variance + pixel_sr / np.pi), names)


def _frame_places(grid, towards):
    """Rows and columns of directions, counted from the frame's first pixel."""
    return [place - overscan for place, overscan in zip(places_of(grid, towards), grid.overscan_px, strict=True)]


class _Cells:
    """A grid's cells: its pixels or, in a large picture, squares of them.

    Parameters
    ----------
    grid : PixelGrid
    """

    def __init__(self, grid):
        self._grid, self._size = grid, -(-max(grid.shape_px) // MOST_CELLS)
        self._sr = np.concatenate([solid_angles_sr(grid, *indices) for indices in self._strips()]).astype(np.float32)

    def irradiance(self, plane):
        """Irradiance from cells, from a plane of radiance: array (row, column)."""
        return self._merged(np.maximum(plane, 0) * self._sr)

    def moments(self, light, nearness):
        """Irradiance (1), weighted by the direction's components (3), and by the inverse distance (1), from planes of
        radiance, and of radiance over depth: array (5, row, column) of cells."""
        strips = []
        for rows, columns in self._strips():
            towards = np.moveaxis(directions(self._grid, rows, columns), -1, 0)
            part = np.maximum(light[rows[:, 0]], 0), np.maximum(nearness[rows[:, 0]], 0)
            planes = np.array([part[0], *(part[0] * towards), part[1] * towards[2]]) * self._sr[rows[:, 0]]
            strips.append(self._merged(planes))
        return np.concatenate(strips, axis=1)

    def _strips(self):
        """Rows and columns of the pixels, in strips of complete cells, because directions take much memory."""
        rows, columns = self._grid.shape_px
        step = self._size * max(1, STRIP_ROWS // self._size)
        for first in range(0, rows, step):
            yield np.broadcast_arrays(*np.ogrid[first:min(first + step, rows), :columns])

    def _merged(self, planes):
        for axis in (-2, -1):
            planes = np.add.reduceat(planes, range(0, planes.shape[axis], self._size), axis=axis)
        return planes


def _within(layers, radiance):
    """The layers on a radiance's grid."""
    return layers.cropped([more - n for more, n in zip(layers.grid.overscan_px, radiance.overscan_px, strict=True)])


def _composed(radiance, light_of):
    """What the pinhole sees of all layers' light: plane (row, column) of `light_of`, a linear function of a cube, with
    NaN and infinite pixels replaced.

    `light_of` also takes the depth in mm.
    """
    if isinstance(radiance, SpectralImage):
        return clamp_fireflies(light_of(radiance.cube, np.inf))[0]
    plane = np.zeros(radiance.grid.shape_px)
    for layer in reversed(radiance.layers):
        part = plane[layer.place]
        part *= 1 - layer.alpha
        depth_mm = np.where(layer.alpha > 0, layer.depth_mm, np.inf)
        part += clamp_fireflies(light_of(layer.cube, depth_mm))[0]
    return plane


def _parts(moments, most, spread_rad):
    """Divide cells into parts of at most this mean spread: a list of (top, bottom, left, right), brightest first, and
    the spread.

    Parameters
    ----------
    moments : array (4, row, column)
        Irradiance, and its product with each component of the direction.
    most : int
    spread_rad : float
    """
    table = np.pad(moments.cumsum(axis=1).cumsum(axis=2), ((0, 0), (1, 0), (1, 0)))
    total = table[0, -1, -1]
    heap, done = [_weighed(table, (0, moments.shape[1], 0, moments.shape[2]))] * bool(total > 0), []
    while heap and len(heap) + len(done) < most:
        if -sum(each[0] for each in heap) <= spread_rad * total:
            break
        _, light, box = heapq.heappop(heap)
        halves = _halves(box)
        if not halves:
            done.append((0.0, light, box))
        for half in halves:
            weighed = _weighed(table, half)
            if weighed[1] > DARK * total:
                heapq.heappush(heap, weighed)
    parts = sorted(heap + done, key=lambda each: (-each[1], each[2]))
    return [box for _, _, box in parts], float(-sum(each[0] for each in parts) / total) if parts else 0.0


def _weighed(table, box):
    """(minus light times spread, light, box) of a part, from sums over all cells above and to the left."""
    top, bottom, left, right = box
    light, *vector = table[:, bottom, right] - table[:, top, right] - table[:, bottom, left] + table[:, top, left]
    if light <= 0:
        return 0.0, 0.0, box
    return -light * float(np.sqrt(max(1 - np.square(vector).sum() / light**2, 0))), float(light), box


def _halves(box):
    """The two halves of a part along its longer side; none of a cell."""
    top, bottom, left, right = box
    if bottom - top >= right - left:
        middle = (top + bottom) // 2
        return [(top, middle, left, right), (middle, bottom, left, right)] if middle > top else []
    middle = (left + right) // 2
    return [(top, bottom, left, middle), (top, bottom, middle, right)]
