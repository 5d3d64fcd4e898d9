"""The depth that the layers of a picture show."""

import numpy as np


def flat_depth_mm(layered):
    """The nearest depth in each pixel of a LayeredRadiance: float32 array (row, column), inf for empty pixels."""
    depth_mm = np.full(layered.grid.shape_px, np.inf, np.float32)
    for layer in reversed(layered.layers):
        np.copyto(depth_mm[layer.place], layer.depth_mm, where=layer.alpha > 0)
    return depth_mm
