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
KINK = 1 / 8  # largest mean over a pixel minus the value in its middle, relative to a change of slope in it


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
    across a row of nodes, where the change has a kink: a sample at a fraction f of a pixel moves f (1 - f) / 2 times
    its change too little to the next pixel. In the pixel with the kink, the mean change also differs from the one in
    its middle, by up to KINK times the kink.

    Parameters
    ----------
    psfs : NodePsfs
        On the grid's pixels.
    nodes : PlaneNodes
        Those around the grid's pixels.
    """
    rows, columns = (np.unique(axis.indices) for axis in (nodes.rows, nodes.columns))
    batches = [[_profiles(samples) for _, samples in psfs.samples(row, columns)] for row in rows]
    pitch_mm = nodes.grid.pitch_um * 1e-3
    error = 0.0
    for number, axis in enumerate((nodes.rows, nodes.columns)):
        kinks = 0.0
        for scale, kind in ((1, 0), (KINK, 1)):
            profiles = np.stack([np.concatenate([batch[number][kind] for batch in row]) for row in batches])
            kinks = kinks + scale * _kinks(nodes.at_nodes(profiles), axis, number, pitch_mm)
        error = error + _largest_in_cells(kinks)
    return float(np.max(error))


def _profiles(samples):
    """For both axes, arrays (PSF, pixel): light times f (1 - f) / 2, and light, along the axis."""
    def along(position_px):
        pixel = np.floor(position_px).astype(int) + samples.radius_px
        f, size = position_px - np.floor(position_px), 2 * samples.radius_px + 1

        def binned(weight, pixel):
            return np.stack([np.bincount(pixel, psf * weight, size) for psf in samples.samples])

        return binned(f * (1 - f) / 2, pixel)[:, :-1], binned(1 - f, pixel) + binned(f, pixel + 1)

    return along(samples.v_px), along(samples.u_px)


def _kinks(profiles, axis, number, pitch_mm):
    """Largest change of slope at each node, in light per pixel, of (row, column, pixel) along an axis of nodes: array
    (row, column)."""
    profiles = np.moveaxis(profiles, number, 0)
    profiles = np.where(axis.flipped[:, None, None], profiles[..., ::-1], profiles)
    steps_px = np.diff(axis.places_mm) / pitch_mm
    slopes = np.diff(profiles, axis=0) / steps_px[:, None, None]
    slopes = np.pad(slopes, ((1, 1), (0, 0), (0, 0)))  # PSFs are constant beyond the nodes
    return np.moveaxis(np.abs(np.diff(slopes, axis=0)).max(axis=-1), 0, number)


def _largest_in_cells(kinks):
    """The largest of (row, column) at the corners of each cell between nodes."""
    along = np.maximum(kinks[1:], kinks[:-1])
    return np.maximum(along[:, 1:], along[:, :-1])


def _weights(axis, at_mm):
    """Weights of nodes at places: array (place, node)."""
    before, on = axis.cells(at_mm)
    weights = np.zeros((at_mm.size, axis.size))
    weights[np.arange(at_mm.size), before] = 1 - on
    weights[np.arange(at_mm.size), before + 1] = on
    return weights
