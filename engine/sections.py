"""Shift-variant filtering, isoplanatic section by section (Eq. 7-9, section 2.2.3).

The image is tiled into sections. Inside a section of order p the PSF at a source pixel is interpolated from p x p
nodes of that section by separable Lagrange weights:

    spectrum of a section = sum over its nodes of OTF_node * FT{weight_node * section}

Order 1 is the paper's method: one PSF for the section, that of its middle. At order 2 the nodes are the section's
corners, shared with its neighbours: bilinear interpolation, which leaves no seams and whose weights are never
negative.
"""

import os

import numpy as np
from scipy import fft

ORDERS = (1, 2)


def section_weights(section_size, order):
    """Interpolation weights of a section's nodes, along one axis.

    Returns
    -------
    array (order, section_size); the weights of each pixel sum to 1
    """
    if order == 1:
        return np.ones((1, section_size))
    rising = (np.arange(section_size) + 0.5) / section_size
    return np.stack([1 - rising, rising])


def node_positions(length_px, section_size, order):
    """Positions, in index terms, of the nodes of all sections along one axis.

    Returns
    -------
    array (sections * (order - 1) + 1,) for order 2, whose sections share their edges; (sections,) for order 1
    """
    sections = section_count(length_px, section_size)
    if order == 1:
        return np.arange(sections) * section_size + (section_size - 1) / 2
    return np.arange(sections + 1) * section_size - 0.5


def section_count(length_px, section_size):
    """Sections that cover an axis; the last may reach beyond it."""
    return -(-length_px // section_size)


def filter_sections(plane, section_size, order, space_px, psf_radius_px, node_psfs):
    """Blur a plane with PSFs that vary over it: a scatter, every source pixel spreading by its own PSF.

    Parameters
    ----------
    plane : array (row, column)
        Ideal irradiance, distorted.
    section_size : int
    order : 1 or 2
    space_px : int
        Side of the computational space, at least section_size + 2 psf_radius_px.
    psf_radius_px : int
    node_psfs : callable (rows, columns) -> array (n, 2 psf_radius_px + 1, 2 psf_radius_px + 1)
        Unit-sum PSFs for nodes at these positions, in index terms of the plane.

    Returns
    -------
    array (row + 2 psf_radius_px, column + 2 psf_radius_px)
        The plane with a canvas around it that holds all light that leaves it.
    """
    rows, columns = plane.shape
    down, across = section_count(rows, section_size), section_count(columns, section_size)
    padded = np.zeros((down * section_size, across * section_size))
    padded[:rows, :columns] = plane
    canvas = np.zeros((down * section_size + space_px, across * section_size + space_px))
    weights = section_weights(section_size, order)
    node_rows = node_positions(rows, section_size, order)
    node_columns = node_positions(columns, section_size, order)
    otfs = {}

    def row_otfs(node_row):
        """OTFs of one row of nodes; the row that two rows of sections share is made once."""
        if node_row not in otfs:
            psfs = node_psfs(np.full(node_columns.size, node_rows[node_row]), node_columns)
            otfs[node_row] = fft.rfft2(psfs, (space_px, space_px), workers=os.cpu_count())
        return otfs[node_row]

    for i in range(down):
        band = padded[i * section_size:(i + 1) * section_size]
        sections = band.reshape(section_size, across, section_size).transpose(1, 0, 2)
        first_node = i * max(order - 1, 1)
        if not band.any():
            continue
        spectrum = 0
        for a in range(order):
            row_of_otfs = row_otfs(first_node + a)
            for b in range(order):
                weighted = sections * (weights[a][:, None] * weights[b])
                spectrum = spectrum + row_of_otfs[b:b + across] * fft.rfft2(weighted, (space_px, space_px),
                                                                            workers=os.cpu_count())
        filtered = fft.irfft2(spectrum, (space_px, space_px), workers=os.cpu_count())
        for j in range(across):
            canvas[i * section_size:i * section_size + space_px, j * section_size:j * section_size + space_px] += \
                filtered[j]
        for node_row in [n for n in otfs if n < first_node + max(order - 1, 1)]:
            del otfs[node_row]
    return canvas[:rows + 2 * psf_radius_px, :columns + 2 * psf_radius_px]
