"""Mirror symmetry: where the axis is in the middle of a picture, its four mirrored quadrants have the same PSFs.

A rotationally symmetric lens has PSFs that are mirror-symmetric about the meridional plane, so that the PSF of a
mirrored place is the mirrored PSF. Quadrants flipped onto one another then share one set of PSFs and OTFs.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..image.pixel_grid import PixelGrid

SYMMETRY_TOLERANCE = 1e-2
"""L1 distance of a PSF from its mirror image that is taken for noise; half a sample off centre is some 20 times it."""


def mirror_symmetric(psf: np.ndarray) -> tuple[np.ndarray, bool]:
    """PSFs made exactly mirror-symmetric in u, where they are so but for the noise of their making.

    Parameters
    ----------
    psf : array (height, v, u), the chief ray at n // 2

    Returns
    -------
    psf : array (height, v, u), as it was or averaged with its mirror image, then of odd size
    symmetric : bool
    """
    if not is_mirror_symmetric(psf):
        return psf, False
    even = 1 - psf.shape[-1] % 2
    odd = np.pad(psf, ((0, 0), (0, even), (0, even))) if even else psf  # -n/2 has its partner then
    return (odd + odd[..., ::-1]) / 2, True


def is_mirror_symmetric(psf: np.ndarray) -> bool:
    """Whether PSFs (height, v, u), the chief ray at n // 2, are mirror-symmetric in u, but for noise."""
    even = 1 - psf.shape[-1] % 2
    right = psf[..., psf.shape[-1] // 2 + 1:]
    left = psf[..., even:even + right.shape[-1]][..., ::-1]
    alone = psf[..., :even].sum(axis=(-2, -1))  # -n/2 of an even size, which is to be dark
    return bool((2 * np.abs(right - left).sum(axis=(-2, -1)) + 2 * alone).max() <= SYMMETRY_TOLERANCE)


@dataclass(frozen=True)
class Planes:
    """The planes in which a picture is filtered: itself, or its four quadrants, which then share the optics.

    Quadrants are laid with the axis at their upper left corner: lower right, upper right, lower left, upper left. The
    middle line of an odd side is in both its quadrants.

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
        """Over how many quarter turns, clockwise from the right, the azimuths in a plane go."""
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
        """The whole picture as each plane sees it, its rows running away from the axis, and so its columns."""
        turned = [picture, picture[::-1], picture[:, ::-1], picture[::-1, ::-1]]
        return turned[:self.count]

    def split(self, picture: np.ndarray, rim_px: int = 0) -> np.ndarray:
        """The planes of a picture: array (plane, row, column).

        They have a rim of so many pixels all around: black beyond the picture; across the axis, what lies there.
        """
        framed = np.pad(picture, rim_px)
        if not self.folded:
            return framed[None]
        rows, columns = (slice(n // 2 - rim_px, None) for n in framed.shape)
        return np.stack([view[rows, columns] for view in self.views(framed)])

    def without_doubles(self, planes: np.ndarray) -> np.ndarray:
        """The planes, in place, with their middle lines left to the right and lower ones alone."""
        if self.folded:
            rows, columns = self.picture.shape_px
            if rows % 2:
                planes[1::2, 0] = 0
            if columns % 2:
                planes[2:, :, 0] = 0
        return planes

    def light(self, planes: np.ndarray) -> float:
        """The sum of the picture that these are the planes of."""
        light = planes.sum(dtype=np.float64)
        if self.folded:  # middle lines are in two planes
            rows, columns = (n % 2 for n in self.picture.shape_px)
            light -= planes[1::2, :rows].sum(dtype=np.float64) + planes[2:, :, :columns].sum(dtype=np.float64)
            light += planes[3:, :rows, :columns].sum(dtype=np.float64)
        return float(light)

    def join(self, planes: np.ndarray, margin_px: int = 0) -> np.ndarray:
        """The picture of planes without doubles, with a margin that came up around each of them.

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
        """A table (row, column) of sections of the planes, which share it, with so many more on each side: `outside`
        beyond the picture; across the axis, the mirrored ones."""
        if not self.folded:
            return np.pad(table, margin, constant_values=outside)
        mirrored = np.pad(table, ((margin, 0), (margin, 0)), mode="symmetric")
        return np.pad(mirrored, ((0, margin), (0, margin)), constant_values=outside)

    def steps_across_axis(self, rows: np.ndarray, first: bool) -> tuple[np.ndarray, np.ndarray]:
        """Steps from pixels beside the axis to those across it.

        Parameters
        ----------
        rows : array (plane, row, column)
            Some rows of the planes.
        first : bool
            Whether the first of them lies beside the axis.

        Returns
        -------
        along_columns : array (pair, row)
            Of each row's first pixel.
        along_rows : array (pair, column)
            Of each column's first pixel; both of no pairs where there is no axis to cross.
        """
        pairs = 2 if self.folded else 0
        across, down = rows[:pairs, :, 0] - rows[len(rows) - pairs:, :, 0], rows[:0, 0]
        if self.folded and first:
            down = rows[::2, 0] - rows[1::2, 0]
        return across, down

    def mirrored_into(self, position_px: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
        """Positions along an axis of a plane, those across the picture's axis brought back into the plane; and the
        signs, -1 for these, that what points along this axis takes there."""
        centre = self.grid.centre_px[axis]
        sign = np.where(self.folded & (position_px < centre), -1, 1)
        return centre + sign * (position_px - centre), sign
