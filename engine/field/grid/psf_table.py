"""Tables of the nodes' PSFs on the pixel grid, for mixing the PSF of any pixel quickly and without error."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...kernels.library import NUMPY, running
from ...kernels.spreading import PackedTable, TablePlaces
from ...lens.grid_lens import GridLens
from ...runtime.threads import thread_pool
from ..mirror_symmetry import Planes
from ..psf_table import CompiledTable, PlainTable, TableCells, TablesByWavelength, corners_between, mixed_by_row
from .node_psfs import NodePsfs, Part, PlacedPsfs
from .nodes import PlaneNodes

Place = tuple[np.ndarray, np.ndarray]
"""Positions from the axis in mm, downwards and to the right: arrays (place,), from `PlacedPsfs.place`."""


@dataclass(frozen=True, eq=False)
class PsfsOfNodes:
    """The PSFs of the nodes around the pixels of a plane, each stored once.

    Attributes
    ----------
    psfs : array (row, column, pixel)
        PSFs of the lens data from the first to the last of these nodes, in squares of 2 radius_px + 1, each followed by
        a black pixel.
    nodes : PlaneNodes
    """

    psfs: np.ndarray
    nodes: PlaneNodes

    @property
    def side(self) -> int:
        """Side of the squares, in pixels."""
        return int(np.sqrt(self.psfs.shape[-1] - 1))

    def table(self) -> "GridTable":
        """The table in plain arrays."""
        return GridTable(self)

    def packed(self) -> "PackedGrid | None":
        """The table for the compiled loops; None without these, and for double precision."""
        return PackedGrid(self) if self.psfs.dtype == np.float32 and running() != NUMPY else None

    @cached_property
    def _flips(self):
        """Indices of the pixels of PSFs: array (flipped down, flipped across, pixel)."""
        square = np.arange(self.side**2).reshape(self.side, self.side)
        flips = [[square, square[:, ::-1]], [square[::-1], square[::-1, ::-1]]]
        return np.array([[np.append(pixels, square.size) for pixels in row] for row in flips])

    def taps(self, node: tuple[int, int], pixels: np.ndarray, out: np.ndarray) -> None:
        """Write these pixels of the PSF of a node of the plane: its row and column."""
        row, column = node
        rows, columns = self.nodes.rows, self.nodes.columns
        psf = self.psfs[rows.indices[row] - rows.indices.min(), columns.indices[column] - columns.indices.min()]
        np.take(psf, self._flips[int(rows.flipped[row]), int(columns.flipped[column])][pixels], out=out, mode="clip")

    def reached(self) -> np.ndarray:
        """Whether the PSF of a node of the plane reaches a pixel: bool array (row, column, pixel)."""
        lit = np.empty((*self.nodes.shape, self.side**2), bool)
        psf = np.empty(self.side**2, self.psfs.dtype)
        for node in np.ndindex(self.nodes.shape):
            self.taps(node, np.arange(psf.size), psf)
            lit[node] = psf != 0
        return lit

    def mean_distance_px(self) -> float:
        """Mean distance of light from the chief ray, at the node where it is largest."""
        down, right = np.indices((self.side, self.side)).reshape(2, -1) - self.side // 2
        return float((self.psfs[..., :-1] @ np.hypot(down, right).astype(self.psfs.dtype)).max())

    def offsets_px(self) -> np.ndarray:
        """Mean offset of the light of the plane's nodes from the chief ray, downwards and to the right: array (node,
        2)."""
        grid_px = (np.indices((self.side, self.side)).reshape(2, -1).T - self.side // 2).astype(self.psfs.dtype)
        rows, columns = self.nodes.rows, self.nodes.columns
        offsets = self.nodes.at_nodes(self.psfs[..., :-1] @ grid_px)
        offsets[rows.flipped, :, 0] *= -1
        offsets[:, columns.flipped, 1] *= -1
        return offsets.reshape(-1, 2)


class GridCells(TableCells):
    """The cells between the nodes of a table.

    Attributes
    ----------
    nodes : PlaneNodes
    """

    def __init__(self, psfs: PsfsOfNodes) -> None:
        super().__init__(psfs.side // 2, psfs.mean_distance_px(), psfs.offsets_px())
        self.nodes = psfs.nodes

    def corners(self, place: Place) -> tuple[np.ndarray, np.ndarray]:
        """See `TableCells`; nodes are numbered row by row."""
        down_mm, right_mm = place
        return corners_between(self.nodes.rows.position(down_mm), self.nodes.columns.position(right_mm),
                               self.nodes.shape, self.offsets_px.dtype)


class GridTable(PlainTable, GridCells):
    """The PSFs of nodes for one wavelength."""

    def __init__(self, psfs: PsfsOfNodes) -> None:
        GridCells.__init__(self, psfs)
        reached = np.any(psfs.reached(), axis=1)
        taps = np.flatnonzero(np.any(reached, axis=0))
        table = np.empty((*self.nodes.shape, taps.size), psfs.psfs.dtype)
        for node in np.ndindex(self.nodes.shape):
            psfs.taps(node, taps, table[node])
        PlainTable.__init__(self, table, taps, reached[:, taps])


class PackedGrid(CompiledTable, GridCells):
    """The PSFs of a table, in pieces for the compiled loops: with an interval for each cell, row by row."""

    def __init__(self, psfs: PsfsOfNodes) -> None:
        GridCells.__init__(self, psfs)
        lit, cells_across = psfs.reached(), self.nodes.columns.size - 1
        lit = lit[:-1] | lit[1:]
        lit = lit[:, :-1] | lit[:, 1:]

        def fill(cell, pixels, out):
            row, column = divmod(cell, cells_across)
            for down, right in np.ndindex(2, 2):
                psfs.taps((row + down, column + right), pixels, out[down, right])

        self.pieces = PackedTable.of(lit.reshape(-1, lit.shape[-1]), 2, fill)

    def places(self, psfs: PlacedPsfs) -> TablePlaces:
        """Positions of the pixels of these PSFs' planes among the cells."""
        x_mm, y_mm = psfs.planes.grid.axes_mm()
        return TablePlaces.in_cells(self.nodes.rows.cells(-y_mm), self.nodes.columns.cells(x_mm),
                                    self.nodes.columns.size - 1)


