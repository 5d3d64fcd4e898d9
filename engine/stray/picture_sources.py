"""Sources of stray light in a picture: its lamps, and the parts of its windows, grounds and skies.

A connected spot much brighter than the mean is a lamp. A large one is shared out among the nodes of a grid, between
which its light is divided linearly, and so is the ground, which is all other light. Each source is in the mean
direction of its light. No light is neglected, and everything is continuous, so sources do not flicker: a lamp that
moves by less than a pixel moves its source by as much, also while its light passes from one node to the next.
"""

import itertools
from dataclasses import dataclass, replace

import numpy as np
import scipy

from ..image.directions import directions, places_of, solid_angles_sr
from ..image.layers import LayeredRadiance
from ..image.sources import Sources, widths_nm
from ..image.spectral_image import SpectralImage
from .visible_light import composed, layers_within

LAMP = 8.0  # times the mean radiance: lamps begin there, and above twice this all light is a lamp's
MOST_LAMPS = 20
SMALL_RAD = 0.01  # root mean square: larger lamps are shared out
LAMP_NODES, GROUND_NODES = (6, 8), (3, 4)  # down, and across
MOST_CELLS = 1024  # along a side of the picture: the smallest parts of larger pictures are cells of several pixels
STRIP_ROWS = 64
DARK = 1e-12  # of the light: rounding in sums over empty parts


def picture_sources(radiance: SpectralImage, focal_mm: float, layers: LayeredRadiance | None = None) -> Sources:
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

    Returns
    -------
    Sources
        A flat picture's are at infinity, and the others at the mean inverse distance of their light. Empty for a
        black picture.
    """
    grid = replace(radiance.grid, focal_mm=radiance.focal_mm or radiance.grid.focal_mm or focal_mm)
    widths, visible = widths_nm(radiance.wavelengths_nm), layers_within(layers, radiance) if layers else radiance
    light = composed(visible, lambda cube, _: np.einsum("w,wrc->rc", widths, cube))
    nearness = composed(visible, lambda cube, depth_mm: np.einsum("w,wrc->rc", widths, cube) / depth_mm
                        ) if layers else np.zeros_like(light)
    cells = _Cells(grid)
    moments = cells.moments(light, nearness)
    parts = _parts(moments, cells.solid_angles_sr)

    def summed(planes):
        return np.array([part.sum(planes) for part in parts])

    irradiance = np.array([summed(cells.irradiance(composed(visible, lambda cube, _, k=k: cube[k])))
                           for k in range(widths.size)])
    return _sources(grid, radiance.wavelengths_nm, irradiance.T, summed(moments).reshape(-1, len(moments)).T)


def _sources(grid, wavelengths_nm, irradiance, moments):
    """The Sources of parts, from their moments: array (moment, part), as in `_Cells.moments`."""
    light, vectors, nearness = moments[0], moments[1:4].T, moments[4]
    radius_rad = np.sqrt(2 * _variance(moments) + solid_angles_sr(grid, *grid.centre_px) / np.pi)
    with np.errstate(divide="ignore"):
        distance_mm = np.where(nearness > 0, light / nearness, np.inf)
    towards = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    names = tuple(f"picture at {row:.0f}, {column:.0f} px"
                  for row, column in zip(*_frame_places(grid, towards), strict=True))
    return Sources(towards, distance_mm, irradiance, wavelengths_nm, radius_rad, names)


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

    @property
    def solid_angles_sr(self):
        """Array (row, column)."""
        return self._merged(self._sr)

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
        for axis in (-2, -1) if self._size > 1 else ():
            planes = np.add.reduceat(planes, range(0, planes.shape[axis], self._size), axis=axis)
        return planes


@dataclass(frozen=True, eq=False)
class _Part:
    """A share of the light of some cells.

    Attributes
    ----------
    place : (slice, slice)
    share : array (row, column)
    """

    place: tuple[slice, slice]
    share: np.ndarray

    def sum(self, planes):
        """Sums of planes (..., row, column) over the part."""
        return np.einsum("...rc,rc->...", planes[(..., *self.place)], self.share)


def _parts(moments, cells_sr):
    """Share out the light of cells among parts, brightest first.

    Parameters
    ----------
    moments : array (moment, row, column)
        As `_Cells.moments`.
    cells_sr : array (row, column)
    """
    light = moments[0]
    total = light.sum()
    if not total > 0:
        return []
    level = np.maximum(LAMP * total / cells_sr.sum() * cells_sr, np.finfo(float).tiny)
    lamps = _sorted(_lamps(moments, np.clip(light / level - 1, 0, 1)), light)[:MOST_LAMPS]
    rest = np.ones(light.shape)
    for lamp in lamps:
        rest[lamp.place] -= lamp.share
    ground = _Part(tuple(slice(0, size) for size in light.shape), np.maximum(rest, 0))
    parts = [*lamps, *_shared_out(ground, GROUND_NODES, light.shape)]
    return _sorted((part for part in parts if part.sum(light) > DARK * total), light)


def _sorted(parts, light):
    return sorted(parts, key=lambda part: -part.sum(light))


def _lamps(moments, bright):
    """The parts of the brightest spots, from the share of each cell's light that is a lamp's."""
    labels, count = scipy.ndimage.label(bright > 0, np.ones((3, 3)))
    places = scipy.ndimage.find_objects(labels)
    light = np.bincount(labels.ravel(), (bright * moments[0]).ravel(), count + 1)[1:]
    for number in np.argsort(-light, kind="stable")[:MOST_LAMPS]:
        place = places[number]
        spot = _Part(place, np.where(labels[place] == number + 1, bright[place], 0.0))
        if _variance(spot.sum(moments)) > SMALL_RAD**2:
            yield from _shared_out(spot, LAMP_NODES, labels.shape)
        else:
            yield spot


def _shared_out(part, nodes, shape):
    """Divide a part's light linearly between the nodes of a grid over all cells."""
    axes = (_near_nodes(*each) for each in zip(part.place, nodes, shape, strict=True))
    for (rows, down), (columns, across) in itertools.product(*axes):
        first_row, first_column = (each.start for each in part.place)
        within = (slice(rows.start - first_row, rows.stop - first_row),
                  slice(columns.start - first_column, columns.stop - first_column))
        yield _Part((rows, columns), part.share[within] * np.multiply.outer(down, across))


def _near_nodes(place, nodes, size):
    """The weights of nodes along an axis, with their places, which are in this place."""
    steps = np.arange(place.start, place.stop) * ((nodes - 1) / max(1, size - 1))
    for node in range(nodes):
        weight = np.maximum(1 - np.abs(steps - node), 0)
        near = np.flatnonzero(weight)
        if near.size:
            yield slice(place.start + near[0], place.start + near[-1] + 1), weight[near]


def _variance(moments):
    """Of the direction of light, from moments as in `_Cells.moments`."""
    return np.maximum(1 - np.sum(np.square(moments[1:4]), axis=0) / np.square(moments[0]), 0)
