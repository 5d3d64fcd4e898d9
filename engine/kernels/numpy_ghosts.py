"""The loop `lf_ghost_light` in numpy: for machines without a library, and the reference for its tests."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .declarations import NUMBERS
from .ghost_meshes import LIGHT, LIMIT, STOP, Blades, Meshes

RIM = NUMBERS["GHOST_RIM"]
FARTHEST_PX, LEAST_PX2, MOST_POINTS, DIAGONAL, SHARED_FROM = 1e6, 1e-12, 2048, 1.4, 3  # as in ghosts.c


@dataclass(frozen=True, eq=False)
class _Canvas:
    blades: Blades
    picture: np.ndarray
    crossings: int
    part: float
    scale: float
    frame_px: tuple[float, float]
    per_light: np.ndarray


def numpy_draw_ghosts(meshes: Meshes, blades: Blades, centre_px: tuple[float, float], px_per_mm: float,
                      levels: Sequence[np.ndarray]) -> np.ndarray:
    """As `draw_ghosts`."""
    light = np.zeros((len(meshes.rays), meshes.rays.shape[1] - LIGHT))
    frame_px = [n - 2 * RIM for n in levels[0].shape[1:]]
    for pair in range(len(light)):
        place, values, own = _laid_out(meshes, pair, centre_px, px_per_mm)
        corners = _triangles(own)
        area, lit = _irradiated(meshes, pair, blades, place, values, own, corners, px_per_mm, frame_px)
        over, level = max(area / meshes.pixels[pair], meshes.blur[pair]), 0
        while over >= 4 and level + 1 < len(levels):
            over, level = over / 4, level + 1
        blurred = (meshes.blur[pair] / 4**level - 1) / 3
        coarser = max(blurred, over - SHARED_FROM, 0.0) if level + 1 < len(levels) else 0.0
        for number, part in ((level, 1 - coarser), (level + 1, coarser)):
            if part > 0:
                scale = 0.5**number
                canvas = _Canvas(blades, levels[number], int(meshes.crossings[pair]), part, scale,
                                 (frame_px[0] * scale, frame_px[1] * scale),
                                 meshes.cells_mm2[pair] / 2 * meshes.irradiance[pair] * (px_per_mm * scale)**2)
                drawn = sum(_drawn(canvas, place[:, *each], values[:, *each].astype(float), lit[:, *each].astype(float),
                                   own[:, *each].mean(axis=1)) for each in corners)
                light[pair] += drawn / (canvas.scale * px_per_mm)**2
    return light


def _laid_out(meshes, pair, centre_px, px_per_mm):
    """Places x, y in pixels, (2, row, column); values, (quantity, row, column): limit and positions in the stop; and
    light, (wave, row, column), below 0 for lost rays."""
    rays = meshes.rays[pair].copy()
    around = np.pad(rays[LIMIT], 1, "reflect")
    rays[LIMIT] -= (np.diff(around[1:-1], 2, axis=1) + np.diff(around[:, 1:-1], 2, axis=0)) / 12
    if meshes.mirrored:
        left = rays[:, :, :0:-1].copy()
        left[[0, *range(STOP, LIGHT, 2)]] *= -1
        rays = np.concatenate([left, rays], axis=2)
    cosine, sine = np.cos(meshes.azimuth_rad), np.sin(meshes.azimuth_rad)
    turned = [np.stack([x * cosine - y * sine, x * sine + y * cosine])
              for x, y in (rays[n:n + 2] for n in (0, *range(STOP, LIGHT, 2)))]
    place = np.stack([centre_px[1] + turned[0][0] * px_per_mm, centre_px[0] - turned[0][1] * px_per_mm])
    reached = (np.abs(place) < FARTHEST_PX).all(axis=0) & (rays[LIGHT] >= 0)
    values = np.concatenate([rays[LIMIT:STOP], *turned[1:]]).astype(np.float32)
    return place, values, np.where(reached, rays[LIGHT:], -1).astype(np.float32)


def _triangles(own):
    """Rows and columns of the corners of all triangles whose rays all reach the sensor: list of (rows, columns)."""
    rows, columns = own.shape[1:]
    triangles = []
    for row in range(rows - 1):
        for column in range(columns - 1):
            a, b, c, d = ((row + down, column + right) for down in (0, 1) for right in (0, 1))
            both = ((a, b, c), (d, b, c)) if 2 * column < columns - 1 else ((b, a, d), (c, a, d))
            triangles += [tuple(np.transpose(each)) for each in both if all(own[0][at] >= 0 for at in each)]
    return triangles


def _irradiated(meshes, pair, blades, place, values, own, triangles, px_per_mm, frame_px):
    """The lit area on the sensor in pixels, and the irradiance at corners, (wave, row, column)."""
    light, areas, lit = np.zeros(own.shape), np.zeros(own.shape[1:]), 0.0
    for each in triangles:
        area = abs(_twice_area(place[:, each[0], each[1]])) / 2 + LEAST_PX2
        light[:, *each] += own[:, *each].sum(axis=1, keepdims=True) / 6.0 * meshes.cells_mm2[pair]
        areas[each] += area
        x, y = place[:, each[0], each[1]]
        limit, stop = values[0][each], values[1][each]**2 + values[2][each]**2
        if np.any((limit < 1) & (stop < blades.reach**2) & (x > 0) & (x < frame_px[1]) & (y > 0) & (y < frame_px[0])):
            lit += area
    per_px2 = meshes.irradiance[pair, :, None, None] * px_per_mm**2
    return lit, (light / np.where(areas > 0, areas, 1) * per_px2).astype(np.float32)


def _twice_area(place):
    (x0, x1, x2), (y0, y1, y2) = place
    return (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)


def _drawn(canvas, place, values, lit, own):
    """Draw a triangle, (2, corner), (quantity, corner) and irradiance (wave, corner), with the mean light `own` of its
    rays; returns its light on the frame."""
    sides = [np.hypot(*(place[:, (k + 1) % 3] - place[:, (k + 2) % 3])) for k in range(3)]
    order = [(int(np.argmax(sides)) + 1 + k) % 3 for k in range(3)]
    place = (place[:, order] + 0.5) * canvas.scale - 0.5 + RIM
    values, lit = values[:, order], lit[:, order]
    rows, columns = canvas.picture.shape[1:]
    if not (place[0].min() < columns and place[0].max() >= 0 and place[1].min() < rows and place[1].max() >= 0):
        return np.zeros(len(lit))
    longest = max(sides) * canvas.scale
    per_px = longest / DIAGONAL if longest > 1 else 1 / DIAGONAL
    changes = np.ptp(values[:1 + 2 * canvas.crossings], axis=1)
    per = per_px / np.maximum([changes[0], *changes[1:].reshape(-1, 2).max(axis=1)], 1e-9 * per_px)
    narrow = abs(_twice_area(place)) < longest
    if narrow:
        return _points(canvas, place, values, per, longest, own * canvas.per_light)
    return _pixels(canvas, place, values, per, lit)


def _open_part(canvas, values, per):
    """The part of the light that nothing blocks, of values (quantity, ...)."""
    distance = (1 - values[0]) * per[0]
    margin, bend, slope = canvas.blades.shape
    for number, (x, y) in enumerate(zip(values[1::2], values[2::2], strict=True)):
        square, reach = x * x + y * y, canvas.blades.reach
        if number < canvas.crossings:
            edges = [(reach**2 - square) / (2 * reach), *(margin - bend * square - slope * (x * across + y * up)
                                                          for across, up in canvas.blades.normals)]
            distance = np.minimum(distance, np.min(edges, axis=0) * per[1 + number])
    return np.clip(distance + 0.5, 0, 1)


def _points(canvas, place, values, per, longest, light):
    """A narrow triangle, whose longest side is from corner 0 to 1, as points along it."""
    count = int(min(longest + 1, MOST_POINTS))
    side = place[:, 1] - place[:, 0]
    foot = np.clip((place[:, 2] - place[:, 0]) @ side / max(side @ side, 1e-30), 0, 1)
    along = (np.arange(count) + 0.5) / count
    height = np.minimum(along / max(foot, 1e-6), (1 - along) / max(1 - foot, 1e-6))
    third = np.minimum(height, 1) / 2
    weights = np.stack([1 - along + third * foot - third, along - third * foot, third])
    light = light[:, None] * (height / height.sum() * canvas.part * _open_part(canvas, values @ weights, per))
    x, y = place @ weights
    rows, columns = canvas.picture.shape[1:]
    inside = (x >= 0) & (y >= 0) & (x < columns - 1) & (y < rows - 1)
    x, y, light = x[inside], y[inside], light[:, inside]
    column, row = x.astype(int), y.astype(int)
    for down in (0, 1):
        for right in (0, 1):
            share = np.abs(1 - down - (y - row)) * np.abs(1 - right - (x - column))
            np.add.at(canvas.picture, (slice(None), row + down, column + right), (share * light).astype(np.float32))
    from_top, from_left = y - (RIM - 0.5), x - (RIM - 0.5)
    below, right = from_top >= canvas.frame_px[0], from_left >= canvas.frame_px[1]
    return light[:, (np.minimum(from_top, from_left) >= 0) & ~below & ~right].sum(axis=1)


def _pixels(canvas, place, values, per, lit):
    """The pixels whose middles are in a triangle."""
    rows, columns = canvas.picture.shape[1:]
    first, end = (int(np.ceil(np.clip(each, 0, rows))) for each in (place[1].min(), place[1].max()))
    gradient = np.linalg.inv(np.stack([place[:, 1] - place[:, 0], place[:, 2] - place[:, 0]]))
    values = np.concatenate([values, lit])
    rises = (values[:, 1:] - values[:, :1]) @ gradient.T
    total = np.zeros(len(lit))
    for row in range(first, end):
        ends = []
        for a, b in ((0, 1), (1, 2), (2, 0)):
            a, b = (a, b) if place[1, a] < place[1, b] else (b, a)
            if place[1, a] <= row < place[1, b]:
                per_row = (place[0, b] - place[0, a]) / (place[1, b] - place[1, a])
                ends.append(place[0, a] + (row - place[1, a]) * per_row)
        left, right = (int(np.ceil(np.clip(each, 0, columns))) for each in (min(ends), max(ends)))
        at = np.stack([np.arange(left, right) - place[0, 0], np.full(right - left, row - place[1, 0])])
        here = values[:, :1] + rises @ at
        light = here[-len(lit):] * canvas.part * _open_part(canvas, here[:-len(lit)], per)
        canvas.picture[:, row, left:right] += light.astype(np.float32)
        if row >= RIM:
            inside = np.clip(RIM + canvas.frame_px[1] - np.arange(left, right), 0, 1) * (np.arange(left, right) >= RIM)
            total += (light * inside).sum(axis=1) * np.clip(RIM + canvas.frame_px[0] - row, 0, 1)
    return total
