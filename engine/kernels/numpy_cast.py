"""Rays through layers by numpy, for machines without the compiled loop, whose results differ by rounding."""

import numpy as np

from .casting import QUANTITIES, STOP, Casting, LayerArrays, LevelArrays, MeshRays

BLOCKED = np.float32(2e-3)  # a ray with a smaller share of its light left ends
APART = np.float32(0.25)  # see cast.c
PORTION = 8  # eights of rays that are processed together


def numpy_cast(casting: Casting, row: int, blurred: np.ndarray, clear: np.ndarray) -> None:
    """As `kernels.cast.cast`."""
    size = casting.tile_px
    for tile in np.flatnonzero(casting.eights[row]):
        corner_px = row * size, tile * size
        pixels = np.s_[:, corner_px[0]:corner_px[0] + size, corner_px[1]:corner_px[1] + size]
        shape_px, step = blurred[pixels].shape[1:], casting.steps[row, tile]
        begin, eights = casting.first_eights[row, tile], casting.eights[row, tile]
        cells = np.sqrt(np.float32(eights)) / np.float32(casting.cell_of_eight)
        light, out_of_focus, through, total = sum(
            _sums(casting, _rays(casting, corner_px, shape_px, step,
                                 np.s_[first:min(first + PORTION, begin + eights)], cells), casting.meetings[row, tile])
            for first in range(begin, begin + eights, PORTION))
        of_rays = np.divide(out_of_focus, light, out=np.zeros_like(light), where=light > 0)
        share = np.clip(np.divide(through, total, out=np.ones_like(total), where=total > 0), 0, 1)
        blurred[pixels], clear[pixels] = _filled(of_rays, shape_px, step), _filled(share, shape_px, step)


def _filled(planes, shape_px, step):
    """All pixels of a tile, interpolated between those that are cast."""
    for axis, count in zip((2, 1), shape_px[::-1], strict=True):
        before, part = np.divmod(np.arange(count), step)
        after = np.minimum(before + 1, planes.shape[axis] - 1)
        weight = part.astype(np.float32) / np.float32(step)
        planes = _between(planes.take(before, axis), planes.take(after, axis), weight if axis == 2 else weight[:, None])
    return planes


