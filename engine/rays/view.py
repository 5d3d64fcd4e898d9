"""The camera that a lens's pictures belong to: its viewpoint, its axes, and its plane of focus.

The camera is in the entrance pupil, and its axis is the normal of the sensor. Depths are along this axis, and are given
as inverse depths, which are 0 at infinity and negative beyond. An object point is where light comes from that passes
the viewpoint with the tangents (x, y) of its angle to the axis. In coordinates of the lens and along the light, this
light has a direction d that is 1 along the camera's axis; the light of the point with the inverse depth q has the
direction d + q (p - E) at the place p, where E is the viewpoint.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..prescription.prescription import Pose, Prescription
from ..prescription.system import System


@dataclass(frozen=True, eq=False)
class View:
    """The camera of a lens.

    Attributes
    ----------
    axes : array (3, 3)
        x, y and normal of the sensor, in coordinates of the lens: one in each row.
    viewpoint_mm : array (3,)
        From the first vertex.
    origin_mm : array (2,)
        Where places on the sensor count from: x and y in the frame of the image plane.
    vertex_mm : array (2,)
        Where the axis of the lens meets the sensor, in the same frame.
    nearness : float
        The inverse depth in focus on the camera's axis, in 1/mm.
    lean : array (2,)
        Its rise with the tangents, in 1/mm.
    """

    axes: np.ndarray
    viewpoint_mm: np.ndarray
    origin_mm: np.ndarray
    vertex_mm: np.ndarray
    nearness: float
    lean: np.ndarray

    @property
    def axis_mm(self) -> np.ndarray:
        """Where the axis of the lens meets the sensor: array (2,)."""
        return self.vertex_mm - self.origin_mm

    def places_mm(self, position: np.ndarray) -> np.ndarray:
        """Places on the sensor of positions (3, ...) in the frame of the image plane: array (2, ...)."""
        return position[:2] - self.origin_mm.reshape(2, *(1,) * (position.ndim - 1))

    def turned(self, direction: np.ndarray) -> np.ndarray:
        """Directions (3, ...) in coordinates of the sensor."""
        return np.tensordot(self.axes, direction, 1)

    def directions(self, tangent: np.ndarray) -> np.ndarray:
        """Directions at the viewpoint, in coordinates of the lens, of tangents (2, ...): array (3, ...)."""
        return np.tensordot(self.axes.T, np.stack([*tangent, np.ones_like(tangent[0])]), 1)

    def in_focus(self, entry: np.ndarray, before: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where rays through points (3, ...), with directions (3, ...), cross the plane of focus.

        Returns
        -------
        tangent : array (2, ...)
        nearness : array (...)
        """
        across = (1,) * (entry.ndim - 1)
        along = self.turned(before)
        from_eye = self.turned(entry - self.viewpoint_mm.reshape(3, *across))
        plane = -np.array([*self.lean, self.nearness])
        per_mm = np.tensordot(plane, along, 1) / (np.tensordot(plane, from_eye, 1) - 1)  # over the distance to it
        scale = along[2] - per_mm * from_eye[2]
        return (along[:2] - per_mm * from_eye[:2]) / scale, per_mm / scale

    def object_space(self, direction: np.ndarray, nearness: np.ndarray, entry: np.ndarray
                     ) -> tuple[np.ndarray, np.ndarray]:
        """Optical paths from object points to points (3, ...) on their rays, relative to the viewpoint; and coordinates
        (2, ...) in their light, over whose area it is evenly distributed.

        The light of an element of the field is the element's area in tangents times this area, in mm^2: the element
        faces the camera, and is Lambertian.
        """
        from_eye = entry - self.viewpoint_mm.reshape(3, *(1,) * (entry.ndim - 1))
        length, away = (np.sqrt(np.sum(each**2, axis=0)) for each in (direction, direction + nearness * from_eye))
        path_mm = (2 * np.sum(direction * from_eye, axis=0)
                   + nearness * np.sum(from_eye**2, axis=0)) / (away + length)
        source = (from_eye - direction * (path_mm / length)) / away
        return path_mm, self.turned(source)[:2]


def sensor_axes(prescription: Prescription) -> np.ndarray:
    """x, y and normal of the sensor, in coordinates of the lens: one in each row."""
    return (prescription.image_pose or Pose()).rotation.T


def sensor_vertex_mm(prescription: Prescription) -> np.ndarray:
    """Where the axis of the lens meets the sensor, x and y in the sensor's frame."""
    pose, axes = prescription.image_pose or Pose(), sensor_axes(prescription)
    along_mm = axes[2] @ pose.offset_mm / axes[2, 2]
    return axes[:2] @ ([0.0, 0.0, along_mm] - np.array(pose.offset_mm))


def focus_lean(system: System, axes: np.ndarray) -> np.ndarray:
    """Rise of the inverse depth in focus with the tangents x and y, in 1/mm, to first order: array (2,).

    An image at the inverse distance q' from the exit pupil has the inverse depth M / f - M^2 q', where M is the
    magnification of the pupils. Along a tilted sensor, q' is linear in the tangents.
    """
    prescription, normal = system.prescription, axes[2]
    offset_mm = (prescription.image_pose or Pose()).offset_mm
    vertex_mm = prescription.surfaces[-1].thickness_mm + normal @ offset_mm / normal[2]
    nearness = 1 / (prescription.object_distance_mm + system.entrance_pupil_mm)
    rise = np.zeros(3)
    for number, section in enumerate((system.across, system)):
        image_mm = vertex_mm - section.exit_pupil_mm
        rise[number] = -_pupil_magnification(section) * normal[number] / normal[2] / image_mm
    rise[2] = (nearness - normal[:2] @ rise[:2]) / normal[2]
    return axes[:2] @ rise


def _pupil_magnification(section):
    """Diameter of the exit pupil divided by the diameter of the entrance pupil."""
    return section.efl_mm / (section.front_focus_mm + section.entrance_pupil_mm)


def tilted(system: System, tilt_deg: tuple[float, float]) -> Prescription:
    """The prescription with its sensor tilted about x and y, so that the picture stays in focus in its middle.

    Raises
    ------
    LensError
        The light along the sensor's normal has no image.
    """
    prescription = replace(system.prescription, image_pose=Pose(tilt_deg=(*tilt_deg, 0.0)))
    normal = sensor_axes(prescription)[2]
    nearness = 1 / (prescription.object_distance_mm + system.entrance_pupil_mm)
    squares = normal[:2]**2 / normal[2]
    powers, per_magnification = np.array([(1 / section.efl_mm, 1 / _pupil_magnification(section))
                                          for section in (system.across, system)]).T
    on_axis = (nearness + squares @ powers) / (normal[2] + squares @ per_magnification)
    magnification = _pupil_magnification(system)
    image_mm = magnification**2 / (magnification / system.efl_mm - on_axis)
    shift_mm = system.exit_pupil_mm + image_mm - system.image_distance_mm
    pose = Pose((0.0, 0.0, shift_mm), (*tilt_deg, 0.0))
    return replace(prescription, image_pose=pose)
