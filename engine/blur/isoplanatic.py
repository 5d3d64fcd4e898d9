"""Sections filtered by their spectra, with PSFs interpolated inside each of them (Eq. 7-9, section 2.2.3).

Inside a section of order p the PSF at a source pixel is interpolated from p x p nodes of that section by separable
Lagrange weights:

    spectrum of a section = sum over its nodes of OTF_node * FT{weight_node * section}

Order 1 is the paper's method: one PSF for the section, that of its middle. At order 2 the nodes are the section's
corners, shared with its neighbours: bilinear interpolation, which leaves no seams and whose weights are never
negative. Orders 3 and 4 take Chebyshev nodes, of the least error; their weights can be slightly negative. Where that
must not be, their nodes are spread evenly from edge to edge, with straight lines between them.
"""

from dataclasses import dataclass

import numpy as np
from scipy import fft

ORDERS = (1, 2, 3, 4)
BATCH_VALUES = 1 << 18


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


def axis_nodes(length_px, section_size, order, non_negative=False):
    """Nodes of the sections that cover an axis; the last section may reach beyond it. Order 0: one node for all."""
    sections = np.arange(-(-length_px // section_size))[:, None]
    if order == 0:
        return AxisNodes(np.array([(length_px - 1) / 2]), np.zeros_like(sections), np.ones((1, section_size)))
    pixel = (np.arange(section_size) + 0.5) / section_size * 2 - 1
    on_edges = order == 2 or (non_negative and order > 2)
    if on_edges:  # a section's last node is the next one's first
        unit = np.linspace(-1, 1, order)
        of_section = sections * (order - 1) + np.arange(order)
    else:
        unit = np.sin(np.pi * (np.arange(order) - (order - 1) / 2) / order)  # 0 to the last digit in the middle
        of_section = sections * order + np.arange(order)
    positions = np.empty(of_section[-1, -1] + 1)
    positions[of_section] = (sections + (unit + 1) / 2) * section_size - 0.5
    weights = np.stack([np.interp(pixel, unit, row) for row in np.eye(order)]) if on_edges else _lagrange(unit, pixel)
    return AxisNodes(positions, of_section, weights)


def _lagrange(nodes, positions):
    """Lagrange polynomials of nodes at positions: array (node, position)."""
    return np.stack([np.prod([(positions - other) / (node - other) for other in nodes if other != node], axis=0)
                     * np.ones(positions.size) for node in nodes])


class FourierSections:
    """Spreads the light of sections by products of spectra.

    Parameters
    ----------
    shape_px : (int, int)
        Rows and columns of the planes.
    section_size, space_px, psf_radius_px : int
        The computational space is at least section_size + 2 psf_radius_px, so that nothing wraps around.
    order : 0 to 4
        0 for a lens whose PSF is the same all over.
    non_negative : bool
    node_psfs : callable (rows, columns) -> array (n, 2 psf_radius_px + 1, 2 psf_radius_px + 1)
        Unit-sum PSFs for nodes at these positions, in index terms of the planes.
    room : Room
        For the OTFs of rows that are done, to keep them for the next picture.
    """

    def __init__(self, shape_px, section_size, order, space_px, psf_radius_px, node_psfs, room, *,
                 non_negative=False):
        self.section_size, self.space_px, self.radius_px = section_size, space_px, psf_radius_px
        self._down, self._across = (axis_nodes(length, section_size, order, non_negative) for length in shape_px)
        self._node_psfs, self._room = node_psfs, room
        self._otfs, self._kept = {}, set()

    def prepare(self, rows, content, pool):
        """Make the OTFs that the lit sections of these rows need."""
        wanted = {}
        for i in rows:
            for precision, lit in ((np.complex64, content.lit[i] & ~content.double[i]),
                                   (np.complex128, content.double[i])):
                if lit.any():
                    nodes = np.unique(self._across.of_section[lit])
                    for row in self._down.of_section[i]:
                        wanted.setdefault((row, precision), []).append(nodes)
        self._otfs = {key: otfs for key, otfs in self._otfs.items() if key in wanted or key in self._kept}
        list(pool.map(self._make_otfs, wanted, wanted.values()))

    def _make_otfs(self, key, nodes):
        row, precision = key
        columns, side = self._across.positions, self.space_px
        otfs, made = self._otfs.setdefault(key, (np.empty((columns.size, side, side // 2 + 1), precision),
                                                 np.zeros(columns.size, dtype=bool)))
        if key not in self._kept and self._room.take(otfs.nbytes):
            self._kept.add(key)
        missing = [node for node in np.unique(np.concatenate(nodes)) if not made[node]]
        if missing:
            psfs = self._node_psfs(np.full(len(missing), self._down.positions[row]), columns[missing])
            real = np.float32 if precision == np.complex64 else np.float64
            otfs[missing] = fft.rfft2(psfs.astype(real, copy=False), (side, side))
            made[missing] = True

    def spread(self, i, columns, band):
        """Patches of the light of these sections of row i, in a band (plane, row, column), and where each begins."""
        size, lit = self.section_size, self.section_size + 2 * self.radius_px  # what is beyond is rounding
        sections = band.reshape(len(band), size, -1, size).swapaxes(1, 2)
        step = max(1, BATCH_VALUES // (len(band) * self.space_px**2))
        for some in (columns[start:start + step] for start in range(0, columns.size, step)):
            spectrum = self._filtered(i, some, sections[:, some])
            patches = fft.irfft2(spectrum, (self.space_px, self.space_px), overwrite_x=True)[..., :lit, :lit]
            yield from zip(some * size, patches.swapaxes(0, 1))

    def _filtered(self, i, columns, sections):
        """Spectra of sections, (plane, section, row, column), filtered by their nodes and summed.

        The weights are separable: weigh and transform along x first, then along y, where half the work is spared.
        """
        side, precision = self.space_px, np.result_type(sections.dtype, np.complex64).type
        members = self._across.of_section[columns]
        weights_x, weights_y = (nodes.weights.astype(sections.dtype) for nodes in (self._across, self._down))
        along_x = fft.rfft(sections[:, :, None] * weights_x[:, None, :], side)
        total = None
        for row, weight in zip(self._down.of_section[i], weights_y):
            spectrum = fft.fft(along_x * weight[:, None], side, axis=-2, overwrite_x=True)
            spectrum *= self._otfs[row, precision][0][members]
            spectrum = spectrum.sum(axis=2) if len(weights_x) > 1 else spectrum[:, :, 0]
            total = spectrum if total is None else np.add(total, spectrum, out=total)
        return total
