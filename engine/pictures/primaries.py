"""Colour spaces of linear RGB pictures, as their files state them, and the conversion to linear Rec. 709."""

from collections.abc import Sequence

import numpy as np

from ..runtime.errors import ImageError

REC709 = (0.640, 0.330, 0.300, 0.600, 0.150, 0.060, 0.3127, 0.3290)
# By the IDs of the ASWF Color Interop Forum (2024): CIE xy of red, green, blue and white, in OpenEXR's order
SCENE_SPACES = {
    "lin_rec709_scene": REC709,
    "lin_ap1_scene": (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767),
    "lin_ap0_scene": (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.0770, 0.32168, 0.33767),
    "lin_rec2020_scene": (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290),
    "lin_p3d65_scene": (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290),
    "lin_adobergb_scene": (0.640, 0.330, 0.210, 0.710, 0.150, 0.060, 0.3127, 0.3290),
}
BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
SAME = 1e-4  # of a chromaticity, the rounding in files


def chromaticities(header: dict) -> Sequence[float]:
    """CIE xy of red, green, blue and white of a file's pixels: eight numbers.

    They come from the attribute `chromaticities`; without it from `colorInteropID`, the only one that Blender writes;
    without both they are Rec. 709, OpenEXR's default.

    Raises
    ------
    ImageError
        The colour space is not linear, or unknown.
    """
    if "chromaticities" in header:
        return header["chromaticities"]
    space = header.get("colorInteropID", "unknown")
    if space == "unknown":
        return REC709
    if space not in SCENE_SPACES:
        raise ImageError("image", "colorInteropID", space, f"expected one of {', '.join(SCENE_SPACES)}")
    return SCENE_SPACES[space]


def to_rec709_matrix(xy: Sequence[float]) -> np.ndarray | None:
    """Matrix that converts linear RGB with these primaries and white to linear Rec. 709.

    The white is adapted by Bradford's transform, so (1, 1, 1) stays white.

    Parameters
    ----------
    xy : eight floats
        CIE xy of red, green, blue and white.

    Returns
    -------
    array (3, 3), or None for Rec. 709 itself

    Raises
    ------
    ImageError
        The primaries do not span a triangle.
    """
    if np.abs(np.subtract(xy, REC709)).max() < SAME:
        return None
    try:
        cone_gain = (BRADFORD @ _white_xyz(REC709)) / (BRADFORD @ _white_xyz(xy))
        adaptation = np.linalg.solve(BRADFORD, cone_gain[:, None] * BRADFORD)
        matrix = np.linalg.solve(_to_xyz(REC709), adaptation @ _to_xyz(xy))
    except np.linalg.LinAlgError:
        matrix = np.full((3, 3), np.nan)
    if not np.all(np.isfinite(matrix)):
        raise ImageError("image", "chromaticities", tuple(round(float(value), 5) for value in xy),
                         "expected three primaries that span a triangle, and a white")
    return matrix


def _to_xyz(xy):
    """Matrix from linear RGB to XYZ, with Y = 1 for white."""
    primaries = np.array([(x, y, 1 - x - y) for x, y in np.reshape(xy, (4, 2))[:3]]).T
    return primaries * np.linalg.solve(primaries, _white_xyz(xy))


def _white_xyz(xy):
    x, y = xy[6:]
    if not y > 0:
        raise np.linalg.LinAlgError
    return np.array([x / y, 1.0, (1 - x - y) / y])
