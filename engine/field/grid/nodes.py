"""The nodes of the lens data around the pixels of a plane."""

from dataclasses import dataclass

import numpy as np

from ...image.pixel_grid import PixelGrid
from ...lens.grid_lens import GridLens, MonochromaticGrid


@dataclass(frozen=True, eq=False)
class NodeAxis:
    """Nodes along an axis of a plane, ascending.

    Attributes
    ----------
    places_mm : array (node,)
        Positions relative to the axis of the lens: downwards, or to the right.
    indices : int array (node,)
        Their indices in the lens data.
    flipped : bool array (node,)
        Whether their PSFs are mirror images of those in the data.
    """

    places_mm: np.ndarray
    indices: np.ndarray
    flipped: np.ndarray

    @classmethod
    def of(cls, places_mm: np.ndarray, mirrored: bool, sign: int, ends_mm: tuple[float, float]) -> "NodeAxis":
        """The nodes around all places between two.

        Parameters
        ----------
        places_mm : array (node,)
            Of the lens data, ascending.
        mirrored : bool
            Whether the data contain one half of the field alone.
        sign : int
            -1 if the plane's axis has the opposite direction.
        ends_mm : (float, float)
        """
        indices = np.arange(places_mm.size)
        places_mm, flipped = sign * places_mm, np.zeros(places_mm.size, bool)
        if mirrored:
            places_mm = np.append(places_mm, -places_mm[1:])
            flipped = np.append(flipped, np.ones(indices.size - 1, bool))
            indices = np.append(indices, indices[1:])
        order = np.argsort(places_mm)
        first = int(np.searchsorted(places_mm[order], ends_mm[0], side="right")) - 1
        last = int(np.searchsorted(places_mm[order], ends_mm[1]))
        first = min(max(first, 0), order.size - 2)
        used = order[first:max(min(last, order.size - 1), first + 1) + 1]
        return cls(places_mm[used], indices[used], flipped[used])

    @property
    def size(self) -> int:
        return self.indices.size

    def position(self, at_mm: np.ndarray) -> np.ndarray:
        """Positions among the nodes, from 0 to size - 1; beyond the last node, its position."""
        return np.interp(at_mm, self.places_mm, np.arange(self.size))

    def cells(self, at_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The nodes before places, and fractions from these to the next: int and float arrays."""
        position = self.position(at_mm)
        before = np.minimum(position.astype(int), self.size - 2)
        return before, position - before


@dataclass(frozen=True, eq=False)
class PlaneNodes:
    """The nodes around the pixels of a plane: rows from its top, columns from its left."""

    rows: NodeAxis
    columns: NodeAxis
    grid: PixelGrid

    @classmethod
    def of(cls, lens: GridLens | MonochromaticGrid, grid: PixelGrid) -> "PlaneNodes":
        """The nodes around all pixels of a grid."""
        x_mm, y_mm = grid.axes_mm()
        return cls(NodeAxis.of(lens.y_mm, lens.mirrored[0], -1, (-y_mm[0], -y_mm[-1])),
                   NodeAxis.of(lens.x_mm, lens.mirrored[1], 1, (x_mm[0], x_mm[-1])), grid)

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns of nodes."""
        return self.rows.size, self.columns.size

    def at_nodes(self, table: np.ndarray) -> np.ndarray:
        """A table of the lens data's nodes from the first to the last one here, (row, column, ...), at these nodes."""
        rows, columns = (axis.indices - axis.indices.min() for axis in (self.rows, self.columns))
        return table[np.ix_(rows, columns)]

    def place(self, rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions of the grid's pixels relative to the axis, downwards and to the right, in mm."""
        x_mm, y_mm = self.grid.position_mm(rows, columns)
        return -y_mm, x_mm

    def shares(self, grid: PixelGrid) -> np.ndarray:
        """Share of a grid's pixels in each cell between nodes: array (row - 1, column - 1)."""
        x_mm, y_mm = grid.axes_mm()
        across, down = (np.bincount(axis.cells(at_mm)[0], minlength=axis.size - 1) / at_mm.size
                        for axis, at_mm in ((self.columns, x_mm), (self.rows, -y_mm)))
        return np.outer(down, across)
