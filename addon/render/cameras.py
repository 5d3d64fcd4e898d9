"""The cameras of a scene's frames: their lenses, their pixels and their places."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens import Lens

from ..job.job import job_of
from ..job.result import Result
from ..scene.camera import camera_pose, frame_grid
from ..scene.lens_cache import unwatched
from ..scene.render_state import go_to_frame
from ..scene.requirements import check_scene
from ..scene.undo import Journal
from .animation import named_frame


@dataclass(frozen=True, eq=False)
class FrameCamera:
    """The camera of a frame.

    Attributes
    ----------
    lens : Lens
        As `Job.lens`.
    grid : PixelGrid
        The frame's pixels on the sensor.
    pose : array (4, 4)
        From the camera's axes, x to the right, y upwards, z backwards, to the scene, in metres. The origin is the
        lens's entrance pupil.
    picture : str
        Name of the frame's picture through the lens.
    words : tuple of str
        A line for each setting of focus and f-stop that the lens does not have.
    """

    lens: Lens
    grid: PixelGrid
    pose: np.ndarray
    picture: str
    words: tuple[str, ...] = ()


def frame_camera(scene, frame, baking=unwatched, **given):
    """The FrameCamera of a frame of a scene.

    Parameters
    ----------
    scene : bpy.types.Scene
    frame : int
    baking : callable (fraction, label)
        Progress of a bake of the lens.
    given : by name
        Fields of a RenderRequest; all others are as in the scene's Lensfield settings at that frame.

    Raises
    ------
    InputError
        As for a render; it states the frame's number.
    """
    with named_frame(frame), Journal() as journal:
        go_to_frame(scene, frame, journal)
        return camera_at(scene, frame, baking, **given)


def camera_at(scene, frame, baking=unwatched, **given):
    """As `frame_camera`, of a scene that is evaluated at the frame."""
    check_scene(scene, **given)
    job = job_of(scene, baking=baking, **given)
    return FrameCamera(job.lens, frame_grid(scene, job.lens), camera_pose(scene),
                       Result.of(scene, Path(), frame).after.name, job.ring_words)
