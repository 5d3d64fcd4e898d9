"""The data of a rotationally symmetric lens: tables over field heights."""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..runtime.errors import LensError
from ..runtime.values import Value
from .lens import Lens, check_ascending, check_finite
from .spline import Spline
from .symmetry import is_mirror_symmetric

AXIS_SLACK = 0.05  # of the last height: accepted distance of the axial image from the axis; `check_lens` is stricter


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class RadialLens(Lens):
    """Lens-design data of a rotationally symmetric lens, for one object distance.

    Attributes
    ----------
    heights_mm : array (height,), ascending from 0
        Field heights, as *paraxial* image heights: the places of `Lens`'s tables.
    real_height_mm : array (wavelength, height)
        Actual height at which the chief ray meets the image plane.
    psf : float32 array (wavelength, height, v, u)
        +v points radially away from the axis, u along the tangent.

    No light arrives beyond the last height if the relative illumination is 0 there.

    Examples
    --------
    >>> import numpy as np
    >>> from lensfield import RadialLens
    >>> nm, heights_mm = [450.0, 650.0], np.array([0.0, 1.0, 2.0, 3.0])
    >>> table, psf = np.ones((2, 4)), np.zeros((2, 4, 5, 5))
    >>> psf[..., 2, 2] = 1  # all light in the sample of the chief ray
    >>> lens = RadialLens(
    ...     name="MINE", efl_mm=10.0, magnification=-0.1, f_number_effective=2.0, object_distance_mm=100.0,
    ...     entrance_pupil_mm=5.0, sensor_mm=(4.8, 3.6), reference_wavelength_nm=550.0, wavelengths_nm=nm,
    ...     heights_mm=heights_mm, real_height_mm=table * heights_mm * (1 - 0.01 * heights_mm),
    ...     relative_illumination=table, psf=psf, psf_pitch_um=2.5, enclosed_energy=table, transmittance=np.ones(2))
    >>> lens.psf.shape
    (2, 4, 5, 5)
    """

    heights_mm: np.ndarray
    real_height_mm: np.ndarray

    AXES: ClassVar = ("heights_mm",)
    PLACE: ClassVar = "height"
    LENGTHS: ClassVar = (*Lens.LENGTHS, "heights_mm", "real_height_mm")

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """See `Lens`."""
        shapes = super().shapes
        return shapes | {"real_height_mm": shapes["relative_illumination"]}

    @property
    def middle(self) -> tuple[int]:
        """See `Lens`."""
        return (0,)

    @property
    def dark_beyond(self) -> bool:
        """Whether no light arrives beyond the last height."""
        return not self.relative_illumination[:, -1].any()

    @cached_property
    def mirror_symmetric(self) -> bool:
        """Whether the PSFs are symmetric about the meridional plane except for noise, as a centred lens's are."""
        return all(map(is_mirror_symmetric, self.psf))

    def at_wavelength(self, wavelength_nm: float) -> "MonochromaticLens":
        """Lens data for one wavelength. Heights are interpolated as the relative illumination is.

        Raises
        ------
        LensError
            The wavelength is outside the range of the lens data.
        """
        tables = self._tables_at(wavelength_nm)
        return MonochromaticLens(heights_mm=self.heights_mm, capture_focal_length_mm=self.capture_focal_length_mm,
                                 real_height_mm=self.real_height_at(tables["wavelength_nm"]), **tables)

    def real_height_at(self, wavelengths_nm: ArrayLike) -> np.ndarray:
        """Real heights at wavelengths within the lens data: array (..., height)."""
        return self._height_spline(wavelengths_nm)

    @cached_property
    def _height_spline(self):
        return Spline.through(self.wavelengths_nm, self.real_height_mm)

    def _check_axes(self):
        if self.heights_mm.ndim != 1 or self.heights_mm.size < 2:
            raise LensError(self.name, "heights_mm", f"of shape {self.heights_mm.shape}",
                            "expected at least two field heights")

    def _check_landing(self):
        check_finite(self, ("heights_mm", "real_height_mm"))
        check_ascending(self, "heights_mm")
        if self.heights_mm[0] != 0:
            raise LensError(self.name, "heights_mm", f"{self.heights_mm[0]} first", "expected 0, the axis, first")
        _check_real_heights(self)


@dataclass(frozen=True, eq=False, repr=False)
class MonochromaticLens(Value):
    """Lens data at one wavelength: the tables of `RadialLens` without their wavelength axis, and its focal length."""

    wavelength_nm: float
    capture_focal_length_mm: float
    heights_mm: np.ndarray
    real_height_mm: np.ndarray
    relative_illumination: np.ndarray
    point_flux: np.ndarray
    psf: np.ndarray
    psf_pitch_um: float
    transmittance: float


def _check_real_heights(lens):
    """Raise a LensError unless chief rays land on the same side of the axis as their paraxial images."""
    real_mm = lens.real_height_mm
    near_axis_mm = AXIS_SLACK * lens.heights_mm[-1]
    wrong = np.argwhere(np.where(lens.heights_mm > 0, real_mm <= 0, np.abs(real_mm) > near_axis_mm))
    if wrong.size:
        wavelength, height = wrong[0]
        raise LensError(lens.name, "real_height_mm",
                        f"{real_mm[wavelength, height]:g} at {lens.wavelengths_nm[wavelength]:g} nm and the paraxial "
                        f"height of {lens.heights_mm[height]:g} mm",
                        "expected 0 on the axis, and positive heights off it")
