"""Where a capture shows light, given the light's position in the ideal image of a lens."""

import numpy as np

from ..image.pixel_grid import PixelGrid
from ..lens.lens import Lens


def in_capture(ideal_mm: tuple[np.ndarray, np.ndarray], lens: Lens,
               capture: PixelGrid) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Positions in a capture of light at positions in a lens's ideal image.

    The ideal image and the capture differ in focal length, in squeeze, and if the capture is a panorama.

    Parameters
    ----------
    ideal_mm : (x_mm, y_mm)
        Arrays (...) of the same shape.
    lens : Lens
    capture : PixelGrid

    Returns
    -------
    (x_mm, y_mm) : arrays (...)
    slopes : array (2, 2, ...)
        Derivatives of these x and y with respect to x and y in the ideal image.
    """
    lens_focal_mm = lens.capture_focal_length_mm
    focal_mm = capture.focal_mm or lens_focal_mm
    along = np.array([lens.squeeze, 1.0]) / lens_focal_mm  # tangents per mm of the ideal image
    across = np.array([focal_mm / capture.squeeze, focal_mm])  # mm of a plane capture per tangent
    tangents = np.stack([at_mm * per_mm for at_mm, per_mm in zip(ideal_mm, along, strict=True)])
    identity = np.eye(2).reshape(2, 2, *np.ones(tangents.ndim - 1, int))
    if capture.projection.is_plane:
        shown, slopes = tangents, identity
    else:
        tangent = np.hypot(*tangents)
        shrinkage, slope = capture.projection.shrinkage(tangent), capture.projection.radius(tangent)[1]
        outwards = tangents / np.maximum(tangent, np.finfo(float).tiny)
        shown = shrinkage * tangents
        slopes = shrinkage * identity + (slope - shrinkage) * outwards[:, None] * outwards
    scale = np.outer(across, along).reshape(identity.shape)
    return (across[0] * shown[0], across[1] * shown[1]), scale * slopes
