"""A small picture whose light is spread by every part of the loop, by which a graphics processor is compared with C."""

import numpy as np

from .spreading import PackedTable, TablePlaces

SHAPE_PX, CENTRE_PX, QUADRANT_PX, SECTION_PX = (21, 34), (8.3, 14.8), (0.0, -0.5), 8
LIT, BRIGHTER = 0.7, 4  # share of pixels and sections; power of their light
RADIUS_PX = 65  # rows of PSFs are in up to three pieces
QUARTER_STEPS, HEIGHTS, FARTHEST_PX, CURVE_STEPS = 3, (0.0, 5.0, 12.0, 30.0), 38.0, 40
CELLS = 2, 3  # down and across


def sample_spreading(planes: int, cells: bool) -> tuple[PackedTable, TablePlaces, np.ndarray, np.ndarray, int]:
    """Table, places, light, lit sections and their size, as for `spread`: PSFs in the cells of a grid, or between
    heights and azimuths of a picture, or of a quadrant if there are several planes."""
    random = np.random.default_rng(planes)
    light = random.random((planes, *SHAPE_PX)) ** BRIGHTER * (random.random(SHAPE_PX) < LIT)
    lit = random.random([-(-n // SECTION_PX) for n in SHAPE_PX]) < LIT
    table, places = _in_cells(random) if cells else _between_heights(random, 1 if planes > 1 else 4)
    return table, places, light.astype(np.float32), lit, SECTION_PX


def _between_heights(random, quarter_turns):
    heights = np.array(HEIGHTS)
    places = TablePlaces.of(CENTRE_PX if quarter_turns > 1 else QUADRANT_PX, CURVE_STEPS / FARTHEST_PX,
                            np.linspace(0, heights[-1], CURVE_STEPS + 1), heights, QUARTER_STEPS, quarter_turns)
    return _table(random, len(heights) - 1, QUARTER_STEPS * quarter_turns + 1), places


def _in_cells(random):
    axes = [np.divmod(np.linspace(0, cells - 0.01, n), 1) for n, cells in zip(SHAPE_PX, CELLS, strict=True)]
    rows, columns = ((cell.astype(int), on) for cell, on in axes)
    return _table(random, CELLS[0] * CELLS[1], 2), TablePlaces.in_cells(rows, columns, CELLS[1])


def _table(random, intervals, azimuths):
    """PSFs in discs that grow with the interval, off the chief ray."""
    down, right = np.indices([2 * RADIUS_PX + 1] * 2).reshape(2, -1) - RADIUS_PX
    radii_px = np.linspace(0.2, 1, intervals)[:, None] * RADIUS_PX
    reached = np.hypot(down, right + 0.3 * (RADIUS_PX - radii_px)) <= radii_px
    psfs = np.pad(random.random((2, azimuths, down.size), np.float32), [(0, 0), (0, 0), (0, 1)])

    def fill(interval, pixels, out):
        out[:] = psfs[..., pixels]

    return PackedTable.of(reached, azimuths, fill)