class PsfTables(TablesByWavelength[PsfsOfNodes]):
    """The PSFs of nodes for tables.

    Parameters
    ----------
    lens : GridLens
    wavelengths_nm : array
        As for `TablesByWavelength`.
    planes : Planes
        The planes for their lookup.
    part : callable (PsfSamples) -> PsfSamples
        Returns the part of the complete PSFs to use, such as the trimmed ones.
    precision : dtype
    """

    def __init__(self, lens: GridLens, wavelengths_nm: Sequence[float] | np.ndarray, planes: Planes, part: Part,
                 precision: str) -> None:
        super().__init__(lens, wavelengths_nm)
        self._pitch_um, self._part = planes.picture.pitch_um, part
        self._nodes, self._precision = PlaneNodes.of(lens, planes.grid), precision

    def _mixed(self, psfs, others, weight):
        return replace(psfs, psfs=mixed_by_row(psfs.psfs, others.psfs, weight))

    def _make(self, wavelength_nm):
        psfs = NodePsfs(self._lens.at_wavelength(wavelength_nm), self._pitch_um, self._part)
        rows, columns = (np.unique(axis.indices) for axis in (self._nodes.rows, self._nodes.columns))

        def row_of_nodes(row):
            squares = psfs.squares(row, columns).reshape(columns.size, -1)
            return np.pad(squares, ((0, 0), (0, 1))).astype(self._precision)

        with thread_pool() as pool:
            table = np.stack(list(pool.map(row_of_nodes, rows)))
        return PsfsOfNodes(table, self._nodes)
