"""Folding a picture onto one quadrant: where the axis is in its middle, four mirrored quadrants have the same PSFs.

A rotationally symmetric lens has PSFs that are mirror-symmetric about the meridional plane, so that the PSF of a
mirrored place is the mirrored PSF. Quadrants flipped onto one another then share one set of PSFs and OTFs.
"""

import numpy as np

SYMMETRY_TOLERANCE = 1e-2
"""L1 distance of a PSF from its mirror image that is taken for noise; half a sample off centre is some 20 times it."""


def mirror_symmetric(psf):
    """PSFs made exactly mirror-symmetric in u, where they are so but for the noise of their making.

    Parameters
    ----------
    psf : array (height, v, u), the chief ray at n // 2

    Returns
    -------
    psf : array (height, v, u), as it was or averaged with its mirror image, then of odd size
    symmetric : bool
    """
    n = psf.shape[-1]
    odd = np.pad(psf, ((0, 0), (0, 1 - n % 2), (0, 1 - n % 2)))  # -n/2 has its partner then
    mirrored = odd[..., ::-1]
    asymmetry = np.abs(odd - mirrored).sum(axis=(-2, -1)).max()
    if asymmetry > SYMMETRY_TOLERANCE:
        return psf, False
    return (odd + mirrored) / 2, True


def quadrants(plane, overlap_px=0):
    """The four quadrants of a plane about its middle, each laid with the axis at its upper left corner.

    Parameters
    ----------
    plane : array (row, column)
    overlap_px : int
        How many rows and columns beyond the axis, at the upper and left edges, come along.

    Returns
    -------
    array (4, ceil(row / 2) + overlap_px, ceil(column / 2) + overlap_px)
        Lower right, upper right, lower left, upper left. The middle line of an odd side is in both its quadrants.
    """
    rows, columns = (slice(n // 2 - overlap_px, None) for n in plane.shape)
    mirrored = plane[::-1]
    return np.stack([plane[rows, columns], mirrored[rows, columns],
                     plane[:, ::-1][rows, columns], mirrored[:, ::-1][rows, columns]])


def quadrant_grid(shape_px):
    """Rows and columns of the quadrants of a plane, and row and column of the axis in their index terms."""
    return tuple(-(-n // 2) for n in shape_px), tuple(0.0 if n % 2 else -0.5 for n in shape_px)


def without_doubles(parts, shape_px):
    """Quadrants of a plane of this shape, in place, with their middle lines left to the right and lower ones alone."""
    if shape_px[0] % 2:
        parts[1::2, 0] = 0
    if shape_px[1] % 2:
        parts[2:, :, 0] = 0
    return parts


def unfold(canvases, shape_px, psf_radius_px):
    """The canvas of the whole plane, from those of its quadrants without doubles; the inverse but for the canvas.

    Parameters
    ----------
    canvases : array (4, ceil(row / 2) + 2 psf_radius_px, ceil(column / 2) + 2 psf_radius_px)
    shape_px : (int, int)
        Rows and columns of the plane.
    psf_radius_px : int

    Returns
    -------
    array (row + 2 psf_radius_px, column + 2 psf_radius_px)
    """
    rows, columns = (n + 2 * psf_radius_px for n in shape_px)
    part_rows, part_columns = canvases.shape[1:]
    lower, right = slice(rows - part_rows, None), slice(columns - part_columns, None)
    upper, left = slice(part_rows), slice(part_columns)
    canvas = np.zeros((rows, columns), canvases.dtype)
    canvas[lower, right] += canvases[0]
    canvas[upper, right] += canvases[1, ::-1]
    canvas[lower, left] += canvases[2, :, ::-1]
    canvas[upper, left] += canvases[3, ::-1, ::-1]
    return canvas
