"""The exact operator: every pixel spreads by its own PSF. Slow; for tests and for measuring the sections."""

import numpy as np

BLOCK_PIXELS = 4096


def filter_exactly(plane, psf_radius_px, node_psfs):
    """What `filter_sections` comes to as its sections shrink to single pixels, without its FFTs.

    Parameters and result as in `sections.filter_sections`.
    """
    rows, columns = plane.shape
    size = 2 * psf_radius_px + 1
    canvas = np.zeros((rows + size - 1, columns + size - 1))
    band = max(1, BLOCK_PIXELS // columns)
    for start in range(0, rows, band):
        block = np.asarray(plane[start:start + band], dtype=np.float64)
        row, column = np.mgrid[start:start + block.shape[0], :columns]
        psfs = node_psfs(row.ravel(), column.ravel()).reshape(*block.shape, size, size)
        for down in range(size):
            for across in range(size):
                canvas[start + down:start + down + block.shape[0], across:across + columns] += \
                    block * psfs[:, :, down, across]
    return canvas
