"""A task of any farm: `lensfield render` on a few frames. It succeeds when all of them are finished."""

import os
import sys
from pathlib import Path

from lensfield.engine import InputError
from lensfield.engine.runtime.inputs import check_input

from ..request import argument
from .arguments import check_limits
from .render_options import OWN_FRAMES, requested_frames
from .sequence import MOST_FRAMES

TASK_SPECIFIC = {"scene", "frames", "report", "help"}
PATHS = "lens", "output", "root"
PACKAGE = __package__.rpartition(".")[0]


def frames_by_task(options):
    """The frames of each task, in order: list of list of int."""
    if options.frames in (None, OWN_FRAMES):
        raise InputError("options", "--frames", options.frames or "not given", "give frame numbers, such as 1-250")
    frames, count = requested_frames(options.frames), options.frames_per_task
    check_limits("--frames-per-task", count, (1, MOST_FRAMES))
    return [frames[first:first + count] for first in range(0, len(frames), count)]


def scene_path(options):
    """The absolute path of the .blend, at which every machine must find it."""
    check_input(options.scene, "scene", "expected a .blend file", None)
    return os.path.abspath(options.scene)


def task_arguments(options, without=()):
    """Arguments of `lensfield render` that repeat the given options, except the scene and the frames."""
    omitted = TASK_SPECIFIC | set(without)
    return [word for name, default in options.task_defaults.items()
            if name not in omitted and (value := getattr(options, name)) != default
            for word in arguments_of(name, value)]


def arguments_of(name, value):
    """The arguments of `lensfield` that set an option, once for each value of a list: a list of str."""
    return [argument(name.replace("_", "-"), resolved_anywhere(one) if name in PATHS else one)
            for one in (value if isinstance(value, list) else [value])]


def resolved_anywhere(path):
    """A path that is the same in every folder; the name of a bundled lens stays."""
    return os.path.abspath(path) if isinstance(path, Path) or os.path.isfile(path) else path


def lensfield_in(blender):
    """The command line of `lensfield` on this machine: in Blender, if given, or in this Python."""
    if blender:
        return [blender, "--background", "--command", "lensfield"]
    return [sys.executable, "-c", f"from {PACKAGE}.cli import console; console()"]
