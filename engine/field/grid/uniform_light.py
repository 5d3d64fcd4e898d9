"""Uniform light on the sensor: what a white wall looks like after distortion, relative illumination and blur.

PSFs move light away from the places where chief rays arrive, so a pixel's light is a sum over the pixels around it.
"""

import numpy as np

from ...image.pixel_grid import PixelGrid
from ...lens.grid_lens import MonochromaticGrid
from ..mirror_symmetry import Planes
from .geometry import GridGeometry
from .node_psfs import NodePsfs, PlacedPsfs
from .nodes import PlaneNodes

ALONG_PX = 192  # of the picture of uniform light, along the longer side of the field
MISSED = 1.2  # limit of the true worst error over the computed one: for other wavelengths, and for changes of flux


def picture_illumination(optics: MonochromaticGrid, geometry: GridGeometry) -> tuple[np.ndarray, PixelGrid]:
    """Irradiance under uniform radiance over the field, relative to the axis: array (row, column), and its pixels.

    It includes the light that PSFs move away from the places where chief rays arrive. The table in the lens data
    describes the bundle around each chief ray instead.
    """
    pitch_mm = max(np.ptp(geometry.x_mm), np.ptp(geometry.y_mm)) / ALONG_PX
    shape = [int(np.ceil(np.ptp(axis) / pitch_mm)) + 1 for axis in (geometry.y_mm, geometry.x_mm)]
    grid = PixelGrid((shape[0], shape[1]), 1e3 * pitch_mm, (geometry.y_mm[-1] / pitch_mm, -geometry.x_mm[0] / pitch_mm))
    psfs = NodePsfs(optics, grid.pitch_um)
    nodes = PlaneNodes.of(optics, grid)
    placed = PlacedPsfs(psfs, 0.0, nodes, Planes(grid, False))
    table = np.stack([placed.row_of_nodes(row) for row in range(nodes.shape[0])])  # (row, column, down, right)
    radius = table.shape[-1] // 2
    wide = grid.framed(radius)
    x_mm, y_mm = wide.axes_mm()
    flux = geometry.relative_flux(x_mm[None, :], y_mm[:, None])
    down, across = (_weights(axis, at_mm) for axis, at_mm in ((nodes.rows, -y_mm), (nodes.columns, x_mm)))
    light = np.zeros(grid.shape_px)
    for row, column in np.ndindex(table.shape[2:]):
        spread = flux * (down @ table[:, :, row, column] @ across.T)
        light += spread[2 * radius - row:][:shape[0], 2 * radius - column:][:, :shape[1]]
    return light, grid


def unevenness(psfs: NodePsfs, nodes: PlaneNodes) -> float:
    """Upper limit of the relative error of pixels under uniform radiance, which is largest next to rows of nodes.

    All light of a pixel has the PSF of its centre. Between nodes, PSFs change linearly along rows and columns. This
    does not matter there, because each pixel gains as much from the one before as it loses to the next one. It does
    across a row of nodes, where the change has a kink. If the row is between two pixels, a sample at a fraction f of a
    pixel moves f (1 - f) / 2 times its change too little to the next pixel. If the row is in the middle of a pixel, the
    mean change over the pixel is not the one in its middle: a pixel whose middle is a distance d < 1/2 from a sample
    receives (1/2 - d)^2 / 2 times the kink too little. Rows elsewhere in a pixel cause errors between these two. Where
    rows and columns of nodes cross, their errors add.

    Parameters
    ----------
    psfs : NodePsfs
        On the grid's pixels.
    nodes : PlaneNodes
        Those around the grid's pixels.
    """
    rows, columns = (np.unique(axis.indices) for axis in (nodes.rows, nodes.columns))
    batches = [[_profiles(samples) for _, samples in psfs.samples(row, columns)] for row in rows]
    most = least = 0.0
    for number in range(2):
        profiles = np.stack([np.concatenate([batch[number] for batch in row]) for row in batches])
        errors = _kinks(nodes.at_nodes(profiles), nodes, number)
        most, least = most + errors.max(axis=-1), least + errors.min(axis=-1)
    return MISSED * float(max(np.max(most), -np.min(least)))


def _profiles(samples):
    """For both axes, errors per change of a PSF from pixel to pixel: arrays (PSF, half a pixel), alternately for nodes
    in the middle of a pixel and between two pixels."""
    def along(position_px):
        before, nearest = np.floor(position_px), np.round(position_px)
        f, distance_px = position_px - before, np.abs(position_px - nearest)
        halves = np.concatenate([2 * before + 1, 2 * nearest]).astype(int) + 2 * samples.radius_px
        errors = np.concatenate([f * (1 - f) / 2, -(0.5 - distance_px) ** 2 / 2])
        return np.stack([np.bincount(halves, np.tile(psf, 2) * errors, 4 * samples.radius_px + 1)
                         for psf in samples.samples])

    return along(samples.v_px), along(samples.u_px)


def _kinks(profiles, nodes, number):
    """Changes of slope at each node, per pixel, of (row, column, half a pixel) along an axis of nodes: an array of this
    shape. Nodes beyond the pixels do not count."""
    x_mm, y_mm = nodes.grid.axes_mm()
    axis, at_mm = ((nodes.rows, -y_mm), (nodes.columns, x_mm))[number]
    profiles = np.moveaxis(profiles, number, 0)
    profiles = np.where(axis.flipped[:, None, None], profiles[..., ::-1], profiles)
    steps_px = np.diff(axis.places_mm) / (nodes.grid.pitch_um * 1e-3)
    slopes = np.diff(profiles, axis=0) / steps_px[:, None, None]
    kinks = np.diff(slopes, axis=0, prepend=0, append=0)  # PSFs are constant beyond the nodes
    kinks[(axis.places_mm <= at_mm[0]) | (axis.places_mm >= at_mm[-1])] = 0
    return np.moveaxis(kinks, 0, number)


def _weights(axis, at_mm):
    """Weights of nodes at places: array (place, node)."""
    before, on = axis.cells(at_mm)
    weights = np.zeros((at_mm.size, axis.size))
    weights[np.arange(at_mm.size), before] = 1 - on
    weights[np.arange(at_mm.size), before + 1] = on
    return weights
