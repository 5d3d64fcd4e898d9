"""PSFs of the nodes on the sensor's pixel grid, and the PSF of each pixel as a mixture of four of them."""

from collections.abc import Callable, Iterator
from functools import lru_cache

import numpy as np

from ...lens.grid_lens import MonochromaticGrid
from ..mirror_symmetry import Planes
from ..psf_samples import PsfSamples, refinement, samples_of
from ..psf_table import corners_between
from .nodes import PlaneNodes

UPWARDS = np.array([np.pi / 2])  # the azimuth at which v of the lens data points upwards, and u to the right
BATCH_VALUES = 1 << 21  # samples that are computed together
CACHED_ROWS = 4  # of nodes

Part = Callable[[PsfSamples], PsfSamples]


class NodePsfs:
    """The PSFs of the nodes of the lens data at one wavelength.

    The PSFs of nodes on a line of symmetry are made symmetric, because their mirror images are those of the same nodes.

    Parameters
    ----------
    optics : MonochromaticGrid
    pitch_um : float
        Of the pixels.
    part : callable (PsfSamples) -> PsfSamples
        Returns the part of the complete PSFs to use, such as the trimmed ones.
    """

    def __init__(self, optics: MonochromaticGrid, pitch_um: float, part: Part = lambda psfs: psfs) -> None:
        self._psf, self._sample_um, self._pitch_um, self._part = optics.psf, optics.psf_pitch_um, pitch_um, part
        if any(optics.mirrored):
            self._psf = _symmetric(self._psf, optics.mirrored)
        samples = ((self._psf.shape[-1] - 1) * refinement(self._sample_um, pitch_um) + 1) ** 2
        self._batch = max(1, BATCH_VALUES // samples)

    def samples(self, row: int, columns: np.ndarray) -> Iterator[tuple[slice, PsfSamples]]:
        """Yield the samples of nodes of a row by batches: slices of `columns`, and their PSFs."""
        for start in range(0, len(columns), self._batch):
            some = slice(start, min(start + self._batch, len(columns)))
            yield some, self._part(samples_of(self._psf[row, columns[some]], self._sample_um, self._pitch_um))

    def squares(self, row: int, columns: np.ndarray) -> np.ndarray:
        """PSFs of nodes of a row: float64 array (node, row, column), odd square, the chief ray in the middle."""
        return np.concatenate([samples.turned(UPWARDS)[0] for _, samples in self.samples(row, columns)])


class PlacedPsfs:
    """The PSFs of a lens at the pixels of planes.

    Parameters
    ----------
    psfs : NodePsfs
    extent_mm : float
        Distance from the axis that the lens data reach.
    nodes : PlaneNodes
        Around the pixels of a plane.
    planes : Planes
    """

    def __init__(self, psfs: NodePsfs, extent_mm: float, nodes: PlaneNodes, planes: Planes) -> None:
        self.nodes, self.extent_mm, self.planes = nodes, extent_mm, planes
        self._psfs, self._row = psfs, lru_cache(CACHED_ROWS)(self._row_of_nodes)

    @property
    def nbytes(self) -> int:
        """Memory of the PSFs that it caches."""
        return CACHED_ROWS * self._row(0).nbytes

    def place(self, rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places where the light of these pixels lands: (down_mm, right_mm) from the axis."""
        return self.nodes.place(rows, columns)

    def psfs(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """PSFs of these pixels: float64 array (n, row, column), unit sums, the chief ray in the middle."""
        down_mm, right_mm = self.place(np.asarray(rows), np.asarray(columns))
        corners, weights = corners_between(self.nodes.rows.position(down_mm), self.nodes.columns.position(right_mm),
                                           self.nodes.shape, float)
        corner_rows, corner_columns = np.divmod(corners, self.nodes.shape[1])
        psfs_of = {int(row): self.row_of_nodes(int(row)) for row in np.unique(corner_rows)}
        return np.stack([sum(weight * psfs_of[row][column] for row, column, weight in zip(*pixel, strict=True))
                         for pixel in zip(corner_rows.T.tolist(), corner_columns.T, weights.T, strict=True)])

    def row_of_nodes(self, row: int) -> np.ndarray:
        """PSFs of a row of the plane's nodes: array (node, row, column)."""
        return self._row(row)

    def _row_of_nodes(self, row):
        axis = self.nodes.columns
        psfs = self._psfs.squares(self.nodes.rows.indices[row], axis.indices)
        if self.nodes.rows.flipped[row]:
            psfs = psfs[:, ::-1]
        return np.where(axis.flipped[:, None, None], psfs[:, :, ::-1], psfs)


def _symmetric(psf, mirrored):
    """PSFs (row, column, v, u) of odd size, symmetric at the first row and column of nodes where these are mirrored."""
    even = 1 - psf.shape[-1] % 2
    psf = np.pad(psf, ((0, 0), (0, 0), (0, even), (0, even)))  # gives -n/2 a partner
    if mirrored[0]:
        psf[0] = (psf[0] + psf[0, :, ::-1]) / 2
    if mirrored[1]:
        psf[:, 0] = (psf[:, 0] + psf[:, 0, :, ::-1]) / 2
    return psf
