"""The cameras that `lens calibration` and `lens stmap` describe: a lens on its sensor, or the cameras of a scene."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lensfield.engine import InputError
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens import Lens
from lensfield.engine.lens.pinhole import fitting_pitch_um

from .arguments import LENSES, add_lens_settings, chosen_lens, given_fields, resolution, say_clamped
from .blend import open_scene
from .prescription_file import lens_source
from .render_options import requested_frames
from .terminal import progress_bar


@dataclass(frozen=True, eq=False)
class ShownCamera:
    """A lens and the pixels of its frame; with a scene, the camera's frame, pose and picture, as in `FrameCamera`."""

    lens: Lens
    grid: PixelGrid
    frame: int | None = None
    pose: np.ndarray | None = None
    picture: str = ""


def add_cameras(command):
    """Add the lens, its settings, and the size of its picture or a scene."""
    command.add_argument("lens", metavar="NAME|FILE", nargs="?",
                         help=f"{LENSES} (default with --scene: the lens of its camera)")
    view = command.add_mutually_exclusive_group(required=True)
    view.add_argument("--resolution", metavar="WIDTHxHEIGHT", help="size in pixels of the picture on the sensor")
    view.add_argument("--scene", type=Path, metavar="SCENE.blend",
                      help="take the camera of this file's scene: its lens, focus, f-stop, resolution, Shift and place")
    command.add_argument("--frames", metavar="SPEC", help="with --scene: the frames, as for lensfield render "
                                                          "(default: the current frame)")
    add_lens_settings(command)


def check_cameras(options):
    """Raise an InputError for options that do not belong together."""
    if not options.lens and not options.scene:
        raise InputError("options", "NAME|FILE", "not given", "required without --scene")
    if options.frames is not None and not options.scene:
        raise InputError("options", "--frames", options.frames, "also give --scene")


def sources(options):
    """The files that the cameras come from, and the lens's name."""
    return [path for path in (options.lens, options.scene) if path]


def cameras(options):
    """The ShownCamera of each frame; of the lens alone without a scene. Prints settings that the lenses do not have."""
    return _of_scene(options) if options.scene else [_of_lens(options)]


def _of_lens(options):
    width, height = resolution(options.resolution)

    def frame_of(lens):
        return PixelGrid((height, width), fitting_pitch_um(lens, (height, width)))

    lens = chosen_lens(options, frame_of)
    return ShownCamera(lens, frame_of(lens))


def _of_scene(options):
    given = given_fields(options)
    if options.lens:
        given["lens"] = lens_source(options, options.lens)
    frames = None if options.frames is None else requested_frames(options.frames)
    scene = open_scene(options.scene)
    from ..addon import frame_camera, frames_of

    if options.frames is None:
        frames = [scene.frame_current]
    shown, words = [], []
    with progress_bar() as on_progress:
        for frame in frames_of(scene) if frames is None else frames:
            camera = frame_camera(scene, frame, on_progress, **given)
            shown.append(ShownCamera(camera.lens, camera.grid, frame, camera.pose, camera.picture))
            words += camera.words
    say_clamped(words)
    return shown
