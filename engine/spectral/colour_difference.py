"""Perceived colour difference: CIE 1976 L*a*b* and CIEDE2000."""

import numpy as np
from numpy.typing import ArrayLike


def lab_from_xyz(xyz: ArrayLike, white: ArrayLike) -> np.ndarray:
    """L*, a*, b* of tristimulus values (..., 3) relative to a white (3,) (CIE 015:2018, 8.2.1)."""
    ratio = np.asarray(xyz) / white
    cube_root = np.where(ratio > (6 / 29)**3, np.cbrt(ratio), ratio * (29 / 6)**2 / 3 + 4 / 29)
    x, y, z = np.moveaxis(cube_root, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def ciede2000(first: ArrayLike, second: ArrayLike) -> np.ndarray:
    """Difference of L*a*b* colours (..., 3): about 1 is just noticeable (CIE 142-2001; Sharma et al. 2005)."""
    (l1, a1, b1), (l2, a2, b2) = (np.moveaxis(np.asarray(lab, dtype=float), -1, 0) for lab in (first, second))
    chroma_7 = ((np.hypot(a1, b1) + np.hypot(a2, b2)) / 2)**7
    stretch = 1.5 - 0.5 * np.sqrt(chroma_7 / (chroma_7 + 25.0**7))
    c1, c2 = np.hypot(stretch * a1, b1), np.hypot(stretch * a2, b2)
    h1, h2 = (np.degrees(np.arctan2(b, stretch * a)) % 360 for a, b in ((a1, b1), (a2, b2)))
    turn = np.where(c1 * c2 == 0, 0, (h2 - h1 + 180) % 360 - 180)
    hue = np.where(c1 == 0, h2, h1 + turn / 2)
    chroma, lightness = (c1 + c2) / 2, ((l1 + l2) / 2 - 50)**2
    t = (1 - 0.17 * _cos(hue - 30) + 0.24 * _cos(2 * hue) + 0.32 * _cos(3 * hue + 6) - 0.20 * _cos(4 * hue - 63))
    in_lightness = (l2 - l1) / (1 + 0.015 * lightness / np.sqrt(20 + lightness))
    in_chroma = (c2 - c1) / (1 + 0.045 * chroma)
    in_hue = 2 * np.sqrt(c1 * c2) * np.sin(np.radians(turn) / 2) / (1 + 0.015 * chroma * t)
    blue = -2 * np.sqrt(chroma**7 / (chroma**7 + 25.0**7)) * np.sin(np.radians(
        60 * np.exp(-(((hue % 360) - 275) / 25)**2)))
    return np.sqrt(np.maximum(in_lightness**2 + in_chroma**2 + in_hue**2 + blue * in_chroma * in_hue, 0))


def _cos(degrees):
    return np.cos(np.radians(degrees))
