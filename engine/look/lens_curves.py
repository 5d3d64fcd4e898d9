"""A lens in a few curves, for a compositor: where the light of a picture comes from, how bright it is, and its blur."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..lens import Lens, RadialLens
from ..lens.entrance_pupil import entrance_pupil_diameter_mm
from ..lens.iris import Iris, opening
from .lens_tables import STEEPEST_RAD, colour_directions

POINTS = 512  # linear interpolation is accurate to 0.02 px of 1080 rows
BOKEH_PX = 33


@dataclass(frozen=True, eq=False, kw_only=True)
class CompositorLens:
    """What curves and maps of lenses have in common. Lengths are in distances of the sensor's farthest corner from the
    axis.

    Attributes
    ----------
    sensor : (float, float)
        Width and height.
    shift : (float, float)
        From the axis to the middle of the sensor, to the right and up.
    bokeh : float32 array (BOKEH_PX, BOKEH_PX)
        The opening of the stop, with the hole of a mirror lens, which a distant point shows turned by 180 degrees,
        from the lower left.
    bokeh_mm : float
        The side of `bokeh` in the blur of infinitely distant points, times the focus distance in mm and the f-number.
    f_number : float
    """

    sensor: tuple[float, float]
    shift: tuple[float, float]
    bokeh: np.ndarray
    bokeh_mm: float
    f_number: float

    def green_sources(self, place: np.ndarray) -> np.ndarray:
        """Where the green light of places (..., 2) from the axis comes from in a pinhole's picture."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False, kw_only=True)
class LensCurves(CompositorLens):
    """A rotationally symmetric lens from its axis outwards.

    Attributes
    ----------
    sources : float32 array (POINTS, colour)
        Distances in a pinhole's picture from which red, green and blue light comes, relative to the distances at which
        it arrives: these are evenly spaced from 0 to 1.
    illumination : float32 array (POINTS,)
        Light, relative to the axis, at the same distances.
    """

    sources: np.ndarray
    illumination: np.ndarray

    def green_sources(self, place: np.ndarray) -> np.ndarray:
        """See `CompositorLens`."""
        radius = np.linalg.norm(place, axis=-1, keepdims=True)
        return place * np.interp(radius, np.linspace(0, 1, POINTS), self.sources[:, 1])


def lens_curves(lens: RadialLens, f_number: float, iris: Iris | None = None, vignette: bool = False,
                shift_mm: tuple[float, float] = (0.0, 0.0)) -> LensCurves:
    """The curves of a lens.

    Parameters
    ----------
    lens : RadialLens
        Its data cover `COLOURS_NM`.
    f_number : float
        As on its ring.
    iris : Iris, optional
        The blades that stop the lens down; by default the stop is round.
    vignette : bool
        Whether the area beyond the lens data is black.
    shift_mm : (float, float)
        From the axis to the middle of the sensor, to the right and up.
    """
    focal_mm, farthest_mm = lens.capture_focal_length_mm, farthest_corner_mm(lens, shift_mm)
    distance = np.linspace(0, 1, POINTS)
    distance[0] = distance[1] * 1e-3  # the limit on the axis
    x_mm, y_mm = distance * farthest_mm, np.zeros(POINTS)
    angle_rad, illumination = colour_directions(lens, x_mm, y_mm, vignette)
    sources = np.tan(np.minimum(angle_rad[..., 0], STEEPEST_RAD)) * focal_mm / x_mm[:, None]
    return LensCurves(sources=sources.astype(np.float32), illumination=illumination.astype(np.float32),
                      bokeh=_bokeh(opening(iris, lens), lens.central_obstruction),
                      **common_values(lens, f_number, iris, shift_mm))


def farthest_corner_mm(lens: Lens, shift_mm: tuple[float, float]) -> float:
    """Distance of a shifted sensor's farthest corner from the axis."""
    return float(np.linalg.norm(np.divide(lens.sensor_mm, 2) + np.abs(shift_mm)))


def common_values(lens: Lens, f_number: float, iris: Iris | None, shift_mm: tuple[float, float]) -> dict[str, Any]:
    """The fields of CompositorLens except the bokeh; `bokeh_mm` is for the picture's height."""
    focal_mm, farthest_mm = lens.capture_focal_length_mm, farthest_corner_mm(lens, shift_mm)
    bokeh_mm = entrance_pupil_diameter_mm(lens) * opening(iris, lens).reach * focal_mm * f_number / farthest_mm
    sensor, shift = ((across_mm / farthest_mm, up_mm / farthest_mm) for across_mm, up_mm in (lens.sensor_mm, shift_mm))
    return {"sensor": sensor, "shift": shift, "bokeh_mm": bokeh_mm, "f_number": f_number}


def _bokeh(stop, obstruction):
    cell, middles = 2 * stop.reach / BOKEH_PX, (np.arange(BOKEH_PX) + 0.5) / BOKEH_PX * 2 - 1
    place = np.stack(np.meshgrid(middles, middles)) * stop.reach
    radius = np.linalg.norm(place, axis=0)
    rim = np.clip((stop.reach - radius) / cell + 0.5, 0, 1)
    if obstruction:
        rim = rim * np.clip((radius - obstruction) / cell + 0.5, 0, 1)
    return (rim * stop.open_share(place, cell)).astype(np.float32)
