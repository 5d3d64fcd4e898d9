"""The ends of a grid on the sensor: up to the frame of the pictures, in coarse steps, within the image circle."""

import numpy as np

from ..prescription.mirrors import mirrored
from ..prescription.system import System
from ..rays.field_heights import image_radius_mm
from ..rays.fields import undisturbed, view_of
from .sampling import sensor_mm

MARGIN = 1.04  # of the ends, relative to the sensor: the blur of light from beyond the frame
STEPS = 12  # in the sensor's longer side, beyond the sensor: pictures with similar shifts share a grid
ROUNDING = 1e-6  # of a step

Ends = tuple[tuple[float, float], tuple[float, float]]
"""Lower and upper end, left and right end, in mm from the axis in the upright picture."""


def grid_ends_mm(system: System, edges_mm: tuple[float, float, float, float] | None = None) -> Ends:
    """The ends of the grid for pictures on a sensor.

    The grid covers the sensor that the lens is designed for, which is turned with a portrait picture unless the lens is
    anamorphic, and more of the image circle if the picture reaches beyond this sensor.

    Parameters
    ----------
    system : System
    edges_mm : (float, float, float, float) or None
        Left, lower, right and upper edge of the picture's frame, as `PixelGrid.edges_mm`; None for the sensor.

    Returns
    -------
    Ends
        From 0 along an axis with mirrored halves.
    """
    width_mm, height_mm = sides_mm = sensor_mm(system)
    left, lower, right, upper = edges_mm or (-width_mm / 2, -height_mm / 2, width_mm / 2, height_mm / 2)
    if system.squeeze == 1 and (upper - lower > right - left) != (height_mm > width_mm):
        width_mm, height_mm = height_mm, width_mm
    needed_mm, sensor_ends_mm = np.array([[-lower, upper], [-left, right]]), np.array([[height_mm], [width_mm]]) / 2
    halves = np.array(mirrored(system.prescription))
    needed_mm[halves] = needed_mm[halves].max(axis=1, keepdims=True)
    step_mm = max(sides_mm) / STEPS
    steps = np.maximum(np.ceil((needed_mm - sensor_ends_mm) / step_mm - ROUNDING), 0)
    ends_mm = MARGIN * sensor_ends_mm + steps * step_mm
    if steps.any():
        ends_mm = np.where(steps > 0, np.clip(_circle_ends_mm(system), MARGIN * sensor_ends_mm, ends_mm), ends_mm)
    (lower, upper), (left, right) = ends_mm.tolist()
    return (0.0 if halves[0] else -lower, upper), (0.0 if halves[1] else -left, right)


def _circle_ends_mm(system):
    """Distances to the lowest, highest, leftmost and rightmost place of the image circle: array (2, 2)."""
    x_mm, y_mm = -view_of(system).axis_mm
    return image_radius_mm(undisturbed(system)) + np.array([[-y_mm, y_mm], [-x_mm, x_mm]])
