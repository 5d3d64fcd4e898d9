"""The chief rays of the pixels of a frame: their places in a capture, and values of its planes there."""

import numpy as np

from ..image.directions import directions
from ..image.pixel_grid import PixelGrid
from ..lens.lens import Lens
from .field_map import field_map
from .in_capture import from_capture


class ChiefRays:
    """The chief rays of all pixels of a frame, through their middles, in a capture.

    A capture knows the scene in the middles of its own pixels. Of these, the nearest answers for a chief ray.

    Parameters
    ----------
    lens : Lens
    frame : PixelGrid
        Of the sensor.
    capture : PixelGrid
        With the focal length of its pinhole. It may be a part of a larger capture.
    wavelength_nm : float
    """

    def __init__(self, lens: Lens, frame: PixelGrid, capture: PixelGrid, wavelength_nm: float) -> None:
        self._lens, self._frame, self._capture = lens, frame, capture
        self._field = field_map(lens).at_wavelength(wavelength_nm)
        x_mm, y_mm = frame.axes_mm()
        self._place_px = np.broadcast_arrays(
            *capture.index_of(*self._field.source_mm(x_mm[None, :], y_mm[:, None], capture)))
        row, column = (np.clip(np.rint(at), 0, n - 1).astype(np.intp)
                       for at, n in zip(self._place_px, capture.shape_px, strict=True))
        (rows, columns), (down, right) = capture.shape_px, self._place_px
        self._nearest = row * columns + column  # in the flattened capture
        self._neighbours = [(self._nearest - step * (at > 0), self._nearest + step * (at < last),
                             np.clip(away, -0.5, 0.5)) for step, at, last, away in (
                                 (columns, row, rows - 1, down - row), (1, column, columns - 1, right - column))]

    def directions(self) -> np.ndarray:
        """Unit vectors to the right, up and along the axis, towards the scene: array (row, column, 3)."""
        return directions(self._capture, *self._place_px)

    def nearest(self, plane: np.ndarray) -> np.ndarray:
        """The nearest values of a plane (row, column) of the capture, in the plane's type. Beyond it, its edge
        continues."""
        return plane.ravel().take(self._nearest)

    def continued(self, plane: np.ndarray) -> np.ndarray:
        """Values of a plane (row, column) of the capture at the chief rays: the nearest ones, continued by the slope of
        the surface that they belong to.

        The slope along rows and along columns is the smaller of the differences from both neighbours, and 0 if their
        signs differ: the exact slope on a plane, and next to another surface, too. NaN marks pixels without a surface;
        next to them, the other neighbour decides.

        Returns
        -------
        array (row, column) of the frame, in the precision of the plane
        """
        values, here = plane.ravel(), self.nearest(plane)
        result = here.copy()
        for before, after, away_px in self._neighbours:
            before, after = here - values.take(before), values.take(after) - here
            before, after = np.where(np.isnan(before), after, before), np.where(np.isnan(after), before, after)
            smaller = np.where(np.abs(before) < np.abs(after), before, after)
            result += np.where(before * after > 0, smaller * away_px, 0)
        return result

    def moved(self, right_px: np.ndarray, up_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Displacements in the frame of what moves in the capture, in pixels to the right and up.

        Parameters
        ----------
        right_px, up_px : arrays (row, column) of the frame
            Displacements in the capture, in its pixels.

        Returns
        -------
        right_px, up_px : float64 arrays (row, column)
            Exactly 0 where nothing moves; NaN for ends at more than 90 degrees from the axis.
        """
        moves = (right_px != 0) | (up_px != 0)
        row, column = (at[moves] for at in self._place_px)
        begin, end = (self._landing_px(*place) for place in ((row, column),
                                                             (row - up_px[moves], column + right_px[moves])))
        results = np.zeros((2, *moves.shape))
        results[0][moves], results[1][moves] = end[1] - begin[1], begin[0] - end[0]
        return results[0], results[1]

    def turned(self, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Displacements in the frame of light from infinity by a turn of the camera, in pixels to the right and up.

        Parameters
        ----------
        turn : array (3, 3)
            From the axes of `directions` to the axes of the turned camera.

        Returns
        -------
        right_px, up_px : float64 arrays (row, column)
            NaN for ends at more than 90 degrees from the axis.
        """
        towards = self.directions()
        begin, end = self._shown_px(towards), self._shown_px(towards @ turn.T)
        return end[1] - begin[1], begin[0] - end[0]

    def _landing_px(self, row, column):
        """Rows and columns in the frame, as indices, of light at these indices in the capture."""
        return self._of_ideal_px(from_capture(*self._capture.position_mm(row, column), self._lens, self._capture))

    def _shown_px(self, towards):
        """Rows and columns in the frame, as indices, of light from these directions."""
        x, y, along = np.moveaxis(towards, -1, 0)
        focal_mm = np.divide(self._lens.capture_focal_length_mm, along, out=np.full(along.shape, np.nan),
                             where=along > 0)
        return self._of_ideal_px((x * focal_mm / self._lens.squeeze, y * focal_mm))

    def _of_ideal_px(self, ideal_mm):
        return self._frame.index_of(*self._field.landing_mm(*ideal_mm))
