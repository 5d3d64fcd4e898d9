"""The steps that a job is made of, for whoever runs them."""

from collections.abc import Callable
from dataclasses import dataclass

import bpy


@dataclass(frozen=True)
class RenderPass:
    """Step: render the scene as it stands, to the file that it names.

    `fraction` of the whole job is done before this step, `share` of it is this step's.
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
