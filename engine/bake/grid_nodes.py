"""Choice of the nodes of a grid on the sensor: as many and as dense as interpolation between their PSFs needs."""

from collections.abc import Callable

import numpy as np

from .grid_ends import Ends

AT_ONCE = 3  # one in three of the intervals that are too wide is halved before errors are computed again


def first_lines_mm(ends_mm: Ends, longest_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Lines of the coarsest grid, along y and x, through the axis: at most about this distance apart."""
    lines = []
    for first_mm, last_mm in ends_mm:
        before, after = (max(1, round(end_mm / longest_mm)) for end_mm in (-first_mm, last_mm))
        below = first_mm * np.arange(before, 0, -1) / before if first_mm else np.array([])
        lines.append(np.concatenate([below, last_mm * np.arange(after + 1) / after]))
    return lines[0], lines[1]


def adaptive_grid_mm(lines_mm: tuple[np.ndarray, np.ndarray], psfs_at: Callable[[np.ndarray, np.ndarray], np.ndarray],
                     tolerance: float, most: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Lines between whose nodes PSFs can be mixed, by halving intervals until the error is small enough.

    Errors along y are computed on the coarsest lines of x, and those along x on the coarsest lines of y. In the middle
    of a cell, the error is at most their sum.

    Parameters
    ----------
    lines_mm : (array, array)
        Of the coarsest grid, y and x.
    psfs_at : function (y_mm, x_mm)
        PSFs of unit sum at places, (place,) arrays: array (place, v, u).
    tolerance : float
        Share of misplaced light allowed in the middle of the grid's cells and of their edges, averaged over the
        picture.
    most : int
        Number of nodes.

    Returns
    -------
    y_mm, x_mm : arrays
    error : float
        The actual share.
    """
    lines, across_mm = list(lines_mm), lines_mm[::-1]
    known: tuple[dict, dict] = {}, {}
    while True:
        errors = [_errors(psfs, psfs_at, line, other, axis) for axis, (psfs, line, other) in
                  enumerate(zip(known, lines, across_mm, strict=True))]
        error = 2 / 3 * sum(map(np.sum, errors))
        halved = _halved(errors, [line.size for line in lines], tolerance, most) if error > tolerance else ()
        if not any(each.size for each in halved):
            return lines[0], lines[1], float(error)
        lines = [np.sort(np.concatenate([line, (line[each] + line[each + 1]) / 2]))
                 for line, each in zip(lines, halved, strict=True)]


def _errors(known, psfs_at, line_mm, across_mm, axis):
    """Misplaced light in the intervals of a line, on other lines across it: each interval's part of the mean."""
    middles_mm = (line_mm[1:] + line_mm[:-1]) / 2
    new = [place for place in (*line_mm, *middles_mm) if place not in known]
    if new:
        places = np.meshgrid(new, across_mm, indexing="ij")
        psfs = psfs_at(*(each.ravel() for each in places[::1 if axis == 0 else -1]))
        known.update(zip(new, psfs.reshape(len(new), across_mm.size, *psfs.shape[1:]), strict=True))
    at_lines, at_middles = (np.stack([known[place] for place in each]) for each in (line_mm, middles_mm))
    misplaced = np.abs((at_lines[1:] + at_lines[:-1]) / 2 - at_middles).sum(axis=(-2, -1)).mean(axis=1)
    return misplaced * np.diff(line_mm) / np.ptp(line_mm)


def _halved(errors, sizes, tolerance, most):
    """Indices of the intervals along y and along x to halve: those with the largest part of the error, and as many as
    there is room for."""
    worst = sorted(((part, axis, index) for axis, row in enumerate(errors) for index, part in enumerate(row)),
                   reverse=True)
    mean = tolerance / len(worst)
    worst = worst[:max(1, -(-sum(part > mean for part, *_ in worst) // AT_ONCE))]
    chosen, sizes = ([], []), list(sizes)
    for _, axis, index in worst:
        if (sizes[axis] + 1) * sizes[1 - axis] <= most:
            sizes[axis] += 1
            chosen[axis].append(index)
    return [np.array(sorted(each), dtype=int) for each in chosen]
