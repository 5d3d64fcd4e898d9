"""Uniform light on the sensor: what a white wall looks like after distortion, relative illumination and blur.

PSFs move light away from the places where chief rays arrive, so a pixel's light is a sum over the pixels around it.
Here it is computed for single pixels, without a picture.
"""

import numpy as np

from ...image.pixel_grid import PixelGrid
from ...lens.radial_lens import MonochromaticLens
from .distortion import FieldGeometry
from .psf_bank import PsfBank

AZIMUTHS = 25  # from 0 to 90 degrees, both included
NEAR_PX = (0, 1, 1, 2), (0, 0, 1, 0)  # pixels next to the axis: to the right and upwards
AROUND_PX = (6, 5, 4, 3, 0, -6), (0, 3, 4, 5, 6, 0)
CURVE_PX = 192  # from the axis to the last height, for relative illumination
MISSED = 1.2  # limit of the true worst error over the worst examined: for other wavelengths, and tables of azimuths


class UniformLight:
    """The irradiance of pixels under uniform radiance, at one wavelength.

    Parameters
    ----------
    bank : PsfBank
    field : FieldGeometry
    pitch_mm : float
        Of the pixels of `bank`.
    """

    def __init__(self, bank: PsfBank, field: FieldGeometry, pitch_mm: float) -> None:
        self._heights_mm, self._radius_px = bank.heights_mm, bank.radius_px
        self._field, self._pitch_mm = field, pitch_mm
        psfs = bank.at_table_heights(np.linspace(0, np.pi / 2, AZIMUTHS))
        self._psfs = psfs.reshape(*psfs.shape[:2], -1)

    def at(self, x_px: np.ndarray, y_px: np.ndarray) -> np.ndarray:
        """Irradiance of pixels at these distances from the axis, to the right and upwards: array (place,).

        It is relative to the irradiance that follows from radiance, transmittance and f-number (Eq. 2).
        """
        reach = np.arange(-self._radius_px, self._radius_px + 1)
        right, up = (each.ravel() for each in np.meshgrid(reach, reach))
        from_x, from_y = np.asarray(x_px)[:, None] - right, np.asarray(y_px)[:, None] - up
        height_mm = self._field.paraxial_height_mm(np.hypot(from_x, from_y) * self._pitch_mm)
        quarters, azimuth = np.divmod(np.arctan2(from_y, from_x) / (np.pi / 2), 1)
        right, up = np.broadcast_arrays(right, up, from_x)[:2]
        for turns in range(1, 4):  # into the first quarter
            turned = quarters % 4 >= turns
            right, up = np.where(turned, up, right), np.where(turned, -right, up)
        pixel = (self._radius_px - up) * reach.size + self._radius_px + right
        share = np.zeros(pixel.shape)
        for before, on in _neighbours(azimuth * (AZIMUTHS - 1), AZIMUTHS):
            for below, at in _neighbours(np.interp(height_mm, self._heights_mm, np.arange(self._heights_mm.size)),
                                         self._heights_mm.size):
                share += on * at * self._psfs[before, below, pixel]
        return (share * self._field.relative_flux(height_mm)).sum(axis=1)

    def moved(self, x_px: np.ndarray, y_px: np.ndarray) -> np.ndarray:
        """The irradiance of pixels, relative to the same without PSFs: array (place,)."""
        height_mm = self._field.paraxial_height_mm(np.hypot(x_px, y_px) * self._pitch_mm)
        return self.at(x_px, y_px) / self._field.relative_flux(height_mm)


def picture_illumination(optics: MonochromaticLens, field: FieldGeometry, real_height_mm: np.ndarray) -> np.ndarray:
    """Irradiance under uniform radiance at ascending heights from 0 on the sensor, relative to the axis: array
    (height,).

    It includes the light that PSFs move away from the places where chief rays arrive. The table in the lens data
    describes the bundle around each chief ray instead.
    """
    pitch_mm = field.last_real_mm / CURVE_PX
    light = UniformLight(PsfBank.of(optics, 1e3 * pitch_mm), field, pitch_mm)
    x_px = np.maximum(real_height_mm / pitch_mm, 0.5)
    curve = light.at(x_px, np.full_like(x_px, 0.5))
    return curve / curve[0]


def unevenness(bank: PsfBank, field: FieldGeometry, grid: PixelGrid) -> float:
    """Upper limit of the relative error of pixels under uniform radiance, which is largest next to the axis.

    There, adjacent pixels are on different sides of the axis, and each has the PSF of its centre. Elsewhere PSFs vary
    smoothly over many pixels. The light around is the truth, because what PSFs move out of a pixel or into it changes
    little next to the axis.

    Parameters
    ----------
    bank : PsfBank
        On the grid's pixels.
    field : FieldGeometry
    grid : PixelGrid

    Returns
    -------
    float
        0 if the axis is outside the grid.
    """
    nearest = np.round(grid.centre_px)
    if np.any(nearest < 0) or np.any(nearest >= grid.shape_px):
        return 0.0
    y_px, x_px = nearest - grid.centre_px
    pitch_mm = grid.pitch_um * 1e-3
    reach_px = np.hypot(1, 1) * (np.max(AROUND_PX) + 1 + bank.radius_px)
    light = UniformLight(bank.up_to(float(field.paraxial_height_mm(reach_px * pitch_mm))), field, pitch_mm)
    near, around = (light.moved(x_px + np.array(right), y_px + np.array(up)) for right, up in (NEAR_PX, AROUND_PX))
    return MISSED * float(np.abs(near / around.mean() - 1).max())


def _neighbours(position, count):
    """The two entries of a table of this size around positions, and their weights."""
    below = np.minimum(position.astype(int), count - 2)
    return (below, 1 - (position - below)), (below + 1, position - below)
