"""Coordinate systems that follow one another along a file's surfaces, and the poses of surfaces in them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...runtime.errors import LensError
from ..prescription import POSE_DIGITS, Pose, Surface

ROUNDING = 1e-10  # of distances between surfaces, as a share of the distance from the first


class Frame(NamedTuple):
    """A coordinate system: its origin, and its axes as columns; both in the coordinates of the object.

    Infinite lengths and angles lead to NaN, which prescriptions reject.
    """

    origin: np.ndarray
    axes: np.ndarray

    @np.errstate(invalid="ignore")
    def moved(self, x: float, y: float, z: float) -> "Frame":
        """The frame moved along its own axes."""
        return Frame(self.origin + self.axes @ np.array([x, y, z]), self.axes)

    @np.errstate(invalid="ignore")
    def turned(self, *turns: tuple[str, float]) -> "Frame":
        """The frame turned about its own axes, one after the other: pairs of axis and degrees, as in `Pose`."""
        axes = self.axes
        for axis, degrees in turns:
            tilts = {"x": (degrees, 0.0, 0.0), "y": (0.0, degrees, 0.0), "z": (0.0, 0.0, degrees)}
            axes = axes @ Pose(tilt_deg=tilts[axis]).rotation if degrees else axes
        return Frame(self.origin, axes)

    def centred(self) -> "Frame":
        """The frame at the same place along the axis of the object, without tilts and decentres."""
        return Frame(np.array([0.0, 0.0, self.origin[2]]), np.eye(3))


START = Frame(np.zeros(3), np.eye(3))


@np.errstate(invalid="ignore")
def posed(surfaces: Sequence[Surface], frames: Sequence[Frame]) -> tuple[list[Surface], Pose | None]:
    """Surfaces on one axis, with poses and the thicknesses between them; and the pose of the image plane.

    Parameters
    ----------
    surfaces : sequence of Surface
    frames : sequence of Frame
        Of each surface, and of the image plane; in the units of the surfaces.
    """
    *_, image = frames
    if all(surface.rolls for surface in surfaces):
        image = _unrolled(image)
    return [_in_pose(_reaching(surface, frame.origin[2], behind.origin[2]), frame)
            for surface, frame, behind in zip(surfaces, frames, frames[1:], strict=False)], _pose(image)


def check_return(path: Path, image_pose: Pose | None) -> None:
    """Raise a LensError for an image plane whose pose is not its own: the axis has not returned in front of it."""
    if image_pose:
        raise LensError(path, "image", "tilted or decentred with the surfaces in front of it",
                        "expected tilts and decentres that return, or that apply to the image plane only")


def _rounded(value):
    return round(float(value), POSE_DIGITS) + 0.0  # no negative zero


def _pose(frame):
    """Pose in a frame; None on the axis. The place along the axis does not belong to it."""
    pose = Pose.of(frame.origin * (1, 1, 0), frame.axes)
    return None if pose == Pose() else pose


def _reaching(surface, place, behind):
    """The surface with its thickness along the axis: as in the file, unless tilts and decentres change it."""
    if abs(behind - place - surface.thickness_mm) > ROUNDING * (1 + abs(place)):
        return replace(surface, thickness_mm=_rounded(behind - place))
    return surface


def _in_pose(surface, frame):
    """The surface in this frame. Where its symmetry allows, it is not turned about z."""
    if not frame.origin[:2].any() and (frame.axes == START.axes).all():
        return surface
    if surface.rolls:
        return replace(surface, pose=_pose(_unrolled(frame)))
    pose = _pose(frame)
    if not pose or any(pose.tilt_deg[:2]) or pose.tilt_deg[2] % 90:
        return replace(surface, pose=pose)
    pose = replace(pose, tilt_deg=(0.0, 0.0, 0.0)) if any(pose.offset_mm) else None
    return replace(surface, pose=pose) if frame.axes[0, 0] ** 2 > 0.5 else replace(_quarter_turn(surface), pose=pose)


def _unrolled(frame):
    """The frame with the same z axis that is turned about x and y only."""
    x, y, z = frame.axes[:, 2]
    return Frame(frame.origin, np.eye(3)).turned(("y", np.degrees(np.arctan2(x, z))),
                                                 ("x", np.degrees(-np.arcsin(np.clip(y, -1, 1)))))


def _quarter_turn(surface):
    """The surface turned by 90 degrees about z: x and y change places."""
    surface = replace(surface, half_widths_mm=surface.half_widths_mm[::-1])
    if surface.radius_x_mm is None:
        return surface
    return replace(surface, radius_mm=surface.radius_x_mm, conic=surface.conic_x, radius_x_mm=surface.radius_mm,
                   conic_x=surface.conic, profile={"x": "y", "y": "x", "": ""}[surface.profile],
                   skews=tuple(-skew for skew in surface.skews))
