"""Directions of a capture's pixels, and the solid angles that they show, from the pinhole in the entrance pupil.

Directions are unit vectors to the right and up, as in the upright picture, and along the camera's axis towards the
scene. The grid states the pinhole's focal length: `focal_mm`.
"""

import numpy as np

from ..runtime.errors import ImageError
from .pixel_grid import PixelGrid


def directions(grid: PixelGrid, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Unit vectors (..., 3) of positions that are given as indices."""
    x, y = _tangent_plane(grid, rows, columns)
    radius = np.hypot(x, y)
    angle_rad = grid.projection.angle_rad(radius)
    sine = np.sin(angle_rad) / np.maximum(radius, np.finfo(float).tiny)
    return np.stack([sine * x, sine * y, np.cos(angle_rad)], axis=-1)


def solid_angles_sr(grid: PixelGrid, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Solid angles of the pixels with their centres at these indices."""
    area = grid.squeeze * (grid.pitch_um * 1e-3 / _focal_mm(grid))**2
    return area * grid.projection.solid_angle(np.hypot(*_tangent_plane(grid, rows, columns)))


def places_of(grid: PixelGrid, towards: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns, as indices, at which a capture shows directions (..., 3): NaN for those beyond 90 degrees."""
    x, y, along = np.moveaxis(np.asarray(towards, float), -1, 0)
    ahead = along > 0
    tangent = np.divide(np.hypot(x, y), along, out=np.full(along.shape, np.nan), where=ahead)
    scale = _focal_mm(grid) * grid.projection.shrinkage(tangent) / np.where(ahead, along, np.nan)
    return grid.index_of(scale * x / grid.squeeze, scale * y)


def holds(grid: PixelGrid, towards: np.ndarray) -> np.ndarray:
    """Whether a capture shows directions (..., 3): array of bool."""
    (rows, columns), (row, column) = grid.shape_px, places_of(grid, towards)
    return (row >= -0.5) & (row < rows - 0.5) & (column >= -0.5) & (column < columns - 0.5)


def _tangent_plane(grid, rows, columns):
    """x and y of positions in the capture, in focal lengths."""
    x_mm, y_mm = grid.position_mm(np.asarray(rows, float), np.asarray(columns, float))
    return grid.squeeze * x_mm / _focal_mm(grid), y_mm / _focal_mm(grid)


def _focal_mm(grid):
    if grid.focal_mm is None:
        raise ImageError("image", "focal_mm", "missing", "give the focal length of the capture's pinhole")
    return grid.focal_mm
