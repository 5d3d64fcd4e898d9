"""What `draw_ghosts` takes: meshes of rays, and the blades of an iris."""

from dataclasses import dataclass

import numpy as np

from .declarations import NUMBERS

LIMIT, STOP, LIGHT = 2, 3, NUMBERS["GHOST_QUANTITIES"]
"""Where the quantities of a ray begin behind its place: limit, positions in the stop, and light at each wavelength."""


@dataclass(frozen=True, eq=False)
class Blades:
    """The opening of the stop, in its semi-apertures: `shape` and `reach` as of `Opening`, and the blades' normals
    (blade, 2), float32."""

    normals: np.ndarray
    shape: tuple[float, float, float]
    reach: float


@dataclass(frozen=True, eq=False)
class Meshes:
    """Rays of several ghosts of one source, from `ghost_rays`.

    Attributes
    ----------
    rays : array (pair, LIGHT + wave, row, column)
    crossings : int64 array (pair,)
        How often the light crosses the stop.
    cells_mm2 : array (pair,)
        Cross section of the light in a cell.
    pixels : array (pair,)
        Number of pixels to spend on each ghost, a quarter to all of which are used.
    blur : array (pair,)
        Least area of the pixels that a ghost is drawn in, in pixels: these blur it.
    mirrored : bool
        Whether the first column is the middle, and the other half is the mirror image.
    azimuth_rad : float
        Angle by which the rays are turned, from the right upwards.
    irradiance : array (pair, wave)
        W m^-2 nm^-1 of the light in front of the lens, without what glass absorbs.
    """

    rays: np.ndarray
    crossings: np.ndarray
    cells_mm2: np.ndarray
    pixels: np.ndarray
    blur: np.ndarray
    mirrored: bool
    azimuth_rad: float
    irradiance: np.ndarray
