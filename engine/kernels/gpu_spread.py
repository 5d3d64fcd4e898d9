"""Spread light on a graphics processor, by spread.wgsl."""

from contextlib import closing

import numpy as np

from .gpu import Gpu
from .gpu_calls import CALL, CALL_BYTES, MOST_LOOPS, UNIFORMS, Buffers, cached_buffers, check_agreement, compiled
from .sample_spreading import sample_spreading
from .spreading import LONGEST, MOST_TAPS, PackedTable, TablePlaces, spread

WIDE, TALL = 32, 4  # pixels of a workgroup: threads that run in step are next to each other
LOOK_UPS = 5  # of a tap: four PSFs and a place

SPREADING = np.dtype([(name, kind) for kind, names in (
    ("u4", "rows columns side intervals section_px section_columns azimuths quarter_steps heights samples"),
    ("i4", "centre_row centre_column"),
    ("f4", "centre_row_part centre_column_part samples_per_px")) for name in names.split()])
SPAN = np.dtype([(name, "u4") for name in "column count full last".split()])
TAPS, INTERVALS, SPANS, STEPS, CURVE, LIT, LIGHT, PLACES, PICTURE = range(CALL + 1, CALL + 10)  # bindings


def gpu_spread(gpu: Gpu, table: PackedTable, places: TablePlaces, light: np.ndarray, lit: np.ndarray,
               section_px: int) -> np.ndarray:
    """All of a picture's light, spread as by `kernels.spreading.spread`.

    Raises
    ------
    MemoryError
        TooLarge, or the library's own error.
    Disagreement
    Exception
        Of the library or the driver.
    """
    return gpu.call(_checked_spread, gpu, table, places, light, lit, section_px)


def _checked_spread(gpu, table, places, light, lit, section_px):
    """`gpu_spread`, in the thread of the graphics processor."""
    planes, cells = len(light), bool(places.structure.row_cell)
    if (planes, cells) not in gpu.pipelines:
        pipelines = compiled(gpu, "spread.wgsl", ("find_places", "gather"), WIDE=WIDE, TALL=TALL, PLANES=planes,
                             CELLS=cells, MOST_TAPS=MOST_TAPS)
        sample = sample_spreading(planes, cells)
        check_agreement([_spread(gpu, pipelines, *sample)], [spread(*sample, slice(None))])
        gpu.pipelines[planes, cells] = pipelines
    return _spread(gpu, gpu.pipelines[planes, cells], table, places, light, lit, section_px)


