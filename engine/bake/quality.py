"""Bake qualities: field heights, rays and sums of each."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..rays.rays import FullPupil, HalfPupil
from .diffraction import Sums


@dataclass(frozen=True, eq=False)
class Quality:
    """Settings of a bake quality.

    Attributes
    ----------
    between : float
        Share of misplaced light allowed halfway between two field heights, averaged over the picture; inf for
        `most_heights` at equal distances in it.
    most_heights : int
        Limit of field heights, even if the error is larger; the lens's notes then state the error.
    most_nodes : int
        Limit of the nodes of a quadrant of a lens without rotational symmetry, as `most_heights`; twice as many for a
        lens without mirror symmetry.
    picture_px : int
        PSF samples are no larger than the pixels of a picture of this width, within the limits of their number.
    pupil : HalfPupil
        Rays of each wavefront.
    traced : int
        Number of traced wavelengths; wavefronts at other wavelengths are interpolated.
    sums : Sums
    edges : (int, int)
        Radii and azimuths of the pupil's samples for relative illumination.
    """

    between: float
    most_heights: int
    most_nodes: int
    picture_px: int
    pupil: HalfPupil
    traced: int
    sums: Sums
    edges: tuple[int, int]

    @cached_property
    def full_pupil(self) -> FullPupil:
        """Rays of each wavefront across the complete stop, as close as in `pupil`."""
        radii, azimuths = self.pupil.shape
        return FullPupil(radii, 2 * (azimuths - 1))


QUALITIES = {
    "preview": Quality(0.03, 41, 100, 1920, HalfPupil(17, 21), 5,
                       Sums(degree=12, oversampling=0.9, repeat=1.1, fringes=11.5, beyond=0.02), (48, 64)),
    "standard": Quality(0.01, 81, 300, 2880, HalfPupil(25, 33), 6,
                        Sums(degree=16, oversampling=1.3, repeat=1.3, fringes=13.5, beyond=0.01), (96, 128)),
    "reference": Quality(0.002, 161, 1000, 3840, HalfPupil(41, 65), 7,
                         Sums(degree=20, oversampling=2.0, repeat=3.0, fringes=np.inf, beyond=0.001), (96, 128)),
}

SKETCH = replace(QUALITIES["preview"], between=np.inf, most_heights=4, edges=(24, 32))
"""For pixels of a 160th of the picture: distortion within 0.3 px, relative illumination within 0.05, except at the end
of a fisheye's field."""
