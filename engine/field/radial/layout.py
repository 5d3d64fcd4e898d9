"""The size of tables of PSFs over heights and azimuths, which determines their cost."""

from dataclasses import dataclass

import numpy as np

from ...lens.radial_lens import RadialLens
from ..mirror_symmetry import Planes
from ..psf_samples import refinement

NODES_BESIDE, OVER_EDGE = 2, 1.1  # nodes around a section in addition to those in it; its extent over its side


@dataclass(frozen=True)
class RadialLayout:
    """The tables of a lens on pixels of one pitch: each step is an azimuth from 0 to 45 degrees.

    Attributes
    ----------
    psfs : int
        Number of field heights of the lens data, each with a PSF.
    height_px : float
        Distance between adjacent heights.
    window_um, sample_um : float
        Sides of a PSF of the lens data, and of its samples, at the resolution that the pixels require.
    mirror_symmetric : bool
        Whether the PSFs are mirror-symmetric.
    """

    psfs: int
    height_px: float
    window_um: float
    sample_um: float
    mirror_symmetric: bool

    @classmethod
    def of(cls, lens: RadialLens, pitch_um: float) -> "RadialLayout":
        """The layout of a lens's tables."""
        heights = lens.heights_mm.size
        height_um = 1e3 * lens.real_height_mm[:, -1].max() / heights
        return cls(heights, height_um / pitch_um, lens.psf.shape[-1] * lens.psf_pitch_um,
                   lens.psf_pitch_um / refinement(lens.psf_pitch_um, pitch_um), lens.mirror_symmetric)

    def extra_counts(self, pixels: float) -> dict[str, float]:
        """See `TableLayout`."""
        return {}

    def turned(self, steps: int) -> int:
        """Number of azimuths that PSFs are turned to; the others are mirror images of these."""
        return steps if self.mirror_symmetric else 2 * steps

    def nodes(self, steps: int, planes: Planes) -> int:
        """Number of nodes: heights times azimuths."""
        return 2 * planes.quarter_turns * steps * self.psfs

    def nodes_around(self, steps: int, planes: Planes, section_px: int) -> tuple[float, float]:
        """Number of nodes around the sections of a plane: summed over the sections, and without duplicates."""
        rows, columns = ((np.arange(-(-n // section_px)) + 0.5) * section_px - centre
                         for n, centre in zip(planes.grid.shape_px, planes.grid.centre_px, strict=True))
        radius_px = np.maximum(np.hypot(rows[:, None], columns), section_px / 2)
        azimuths = 2 * steps * planes.quarter_turns + 1
        over = OVER_EDGE * section_px
        across = np.minimum(over * steps / (np.pi / 4 * radius_px) + NODES_BESIDE, azimuths)
        along = min(over / self.height_px + NODES_BESIDE, self.psfs)
        nodes = min(self.psfs, radius_px.max() / self.height_px + NODES_BESIDE) * azimuths
        return float((along * across).sum()), nodes
