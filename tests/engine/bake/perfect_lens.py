"""A perfect lens, whose PSFs, distortion and illumination are known in closed form."""

import numpy as np

from lensfield.engine.bake.wavefront import Wavefronts
from lensfield.engine.rays.rays import HalfPupil

EFL_MM = 50.0
PUPIL = HalfPupil(21, 27)


def perfect_wavefronts(f_number, angles_deg, wavelength_nm=550.0, defocus_mm=0.0):
    """Wavefronts of a thin lens that is its own stop, focused at infinity: all paths to the image point are equal.

    `defocus_mm` moves the image plane this far behind the focus, along the axis; PSFs stay centred on the image point.
    """
    angle = np.radians(angles_deg)[:, None, None]
    height_mm = EFL_MM * np.tan(angle)
    x, y = (EFL_MM / f_number / 2 * place + 0 * angle for place in (PUPIL.x, PUPIL.y))
    distance_mm = np.sqrt(x**2 + (y - height_mm)**2 + EFL_MM**2)
    cosine = np.stack([x, y - height_mm]) / distance_mm
    density = np.log(np.cos(angle) * distance_mm**4 / EFL_MM**2)  # of the beam's cross-section divided by the cosines
    path_mm = -defocus_mm * (EFL_MM / distance_mm - 1)
    limits = np.empty((0, *x.shape))
    return Wavefronts(PUPIL, np.array([wavelength_nm]), height_mm[:, 0, 0][None], path_mm[None], cosine[:, None],
                      -cosine[:, None], np.stack([x, y * np.cos(angle)])[:, None], density[None], limits[:, None],
                      np.stack([-x, height_mm - y])[:, None] * (defocus_mm / EFL_MM))
