"""The loop `lf_spots` in numpy: for machines without a library, and the reference for its tests."""

import numpy as np

UNDEFLECTED, NARROW, WIDER, SMALLEST, PER_SAMPLE = 8, 0.25, 1.25, 0.01, 1.5  # as in spots.c
TOGETHER = 4096  # boxes, for the memory


def numpy_spots(corners: np.ndarray, parts: int, side: int) -> tuple[np.ndarray, float]:
    """As `spots`."""
    needed = _needed_parts(corners, parts)
    lights = [_light_of_cells(corners, number, needed == number, side) for number in np.unique(needed)]
    return sum(light for light, _ in lights), sum(total for _, total in lights)


def _needed_parts(corners, parts):
    """Parts of each cell along each side: array (radius, azimuth)."""
    _, along, around = _in_parts(corners[:2], 1)
    extent = PER_SAMPLE * np.max(np.abs(along) + np.abs(around), axis=0)
    fewer = extent < parts - 1
    return np.where(fewer, 1 + np.where(fewer, extent, 0).astype(int), parts)


def _light_of_cells(corners, parts, cells, side):
    """Light of chosen cells, and its sum."""
    (x, y, *source, cosine_x, cosine_y, limit), along, around = _in_parts(corners, parts)
    change, inside = np.abs(along[6]) + np.abs(around[6]), 1 - limit
    share = np.clip(0.5 + inside / np.maximum(change, 1e-12), 0, 1) * np.kron(cells, np.ones((parts, parts)))
    light = share * np.abs(along[2] * around[3] - around[2] * along[3])
    across, up = along[6] * around[5] - around[6] * along[5], around[6] * along[4] - along[6] * around[4]
    slope = np.maximum(np.hypot(across, up), 1e-300)
    per = np.abs(along[4] * around[5] - around[4] * along[5]) / slope
    near, far = np.maximum((inside - change / 2) * per, 0), (inside + change / 2) * per
    size = np.abs(along[:2]) + np.abs(around[:2])
    straight = (near > UNDEFLECTED) | ~(far > near)
    lit, bent = straight & (light > 0), ~straight & (light > 0)
    out = _boxes(side, np.stack([x, y])[:, lit], size[:, lit], light[lit])
    normal = np.stack([across, up])[:, bent] / slope[bent]
    return out + _deflected(side, np.stack([x, y])[:, bent], normal, size[:, bent], near[bent], far[bent],
                            light[bent]), float(light.sum())


def _in_parts(corners, parts):
    """Values in the middle of each part of the cells, and their changes along the radius and around: arrays
    (quantity, radius, azimuth)."""
    (radial, radial_step), (azimuthal, azimuthal_step) = (_weights(count, parts) for count in corners.shape[1:])
    return (radial @ corners @ azimuthal.T, radial_step @ corners @ azimuthal.T, radial @ corners @ azimuthal_step.T)


def _weights(corners, parts):
    """Weights of corners along an axis in the middles of parts, and in the changes across parts."""
    cell, place = np.repeat(np.arange(corners - 1), parts), np.tile((np.arange(parts) + 0.5) / parts, corners - 1)
    step = np.diff(np.eye(corners), axis=0)[cell]
    return np.eye(corners)[cell] + place[:, None] * step, step / parts


def _boxes(side, place, size, light):
    """Light of boxes of sizes (2, box) around places (2, box), x and y, in the samples that they cover, by area."""
    out, edges = np.zeros((side, side)), np.arange(side + 1)
    for first in range(0, light.size, TOGETHER):
        some = slice(first, first + TOGETHER)
        before = (edges - place[:, some, None]) / np.maximum(size[:, some, None], SMALLEST) + 0.5
        columns, rows = np.diff(np.clip(before, 0, 1))
        out += (rows * light[some, None]).T @ columns
    return out


def _deflected(side, place, normal, size, near, far, light):
    """Light of rays between `near` and `far` of the edge, deflected to both sides."""
    out, per_distance, inner = np.zeros((side, side)), light / (far - near) / 2, 1 / far
    while (within := inner < 2 * side).any():
        place, normal, size = place[..., within], normal[..., within], size[..., within]
        near, per_distance, inner = near[within], per_distance[within], inner[within]
        last = (WIDER * inner + NARROW) * near >= 1
        outer = np.where(last, 1 / np.maximum(near, 1e-300), WIDER * inner + NARROW)
        extent = np.maximum(size, np.abs(normal) * (outer - inner))
        share = per_distance * (1 / inner - 1 / outer)
        for sign in (1, -1):
            out += _boxes(side, place + sign * normal * (inner + outer) / 2, extent, share)
        inner = np.where(last, np.inf, outer)
    return out
