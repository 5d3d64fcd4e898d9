"""Ground truth of a capture: what the rays through the middles of its pixels meet."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..image.pixel_grid import PixelGrid
from .mattes import Mattes

DEPTH, NORMAL, UV, VECTOR, CRYPTOMATTE = "Depth", "Normal", "UV", "Vector", "Crypto"
"""Blender's names of passes, and the start of its names of Cryptomatte layers."""
OBJECT = "Object.X"
"""The channel of objects: the Cryptomatte id of each object's name, 0 for the background."""
BACKGROUND_M = 1e10


@dataclass(frozen=True)
class ShownObject:
    """What annotations state of an object.

    Attributes
    ----------
    category_id : int
        0 for an object that is not annotated.
    instances : int
        How often the scene shows objects of this name.
    """

    category_id: int
    instances: int


@dataclass(frozen=True, eq=False)
class CapturedTruth:
    """Blender's passes of a capture, by the first sample of each pixel, which is in its middle.

    Attributes
    ----------
    grid : PixelGrid
        With the focal length of the capture's pinhole.
    planes : mapping of str to float32 array (row, column)
        By Blender's names of their channels, such as Normal.X. Depth.Z is in metres along the optical axis, inf for the
        background.
    layer : str
        Of Blender's view layer: the start of the channels' names in files.
    products : tuple of str
        The requested kinds of truth.
    to_world : float64 array (3, 4)
        From the camera, with x to the right, y up and z backwards, to the world, in metres.
    neighbours : float64 array (2, 3, 3)
        The axes of the camera in the world, as in `to_world`, at the frame before and at the next one. None without
        motion.
    names : mapping of str to collection of str
        Names in each Cryptomatte layer, such as CryptoObject.
    objects : mapping of str to ShownObject
        By name, if the objects are requested.
    mattes : mapping of str to Mattes
        For each requested kind of coverage what the surfaces belong to, in the layers of the capture's light.
    """

    grid: PixelGrid
    planes: Mapping[str, np.ndarray]
    layer: str
    products: tuple[str, ...]
    to_world: np.ndarray
    neighbours: np.ndarray | None = None
    names: Mapping[str, frozenset[str]] = field(default_factory=dict)
    objects: Mapping[str, ShownObject] = field(default_factory=dict)
    mattes: Mapping[str, Mattes] = field(default_factory=dict)
