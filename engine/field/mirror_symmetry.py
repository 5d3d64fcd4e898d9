"""Mirror symmetry: if the axis is in the middle of a picture, its four mirrored quadrants have the same PSFs.

The PSFs of a rotationally symmetric lens are mirror-symmetric about the meridional plane, so the PSF of a mirrored
place is the mirrored PSF. Quadrants flipped onto one another then share one set of PSFs and OTFs.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..image.pixel_grid import PixelGrid
from ..runtime.threads import in_bands

BAND_PIXELS = 1 << 16  # copied together


@dataclass(frozen=True)
class Planes:
    """The planes that are filtered: the picture, or its four quadrants, which then share the optics.

    Quadrants are flipped so that the axis is at their upper left corner. Their order is lower right, upper right, lower
    left, upper left. The middle line of an odd side is in both of its quadrants.

    Attributes
    ----------
    picture : PixelGrid
    folded : bool
        Whether the planes are quadrants; the picture's axis is then in its middle.
    """

    picture: PixelGrid
    folded: bool

    @property
    def count(self) -> int:
        return 4 if self.folded else 1

    @property
    def quarter_turns(self) -> int:
        """Range of the azimuths in a plane in quarter turns, clockwise from the right."""
        return 1 if self.folded else 4

    @cached_property
    def grid(self) -> PixelGrid:
        """The pixels of a plane."""
        if not self.folded:
            return self.picture
        rows, columns = self.picture.shape_px
        return PixelGrid((-(-rows // 2), -(-columns // 2)), self.picture.pitch_um,
                         (0.0 if rows % 2 else -0.5, 0.0 if columns % 2 else -0.5))

    def views(self, picture: np.ndarray) -> list[np.ndarray]:
        """The complete picture, flipped for each plane: rows and columns run away from the axis."""
        turned = [picture, picture[::-1], picture[:, ::-1], picture[::-1, ::-1]]
        return turned[:self.count]

    def together(self, picture: np.ndarray, rim_px: int) -> tuple[np.ndarray, tuple[float, float]]:
        """The planes of a picture, with the samples of a pixel next to each other: array (row, column, plane).

        Quadrants extend across the axis by this many pixels, or up to the picture's edge.

        Returns
        -------
        array (row, column, plane)
        (row, column)
            Position of the axis, the same in all planes.
        """
        if not self.folded:
            return picture[:, :, None], self.picture.centre_px
        first_row, first_column = (max(n // 2 - rim_px, 0) for n in picture.shape)
        views = [view[first_row:, first_column:] for view in self.views(picture)]
        planes = np.empty((*views[0].shape, self.count), picture.dtype)

        def copy(rows):
            for plane, view in enumerate(views):
                planes[rows, :, plane] = view[rows]

        in_bands(copy, len(planes), BAND_PIXELS // planes[0].size)
        row, column = self.picture.centre_px
        return planes, (row - first_row, column - first_column)

    def split(self, picture: np.ndarray, rim_px: int = 0) -> np.ndarray:
        """The planes of a picture: array (plane, row, column).

        They have a rim of this many pixels on all sides: black outside the picture, and the picture across the axis.
        """
        framed = np.pad(picture, rim_px)
        if not self.folded:
            return framed[None]
        rows, columns = (slice(n // 2 - rim_px, None) for n in framed.shape)
        return np.stack([view[rows, columns] for view in self.views(framed)])

    def without_doubles(self, planes: np.ndarray) -> np.ndarray:
        """The planes, in place, with the picture's middle lines removed from all but the right and lower planes."""
        if self.folded:
            rows, columns = self.picture.shape_px
            if rows % 2:
                planes[1::2, 0] = 0
            if columns % 2:
                planes[2:, :, 0] = 0
        return planes

    def light(self, planes: np.ndarray) -> float:
        """The sum over the picture with these planes."""
        light = planes.sum(dtype=np.float64)
        if self.folded:  # middle lines are in two planes
            rows, columns = (n % 2 for n in self.picture.shape_px)
            light -= planes[1::2, :rows].sum(dtype=np.float64) + planes[2:, :, :columns].sum(dtype=np.float64)
            light += planes[3:, :rows, :columns].sum(dtype=np.float64)
        return float(light)

    def join(self, planes: np.ndarray, margin_px: int = 0) -> np.ndarray:
        """Join planes without doubles to the picture; each plane has a margin.

        Parameters
        ----------
        planes : array (plane, row + 2 margin_px, column + 2 margin_px)
        margin_px : int

        Returns
        -------
        array (row + 2 margin_px, column + 2 margin_px) of the picture
        """
        if not self.folded:
            return planes[0]
        rows, columns = (n + 2 * margin_px for n in self.picture.shape_px)
        part_rows, part_columns = planes.shape[1:]
        lower, right = slice(rows - part_rows, None), slice(columns - part_columns, None)
        upper, left = slice(part_rows), slice(part_columns)
        picture = np.zeros((rows, columns), planes.dtype)
        picture[lower, right] += planes[0]
        picture[upper, right] += planes[1, ::-1]
        picture[lower, left] += planes[2, :, ::-1]
        picture[upper, left] += planes[3, ::-1, ::-1]
        return picture

    def around(self, table: np.ndarray, margin: int, outside: float) -> np.ndarray:
        """Extend the planes' common table (row, column) of sections by a margin on each side.

        The value beyond the picture is `outside`; across the axis, sections are mirrored.
        """
        if not self.folded:
            return np.pad(table, margin, constant_values=outside)
        mirrored = np.pad(table, ((margin, 0), (margin, 0)), mode="symmetric")
        return np.pad(mirrored, ((0, margin), (0, margin)), constant_values=outside)

    def steps_across_axis(self, first_columns: np.ndarray, first_rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Largest steps between adjacent pixels on opposite sides of the axis; 0 without an axis to cross.

        Parameters
        ----------
        first_columns : array (plane, row)
        first_rows : array (plane, column)

        Returns
        -------
        along_columns : array (row,)
        along_rows : array (column,)
        """
        pairs = 2 if self.folded else 0
        across = first_columns[:pairs] - first_columns[len(first_columns) - pairs:]
        down = first_rows[:2 * pairs:2] - first_rows[1:2 * pairs:2]
        return np.abs(across).max(axis=0, initial=0), np.abs(down).max(axis=0, initial=0)

    def mirrored_into(self, position_px: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
        """Positions along an axis of a plane, mirrored into the plane if they are across the picture's axis; and the
        signs of components along this axis there, -1 for mirrored positions."""
        centre = self.grid.centre_px[axis]
        sign = np.where(self.folded & (position_px < centre), -1, 1)
        return centre + sign * (position_px - centre), sign
