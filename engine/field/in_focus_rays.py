"""Rays of a lens without a prescription: straight lines through the entrance pupil to points in the plane of focus."""

import numpy as np

from ..rays.ray_table import WAVELENGTHS_NM


def in_focus_rays(pupil_mm: np.ndarray, chief: np.ndarray, nearness: float | np.ndarray, light: np.ndarray,
                  margin: np.ndarray) -> np.ndarray:
    """Quantities of rays from points in focus, for the tables of rays.

    Parameters
    ----------
    pupil_mm : array (2, radius, azimuth)
        Points of the entrance pupil, x and y.
    chief : array (2, ..., 1, 1)
        Tangents of the chief rays along the light.
    nearness : float, or array (..., 1, 1)
        Inverse depths in focus, per mm.
    light : array (..., 1, 1)
    margin : array (radius, azimuth)
        As `pupil_margin`.

    Returns
    -------
    array (7, ..., radius, azimuth)
        As `RayTable.coefficients`.
    """
    tangent_x, tangent_y = nearness * pupil_mm[0] + chief[0], nearness * pupil_mm[1] + chief[1]
    cosine = 1 / np.sqrt(1 + tangent_x**2 + tangent_y**2)
    along_mm = (pupil_mm[0] * tangent_x + pupil_mm[1] * tangent_y) * cosine  # from the foot to the plane
    foot_x, foot_y = (at - along_mm * tangent * cosine for at, tangent in
                      zip(pupil_mm, (tangent_x, tangent_y), strict=True))
    foot_square_mm2 = foot_x**2 + foot_y**2 + (along_mm * cosine)**2
    # all paths from the point in focus, through the plane of the feet, are equal
    away = np.sqrt(1 + chief[0]**2 + chief[1]**2)
    path_mm = nearness * foot_square_mm2 / (away + np.sqrt(np.maximum(away**2 - nearness**2 * foot_square_mm2, 0)))
    return np.stack([foot_x, foot_y, *(tangent * cosine / (1 + cosine) for tangent in (tangent_x, tangent_y)),
                     margin + 0 * cosine, path_mm, light + 0 * cosine])


def pupil_margin(stop: np.ndarray, obstruction: float) -> np.ndarray:
    """`SensorRays.surface_margin` of rays through the stop, (2, ...) in semi-apertures, of a lens with this central
    obstruction and no other limits."""
    return np.sum(stop**2, axis=0) - obstruction**2 if obstruction else np.ones(stop.shape[1:])


def table_wavelengths(first_nm: float, last_nm: float) -> np.ndarray:
    """Wavelengths from the first to the last, distributed like `WAVELENGTHS_NM` in reciprocal wavelength."""
    if first_nm == last_nm:
        return np.array([float(first_nm)])
    share = (1 / WAVELENGTHS_NM[0] - 1 / np.array(WAVELENGTHS_NM)) / (1 / WAVELENGTHS_NM[0] - 1 / WAVELENGTHS_NM[-1])
    return 1 / (1 / first_nm - share * (1 / first_nm - 1 / last_nm))
