"""Choice of the nodes of a grid on the sensor: as many and as dense as interpolation between their PSFs needs."""

from collections.abc import Callable

import numpy as np

LEAST = 3  # intervals from the axis to the end of the sensor, along the longer side
AT_ONCE = 3  # one in three of the intervals that are too wide is halved before errors are computed again


def first_lines_mm(sensor_mm: tuple[float, float], mirrored: tuple[bool, bool], margin: float
                   ) -> tuple[np.ndarray, np.ndarray]:
    """Lines of the coarsest grid, along y and x, from the axis or across it, to a little beyond the sensor."""
    width_mm, height_mm = sensor_mm
    step_mm = max(sensor_mm) / 2 / LEAST
    lines = []
    for side_mm, half in ((height_mm, mirrored[0]), (width_mm, mirrored[1])):
        count = max(1, round(side_mm / 2 / step_mm))
        lines.append(margin * side_mm / 2 * np.arange(0 if half else -count, count + 1) / count)
    return lines[0], lines[1]


def adaptive_grid_mm(lines_mm: tuple[np.ndarray, np.ndarray], psfs_at: Callable[[np.ndarray, np.ndarray], np.ndarray],
                     tolerance: float, most: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Lines between whose nodes PSFs can be mixed, by halving intervals until the error is small enough.

    Parameters
    ----------
    lines_mm : (array, array)
        Of the coarsest grid, y and x.
    psfs_at : function (y_mm, x_mm)
        PSFs of unit sum at places, (place,) arrays: array (place, wavelength, v, u).
    tolerance : float
        Share of misplaced light allowed in the middle of the grid's cells and of their edges, averaged over the
        picture; inf for the coarsest grid.
    most : int
        Number of nodes.

    Returns
    -------
    y_mm, x_mm : arrays
    error : float
        The actual share; 0 if any is allowed.
    """
    if np.isinf(tolerance):
        return *lines_mm, 0.0
    known = {}
    lines_mm = list(lines_mm)
    while True:
        fine_mm = [np.sort(np.concatenate([line, (line[1:] + line[:-1]) / 2])) for line in lines_mm]
        psfs = _looked_up(known, psfs_at, *fine_mm)
        errors, error = _errors(psfs, *(np.diff(line) for line in lines_mm))
        if error <= tolerance:
            break
        chosen = _halved(errors, [line.size for line in lines_mm], tolerance, most)
        if not any(each.size for each in chosen):
            break
        lines_mm = [np.sort(np.concatenate([line, (line[each] + line[each + 1]) / 2]))
                    for line, each in zip(lines_mm, chosen, strict=True)]
    return *lines_mm, error


def _looked_up(known, psfs_at, y_mm, x_mm):
    """PSFs at the crossings of lines: array (y, x, wavelength, v, u); computed unless they are known."""
    places = [(float(y), float(x)) for y in y_mm for x in x_mm]
    new = [place for place in places if place not in known]
    known.update(zip(new, psfs_at(*np.array(new).reshape(-1, 2).T), strict=True))
    psfs = np.stack([known[place] for place in places])
    return psfs.reshape(y_mm.size, x_mm.size, *psfs.shape[1:])


def _errors(psfs, heights_mm, widths_mm):
    """Misplaced light in the intervals along y and along x, and in all cells, from PSFs at nodes, alternating with those
    between them."""
    def misplaced(mixed, truth):
        return np.abs(mixed - truth).sum(axis=(-2, -1)).mean(axis=-1)

    nodes = psfs[::2, ::2]
    rows, columns = (nodes[1:] + nodes[:-1]) / 2, (nodes[:, 1:] + nodes[:, :-1]) / 2
    over_y = misplaced(rows, psfs[1::2, ::2])
    over_x = misplaced(columns, psfs[::2, 1::2])
    middles = misplaced((columns[1:] + columns[:-1]) / 2, psfs[1::2, 1::2])
    cells = (middles + (over_y[:, 1:] + over_y[:, :-1]) / 2 + (over_x[1:] + over_x[:-1]) / 2) / 3
    error = float(np.average(cells, weights=heights_mm[:, None] * widths_mm))
    return (over_y.mean(axis=1) * heights_mm / heights_mm.sum(), over_x.mean(axis=0) * widths_mm / widths_mm.sum()), error


def _halved(errors, sizes, tolerance, most):
    """Indices of the intervals along y and along x to halve: the worst ones, and as many as there is room for."""
    worst = sorted(((error, axis, index) for axis, row in enumerate(errors) for index, error in enumerate(row)),
                   reverse=True)
    worst = worst[:max(1, -(-sum(error > tolerance for error, *_ in worst) // AT_ONCE))]
    chosen, sizes = ([], []), list(sizes)
    for _, axis, index in worst:
        if (sizes[axis] + 1) * sizes[1 - axis] <= most:
            sizes[axis] += 1
            chosen[axis].append(index)
    return [np.array(sorted(each), dtype=int) for each in chosen]
