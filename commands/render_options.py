"""Options that `lensfield render` shares with other commands: the .blend, its settings, the frames, the farm."""

from pathlib import Path

from lensfield.engine.runtime.setting import settings_of
from lensfield.engine.spectral.wavelength_choice import SpectralOptions

from ..request import FOLLOWER_FIELDS, RING_FIELDS, RenderRequest
from .arguments import (
    add_engine_options,
    add_iris,
    add_lens_settings,
    add_settings,
    add_stray,
    add_untrusted,
    check_limits,
    scene_defaults,
)
from .sequence import parse_frames

FRAME_LIMITS = -1048574, 1048574  # Blender's
OWN_FRAMES = "scene"
ELSEWHERE = "lens", *RING_FIELDS, "lens_quality"
"""Fields whose options `add_engine_options` and `add_lens_settings` add, here and in other commands."""


def add_task_options(command):
    """Add the options that a task of a farm repeats, for the scene and the frames; `task_defaults` are their
    defaults."""
    add_scene_options(command)
    add_frame_options(command)
    command.set_defaults(task_defaults={action.dest: action.default for action in command._actions})


def add_frame_options(render):
    """Add options for the frames to render, and for the reuse of finished frames."""
    render.add_argument("--frames", metavar="SPEC",
                        help="frames to render: 7, 1-250, 1-250:2, 1,5,10-20, or scene for the scene's range (default: "
                             "the current frame). Complete frames with the same settings are skipped, and processes "
                             "that render into one folder share the frames; --report covers each frame")
    render.add_argument("--overwrite", action="store_true",
                        help="render all frames again, and ignore the finished passes of interrupted renders")
    render.add_argument("--any-build", action="store_true",
                        help="accept finished frames from other builds of Lensfield (default: render them again)")


def add_farm_options(group):
    """Add options for rendering frames as farm tasks."""
    group.add_argument("--frames-per-task", type=int, default=1, metavar="N",
                       help="frames in each task; they share the start of Blender and the preparation of the lens "
                            "(default: 1)")
    group.add_argument("--blender", metavar="EXE",
                       help="Blender on those machines, with the extension (default: the lensfield command installed "
                            "there)")


def add_scene_options(render, required=True):
    """Add arguments for the .blend and its render settings."""
    render.add_argument("scene", type=Path, metavar="SCENE.blend", nargs=None if required else "?",
                        help="file to render")
    add_capture_options(render)
    add_engine_options(render, of_scene=True)
    add_lens_settings(render, camera=True)
    add_iris(render, camera=True)
    add_stray(render, of_scene=True)
    add_untrusted(render)


def add_capture_options(render, left_out=(), unset=None):
    """Add options for the scene of the .blend, its spectra and its capture.

    Parameters
    ----------
    render : argparse parser or group
    left_out : collection of str
        Fields of a RenderRequest without an option.
    unset : dict of str: str, optional
        Texts of defaults that differ from the scene, by field.
    """
    of_scene = scene_defaults(SpectralOptions) | scene_defaults(RenderRequest) | {"camera": "the camera's body"}
    render.add_argument("--scene-name", metavar="NAME",
                        help="scene of the file to render (default: the one that was open when the file was saved)")
    unset = of_scene | (unset or {})
    add_settings(render, SpectralOptions, settings_of(SpectralOptions), unset)
    listed = [name for name, each in settings_of(RenderRequest).items()
              if each.option is not None and name not in (*ELSEWHERE, *FOLLOWER_FIELDS, *left_out)]
    add_settings(render, RenderRequest, listed, unset)
    render.add_argument("--samples", type=int, help="Cycles samples per pixel (default: from the scene)")
    render.add_argument("--resolution", metavar="WIDTHxHEIGHT", help="size in pixels (default: from the scene)")


def requested_frames(text):
    """The frames of --frames, ascending; None for the scene's range."""
    if text == OWN_FRAMES:
        return None
    frames = parse_frames(text)
    for frame in frames:
        check_limits("--frames", frame, FRAME_LIMITS)
    return frames
