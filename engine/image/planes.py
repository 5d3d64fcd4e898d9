"""Planes next to the light of a capture, such as depth and alpha: what a lens makes of them depends on their kind."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

COVERAGE: Literal["coverage"] = "coverage"
"""Shares from 0 to 1 of each pixel's light, which a lens blurs like light."""
NEAREST: Literal["nearest"] = "nearest"
"""Values of the surface that the middle of each pixel shows, which are never mixed."""


@dataclass(frozen=True, eq=False)
class Plane:
    """Values of pixels.

    Attributes
    ----------
    values : float32 array (row, column)
    kind : str
        COVERAGE or NEAREST.
    """

    values: np.ndarray
    kind: Literal["coverage", "nearest"]
