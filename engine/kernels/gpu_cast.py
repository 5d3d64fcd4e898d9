"""Cast on a graphics processor, by cast.wgsl.

Bands of the picture are cast one after the other, and read back.
"""

import math
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import numpy as np

from .cast import cast
from .casting import MEETING, Casting, MeshRays
from .gpu import Gpu
from .gpu_calls import CALL, CALL_BYTES, MOST_LOOPS, UNIFORMS, Buffers, cached_buffers, check_agreement, compiled
from .gpu_levels import Stack, level_place, make_levels
from .sample_casting import sample_casting

GROUP = 32  # invocations of a workgroup, pixels of a tile next to each other: the threads that run in step
MOST_GROUPS = 65535  # in a call
BAND_SUMS = 1 << 24  # of a band's pixels
FARTHEST_PX = 3e38  # in place of infinity, for which shaders have no rules

CASTING = np.dtype([(name, kind) for kind, names in (
    ("u4", "nodes eights mesh_rows finer chief shrinkage shrinkage_steps blade blades mirrored_right mirrored_up "
           "layers levels columns"),
    ("i4", "centre_row centre_column"),
    ("f4", "centre_row_part centre_column_part nodes_per_px rows_per_px first_right first_up per_focal_right "
           "per_focal_up blade_margin blade_bend blade_slope cell_of_eight")) for name in names.split()]
    + [("faint", "f4", 8)])
LEVEL = np.dtype([(name, "u4") for name in "light alpha depth rows columns".split()]
                 + [(name, "f4") for name in "axis_row axis_column per_px top bottom left right".split()])
TILE = np.dtype([(name, "u4") for name in "row column height width step tall wide first_eight eights focused meetings "
                 "first_pixel".split()])
LENS, LIGHT, DEPTHS, LEVELS, MEETINGS, TILES, GROUPS, SUMS, PICTURES = range(CALL + 1, CALL + 10)  # bindings


def gpu_cast(gpu: Gpu, casting: Casting, blurred: np.ndarray, clear: np.ndarray) -> Iterator[float]:
    """Write the pixels of all tiles with rays, as `kernels.cast.cast`; yield the completed fraction.

    Raises
    ------
    MemoryError
        TooLarge, or the library's own error.
    Disagreement
    Exception
        Of the library or the driver.
    """
    steps = _steps(gpu, casting, blurred, clear)
    try:
        while (fraction := gpu.call(next, steps, None)) is not None:
            yield fraction
    finally:
        gpu.call(steps.close)


def _steps(gpu, casting, blurred, clear):
    """`gpu_cast`, in the thread of the graphics processor."""
    pipelines = _checked_pipelines(gpu, casting.wavelengths, isinstance(casting.rays, MeshRays))
    yield from _cast(gpu, pipelines, casting, blurred, clear)


def _checked_pipelines(gpu, wavelengths, mesh):
    """The compiled loops, which agreed with C."""
    if (wavelengths, mesh) not in gpu.pipelines:
        pipelines = compiled(gpu, "cast.wgsl", ("cast_pixels", "fill_tiles"), GROUP=GROUP, WAVELENGTHS=wavelengths,
                             MESH=mesh)
        _check(gpu, pipelines, sample_casting(wavelengths, mesh))
        gpu.pipelines[wavelengths, mesh] = pipelines
    return gpu.pipelines[wavelengths, mesh]


def _check(gpu, pipelines, casting):
    """Raise Disagreement if the graphics processor and C cast different pictures."""
    rows, columns = (count * casting.tile_px - 3 for count in casting.eights.shape)
    by_gpu, by_c = (np.zeros((2, casting.wavelengths, rows, columns), np.float32) for _ in range(2))
    for _ in _cast(gpu, pipelines, casting, *by_gpu):
        pass
    for row in range(len(casting.eights)):
        cast(casting, row, *by_c)
    check_agreement(by_gpu, by_c)


