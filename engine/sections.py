"""Shift-variant filtering, isoplanatic section by section (Eq. 7-9, section 2.2.3).

The image is tiled into sections. Inside a section of order p the PSF at a source pixel is interpolated from p x p
nodes of that section by separable Lagrange weights:

    spectrum of a section = sum over its nodes of OTF_node * FT{weight_node * section}

Order 1 is the paper's method: one PSF for the section, that of its middle. At order 2 the nodes are the section's
corners, shared with its neighbours: bilinear interpolation, which leaves no seams and whose weights are never
negative. Orders 3 and 4 take Chebyshev nodes, of the least error; their weights can be slightly negative.
"""

import os
from dataclasses import dataclass

import numpy as np
from scipy import fft

ORDERS = (1, 2, 3, 4)


@dataclass(frozen=True, eq=False)
class AxisNodes:
    """Nodes of the sections along one axis of the image.

    Attributes
    ----------
    positions : array (node,)
        In index terms of the image.
    of_section : int array (section, order)
        Which nodes belong to each section.
    weights : array (order, section_size)
        Interpolation weights of a section's nodes; those of each pixel sum to 1.
    """

    positions: np.ndarray
    of_section: np.ndarray
    weights: np.ndarray


def axis_nodes(length_px, section_size, order):
    """Nodes of the sections that cover an axis; the last section may reach beyond it."""
    sections = -(-length_px // section_size)
    unit = {1: np.zeros(1), 2: np.array([-1.0, 1.0])}.get(order, -np.cos(np.pi * (np.arange(order) + 0.5) / order))
    within = (unit + 1) / 2 * section_size - 0.5
    every = np.arange(sections)[:, None] * section_size + within
    if order == 2:  # a section's last node is the next one's first
        positions = np.append(every[:, 0], every[-1, 1])
        of_section = np.arange(sections)[:, None] + np.arange(2)
    else:
        positions, of_section = every.ravel(), np.arange(sections * order).reshape(sections, order)
    return AxisNodes(positions, of_section, _lagrange_weights(unit, section_size))


def _lagrange_weights(nodes, section_size):
    """Lagrange polynomials of nodes in [-1, 1], at the pixels of a section: array (node, section_size)."""
    pixel = (np.arange(section_size) + 0.5) / section_size * 2 - 1
    return np.stack([np.prod([(pixel - other) / (node - other) for other in nodes if other != node], axis=0)
                     * np.ones(section_size) for node in nodes])


def filter_sections(planes, section_size, order, space_px, psf_radius_px, node_psfs):
    """Blur planes with PSFs that vary over them: a scatter, every source pixel spreading by its own PSF.

    Parameters
    ----------
    planes : float array (plane, row, column)
        Ideal irradiance, distorted; all planes have the same PSFs. Their precision is that of the work.
    section_size : int
    order : 1 to 4
    space_px : int
        Side of the computational space, at least section_size + 2 psf_radius_px.
    psf_radius_px : int
    node_psfs : callable (rows, columns) -> array (n, 2 psf_radius_px + 1, 2 psf_radius_px + 1)
        Unit-sum PSFs for nodes at these positions, in index terms of the planes.

    Returns
    -------
    array (plane, row + 2 psf_radius_px, column + 2 psf_radius_px)
        The planes with a canvas around them that holds all light that leaves them.
    """
    count, rows, columns = planes.shape
    across, down = (axis_nodes(length, section_size, order) for length in (columns, rows))
    padded = np.zeros((count, len(down.of_section) * section_size, len(across.of_section) * section_size), planes.dtype)
    padded[:, :rows, :columns] = planes
    canvas = np.zeros((count, padded.shape[1] + space_px, padded.shape[2] + space_px), planes.dtype)
    otfs = {}
    for i, node_rows in enumerate(down.of_section):
        top = i * section_size
        band = padded[:, top:top + section_size]
        if not band.any():  # black: nothing to spread
            continue
        otfs = {row: otfs[row] if row in otfs else
                _otfs(node_psfs, down.positions[row], across.positions, space_px, planes.dtype) for row in node_rows}
        sections = band.reshape(count, section_size, -1, section_size).swapaxes(1, 2)
        spectrum = _filtered_spectrum(sections, down, across, [otfs[row] for row in node_rows], space_px)
        filtered = fft.irfft2(spectrum, (space_px, space_px), workers=os.cpu_count())
        for j in range(len(across.of_section)):
            left = j * section_size
            canvas[:, top:top + space_px, left:left + space_px] += filtered[:, j]
    return canvas[:, :rows + 2 * psf_radius_px, :columns + 2 * psf_radius_px]


def _otfs(node_psfs, row, columns, space_px, precision):
    """OTFs of one row of nodes: array (node, space_px, space_px // 2 + 1)."""
    psfs = node_psfs(np.full(columns.size, row), columns).astype(precision, copy=False)
    return fft.rfft2(psfs, (space_px, space_px), workers=os.cpu_count())


def _filtered_spectrum(sections, down, across, otf_rows, space_px):
    """Spectra of a row of sections, (plane, section, row, column), each filtered by its nodes.

    The weights are separable: weigh and transform along x first, then along y, where half the work is spared.
    """
    along_x = fft.rfft(sections[:, :, None] * across.weights.astype(sections.dtype)[:, None, :], space_px,
                       workers=os.cpu_count())
    total = 0
    for weight, otfs in zip(down.weights.astype(sections.dtype), otf_rows):
        spectrum = fft.fft(along_x * weight[:, None], space_px, axis=-2, workers=os.cpu_count(), overwrite_x=True)
        spectrum *= otfs[across.of_section]
        total = total + spectrum.sum(axis=2)
    return total
