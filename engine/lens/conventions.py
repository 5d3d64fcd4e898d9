"""The default sampling of lens data, by a bake or by another program's macro."""

import numpy as np

HEIGHTS = 21
WAVELENGTHS = "400:700:31"
WAVELENGTHS_NM = tuple(np.linspace(400.0, 700.0, 31).tolist())


def four_by_three(half_diagonal_mm: float) -> tuple[float, float]:
    """Width and height of the sensor with sides 4 : 3."""
    return 1.6 * half_diagonal_mm, 1.2 * half_diagonal_mm
