"""Cubic B-splines at equal distances, for tables of rays."""

import numpy as np

EVEN, ODD, FREE = (1, 0, -1), (1, 0, 1), (1, -4, 6, -4, 1)  # sums of coefficients that vanish at an end of splines


def spline_matrix(count: int, start: tuple[int, ...], end: tuple[int, ...]) -> np.ndarray:
    """Matrix from values at equal distances to coefficients (count + 2), with vanishing sums at both ends."""
    rows = np.zeros((count + 2, count + 2))
    for node in range(count):
        rows[node, node:node + 3] = 1 / 6, 4 / 6, 1 / 6
    rows[-2, :len(start)], rows[-1, -len(end):] = start, end
    return np.linalg.inv(rows)[:, :count]


def periodic_spline_matrix(count: int) -> np.ndarray:
    """Matrix from values at equal distances around a circle to coefficients (count + 3): the first three repeat at the
    end."""
    unit = np.eye(count)
    rows = (np.roll(unit, -1, axis=1) + 4 * unit + np.roll(unit, 1, axis=1)) / 6
    return np.pad(np.linalg.inv(rows), ((1, 2), (0, 0)), mode="wrap")


def even_place(share: np.ndarray) -> np.ndarray:
    """Position from -1 to 1, linear in the table's index, of a share of the last height or radius."""
    return 2 / np.pi * np.arcsin(np.clip(share, -1, 1))


def cubic(place: np.ndarray, count: int) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Index of the first of the four coefficients that contribute at a place, and their weights.

    Places are in units of the coefficients' distance, from the second coefficient.
    """
    first = np.clip(np.floor(place).astype(int), 0, count - 4)
    t = place - first
    return first, ((1 - t)**3 / 6, 2 / 3 - t**2 + t**3 / 2, 2 / 3 - (1 - t)**2 + (1 - t)**3 / 2, t**3 / 6)


def splines(share: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Indices and weights of the four coefficients that contribute at positions from 0 to 1: arrays (place, 4)."""
    first, weights = cubic(share * (count - 3), count)
    return first[:, None] + np.arange(4), np.stack(weights, axis=-1)
