"""Overlap-add: the picture cut into sections, the light of each spread into a patch, the patches summed (Eq. 7-9)."""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np

ROWS_PER_CORE = 3  # prepared at once: enough that no core waits long for another, few enough for memory


def overlap_add(planes, spreader, content):
    """Spread the light of every lit section and sum what comes out.

    Parameters
    ----------
    planes : array (plane, row, column)
        Ideal irradiance, distorted. Their precision is that of the sum.
    spreader : PolarSections, PixelSections or FourierSections
        `section_size`, `space_px` and `radius_px`; `prepare(rows, content, pool)` before these rows of sections; and
        `spread(i, columns, band)`, which gives patches of the light of these sections of row i, and at which column
        each begins. Patches begin `radius_px` above and left of their sections and are up to `space_px` high.
    content : Content

    Returns
    -------
    array (plane, row + 2 radius_px, column + 2 radius_px)
        The planes with a canvas around them that holds all light that leaves them.
    """
    size, space, radius = spreader.section_size, spreader.space_px, spreader.radius_px
    count, rows, columns = planes.shape
    down, across = content.lit.shape
    canvas = np.zeros((count, down * size + space, across * size + space), planes.dtype)

    def strip(i):
        band = np.zeros((count, size, across * size), planes.dtype)
        part = planes[:, i * size:(i + 1) * size]
        band[:, :part.shape[1], :columns] = part
        spread = np.zeros((count, space, canvas.shape[2]), planes.dtype)
        for precision, chosen in ((np.float32, content.lit[i] & ~content.double[i]), (np.float64, content.double[i])):
            if chosen.any():
                for left, patch in spreader.spread(i, np.flatnonzero(chosen), band.astype(precision, copy=False)):
                    spread[:, :patch.shape[1], left:left + patch.shape[2]] += patch
        return spread

    lit_rows = np.flatnonzero(content.lit.any(axis=1))
    step = ROWS_PER_CORE * os.cpu_count()
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for start in range(0, lit_rows.size, step):
            chunk = lit_rows[start:start + step]
            spreader.prepare(chunk, content, pool)
            for i, spread in zip(chunk, pool.map(strip, chunk)):  # in order: the same with any number of threads
                canvas[:, i * size:i * size + space] += spread
    return canvas[:, :rows + 2 * radius, :columns + 2 * radius]
