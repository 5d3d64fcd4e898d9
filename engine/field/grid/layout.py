"""The size of tables of the nodes' PSFs, which determines their cost."""

from dataclasses import dataclass

import numpy as np

from ...lens.conventions import HEIGHTS
from ...lens.grid_lens import GridLens
from ..mirror_symmetry import Planes
from ..psf_samples import refinement
from .nodes import PlaneNodes

NODES_BESIDE = 1.5  # nodes around a section along a side, on average, in addition to its extent over their distance


@dataclass(frozen=True)
class GridLayout:
    """The tables of a lens on pixels of one pitch.

    Attributes
    ----------
    lens : GridLens
    psfs : int
        Number of nodes of the lens data, each with a PSF.
    window_um, sample_um : float
        Sides of a PSF of the lens data, and of its samples, at the resolution that the pixels require.
    """

    lens: GridLens
    psfs: int
    window_um: float
    sample_um: float

    @classmethod
    def of(cls, lens: GridLens, pitch_um: float) -> "GridLayout":
        """The layout of a lens's tables."""
        return cls(lens, lens.y_mm.size * lens.x_mm.size, lens.psf.shape[-1] * lens.psf_pitch_um,
                   lens.psf_pitch_um / refinement(lens.psf_pitch_um, pitch_um))

    def extra_counts(self, pixels: float) -> dict[str, float]:
        """See `TableLayout`."""
        return {"grid node": self.psfs, "grid pixel": pixels}

    def turned(self, steps: int) -> int:
        """The work of computing all PSFs, in units of the PSFs of a rotationally symmetric lens at one azimuth."""
        return -(-self.psfs // HEIGHTS)

    def nodes(self, steps: int, planes: Planes) -> int:
        """Number of nodes: four for each cell, which has them next to each other."""
        rows, columns = PlaneNodes.of(self.lens, planes.grid).shape
        return 4 * (rows - 1) * (columns - 1)

    def nodes_around(self, steps: int, planes: Planes, section_px: int) -> tuple[float, float]:
        """Number of nodes around the sections of a plane: summed over the sections, and without duplicates."""
        nodes, around = PlaneNodes.of(self.lens, planes.grid), 1.0
        for axis, side_px in zip((nodes.rows, nodes.columns), planes.grid.shape_px, strict=True):
            sections = -(-side_px // section_px)
            step_px = float(np.ptp(axis.places_mm)) / (axis.size - 1) / (planes.grid.pitch_um * 1e-3)
            around *= sections * min(section_px / step_px + NODES_BESIDE, axis.size)
        return around, nodes.rows.size * nodes.columns.size
