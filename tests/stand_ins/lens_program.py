"""A lens in closed form, for stand-ins of the programs in which the export macros run."""

from dataclasses import dataclass, field

import numpy as np


@dataclass
class LensInProgram:
    """Paraxial data and rays of a lens with distortion, vignetting and lateral colour, and its fields and wavelengths.

    `fields` are dictionaries with x and y of the kind `field_type`; wavelengths are in nm.
    """

    object_mm: float = 250.0
    field_type: str = "angle"
    fields: list = field(default_factory=list)
    wavelengths_nm: list = field(default_factory=lambda: [486.1, 587.6, 656.3])
    primary: int = 2
    solve: bool = False
    units: int = 0  # of length; 0 is mm
    ray_aiming: bool = True
    vignetting_set: bool = False

    @property
    def nm(self):
        return self.wavelengths_nm[self.primary - 1]

    def scale(self, nm):
        """By how much focal length and magnification change with the wavelength."""
        return 1 + 2e-5 * (nm - 587.6)

    def efl_mm(self, nm):
        return 6.0 * self.scale(nm)

    def magnification(self, nm):
        return 0.0 if np.isinf(self.object_mm) else -0.024 * self.scale(nm)

    def thickness(self, surface):
        """Of three surfaces before the image; a solve moves the image plane with the wavelength."""
        return {0: self.object_mm, 1: 2.0, 2: 0.5, 3: 5.0 + (self.solve and 1e-4 * (self.nm - 587.6))}[surface]

    def curvature(self, surface):
        return {0: 0.0, 1: 0.2, 2: -0.1, 3: 0.0}[surface]

    def real_height(self, paraxial_mm):
        return paraxial_mm * (1 - 0.01 * paraxial_mm**2)

    def lost(self, paraxial_mm):
        """Whether the chief ray does not reach the image."""
        return abs(paraxial_mm) > 4

    def relative_illumination(self, paraxial_mm):
        return 1 - 0.02 * paraxial_mm**2

    def psf(self, paraxial_mm, samples, pitch_um):
        """Rows ascend with y: a core at the chief ray, at [samples // 2] twice, and a wing outwards of it."""
        offset_um = (np.arange(samples) - samples // 2) * pitch_um
        wing_um = 1.5 * self.real_height(paraxial_mm)
        along = np.exp(-offset_um**2 / 2) + 0.3 * np.exp(-(offset_um - wing_um)**2 / 2)
        return along[:, None] * np.exp(-offset_um**2 / 2)


ENTRANCE_PUPIL_MM = 4.0
MARGINAL_COSINE = 0.25
OUTERMOST_MM = 2.5