def _rays(casting, corner_px, shape_px, step, eights, cells):
    """Arrays (wavelength, row, column, ray): positions at infinity to the right and up, and their change with the
    inverse depth; the light of rays; and 1 for rays that pass. `cells` is their number in a semi-aperture."""
    row, column = step * np.indices([(count + step - 2) // step + 1 for count in shape_px])
    x, y = corner_px[1] + column - casting.centre_px[1], casting.centre_px[0] - corner_px[0] - row
    at_pixels = _at_mesh if isinstance(casting.rays, MeshRays) else _at_heights
    stop, (one, two, by_one, by_two), (inside, light), right, up = at_pixels(casting.rays, x, y, eights)
    part = _open_share(inside) * _between_blades(casting, *stop, right, up, cells)
    places = (one * right[0] + two * right[1], one * up[0] + two * up[1],
              by_one * right[0] + by_two * right[1], by_one * up[0] + by_two * up[1])
    return places, part * light, (part > 0).astype(np.float32)


def _at_heights(rays, x, y, eights):
    """Positions in the stop, positions, and distances from the rims with light, of the rays of pixels; and x and y of
    positions, as sums of their first and second component."""
    height = np.sqrt(x * x + y * y)
    right = np.divide(x, height, out=np.zeros_like(height), where=height > 0).astype(np.float32)[..., None]
    up = np.divide(y, height, out=np.ones_like(height), where=height > 0).astype(np.float32)[..., None]
    before, weight = _nodes(height * rays.heights_per_px, len(rays.values))
    stop, *low = _separate(rays.values[before, eights])
    _, *high = _separate(rays.values[before + 1, eights])
    places, rims = (_between(a, b, held) for a, b, held in
                    zip(low, high, (weight, np.minimum(weight, np.float32(1))), strict=True))
    return stop, places, rims, (right, up), (up, -right)


def _at_mesh(rays, x, y, eights):
    """As `_at_heights`."""
    (below, left), (up, right) = rays.mirrored, rays.first
    side_x, side_y = (np.where(mirrored & (each < 0), np.float32(-1), np.float32(1))
                      for mirrored, each in ((left, x), (below, y)))
    up, right = side_y * y * rays.nodes_per_px[0] - up, side_x * x * rays.nodes_per_px[1] - right
    (row, up_weight), (column, weight) = (_nodes(*each) for each in zip((up, right), rays.values.shape, strict=False))
    corners = [[_separate(rays.values[row + n, column + m, eights]) for m in (0, 1)] for n in (0, 1)]

    def mixed(part, across, upwards):
        return _between(*(_between(low[part], high[part], across) for low, high in corners), upwards)

    places, rims = mixed(1, weight, up_weight), mixed(2, *(np.clip(each, 0, 1) for each in (weight, up_weight)))
    places[:2] += _chief(rays, up * rays.finer, right * rays.finer)
    zero = np.float32(0)
    return corners[0][0][0], places, rims, (side_x[..., None], zero), (zero, side_y[..., None])


def _chief(rays, up, right):
    """Positions of chief rays at places in nodes of their mesh: array (2, wavelength, row, column, 1)."""
    (row, upwards), (column, across) = (_nodes(*each) for each in zip((up, right), rays.chief_px.shape, strict=False))
    low, high = (_between(rays.chief_px[row + n, column], rays.chief_px[row + n, column + 1], across[..., None])
                 for n in (0, 1))
    return np.moveaxis(_between(low, high, upwards[..., None]), (-1, -2), (0, 1))[..., None]


def _nodes(place, count):
    """The nodes before places, and the places' distances from them."""
    before = np.clip(place, 0, count - 2).astype(np.int64)
    return before, (place - before).astype(np.float32)[..., None]


def _separate(values):
    """Positions in the stop, positions, and distances from the rims with light: arrays (quantity, [wavelength,] row,
    column, ray) of values (row, column, eight, quantity, 8)."""
    values = np.moveaxis(values, -2, 0)
    values = values.reshape(*values.shape[:3], -1)
    of_waves = values[STOP:].reshape(-1, QUANTITIES, *values.shape[1:]).swapaxes(0, 1)
    return values[:STOP, None], of_waves[:4], of_waves[4:]


def _open_share(cells_inside):
    """The share of a cell that is open, at this distance from a rim."""
    return np.clip(cells_inside + np.float32(0.5), 0, 1)


def _between(a, b, weight):
    return a + weight * (b - a)


def _between_blades(casting, second, first, right, up, cells):
    """The share of each ray's cell that is between the blades of an iris."""
    x, y = second * right[1] + first * right[0], first * up[0] + second * up[1]
    margin, bend, slope = map(np.float32, casting.blade_shape)
    part = np.ones(x.shape, np.float32)
    for across, along in casting.blades:
        part *= _open_share((margin - bend * (x * x + y * y) - slope * (x * across + y * along)) * cells)
    return part


def _sums(casting, rays, meetings):
    """Sums over rays: array (quantity, wavelength, row, column).

    The quantities are the rays' light; this times the out-of-focus radiance; and this times the in-focus radiance, with
    and without occlusion by out-of-focus surfaces.
    """
    places, light, free = rays
    in_focus, middle = free.copy(), len(light) // 2
    faint = np.array(casting.faint, np.float32)[:, None, None, None]
    blurred, through, total = np.zeros((3, *light.shape[:-1]), np.float32)
    for layer, meeting in zip(casting.layers, meetings, strict=True):
        if meeting["steps"] < 0:
            continue
        depth, share = _meet(layer, [each[middle] for each in places], meeting, casting)
        spots = _moved(places, depth, casting)
        alpha, radiance = _looked_up(layer.levels[meeting["level"]], spots, share >= 0, meeting)
        left, bright = free * light, radiance + faint * alpha
        sharp = left * share
        blurred += ((left - sharp) * radiance).sum(axis=-1)
        through += (sharp * bright).sum(axis=-1)
        total += (in_focus * light * share * bright).sum(axis=-1)
        for passing, hidden in ((in_focus, share * alpha), (free, alpha)):
            passing -= passing * hidden
            passing *= passing > BLOCKED
    return np.stack([light.sum(axis=-1), blurred, through, total])


def _moved(places, depth, casting):
    """Positions of rays at an inverse depth: pixels to the right of the axis, and up."""
    far_x, far_y, by_x, by_y = places
    x, y = far_x + by_x * depth, far_y + by_y * depth
    right, up = map(np.float32, casting.per_focal)
    if up > 0:
        tangent, last = np.hypot(x * right, y * up), np.float32(len(casting.shrinkage) - 1)
        step = np.fmin(tangent / (1 + tangent) * last, last)  # last for an infinite tangent
        before = np.minimum(step, last - 1).astype(np.int32)
        part = _between(casting.shrinkage[before], casting.shrinkage[before + 1], step - before.astype(np.float32))
        x, y = x * part, y * part
    return x, y


def _meet(layer: LayerArrays, places, meeting, casting):
    """The inverse depth at which rays meet a layer, and the focus share there: see cast.c."""
    depth, share = (np.full(places[0].shape, meeting[name]) for name in ("inverse_depth", "share"))
    fine = layer.levels[0]
    row, column = (np.float32(each) + np.float32(0.5) for each in fine.axis_px)
    before = depth, share
    for _ in range(meeting["steps"]):
        before = depth, share
        x, y = _moved(places, depth, casting)
        rows, columns = (np.clip(each, 0, most - 1).astype(np.int32)
                         for each, most in zip((row - y, column + x), fine.alpha.shape, strict=True))
        depth, share = np.moveaxis(layer.depth[rows, columns], -1, 0)
    if meeting["steps"] < 2:
        return depth, share
    change, half = before[0] - depth, np.float32(0.5)
    x, y = (by * change for by in places[2:])
    nearer, between_pixels = change > 0, (change != 0) & (x * x + y * y <= APART)
    return tuple(np.where(between_pixels, half * (first + second), np.where(nearer, first, second))
                 for first, second in zip(before, (depth, share), strict=True))


def _looked_up(level: LevelArrays, places, covered, meeting):
    """Alpha and radiance of a layer's level where rays meet it; 0 for rays that miss it."""
    per_px, cells, opaque = np.float32(level.per_px), meeting["cells"], bool(meeting["opaque"])
    x, y = np.float32(level.axis_px[1]) + per_px * places[0], np.float32(level.axis_px[0]) - per_px * places[1]
    top, bottom, left, right = level.bounds_px
    inside = covered & (opaque | (x > left) & (x < right) & (y > top) & (y < bottom))
    rows, columns = level.alpha.shape
    x, y = np.clip(x, 0, np.float32(columns - 1)), np.clip(y, 0, np.float32(rows - 1))
    column, row = np.minimum(x.astype(np.int32), columns - 2), np.minimum(y.astype(np.int32), rows - 2)
    half = np.float32(0.5)
    across, down = (np.clip((each - before.astype(np.float32)) * cells + (half - half * cells), 0, 1)
                    for each, before in ((x, column), (y, row)))
    wavelength = np.arange(len(x))[:, None, None, None]

    def mean(planes):
        before, behind = (_between(planes[wavelength, row, column + n], planes[wavelength, row + 1, column + n], down)
                          for n in (0, 1))
        return np.where(inside, _between(before, behind, across), np.float32(0))

    alpha = inside.astype(np.float32) if opaque else mean(np.broadcast_to(level.alpha, level.light.shape))
    return alpha, mean(level.light)
