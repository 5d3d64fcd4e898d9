"""Overlap-add: divide the picture into sections, spread the light of each into a patch, sum the patches (Eq. 7-9)."""


import numpy as np

from ..runtime.threads import thread_count, thread_pool
from .method import Spreader
from .section_needs import SectionNeeds

ROWS_PER_CORE = 3  # prepared together: enough to avoid idle cores, and few enough for memory


def overlap_add(light: np.ndarray, spreader: Spreader, needs: SectionNeeds) -> np.ndarray:
    """Spread the light of every lit section and sum the patches.

    Parameters
    ----------
    light : array (plane, row, column)
        Ideal irradiance. The sum has the same precision.
    spreader : Spreader
    needs : SectionNeeds

    Returns
    -------
    array (plane, row + 2 radius_px, column + 2 radius_px)
        The planes with a margin for the light that leaves them.
    """
    at_once = spreader.at_once(light, needs.lit)
    if at_once is not None:
        return at_once
    size, space, radius = spreader.section_size, spreader.space_px, spreader.radius_px
    count, rows, columns = light.shape
    down, across = needs.lit.shape
    canvas = np.zeros((count, down * size + space, across * size + space), light.dtype)

    def patches(i):
        band = light[:, i * size:(i + 1) * size]
        if band.shape[1:] != (size, across * size):
            band = np.pad(band, ((0, 0), (0, size - band.shape[1]), (0, across * size - columns)))
        for precision, chosen in ((np.float32, needs.lit[i] & ~needs.double[i]), (np.float64, needs.double[i])):
            if chosen.any():
                yield from spreader.spread(i, np.flatnonzero(chosen), band.astype(precision, copy=False))

    def strip(i):
        spread = None
        for left, patch in patches(i):
            if spread is None and patch.dtype == light.dtype and patch.shape[2] == across * size + 2 * radius:
                spread = patch  # of all sections
                continue
            if spread is None:
                spread = np.zeros((count, space, canvas.shape[2]), light.dtype)
            spread[:, :patch.shape[1], left:left + patch.shape[2]] += patch
        return spread

    lit_rows = np.flatnonzero(needs.lit.any(axis=1))
    step = ROWS_PER_CORE * thread_count()
    with thread_pool() as pool:
        for start in range(0, lit_rows.size, step):
            chunk = lit_rows[start:start + step]
            spreader.prepare(chunk, needs, pool)
            for i, spread in zip(chunk, pool.map(strip, chunk), strict=True):  # in order, independent of threads
                canvas[:, i * size:i * size + spread.shape[1], :spread.shape[2]] += spread
    return canvas[:, :rows + 2 * radius, :columns + 2 * radius]