def _cast(gpu, pipelines, casting, blurred, clear):
    """Cast with compiled loops, a band of rows after the other; yield the completed fraction."""
    with _cached_depths(gpu, casting.layers) as depths, closing(Buffers(gpu, depths)) as shared:
        _share(gpu, shared, casting, blurred.shape[2])
        rows = max(1, BAND_SUMS // (4 * casting.wavelengths * casting.tile_px * blurred.shape[2]))
        for first in range(0, len(casting.eights), rows):
            lit = casting.eights[first:first + rows] > 0
            if not lit.any():
                continue
            place = slice(first * casting.tile_px, min((first + rows) * casting.tile_px, blurred.shape[1]))
            with closing(Buffers(gpu, shared)) as buffers:
                for completed in _band(gpu, pipelines, buffers, casting, first, lit, place, blurred.shape[1:]):
                    yield (first + completed * len(lit)) / len(casting.eights)
                pictures = buffers.read(PICTURES).reshape(2, casting.wavelengths, -1, blurred.shape[2])
            _write(pictures, (blurred[:, place], clear[:, place]), lit, casting.tile_px)
        yield 1.0


def _write(pictures, to, lit, tile_px):
    """Copy the pixels of tiles with rays."""
    where: Any = True
    if not lit.all():
        rows, columns = pictures.shape[2:]
        where = lit.repeat(tile_px, axis=0).repeat(tile_px, axis=1)[:rows, :columns]
    for picture, each in zip(pictures, to, strict=True):
        np.copyto(each, picture, where=where)


def _band(gpu, pipelines, buffers, casting, first_row, lit, place, shape_px):
    """Cast rows of tiles into PICTURES; yield the completed fraction after each call."""
    tiles, rows = _tiles(casting, first_row, lit, shape_px), place.stop - place.start
    groups, of_tile = _groups(tiles)
    buffers.put(TILES, tiles)
    buffers.put(GROUPS, groups)
    buffers.make(SUMS, 16 * casting.wavelengths * int((tiles["tall"] * tiles["wide"]).sum()))
    buffers.make(PICTURES, 8 * casting.wavelengths * rows * shape_px[1])
    cast_pixels, fill_tiles = pipelines
    bound = buffers.bound(cast_pixels, range(PICTURES))
    work, most_eights = _look_ups(casting, tiles)[of_tile], _most_eights(casting)
    completed, total = 0.0, (work * tiles["eights"][of_tile]).sum()
    for first_eight in range(0, int(tiles["eights"][0]), most_eights):  # tiles with the most rays are the first ones
        eights = np.clip(tiles["eights"][of_tile].astype(int) - first_eight, 0, most_eights)
        done, begin = np.append(0.0, np.cumsum(work * eights)), 0
        while begin < np.count_nonzero(eights):
            end = int(np.searchsorted(done, done[begin] + gpu.look_ups_of_call, "right")) - 1
            end = min(max(end, begin + 1), begin + MOST_GROUPS, np.count_nonzero(eights))
            buffers.run(cast_pixels, bound, (end - begin,), (begin, first_eight, most_eights, place.start, rows),
                        done[end] - done[begin])
            completed += done[end] - done[begin]
            yield completed / total
            begin = end
    bound = buffers.bound(fill_tiles, (UNIFORMS, CALL, TILES, SUMS, PICTURES))
    buffers.run(fill_tiles, bound, (len(tiles),), (0, 0, 0, place.start, rows))


def _tiles(casting, first_row, lit, shape_px):
    """The tiles with rays among some rows, as cast.wgsl reads them, those with the most rays first."""
    rows, columns = np.nonzero(lit)
    rows = rows + first_row
    order = np.argsort(-casting.eights[rows, columns], kind="stable")
    at, size = (rows[order], columns[order]), casting.tile_px
    tiles = np.zeros(len(rows), TILE)
    tiles["row"], tiles["column"] = (each * size for each in at)
    tiles["height"], tiles["width"] = (np.minimum(size, n - tiles[name].astype(int))
                                       for n, name in zip(shape_px, ("row", "column"), strict=True))
    tiles["step"] = step = casting.steps[at]
    for count, name in (("tall", "height"), ("wide", "width")):
        tiles[count] = (tiles[name] + step - 2) // step + 1
    tiles["first_eight"], tiles["eights"] = casting.first_eights[at], casting.eights[at]
    tiles["focused"] = casting.meetings["focused"][at].any(axis=-1)
    tiles["meetings"] = np.ravel_multi_index(at, casting.eights.shape) * len(casting.layers)
    sizes = tiles["tall"] * tiles["wide"]
    tiles["first_pixel"] = np.cumsum(sizes) - sizes
    return tiles


def _groups(tiles):
    """Array (group, 2) of the workgroups' tiles and first pixels; and these tiles."""
    counts = -(-(tiles["tall"] * tiles["wide"]).astype(int) // GROUP)
    of_tile = np.repeat(np.arange(len(tiles)), counts)
    first = GROUP * (np.arange(len(of_tile)) - np.repeat(np.cumsum(counts) - counts, counts))
    return np.stack([of_tile, first], axis=-1).astype(np.uint32), of_tile


def _look_ups(casting, tiles):
    """Look-ups of a workgroup with an eight of rays in each pixel, in layers and of rays themselves."""
    met = (casting.meetings["steps"] >= 0).sum(axis=-1).ravel()[tiles["meetings"] // len(casting.layers)]
    return 8.0 * GROUP * casting.wavelengths * (1 + met)


def _most_eights(casting):
    """The largest number of eights of rays that an invocation can follow."""
    of_layer = 2 + casting.wavelengths + max(0, int(casting.meetings["steps"].max()))
    return max(1, MOST_LOOPS // (8 * (2 + casting.wavelengths + len(casting.layers) * of_layer)))


def _share(gpu, buffers, casting, columns):
    """Upload or make everything that all bands have in common."""
    facts = np.zeros((), CASTING)
    lens = [casting.rays.values.ravel(), casting.shrinkage, casting.blades.ravel()]
    if isinstance(casting.rays, MeshRays):
        lens.append(casting.rays.chief_px.ravel())
    begins = np.cumsum([0, *map(len, lens)])
    facts["shrinkage"], facts["blade"], facts["chief"] = begins[1:4]
    facts["nodes"], facts["mesh_rows"], facts["nodes_per_px"] = casting.rays.nodes
    (facts["rows_per_px"], facts["first_right"], facts["first_up"], _, facts["finer"], facts["mirrored_right"],
     facts["mirrored_up"]) = casting.rays.mesh
    facts["eights"], facts["columns"] = casting.rays.eights.shape[1], columns
    facts["shrinkage_steps"], facts["blades"] = len(casting.shrinkage) - 1, len(casting.blades)
    facts["layers"], facts["levels"] = len(casting.layers), _most_levels(casting)
    facts["centre_row"], facts["centre_column"] = whole = np.floor(casting.centre_px).astype(int)
    facts["centre_row_part"], facts["centre_column_part"] = casting.centre_px - whole
    facts["per_focal_right"], facts["per_focal_up"] = casting.per_focal
    facts["blade_margin"], facts["blade_bend"], facts["blade_slope"] = casting.blade_shape
    facts["cell_of_eight"] = casting.cell_of_eight
    facts["faint"][:casting.wavelengths] = casting.faint
    buffers.put(UNIFORMS, facts, usage="UNIFORM")
    buffers.put(LENS, *lens)
    buffers.put(MEETINGS, casting.meetings.view(MEETING))
    buffers.make(CALL, CALL_BYTES, "UNIFORM")
    _make_levels(gpu, buffers, casting)
    buffers.wait()


def _most_levels(casting):
    """The largest number of levels of a layer."""
    return max(1 + len(layer.planes.coarser) for layer in casting.layers)


def _make_levels(gpu, buffers, casting):
    """Put the levels that rays look up, and their table as cast.wgsl reads it; others have no planes."""
    table = np.zeros((len(casting.layers), _most_levels(casting)), LEVEL)
    met, stacks, begin, depth = casting.meetings[casting.eights > 0], [], 0, 0
    for row, layer, meetings in zip(table, casting.layers, met.T, strict=True):
        used, planes, of_layer = set(meetings["level"][meetings["steps"] >= 0].tolist()), layer.planes, {}
        for number, kind in enumerate((None, *planes.coarser)):
            first, shape = level_place(planes.place, kind) if kind else (planes.origin_px, layer.depth.shape[:2])
            geometry = planes.geometry(kind, first) if kind else planes.finest
            light = alpha = 0
            if number in used:
                of_layer[number] = begin, first, (casting.wavelengths + 1, *shape)
                light, alpha = begin, begin + casting.wavelengths * math.prod(shape)
                begin = alpha + math.prod(shape)
            axis_px, per_px, bounds_px = geometry
            row[number] = light, alpha, depth, *shape, *axis_px, per_px, *np.clip(bounds_px, -FARTHEST_PX, FARTHEST_PX)
        stacks.append(of_layer)
        depth += layer.depth.size // 2
    buffers.put(LEVELS, table)
    buffers.make(LIGHT, 4 * begin)
    for layer, of_layer in zip(casting.layers, stacks, strict=True):
        make_levels(gpu, layer.planes, {number: Stack(buffers[LIGHT], *stack)
                                        for number, stack in of_layer.items()})


def _cached_depths(gpu, layers):
    """The layers' depths, as a context manager of buffers: wavelengths share them."""
    def upload():
        buffers = Buffers(gpu)
        buffers.put(DEPTHS, *(layer.depth for layer in layers))
        return buffers

    return cached_buffers(gpu).of(layers[0].depth, tuple(id(layer.depth) for layer in layers), upload)
