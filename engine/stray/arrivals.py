"""The light that arrives at a sensor before a lens scatters or diffracts any of it, in cells of the picture."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..field.field_map import MonochromaticField, field_map
from ..field.in_capture import from_capture
from ..image.irradiance import irradiance_per_radiance
from ..image.pixel_grid import PixelGrid
from ..image.spectral_image import SpectralImage
from ..lens import Lens
from .sources import Sources

CELL_PX = 8
LEAST_COSINE = 0.05  # of the angle between a source and the axis: others land as far away as this
STEP = 1e-4  # of the focal length: for the derivatives of the distortion


@dataclass(frozen=True, eq=False)
class Arrivals:
    """Spots of light on the sensor's plane.

    Attributes
    ----------
    wavelengths_nm : array (wavelength,)
    x_mm, y_mm : arrays (wavelength, spot)
        Where their chief rays land, from the axis, to the right and up.
    light : array (wavelength, spot)
        Irradiance times area in pixels of the sensor, W m^-2 nm^-1: the sum of a spot's image over its pixels.
    radius_px : array (spot,)
        Of a disc with the spot's variance.
    cells : (int, int)
        Rows and columns of the cells of the picture, which come first; spots of sources follow.
    """

    wavelengths_nm: np.ndarray
    x_mm: np.ndarray
    y_mm: np.ndarray
    light: np.ndarray
    radius_px: np.ndarray
    cells: tuple[int, int]


def arrivals(radiance: SpectralImage, lens: Lens, beyond: Sources | None = None) -> Arrivals:
    """The light of a picture, with its overscan, in cells of CELL_PX pixels, and of sources outside it.

    Parameters
    ----------
    radiance : SpectralImage
        As for `simulate`.
    lens : Lens
    beyond : Sources, optional
        Sources that the radiance does not contain, of the same wavelengths. Those behind the camera are dark.

    Returns
    -------
    Arrivals
    """
    grid, nm = radiance.grid, np.asarray(radiance.wavelengths_nm, dtype=float)
    starts = [np.arange(0, n, CELL_PX) for n in grid.shape_px]
    (rows, columns), variance = _centroids(radiance.cube, starts)
    ideal_mm = from_capture(*grid.position_mm(rows, columns), lens, grid)
    parts = [_of_picture(lens, one, plane, grid, starts, ideal_mm)
             for one, plane in zip(nm, radiance.cube, strict=True)]
    radius_px = 2 * np.sqrt(variance).ravel()
    if beyond is not None and len(beyond):
        sources = [_of_sources(lens, one, beyond, beyond.irradiance[:, index], grid) for index, one in enumerate(nm)]
        parts = [np.concatenate(pair, axis=1) for pair in zip(parts, sources, strict=True)]
        radius_px = np.append(radius_px, beyond.radius_rad * lens.capture_focal_length_mm / (grid.pitch_um * 1e-3))
    x_mm, y_mm, light = np.stack(parts, axis=1)
    return Arrivals(nm, x_mm, y_mm, light, radius_px, (starts[0].size, starts[1].size))


def _sums(plane, starts):
    """Sums over the cells of a plane: float64 array (row, column)."""
    return np.add.reduceat(np.add.reduceat(plane, starts[0], axis=0, dtype=np.float64), starts[1], axis=1)


def _centroids(cube, starts):
    """Mean row and column of each cell's light, the cell's middle without any, and the variance around it in px^2."""
    light = np.maximum(sum(plane.astype(np.float64) for plane in cube), 0)
    sums = _sums(light, starts)
    axes = np.ogrid[tuple(map(slice, light.shape))]
    dark, places, variance = sums <= 0, [], 1 / 6
    for axis in axes:
        middle = _sums(np.broadcast_to(axis, light.shape), starts) / _sums(np.ones_like(light), starts)
        mean, square = (np.divide(_sums(light * axis**power, starts), sums, out=middle**power, where=~dark)
                        for power in (1, 2))
        places.append(mean)
        variance = variance + np.maximum(square - mean**2, 0)
    return places, variance / 2


def _of_picture(lens, wavelength_nm, plane, grid, starts, ideal_mm):
    """x_mm, y_mm and light of the cells of a plane of radiance: array (3, cell)."""
    field = field_map(lens).at_wavelength(wavelength_nm)

    def landing_mm(x_mm, y_mm):
        return field.landing_mm(*from_capture(x_mm, y_mm, lens, grid))

    x_mm, y_mm = (np.broadcast_to(each, ideal_mm[0].shape) for each in grid.position_mm(
        *np.meshgrid(*(start + (np.diff(start, append=n) - 1) / 2
                       for start, n in zip(starts, grid.shape_px, strict=True)), indexing="ij")))
    light = _sums(plane, starts) * _growth(landing_mm, x_mm, y_mm, STEP * lens.capture_focal_length_mm)
    return _landed(lens, field, ideal_mm, light)


def _growth(landing_mm: Callable, x_mm, y_mm, step_mm):
    """Area on the sensor over area in the picture."""
    across = np.subtract(landing_mm(x_mm + step_mm, y_mm), landing_mm(x_mm - step_mm, y_mm))
    upwards = np.subtract(landing_mm(x_mm, y_mm + step_mm), landing_mm(x_mm, y_mm - step_mm))
    return np.abs(across[0] * upwards[1] - across[1] * upwards[0]) / (2 * step_mm) ** 2


def _of_sources(lens, wavelength_nm, sources: Sources, irradiance, grid: PixelGrid):
    """As `_of_picture`, of sources with this irradiance at the entrance pupil: array (3, source).

    A source of the radiance L and the solid angle w covers the area f^2 w / cos^3 of the ideal image, and its
    irradiance at the pupil is L w. Beyond the lens data, the pupil's area as seen from the source is that of the last
    known place.
    """
    fields = field_map(lens)
    field, focal_mm = fields.at_wavelength(wavelength_nm), lens.capture_focal_length_mm
    right, up, towards = sources.directions.T
    ideal_mm = focal_mm * np.stack([right / lens.squeeze, up]) / np.maximum(towards, LEAST_COSINE)
    known_mm = ideal_mm * np.minimum(1, fields.extent_mm / np.maximum(np.hypot(*ideal_mm), np.finfo(float).tiny))
    cosine = 1 / np.sqrt(1 + np.sum(np.square(known_mm / focal_mm * [[lens.squeeze], [1]]), axis=0))
    growth = _growth(field.landing_mm, known_mm[0], known_mm[1], STEP * focal_mm)
    area = focal_mm**2 / lens.squeeze / cosine**4 * growth / (grid.pitch_um * 1e-3) ** 2
    return _landed(lens, field, ideal_mm, irradiance * np.maximum(towards, 0) * area)


def _landed(lens, field: MonochromaticField, ideal_mm, light):
    x_mm, y_mm = field.landing_mm(*ideal_mm)
    known = np.isfinite(x_mm) & np.isfinite(y_mm)
    x_mm, y_mm = np.where(known, x_mm, 0), np.where(known, y_mm, 0)
    light = light * irradiance_per_radiance(field.transmittance, lens.f_number_effective) * field.relative_flux(
        x_mm, y_mm)
    return np.stack([each.ravel() for each in (x_mm, y_mm, np.where(known, light, 0))])
