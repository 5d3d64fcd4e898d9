"""Mirror symmetry of a lens about the planes of its axis."""

import numpy as np

from .prescription import Pose, Prescription, Surface

SLACK = 1e-12  # of a direction cosine, for rounding


def mirrored(prescription: Prescription) -> tuple[bool, bool]:
    """Whether the upper and lower halves of a lens are mirror images, and the right and left ones."""
    up, across = (all(_is_mirrored(surface, axis) for surface in prescription.surfaces)
                  and _is_sensor_mirrored(prescription.image_pose or Pose(), axis) for axis in (1, 0))
    return up, across


def _is_mirrored(surface: Surface, axis: int) -> bool:
    """Whether a surface is its own mirror image if x (axis 0) or y (axis 1) changes its sign."""
    pose = surface.pose or Pose()
    own = np.abs(pose.rotation[axis])  # the mirrored axis, in the surface's own frame
    if pose.offset_mm[axis] or own[2] > SLACK:
        return False
    return surface.rolls or bool(own.min(initial=1, where=own > SLACK) > 1 - SLACK)


def _is_sensor_mirrored(pose: Pose, axis: int) -> bool:
    """Whether a sensor is its own mirror image; its offset counts from the axis of the picture."""
    return bool(np.abs(pose.rotation[axis, axis]) > 1 - SLACK)
