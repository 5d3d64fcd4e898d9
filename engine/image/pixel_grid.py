"""PixelGrid: the pixels of an image in the sensor's plane, and their position relative to the optical axis."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..runtime.errors import ImageError
from ..runtime.numbers import is_integer, is_number, is_positive
from .projection import PLANE, Projection

MOST_PITCH_UM, FOCAL_LIMITS_MM = 1e9, (1e-4, 1e12)
"""Beyond all pictures; blur is finite, and at least a billionth of a pixel wide."""


@dataclass(frozen=True)
class PixelGrid:
    """Square pixels in the sensor's plane: their number, their size, and the position of the optical axis.

    Attributes
    ----------
    shape_px : (int, int)
        Rows and columns of all pixels, including overscan.
    pitch_um : float
        Distance between pixel centres, the same in x and y.
    centre_px : (float, float)
        Row and column, as indices, at which the optical axis meets the grid; the middle by default.
    overscan_px : (int, int)
        Rows and columns by which the grid extends beyond the sensor's frame on each side.
    projection : Projection
        Of a capture; a plane by default.
    focal_mm : float or None
        Focal length of the capturing pinhole, if it is not the lens's `capture_focal_length_mm`, which changes when a
        lens on the same sensor is focused nearer.
    squeeze : float
        Of a capture, in which a pixel is this many times as wide as tall in the scene: focal length of the picture's
        height over the one of its width. The sensor's pixels are square.
    across : int
        Of a capture: its columns in a column of the sensor. `pitch_um` is then the height of its pixels; in x,
        positions are this many times as large as on the sensor.

    Raises
    ------
    ImageError
        An attribute is invalid.
    """

    shape_px: tuple[int, int]
    pitch_um: float
    centre_px: tuple[float, float] = None  # type: ignore[assignment]  # replaced by the middle on creation
    overscan_px: tuple[int, int] = (0, 0)
    projection: Projection = PLANE
    focal_mm: float | None = None
    squeeze: float = 1.0
    across: int = 1

    def __post_init__(self) -> None:
        for name in ("shape_px", "overscan_px"):
            if np.shape(getattr(self, name)) != (2,) or not all(is_integer(n) for n in getattr(self, name)):
                raise ImageError("image", name, getattr(self, name), "expected whole numbers of rows and columns")
        rows, columns = map(int, self.shape_px)
        overscan = tuple(map(int, self.overscan_px))
        centre = ((rows - 1) / 2, (columns - 1) / 2) if self.centre_px is None else self.centre_px
        if not is_positive(self.pitch_um) or self.pitch_um > MOST_PITCH_UM:
            raise ImageError("image", "pitch_um", self.pitch_um, f"expected a positive number, up to {MOST_PITCH_UM:g}")
        if self.focal_mm is not None:
            check_focal_length("image", self.focal_mm)
        if not isinstance(self.projection, Projection):
            raise ImageError("image", "projection", self.projection, "expected a Projection")
        if not is_positive(self.squeeze):
            raise ImageError("image", "squeeze", self.squeeze, "expected a positive number")
        if not is_integer(self.across) or self.across < 1:
            raise ImageError("image", "across", self.across, "expected a whole number of columns")
        if min(overscan) < 0 or 2 * overscan[0] >= rows or 2 * overscan[1] >= columns:
            raise ImageError("image", "overscan_px", overscan, f"expected less than half of {rows} x {columns} px")
        if np.shape(centre) != (2,) or not all(is_number(c) and np.isfinite(c) for c in centre):
            raise ImageError("image", "centre_px", centre, "expected a row and a column")
        object.__setattr__(self, "shape_px", (rows, columns))
        object.__setattr__(self, "pitch_um", float(self.pitch_um))
        object.__setattr__(self, "squeeze", float(self.squeeze))
        object.__setattr__(self, "across", int(self.across))
        object.__setattr__(self, "centre_px", tuple(float(c) for c in centre))
        object.__setattr__(self, "overscan_px", overscan)

    @classmethod
    def around_frame(cls, frame_px: Sequence[int], pitch_um: float, overscan_px: Sequence[int] = (0, 0),
                     projection: Projection = PLANE) -> "PixelGrid":
        """A frame of these (rows, columns), with the axis in its middle and the given overscan on each side."""
        (rows, columns), (above, left) = frame_px, overscan_px
        return cls((rows + 2 * above, columns + 2 * left), pitch_um, overscan_px=(above, left), projection=projection)

    @property
    def frame_px(self) -> tuple[int, int]:
        """Rows and columns of the sensor's frame."""
        (rows, columns), (above, left) = self.shape_px, self.overscan_px
        return rows - 2 * above, columns - 2 * left

    @property
    def centred(self) -> bool:
        """Whether the optical axis meets the middle, so four mirrored quadrants can share all optical data."""
        return all(abs(centre - (n - 1) / 2) < 1e-9 for centre, n in zip(self.centre_px, self.shape_px, strict=True))

    @property
    def farthest_px(self) -> float:
        """Distance from the axis to the farthest corner of a pixel."""
        down, right = (max(centre + 0.5, n - 0.5 - centre)
                       for n, centre in zip(self.shape_px, self.centre_px, strict=True))
        return float(np.hypot(down, right))

    @property
    def edges_mm(self) -> tuple[float, float, float, float]:
        """Image-plane coordinates of the left, lower, right and upper edge."""
        rows, columns = self.shape_px
        (left, right), (upper, lower) = self.position_mm(np.array((-0.5, rows - 0.5)), np.array((-0.5, columns - 0.5)))
        return float(left), float(lower), float(right), float(upper)

    def frame(self) -> "PixelGrid":
        """The grid of the sensor's frame, without overscan."""
        return self.cropped(self.overscan_px)

    def cropped(self, margin_px: Sequence[int]) -> "PixelGrid":
        """The grid without `margin_px` (rows, columns) on each side, taken from its overscan."""
        (rows, columns), (above, left) = self.shape_px, margin_px
        return replace(self, shape_px=(rows - 2 * above, columns - 2 * left),
                       centre_px=(self.centre_px[0] - above, self.centre_px[1] - left),
                       overscan_px=(self.overscan_px[0] - above, self.overscan_px[1] - left))

    def part(self, region: tuple[slice, slice]) -> "PixelGrid":
        """The grid of a region, given as slices of rows and columns, without overscan."""
        rows, columns = region
        return replace(self, shape_px=(rows.stop - rows.start, columns.stop - columns.start), overscan_px=(0, 0),
                       centre_px=(self.centre_px[0] - rows.start, self.centre_px[1] - columns.start))

    def with_overscan(self, overscan_px: Sequence[int]) -> "PixelGrid":
        """The grid of the same frame with this overscan (rows, columns) on each side."""
        return self.cropped([own - other for own, other in zip(self.overscan_px, overscan_px, strict=True)])

    def shifted(self, right_px: float, up_px: float) -> "PixelGrid":
        """The grid of a sensor that is moved in the lens's image circle, to the right and up in the upright picture."""
        row, column = self.centre_px
        return replace(self, centre_px=(row + up_px, column - right_px))

    def framed(self, rim_px: int) -> "PixelGrid":
        """The grid with `rim_px` more pixels on each side."""
        (rows, columns), (row, column) = self.shape_px, self.centre_px
        return replace(self, shape_px=(rows + 2 * rim_px, columns + 2 * rim_px),
                       centre_px=(row + rim_px, column + rim_px),
                       overscan_px=(self.overscan_px[0] + rim_px, self.overscan_px[1] + rim_px))

    def finer(self, times: int) -> "PixelGrid":
        """The same area with each pixel split into `times` x `times` pixels."""
        (rows, columns), (row, column), (above, left) = self.shape_px, self.centre_px, self.overscan_px
        before = (times - 1) / 2  # the middle of the first pixel
        return replace(self, shape_px=(times * rows, times * columns), pitch_um=self.pitch_um / times,
                       centre_px=(times * row + before, times * column + before),
                       overscan_px=(times * above, times * left))

    def coarser(self, times: int) -> "PixelGrid":
        """The same area with blocks of `times` x `times` pixels merged: the inverse of `finer`.

        Raises
        ------
        ImageError
            Frame or overscan is not a whole number of blocks.
        """
        if any(n % times for n in (*self.shape_px, *self.overscan_px)):
            raise ImageError("image", "shape_px", self.shape_px,
                             f"expected a frame and an overscan of multiples of {times} px, to merge {times} x {times}")
        (rows, columns), (row, column), (above, left) = self.shape_px, self.centre_px, self.overscan_px
        before = (times - 1) / 2  # the middle of the first block
        return replace(self, shape_px=(rows // times, columns // times), pitch_um=self.pitch_um * times,
                       centre_px=((row - before) / times, (column - before) / times),
                       overscan_px=(above // times, left // times))

    def finer_across(self, times: int) -> "PixelGrid":
        """A capture of the same area with each pixel split into `times` columns."""
        return self._in_columns(times, 1)

    def on_sensor(self) -> "PixelGrid":
        """The capture in columns of the sensor: the inverse of `finer_across`.

        Raises
        ------
        ImageError
            Frame or overscan is not a whole number of these.
        """
        if self.shape_px[1] % self.across or self.overscan_px[1] % self.across:
            raise ImageError("image", "shape_px", self.shape_px,
                             f"expected a frame and an overscan of multiples of {self.across} columns")
        return self._in_columns(1, self.across)

    def _in_columns(self, times, of):
        """The same area with `times` columns in place of `of`."""
        (rows, columns), (row, column), (above, left) = self.shape_px, self.centre_px, self.overscan_px
        return replace(self, shape_px=(rows, columns * times // of), overscan_px=(above, left * times // of),
                       centre_px=(row, (column + 0.5) * times / of - 0.5), squeeze=self.squeeze * of / times,
                       across=self.across * times // of)

    def within_reach(self, reach_px: int) -> "PixelGrid":
        """The frame with at most `reach_px` pixels of the overscan on each side."""
        return self.cropped([max(0, overscan - reach_px) for overscan in self.overscan_px])

    def position_mm(self, rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Image-plane coordinates (x to the right, y upwards) of positions given as indices."""
        pitch_mm = self.pitch_um * 1e-3
        return (columns - self.centre_px[1]) * pitch_mm, (self.centre_px[0] - rows) * pitch_mm

    def index_of(self, x_mm: np.ndarray, y_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns, as indices, of positions in the image plane: the inverse of `position_mm`."""
        pitch_mm = self.pitch_um * 1e-3
        return self.centre_px[0] - y_mm / pitch_mm, self.centre_px[1] + x_mm / pitch_mm

    def axes_mm(self) -> tuple[np.ndarray, np.ndarray]:
        """x_mm (column,) and y_mm (row,) of the pixel centres."""
        return self.position_mm(np.arange(self.shape_px[0]), np.arange(self.shape_px[1]))


def check_focal_length(where: str, focal_mm: object) -> None:
    """Raise an ImageError unless the focal length of a capture is plausible."""
    least_mm, most_mm = FOCAL_LIMITS_MM
    if not (is_positive(focal_mm) and least_mm <= focal_mm <= most_mm):  # type: ignore[operator]
        raise ImageError(where, "focal_mm", focal_mm, f"expected a positive number, from {least_mm:g} to {most_mm:g}")
