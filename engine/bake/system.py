"""A lens as rays go through it: Optiland's system, first-order figures, fields, bulk transmittance."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from optiland.optic import Optic

from .glasses import extinction_at
from .prescription import Prescription


@dataclass(frozen=True, eq=False)
class System:
    """A lens ready to be traced.

    Attributes
    ----------
    optic : optiland.optic.Optic
        Without apertures but for the stop: what they cut off is decided by `semi_apertures_mm`, smoothly.
    prescription : Prescription
        As built: its last thickness is the distance to the image plane, its focus as given.
    materials : list
        Optiland's, one for each surface.
    efl_mm, magnification, entrance_pupil_mm, exit_pupil_distance_mm : float
        Paraxial, at the reference wavelength; the magnification is 0 for an object at infinity, the exit pupil's
        distance is from the image plane.
    stop_semi_aperture_mm : float
    last_height_mm : float
        Paraxial image height where the field ends.
    """

    optic: Optic
    prescription: Prescription
    materials: list
    efl_mm: float
    magnification: float
    entrance_pupil_mm: float
    exit_pupil_distance_mm: float
    stop_semi_aperture_mm: float
    last_height_mm: float

    @property
    def semi_apertures_mm(self) -> np.ndarray:
        """Of each surface: array, inf where nothing stops light but the stop itself."""
        sizes = np.array([surface.semi_aperture_mm for surface in self.prescription.surfaces])
        sizes[self.prescription.stop_index] = np.inf
        return sizes

    def field_of_height(self, height_mm: float) -> float:
        """Optiland's normalised field that has this paraxial image height, on the side where images have +y."""
        if np.isinf(self.prescription.object_distance_mm):
            last = np.arctan(self.last_height_mm / self.efl_mm)
            return float(np.arctan(height_mm / self.efl_mm) / last)
        return float(np.sign(self.magnification) * height_mm / self.last_height_mm)

    def transmittance(self, wavelengths_nm: Sequence[float] | np.ndarray) -> np.ndarray:
        """T of the bulk glass along the axis: array (wavelength,). Model glasses and coatings take nothing."""
        parts = list(zip(self.materials, self.prescription.surfaces, strict=True))

        def absorption(nm):
            return sum(4 * np.pi * extinction_at(material, nm) * abs(surface.thickness_mm) / (nm * 1e-6)
                       for material, surface in parts if surface.glass)

        return np.exp([-absorption(nm) for nm in wavelengths_nm])
