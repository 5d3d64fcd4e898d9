"""The PSFs of a lens on a picture's pixels: their reach, the pixels that they cover, and their errors.

The PSF of every pixel is a mixture of those of the nodes around it, and a table contains these. The only error is
trimmed light, which is missing outside and, because the rest is normalised, in excess by the same amount inside; in the
same pixels, often, for PSFs in a few pixels. The error of a mixture is at most the largest error of its parts: it is
sufficient to examine the nodes.
"""

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from ...image.sampling import Sampling
from ...lens.grid_lens import GridLens
from ...runtime.threads import thread_pool
from ..mirror_symmetry import Planes
from ..psf_samples import FEW_PX, EnclosedLight, covered_px, samples_reach_px, supported_radius_px, telling_wavelengths
from .node_psfs import NodePsfs, PlacedPsfs
from .nodes import PlaneNodes
from .uniform_light import unevenness

UNIFORM_WAVELENGTHS = 3  # to examine


class PicturePsfs:
    """The PSFs of a lens on the pixels of a picture, at the `telling_wavelengths`.

    Parameters
    ----------
    lens : GridLens
    sampling : Sampling
    most_energy : float
        The largest fraction of a PSF that will be used.

    Raises
    ------
    ImageError
        If the pixel pitch is so small that PSFs exceed LARGEST_PSF_RADIUS_PX.
    LensError
        If a wavelength is outside the lens data.
    """

    def __init__(self, lens: GridLens, sampling: Sampling, most_energy: float) -> None:
        self.full_radius_px = supported_radius_px(lens, sampling.grid.pitch_um)
        self._optics = [lens.at_wavelength(nm) for nm in telling_wavelengths(lens, sampling)]
        self._lens, self._grid, self._most_energy = lens, sampling.grid, most_energy
        self._nodes = PlaneNodes.of(lens, sampling.grid)

    @cached_property
    def _enclosed(self):
        """The light in circles of the PSFs of all nodes, for each wavelength: lists of rows of batches."""
        rows, columns = (np.unique(axis.indices) for axis in (self._nodes.rows, self._nodes.columns))
        psfs = [NodePsfs(optics, self._grid.pitch_um) for optics in self._optics]

        def of_row(index, row):
            return [(samples.enclosed, samples.sample_size_px) for _, samples in psfs[index].samples(row, columns)]

        with thread_pool() as pool:
            found = list(pool.map(lambda at: of_row(*at), [(n, row) for n in range(len(psfs)) for row in rows]))
        return [found[start:start + rows.size] for start in range(0, len(found), rows.size)]

    def reach(self, energy: float) -> tuple[int, float]:
        """Radius in pixels of PSFs trimmed to this energy, and the mean number of pixels that they cover."""
        if energy >= 1:
            return self.full_radius_px, float(covered_px(np.array(self.full_radius_px - 1), 0))
        sample_px = self._enclosed[0][0][0][1]
        supports = np.array([self._by_node(of, lambda light: light.support_px(energy)) for of in self._enclosed])
        radius_px = min(self.full_radius_px, samples_reach_px(supports.max(), sample_px))
        taps = self._nodes.at_nodes(covered_px(supports, sample_px).mean(axis=0))
        most = np.max([taps[:-1, :-1], taps[:-1, 1:], taps[1:, :-1], taps[1:, 1:]], axis=0)
        return radius_px, float((self._nodes.shares(self._grid.frame()) * most).sum())

    def mixing(self, energy: float, planes: Planes) -> Iterator[float]:
        """Yield the error of PSFs trimmed to this energy, wavelength by wavelength."""
        for optics, lost in zip(self._optics, self._lost(energy), strict=True):
            yield min(lost, self._trim_error(optics, energy)) if lost and self._few(energy) else lost

    def _lost(self, energy):
        """Yield twice the largest light that PSFs lose when trimmed to this energy, wavelength by wavelength."""
        for enclosed in self._enclosed:
            yield 0.0 if energy >= 1 else 2 * float(self._by_node(enclosed, lambda light: light.lost(energy)).max())

    def _few(self, energy):
        """Whether PSFs trimmed to this energy are in a few pixels."""
        return self.reach(energy)[0] <= FEW_PX

    def _trim_error(self, optics, energy):
        """Largest error of trimmed PSFs: of PSFs in a few pixels, much light is missing and in excess in the same
        pixels."""
        rows, columns = (np.unique(axis.indices) for axis in (self._nodes.rows, self._nodes.columns))
        used, complete = self._trimmed_and_complete(optics, energy)
        return max(_largest_difference(used.squares(row, columns), complete.squares(row, columns)) for row in rows)

    def _trimmed_and_complete(self, optics, energy):
        """The NodePsfs trimmed to this energy, and the complete ones."""
        radius_px, _ = self.reach(energy)
        return (NodePsfs(optics, self._grid.pitch_um, lambda psfs: psfs.trimmed(energy, radius_px)),
                NodePsfs(optics, self._grid.pitch_um))

    def mixing_error(self, wavelengths: list[float], steps: int) -> float:
        """Largest error of trimmed PSFs mixed from a table."""
        return max(wavelengths)

    def mixing_estimate(self, wavelength: float, steps: int) -> float:
        """As `mixing_error` for one wavelength."""
        return wavelength

    def one_psf_error(self, energy: float, planes: Planes, enough: float) -> float:
        """Largest error of the PSF in the middle of the planes for the complete field, or some error above `enough`."""
        nodes, worst = PlaneNodes.of(self._lens, planes.grid), 0.0
        middle = [np.array([(n - 1) / 2]) for n in planes.grid.shape_px]
        for optics, lost in zip(self._optics, self._lost(energy), strict=True):
            psfs, complete = (PlacedPsfs(of, 0.0, nodes, planes) for of in self._trimmed_and_complete(optics, energy))
            true, lost = (complete, 0.0) if self._few(energy) else (psfs, lost)
            psf, rows = psfs.psfs(*middle)[0], range(nodes.shape[0])
            for row in (rows[-1], *rows[:-1]):  # mostly, the last PSFs differ most
                worst = max(worst, lost + _largest_difference(psf, true.row_of_nodes(row)))
                if worst > enough:
                    return worst
        return worst

    def uniform_light_error(self) -> float:
        """Largest relative error of a pixel under uniform radiance, from a few wavelengths."""
        some = np.unique(np.linspace(0, len(self._optics) - 1, UNIFORM_WAVELENGTHS).round().astype(int))
        radius_px, _ = self.reach(self._most_energy)
        nodes = PlaneNodes.of(self._lens, self._grid.within_reach(radius_px))
        return max(unevenness(NodePsfs(self._optics[index], self._grid.pitch_um,
                                       lambda psfs: psfs.trimmed(self._most_energy, radius_px)), nodes)
                   for index in some)

    @staticmethod
    def _by_node(rows: list[list[tuple[EnclosedLight, float]]], of) -> np.ndarray:
        """A figure of each PSF: array (row, column) of the nodes in the lens data."""
        return np.array([np.concatenate([of(enclosed) for enclosed, _ in batches]) for batches in rows])


def _largest_difference(used, true):
    """Largest sum of |difference| between PSFs (..., row, column) and true ones, which may be wider."""
    rim = (true.shape[-1] - used.shape[-1]) // 2
    around = [(0, 0)] * (used.ndim - 2) + [(rim, rim)] * 2
    return float(np.abs(np.pad(used, around) - true).sum(axis=(-2, -1)).max())
