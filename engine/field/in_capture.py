"""Where a capture shows light, given the light's position in the ideal image of a lens, and the reverse."""

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


def from_capture(x_mm: np.ndarray, y_mm: np.ndarray, lens: Lens, capture: PixelGrid) -> tuple[np.ndarray, np.ndarray]:
    """Positions in a lens's ideal image of light at positions in a capture: NaN beyond 90 degrees from the axis.

    Parameters
    ----------
    x_mm, y_mm : arrays (...), which broadcast
    lens : Lens
    capture : PixelGrid
    """
    focal_mm = capture.focal_mm or lens.capture_focal_length_mm
    across, upwards = x_mm * (capture.squeeze / focal_mm), y_mm / focal_mm
    if not capture.projection.is_plane:
        radius = np.hypot(across, upwards)
        angle_rad = capture.projection.angle_rad(radius)
        stretch = np.divide(np.tan(np.where(angle_rad < np.pi / 2, angle_rad, np.nan)), radius,
                            out=np.ones_like(radius), where=radius > 0)
        across, upwards = stretch * across, stretch * upwards
    return across * (lens.capture_focal_length_mm / lens.squeeze), upwards * lens.capture_focal_length_mm
