"""Spot diagrams: PSFs by rays, with the light that diffraction at the edge of the pupil spreads.

A sample that is wide compared with the wavelength over the numerical aperture is a mean over many fringes. Far from
the edge of the pupil, its light is where rays are. An edge spreads light: of the density D per area of direction
cosines, each unit of its length sends D wavelength / (4 pi^2 s^2) per distance s from the ray's image to either side,
the mean of Fresnel's fringes at a straight edge. This is the light of rays that are deflected across the edge to both
sides by wavelength / (2 pi^2 t), at the distance t from the edge in direction cosines (compare Heisenberg uncertainty
ray bending: E. R. Freniere, G. G. Gregory, R. A. Hassler, Proc. SPIE 3780, 1999). For a perfect lens, the share of the
light outside of a radius r is then wavelength / (pi^2 NA r), as for Airy's pattern.

Fringes at caustics cause the remaining error, which is proportional to the wavelength and so falls slowly.
"""

from functools import lru_cache

import numpy as np

from ..kernels.spots import spots
from ..rays.pupil import PupilSplines
from ..rays.rays import Pupil
from .wavefront import Wavefront

CELLS = 40, 48  # of half a pupil, over the radius and the azimuth
MOST_PARTS = 4  # of a cell along each side


def spot_diagram(wavefront: Wavefront, pitch_um: float, samples: int) -> np.ndarray:
    """PSF of a wavefront by its rays.

    Parameters
    ----------
    wavefront : Wavefront
    pitch_um : float
        Distance between samples; each is the mean over a square of this side.
    samples : int
        Along v and u; odd.

    Returns
    -------
    array (v, u)
        Shares of all light, as from `diffraction.point_spread`. Zeros if no light passes.
    """
    if not wavefront.passing.any():
        return np.zeros((samples, samples))
    splines, square_radius = _cells(wavefront.pupil)
    per_cosine = 2 * np.pi**2 * pitch_um / (wavefront.wavelength_nm * 1e-3)
    (x_px, y_px), (source_x, source_y) = wavefront.spot_mm * (1e3 / pitch_um), wavefront.source
    cosine_x, cosine_y = wavefront.cosine * per_cosine
    x_px, source_x, cosine_x = splines.values(np.stack([x_px, source_x, cosine_x]), odd=True)
    y_px, source_y, cosine_y, *limits = splines.values(np.stack([y_px, source_y, cosine_y, *wavefront.limits]))
    limit, middle = np.max([square_radius, *limits], axis=0), samples / 2
    corners = np.stack([x_px + middle, y_px + middle, source_x, source_y, cosine_x, cosine_y, limit])
    light, total = spots(corners, MOST_PARTS, samples)
    return (light + light[:, ::-1]) / (2 * total) if wavefront.pupil.mirrored else light / total


@lru_cache(maxsize=8)
def _cells(pupil: Pupil):
    """Splines to the corners of cells, and the squared radii of these."""
    radii, halves = np.linspace(0, 1, CELLS[0] + 1), 1 if pupil.mirrored else 2
    azimuths = np.linspace(0, halves * np.pi, halves * CELLS[1] + 1)
    return PupilSplines(pupil, radii, azimuths), np.broadcast_to(radii[:, None]**2, (radii.size, azimuths.size))
