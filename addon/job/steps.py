"""The kinds of steps that a job yields."""

from collections.abc import Callable
from dataclasses import dataclass

import bpy


@dataclass(frozen=True)
class RenderPass:
    """Step: render the scene as it is, to the file that its settings name.

    `fraction` is the fraction of the job before this step, and `share` the step's own.
    """

    scene: bpy.types.Scene
    label: str
    fraction: float
    share: float


@dataclass(frozen=True)
class Work:
    """Step: call `call(progress)`, which may run in another thread and must not touch Blender."""

    call: Callable
    label: str
    fraction: float
    share: float = 0.0
