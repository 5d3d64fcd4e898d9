"""The blur of measured lenses, which calibrations do not state: by diffraction, or as a lens is designed."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy

from ..lens import Lens, RadialLens
from ..runtime.errors import LensError
from .diffraction import perfect_psfs

WAVELENGTHS_NM = (400.0, 430.0, 465.0, 500.0, 540.0, 575.0, 610.0, 655.0, 700.0)
REFERENCE_NM = 540.0
SYMMETRIC = "expected a rotationally symmetric lens for the blur of a measured one"


@dataclass(frozen=True, eq=False)
class Light:
    """Blur and light at places, by wavelength.

    Attributes
    ----------
    psf : array (wavelength, place, v, u)
        +v points away from the axis, u along the tangent.
    enclosed_energy, relative_illumination : arrays (wavelength, place)
    """

    psf: np.ndarray
    enclosed_energy: np.ndarray
    relative_illumination: np.ndarray


class Blur(Protocol):
    """The PSFs of a lens over the sensor.

    Attributes
    ----------
    words : str
        For the lens's source.
    wavelengths_nm, transmittance : arrays (wavelength,)
    reference_nm : float
    f_number_effective : float
        In image space.
    pitch_um : float
        Of the PSFs' samples.
    turns : bool
        Whether PSFs depend on the azimuth.
    last_mm : float
        Distance from the axis on the sensor, up to which the blur is known.
    """

    @property
    def words(self) -> str: ...
    @property
    def wavelengths_nm(self) -> np.ndarray: ...
    @property
    def transmittance(self) -> np.ndarray: ...
    @property
    def reference_nm(self) -> float: ...
    @property
    def f_number_effective(self) -> float: ...
    @property
    def pitch_um(self) -> float: ...
    @property
    def turns(self) -> bool: ...
    @property
    def last_mm(self) -> float: ...

    def at(self, distances_mm: np.ndarray) -> Light:
        """The blur at distances from the axis on the sensor."""


class Diffraction:
    """The blur of a perfect lens with even light.

    Parameters
    ----------
    f_number : float
        Of the lens focused at infinity.
    magnification : float
        Of its image: the f-number in image space is 1 - magnification times as high.
    """

    turns, last_mm = False, np.inf
    wavelengths_nm = np.array(WAVELENGTHS_NM)
    reference_nm = REFERENCE_NM
    transmittance = np.ones(len(WAVELENGTHS_NM))

    def __init__(self, f_number: float, magnification: float = 0.0) -> None:
        self.words = f"blur by diffraction at f/{f_number:.3g}"
        self.f_number_effective = f_number * (1 - magnification)
        self._psfs = perfect_psfs(self.f_number_effective, self.wavelengths_nm)
        self.pitch_um = self._psfs.pitch_um

    def at(self, distances_mm: np.ndarray) -> Light:
        """See `Blur`."""
        shape = self.wavelengths_nm.size, distances_mm.size
        psf = np.broadcast_to(self._psfs.psf[:, None], (*shape, *self._psfs.psf.shape[1:]))
        return Light(psf, np.repeat(self._psfs.enclosed[:, None], distances_mm.size, axis=1), np.ones(shape))


class Designed:
    """The blur and the light of a rotationally symmetric lens as designed, by the distance from the axis on the sensor.

    Parameters
    ----------
    lens : Lens
        At its focus and f-number.

    Raises
    ------
    LensError
        The lens is not rotationally symmetric.
    """

    turns = True

    def __init__(self, lens: Lens) -> None:
        if not isinstance(lens, RadialLens):
            raise LensError(lens.name, "blur", "without rotational symmetry", SYMMETRIC)
        self._lens = lens
        self.words = f"blur and light as designed for {lens.name} at f/{lens.f_number_effective:.3g}"
        self.wavelengths_nm, self.transmittance = lens.wavelengths_nm, lens.transmittance
        self.reference_nm, self.pitch_um = lens.reference_wavelength_nm, lens.psf_pitch_um
        self.f_number_effective = lens.f_number_effective
        self.last_mm = float(lens.real_height_mm[:, -1].min())

    def at(self, distances_mm: np.ndarray) -> Light:
        """See `Blur`. Beyond the lens data, it is the blur at their end."""
        lens = self._lens
        psf, enclosed, light = (np.empty((lens.wavelengths_nm.size, distances_mm.size, *table.shape[2:])) for table in
                                (lens.psf, lens.enclosed_energy, lens.relative_illumination))
        for wave, real_mm in enumerate(lens.real_height_mm):
            position = np.interp(distances_mm, real_mm, np.arange(real_mm.size))
            below = np.minimum(position.astype(int), real_mm.size - 2)
            weight = position - below
            psf[wave], enclosed[wave], light[wave] = (_mixed(table[wave], below, weight) for table in
                                                      (lens.psf, lens.enclosed_energy, lens.relative_illumination))
        return Light(psf, enclosed, light)


def _mixed(table, below, weight):
    weight = weight.reshape(-1, *(1,) * (table.ndim - 1))
    return (1 - weight) * table[below] + weight * table[below + 1]


def upright(psf: np.ndarray, azimuth_rad: np.ndarray) -> np.ndarray:
    """PSFs (wavelength, place, v, u) turned from the azimuths of their places, from +x towards +y, so that +v points
    upwards and +u to the right."""
    if psf.shape[-1] % 2 == 0:  # a PSF turns about its middle
        psf = np.pad(psf, ((0, 0), (0, 0), (0, 1), (0, 1)))
    reach = psf.shape[-1] // 2
    up, right = np.meshgrid(*2 * (np.arange(-reach, reach + 1.0),), indexing="ij")
    turned = np.empty_like(psf)
    for place, azimuth in enumerate(azimuth_rad):
        outwards = right * np.cos(azimuth) + up * np.sin(azimuth)
        along = right * np.sin(azimuth) - up * np.cos(azimuth)
        for wave in range(len(psf)):
            turned[wave, place] = scipy.ndimage.map_coordinates(
                psf[wave, place], [outwards + reach, along + reach], order=1)
    return turned / turned.sum(axis=(-2, -1), keepdims=True)
