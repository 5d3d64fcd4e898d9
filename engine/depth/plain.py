"""Rays through layers in plain numpy: to the last bit what the loop in C gives, where there is none."""

import numpy as np

from ..kernels import Casting, SeenLayer
from ..kernels.cast import QUANTITIES, STOP

BLOCKED = np.float32(2e-3)
ARCTAN = np.array([0.0028340643, -0.0160050305, 0.0425876075, -0.0749544544, 0.106367541, -0.142025705, 0.199924836,
                   -0.333330668, 0.999999984], np.float32)


def cast(casting: Casting, row: int, blurred: np.ndarray, clear: np.ndarray) -> None:
    """As `kernels.cast`."""
    size, (_, rows, columns) = casting.tile_px, blurred.shape
    tiles = np.arange(casting.eights.shape[1])
    kinds = {}  # tiles that are met alike go together
    for tile in tiles[casting.eights[row] > 0]:
        met = casting.meetings[row, tile]
        key = (int(casting.eights[row, tile]), bool(met["focused"].any()), tuple(met["steps"].tolist()))
        kinds.setdefault(key, []).append(tile)
    for (eights, focused, steps), alike in kinds.items():
        y, x = (each.ravel() for each in np.meshgrid(
            np.arange(row * size, min((row + 1) * size, rows)),
            np.concatenate([np.arange(tile * size, min((tile + 1) * size, columns)) for tile in alike]),
            indexing="ij"))
        _cast_pixels(casting, y, x, eights, focused, steps, casting.meetings[row, x // size], blurred, clear)


def _cast_pixels(casting, row, column, eights, focused, steps, meetings, blurred, clear):
    x, y = column - casting.centre_px[1], casting.centre_px[0] - row
    height = np.sqrt(x * x + y * y)
    off_axis = height > 0
    with np.errstate(invalid="ignore", divide="ignore"):
        right = np.where(off_axis, x / height, 0).astype(np.float32)[:, None]
        up = np.where(off_axis, y / height, 1).astype(np.float32)[:, None]
    step = height * casting.heights_per_px
    before = np.minimum(step, len(casting.rays) - 2).astype(np.int64)
    weight = (step - before).astype(np.float32)[:, None]
    sequence = row % casting.tile_px % 2 * 4 + column % casting.tile_px % 4
    count = casting.wavelengths
    sums = np.zeros((4, count, row.size, 8), np.float32)
    for eight in range(eights):
        rays, following = (casting.rays[before + n, sequence, eight] for n in (0, 1))
        _follow(casting, rays, following, weight, right, up, focused, steps, meetings, sums)
    light, seen, through, total = (((s[..., 0] + s[..., 1]) + (s[..., 2] + s[..., 3]))
                                   + ((s[..., 4] + s[..., 5]) + (s[..., 6] + s[..., 7])) for s in sums)
    blurred[:, row, column] = np.divide(seen, light, out=np.zeros_like(seen), where=light > 0)
    part = np.divide(through, total, out=np.ones_like(seen), where=(total > 0) & focused)
    clear[:, row, column] = np.clip(part, 0, 1)


def _between(a, b, weight):
    return a + weight * (b - a)


def _through_blades(casting, rays, right, up):
    x = rays[:, 0] * up + rays[:, 1] * right
    y = rays[:, 1] * up - rays[:, 0] * right
    margin, bend, slope = map(np.float32, casting.blade_shape)
    through = np.ones(x.shape, bool)
    for across, along in casting.blades:
        through &= margin - bend * (x * x + y * y) - slope * (x * across + y * along) > 0
    return through


def _follow(casting, rays, following, weight, right, up, focused, steps, meetings, sums):
    """Eight rays of each pixel, arrays (pixel, quantity, 8), through the layers."""
    lit, blurred, through, total = sums
    held, passing = np.minimum(weight, np.float32(1)), _through_blades(casting, rays, right, up)
    places, lights, frees = [], [], []
    for w in range(casting.wavelengths):
        first = STOP + QUANTITIES * w
        far_out, far_across, by_out, by_across = (
            _between(rays[:, first + n], following[:, first + n], weight) for n in range(4))
        margin, light = (_between(rays[:, first + n], following[:, first + n], held) for n in (4, 5))
        light = np.where(passing & (margin > 0), light, np.float32(0))
        places.append((far_out * right + far_across * up, far_out * up - far_across * right,
                       by_out * right + by_across * up, by_out * up - by_across * right))
        frees.append((passing & (margin > 0)).astype(np.float32))
        lights.append(light)
        lit[w] += light
    in_focus = [free.copy() for free in frees]
    for number, layer in enumerate(casting.layers):
        if steps[number] < 0:
            continue
        depth, share = _meet(layer, places[casting.wavelengths // 2], meetings[:, number], steps[number],
                             casting.per_focal)
        covered, opaque = share >= 0, meetings["opaque"][:, number, None] > 0
        for w, place in enumerate(places):
            spot, inside = _spots(layer, place, depth, casting.per_focal)
            inside = (inside | opaque) & covered
            alpha = np.where(opaque & covered, np.float32(1), _looked_up(layer.alpha, spot, inside))
            light = _looked_up(layer.light[w], spot, inside)
            seen = frees[w] * lights[w]
            if focused:
                sharp, bright = seen * share, light + np.float32(casting.faint[w]) * alpha
                blurred[w] += (seen - sharp) * light
                through[w] += sharp * bright
                total[w] += in_focus[w] * lights[w] * share * bright
                in_focus[w] -= in_focus[w] * share * alpha
                in_focus[w] *= in_focus[w] > BLOCKED
            else:
                blurred[w] += seen * light
            frees[w] -= frees[w] * alpha
            frees[w] *= frees[w] > BLOCKED


def _moved(place, depth, per_focal):
    far_x, far_y, by_x, by_y = place
    x, y = far_x + by_x * depth, far_y + by_y * depth
    if per_focal > 0:
        across, along = x * np.float32(per_focal), y * np.float32(per_focal)
        part = _shrunk(across * across + along * along)
        x, y = x * part, y * part
    return x, y


def _shrunk(square):
    """arctan(r) / r."""
    one, far, r = np.float32(1), square > 1, np.sqrt(square)
    z = np.where(far, one / np.where(far, square, one), square)
    series = np.full_like(z, ARCTAN[0])
    for term in ARCTAN[1:]:
        series = series * z + term
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(far, (np.float32(1.57079633) - series / r) / r, series)


def _meet(layer: SeenLayer, place, meetings, steps, per_focal):
    rows, columns = layer.depth.shape[:2]
    depth, share = (np.broadcast_to(meetings[name][:, None], place[0].shape) for name in ("inverse_depth", "share"))
    row, column = map(np.float32, layer.axis_px)
    for _ in range(steps):
        x, y = _moved(place, depth, per_focal)
        x = np.clip(column + np.float32(0.5) + x, 0, columns - 1).astype(np.int32)
        y = np.clip(row + np.float32(0.5) - y, 0, rows - 1).astype(np.int32)
        depth, share = np.moveaxis(layer.depth[y, x], -1, 0)
    return depth, share


def _spots(layer: SeenLayer, place, depth, per_focal):
    """Where rays meet a layer, and which of them do not pass beside it."""
    rows, columns = layer.light.shape[1:]
    x, y = _moved(place, depth, per_focal)
    x, y = np.float32(layer.axis_px[1]) + x, np.float32(layer.axis_px[0]) - y
    top, bottom, left, right = layer.bounds_px
    inside = (x > left) & (x < right) & (y > top) & (y < bottom)
    x, y = np.clip(x, 0, np.float32(columns - 1)), np.clip(y, 0, np.float32(rows - 1))
    column, row = np.minimum(x.astype(np.int32), columns - 2), np.minimum(y.astype(np.int32), rows - 2)
    return (row, column, y - row.astype(np.float32), x - column.astype(np.float32)), inside


def _looked_up(plane, spot, inside):
    row, column, down, right = spot
    before = _between(plane[row, column], plane[row + 1, column], down)
    behind = _between(plane[row, column + 1], plane[row + 1, column + 1], down)
    return np.where(inside, _between(before, behind, right), np.float32(0))