def _spread(gpu, pipelines, table, places, light, lit, section_px):
    """Spread with compiled loops."""
    spans, (planes, rows, columns) = _spans(table), light.shape
    tall, wide = rows + table.side_px - 1, columns + table.side_px - 1

    def table_buffers():
        buffers = Buffers(gpu)
        taps, begin, length = table.arrays[:3]
        buffers.put(TAPS, taps)
        buffers.put(INTERVALS, np.stack([begin[:len(length)], length], axis=-1).astype(np.uint32))
        buffers.put(SPANS, spans)
        return buffers

    with cached_buffers(gpu).of(table, "spread", table_buffers) as cached, closing(Buffers(gpu, cached)) as buffers:
        buffers.put(UNIFORMS, _facts(table, places, light, lit, section_px), usage="UNIFORM")
        buffers.make(CALL, CALL_BYTES, "UNIFORM")
        curve, steps = _curve_and_steps(places)
        buffers.put(CURVE, *curve)
        buffers.put(STEPS, *steps)
        buffers.put(LIT, lit.astype(np.uint32))
        buffers.put(LIGHT, light)
        buffers.make(PLACES, 16 * rows * columns)
        buffers.make(PICTURE, 4 * planes * tall * wide)
        find_places, gather = pipelines
        buffers.run(find_places, buffers.bound(find_places, (UNIFORMS, INTERVALS, STEPS, CURVE, LIT, LIGHT, PLACES)),
                    (-(-columns // WIDE), -(-rows // TALL)), (0,))
        _gather(gpu, gather, buffers, spans[-table.side_px:]["count"], planes, (tall, wide))
        return buffers.read(PICTURE).reshape(planes, tall, wide)


def _gather(gpu, gather, buffers, counts, planes, shape_px):
    """Gather into PICTURE, some rows of workgroups in a call. `counts` are the taps in rows of the PSFs' square."""
    bound = buffers.bound(gather, (UNIFORMS, CALL, TAPS, INTERVALS, SPANS, LIGHT, PLACES, PICTURE))
    down, across = -(-shape_px[0] // TALL), -(-shape_px[1] // WIDE)
    most_of_square = max(1, MOST_LOOPS // ((planes + 1) * (1 + int(counts.max()))))
    for first_of_square in range(0, len(counts), most_of_square):
        taps = counts[first_of_square:first_of_square + most_of_square].sum()
        of_row, first = float(across * WIDE * TALL * taps * (LOOK_UPS + planes)), 0
        while first < down:
            groups = int(min(max(1, gpu.look_ups_of_call / max(of_row, 1)), down - first))
            buffers.run(gather, bound, (across, groups), (TALL * first, first_of_square, most_of_square),
                        groups * of_row)
            first += groups


def _facts(table, places, light, lit, section_px):
    """Numbers as spread.wgsl reads them."""
    facts, of = np.zeros((), SPREADING), places.structure
    _, facts["rows"], facts["columns"] = light.shape
    facts["side"], facts["intervals"] = table.side_px, len(table.taps_by_interval)
    facts["section_px"], facts["section_columns"] = section_px, lit.shape[1]
    for name in ("azimuths", "quarter_steps", "heights", "samples", "samples_per_px"):
        facts[name] = getattr(of, name)
    facts["centre_row"], facts["centre_column"] = whole = np.floor([of.centre_row, of.centre_column]).astype(int)
    facts["centre_row_part"], facts["centre_column_part"] = np.array([of.centre_row, of.centre_column]) - whole
    return facts


def _curve_and_steps(places):
    """Arrays of numbers, and of integers, for finding places."""
    if places.structure.row_cell:
        *cells, row_on, column_on = places.arrays
        return (row_on, column_on), [each.astype(np.uint32) for each in cells]
    paraxial, interval, heights = places.arrays
    return [each.astype(np.float32) for each in (paraxial, heights)], [interval.astype(np.uint32)]


def _spans(table):
    """Array (interval * row) of SPAN: see spread.wgsl."""
    counts, row, column = table.arrays[-3:]
    side, intervals = table.side_px, len(table.taps_by_interval)
    counts = counts.reshape(intervals, LONGEST + 1)
    eights = np.repeat(np.tile(np.arange(LONGEST + 1), intervals), counts.ravel())
    interval = np.repeat(np.arange(intervals), counts.sum(axis=1))
    offset = np.cumsum(8 * eights) - 8 * eights - (np.cumsum(table.taps_by_interval) - table.taps_by_interval)[interval]
    line = interval * side + row
    order = np.lexsort((column, line))
    first = np.flatnonzero(np.diff(line[order], prepend=-1))
    last = np.append(first[1:], len(order)) - 1
    before = MOST_TAPS * (last - first)  # taps in the pieces before the last
    spans = np.zeros((intervals + 1) * side, SPAN)
    begin, end = order[first], order[last]
    spans["column"][line[begin]], spans["full"][line[begin]] = column[begin], offset[begin]
    spans["count"][line[begin]] = before + 8 * eights[end] - 3
    spans["last"][line[begin]] = (offset[end] - before).astype(np.uint32)
    each = spans[:-side].reshape(intervals, side)
    reached = each["count"] > 0
    columns = np.where(reached, each["column"], side).min(axis=0)
    spans["column"][-side:] = columns
    spans["count"][-side:] = np.maximum((each["column"] + each["count"]).max(axis=0, where=reached, initial=0), columns
                                        ) - columns
    return spans
