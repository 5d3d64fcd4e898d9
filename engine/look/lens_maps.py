"""A lens without rotational symmetry in a few maps, for a compositor; `lens_curves` is for symmetric lenses."""

from dataclasses import dataclass

import numpy as np
import scipy

from ..lens import GridLens
from ..lens.entrance_pupil import focus_nearness
from ..lens.iris import Iris, Opening, opening
from .lens_curves import BOKEH_PX, CompositorLens, common_values, farthest_corner_mm
from .lens_tables import NODES, STEEPEST_RAD, colour_directions

PARTS = 5  # of the sides of the bokeh's pixels, whose means they are


@dataclass(frozen=True, eq=False, kw_only=True)
class LensMaps(CompositorLens):
    """A lens over its sensor, from edge to edge: NODES x NODES places, the first at the lower left.

    Attributes
    ----------
    places : float32 array (row, column, 2)
        x and y of the places, from the axis.
    sources : float32 array (row, column, colour, 2)
        x and y in a pinhole's picture from which red, green and blue light comes.
    illumination : float32 array (row, column)
        Light, relative to the axis.
    lean : float32 array (row, column)
        The inverse depth in focus, relative to the axis, per mm.
    """

    places: np.ndarray
    sources: np.ndarray
    illumination: np.ndarray
    lean: np.ndarray

    def green_sources(self, place: np.ndarray) -> np.ndarray:
        """See `CompositorLens`."""
        node = (np.moveaxis(place - self.shift, -1, 0) / np.reshape(self.sensor, (2, 1, 1)) + 0.5) * (NODES - 1)
        return np.stack([scipy.ndimage.map_coordinates(each, node[::-1], order=1, mode="nearest")
                         for each in np.moveaxis(self.sources[:, :, 1], -1, 0)], axis=-1)


def lens_maps(lens: GridLens, f_number: float, iris: Iris | None = None, vignette: bool = False,
              shift_mm: tuple[float, float] = (0.0, 0.0), *, pixel_aspect: float) -> LensMaps:
    """The maps of a lens.

    Parameters
    ----------
    lens : GridLens
        Its data cover `COLOURS_NM`.
    f_number, iris, vignette, shift_mm
        As of `lens_curves`.
    pixel_aspect : float
        Width over height of the pixels of the pinhole's picture: the squeeze of the lens, if it is squeezed as much.
    """
    focal_mm, farthest_mm, squeeze = lens.capture_focal_length_mm, farthest_corner_mm(lens, shift_mm), lens.squeeze
    x_mm, y_mm = (middle_mm + side_mm * np.linspace(-0.5, 0.5, NODES)
                  for side_mm, middle_mm in zip(lens.sensor_mm, shift_mm, strict=True))
    angle_rad, illumination = colour_directions(lens, x_mm[None, :], y_mm[:, None], vignette)
    size_rad = np.maximum(np.linalg.norm(angle_rad, axis=-1, keepdims=True), np.finfo(float).tiny)
    tangents = angle_rad / size_rad * np.tan(np.minimum(size_rad, STEEPEST_RAD))
    in_focus = focus_nearness(lens, *np.moveaxis(tangents[:, :, 1] * focal_mm / (squeeze, 1.0), -1, 0))
    maps = {"places": np.stack(np.meshgrid(x_mm, y_mm), axis=-1) / farthest_mm,
            "sources": tangents * focal_mm / farthest_mm / (pixel_aspect, 1.0),
            "illumination": illumination,
            "lean": np.broadcast_to(in_focus - focus_nearness(lens), illumination.shape)}
    common = common_values(lens, f_number, iris, shift_mm)
    common["bokeh_mm"] *= max(1.0, squeeze**-2)
    return LensMaps(bokeh=_bokeh(opening(iris, lens), squeeze, lens.central_obstruction), **common,
                    **{name: values.astype(np.float32) for name, values in maps.items()})


def _bokeh(stop: Opening, squeeze, obstruction):
    """The stop's image in a squeezed picture, in a square around it, with its central obstruction."""
    middles = (np.arange(BOKEH_PX * PARTS) + 0.5) / (BOKEH_PX * PARTS) * 2 - 1
    wider = np.array([squeeze**2, 1.0]) / min(1.0, squeeze**2)
    place = np.stack(np.meshgrid(*(middles * times for times in wider))) * stop.reach
    radius = np.linalg.norm(place, axis=0)
    open_share = stop.open_share(place, 2 * stop.reach / BOKEH_PX) * (radius <= stop.reach) * (radius >= obstruction)
    return open_share.reshape(BOKEH_PX, PARTS, BOKEH_PX, PARTS).mean(axis=(1, 3)).astype(np.float32)
