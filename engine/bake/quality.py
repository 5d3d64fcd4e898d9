"""How finely a lens is baked: what each quality takes of heights, rays and sums."""

from dataclasses import dataclass

import numpy as np

from .diffraction import Sums
from .rays import HalfPupil


@dataclass(frozen=True, eq=False)
class Quality:
    """How finely a lens is baked.

    Attributes
    ----------
    between : float
        Share of the light that may lie in the wrong place half way between two field heights, in the picture's mean.
    most_heights : int
        No more are taken, were the error larger: the lens's notes tell it then.
    picture_px : int
        PSFs have samples no larger than the pixels of a picture so wide, as far as there are enough of them.
    pupil : HalfPupil
        The rays of each wavefront.
    traced : int
        Wavelengths that are traced; wavefronts of the others lie between them.
    sums : Sums
    edges : (int, int)
        Radii and azimuths of the pupil's samples by which relative illumination is summed up.
    """

    between: float
    most_heights: int
    picture_px: int
    pupil: HalfPupil
    traced: int
    sums: Sums
    edges: tuple[int, int]


QUALITIES = {
    "preview": Quality(0.03, 41, 1920, HalfPupil(17, 21), 5,
                       Sums(degree=12, oversampling=0.9, repeat=1.1, fringes=11.5), (48, 64)),
    "standard": Quality(0.01, 81, 2880, HalfPupil(25, 33), 6,
                        Sums(degree=16, oversampling=1.2, repeat=1.3, fringes=13.5), (96, 128)),
    "reference": Quality(0.002, 161, 3840, HalfPupil(41, 65), 7,
                         Sums(degree=20, oversampling=2.0, repeat=3.0, fringes=np.inf), (200, 256)),
}
