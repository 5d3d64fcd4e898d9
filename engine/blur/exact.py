"""The exact operator: every pixel spreads by its own PSF. Slow; for tests and for measuring the other ways."""

import numpy as np

BLOCK_PIXELS = 1024  # whose PSFs are turned at once


def filter_exactly(plane, psf_radius_px, node_psfs):
    """Blur a plane (row, column) pixel by pixel, in double precision; black ones have nothing to spread.

    Parameters
    ----------
    plane : array (row, column)
        Ideal irradiance, distorted.
    psf_radius_px : int
    node_psfs : callable (rows, columns) -> array (n, 2 psf_radius_px + 1, 2 psf_radius_px + 1)
        Unit-sum PSFs of pixels at these positions.

    Returns
    -------
    float64 array (row + 2 psf_radius_px, column + 2 psf_radius_px)
        The plane with a canvas around it that holds all light that leaves it.
    """
    size = 2 * psf_radius_px + 1
    canvas = np.zeros((plane.shape[0] + size - 1, plane.shape[1] + size - 1))
    rows, columns = np.nonzero(plane)
    for start in range(0, rows.size, BLOCK_PIXELS):
        block = rows[start:start + BLOCK_PIXELS], columns[start:start + BLOCK_PIXELS]
        for row, column, psf in zip(*block, node_psfs(*block)):
            canvas[row:row + size, column:column + size] += float(plane[row, column]) * psf
    return canvas
