"""How finely a lens is baked: what each quality takes of heights, rays and sums."""

from dataclasses import dataclass

from .diffraction import Sums
from .rays import HalfPupil


@dataclass(frozen=True, eq=False)
class Quality:
    """How finely a lens is baked.

    Attributes
    ----------
    heights : int
        Field heights, where no other number is asked for.
    pupil : HalfPupil
        The rays of each wavefront.
    traced : int
        Wavelengths that are traced; wavefronts of the others lie between them.
    sums : Sums
    edges : (int, int)
        Radii and azimuths of the pupil's samples by which relative illumination is summed up.
    """

    heights: int
    pupil: HalfPupil
    traced: int
    sums: Sums
    edges: tuple[int, int]


QUALITIES = {
    "preview": Quality(21, HalfPupil(17, 21), 5, Sums(degree=12, oversampling=1.0, repeat=1.3), (48, 64)),
    "standard": Quality(41, HalfPupil(25, 33), 6, Sums(degree=16, oversampling=1.5, repeat=1.6), (96, 128)),
    "reference": Quality(81, HalfPupil(41, 65), 7, Sums(degree=24, oversampling=2.0, repeat=3.0), (200, 256)),
}
