"""The light that arrives at a sensor before a lens scatters or diffracts any of it, in cells of the picture."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..depth.depth_range import blur_per_nearness_px, focus_in_capture, focus_range_px, focus_share
from ..field.field_map import MonochromaticField, field_map
from ..field.in_capture import from_capture
from ..image.irradiance import irradiance_per_radiance
from ..image.layers import LayeredRadiance
from ..image.pixel_grid import PixelGrid
from ..image.sources import Sources
from ..image.spectral_image import SpectralImage
from ..lens import Lens
from ..lens.entrance_pupil import focus_nearness
from ..prescription.system import system_of
from .visible_light import composed, layers_within

CELL_PX = 8
LEAST_COSINE = 0.05  # of the angle between a source and the axis: others land as far away as this
DISC = 1 / 16  # variance along an axis of a disc of diameter 1
MOST_GRIDS = 2  # in memory: of the picture, and of the chart for a glare index
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
        Of a disc with the spot's variance, including the blur of light that is out of focus.
    cells : (int, int)
        Rows and columns of the cells of the picture, which come first; spots of sources follow.
    """

    wavelengths_nm: np.ndarray
    x_mm: np.ndarray
    y_mm: np.ndarray
    light: np.ndarray
    radius_px: np.ndarray
    cells: tuple[int, int]


def arrivals(radiance: SpectralImage, lens: Lens, beyond: Sources | None = None,
             layers: LayeredRadiance | None = None) -> Arrivals:
    """The light of a picture, with its overscan, in cells of CELL_PX pixels, and of sources outside it.

    Parameters
    ----------
    radiance : SpectralImage
        As for `simulate`.
    lens : Lens
    beyond : Sources, optional
        Sources that the radiance does not contain, of the same wavelengths. Those behind the camera are dark.
    layers : LayeredRadiance, optional
        The same light in layers, which have its depths; without them all of it is in focus.

    Returns
    -------
    Arrivals
    """
    grid, nm = radiance.grid, np.asarray(radiance.wavelengths_nm, dtype=float)
    starts = _starts(grid)
    (rows, columns), variance = _centroids(radiance.cube, starts)
    in_focus = focus_in_capture(lens, grid, rows, columns)
    ideal_mm = from_capture(*grid.position_mm(rows, columns), lens, grid)
    if layers:
        nearness, square = _nearness(layers_within(layers, radiance), starts, in_focus)
        ideal_mm, blur = _out_of_focus(lens, grid, ideal_mm, nearness, square, in_focus)
        variance = variance + blur
    fields = fields_in_cells(lens, tuple(nm.tolist()), grid)
    parts = [_landed(lens, field, ideal_mm, _sums(plane, starts) * growth)
             for (field, growth), plane in zip(fields, radiance.cube, strict=True)]
    radius_px = 2 * np.sqrt(variance).ravel()
    if beyond is not None and len(beyond):
        ideal_mm, variance = _places_of_sources(lens, beyond, grid)
        sources = [_of_sources(lens, field, beyond, beyond.irradiance[:, index], ideal_mm, grid)
                   for index, (field, _) in enumerate(fields)]
        parts = [np.concatenate(pair, axis=1) for pair in zip(parts, sources, strict=True)]
        radius_px = np.append(radius_px, 2 * np.sqrt(variance))
    x_mm, y_mm, light = np.stack(parts, axis=1)
    return Arrivals(nm, x_mm, y_mm, light, radius_px, (starts[0].size, starts[1].size))


def _sums(plane, starts):
    """Sums over the cells of a plane: float64 array (row, column)."""
    return np.add.reduceat(np.add.reduceat(plane, starts[0], axis=0, dtype=np.float64), starts[1], axis=1)


def _centroids(cube, starts):
    """Mean row and column of each cell's light, the cell's middle without any, and the variance around it in px^2."""
    light = np.maximum(sum(plane.astype(np.float64) for plane in cube), 0)
    sums = _sums(light, starts)
    dark, places, variance = sums <= 0, [], 1 / 6
    for axis, (start, size, index) in enumerate(zip(starts, light.shape, np.ogrid[tuple(map(slice, light.shape))],
                                                    strict=True)):
        strips = np.add.reduceat(light, starts[1 - axis], axis=1 - axis)
        middle = np.expand_dims(start + (np.diff(start, append=size) - 1) / 2, 1 - axis)
        mean, square = (np.divide(np.add.reduceat(strips * index**power, start, axis=axis), sums, where=~dark,
                                  out=np.broadcast_to(middle**power, sums.shape).copy()) for power in (1, 2))
        places.append(mean)
        variance = variance + np.maximum(square - mean**2, 0)
    return places, variance / 2


def _nearness(layers, starts, in_focus):
    """Mean inverse depth of each cell's light, and of its square; that in focus without any.

    Light counts in proportion to its pixel's, so that a dim ground does not blur a lamp in front of it.
    """
    light, nearness, square = (np.maximum(composed(layers, lambda cube, depth_mm, power=power: (
        cube.sum(axis=0) * (1 / depth_mm)**power)), 0) for power in range(3))
    total = _sums(light**2, starts)
    return [np.divide(_sums(light * each, starts), total, where=total > 0,
                      out=np.broadcast_to(in_focus**power, total.shape).astype(float))
            for power, each in ((1, nearness), (2, square))]


def _out_of_focus(lens, grid, ideal_mm, nearness, square, in_focus):
    """Places x_mm and y_mm in the ideal image where chief rays of light cross the plane of focus, and the variance of
    its blur along an axis, in px^2; from means of its inverse depths and of their squares.

    As in the lens image, light that counts as in focus is where a pinhole sees it. The variance of a squeezed picture
    is the mean of those along its width and its height.
    """
    square_px = blur_per_nearness_px(lens, grid.pitch_um)**2 * np.maximum(
        square - 2 * in_focus * nearness + in_focus**2, 0)
    share = 1 - focus_share(np.sqrt(square_px), focus_range_px(lens, grid.pitch_um))
    ratio = min(lens.squeeze, 1 / lens.squeeze)**2  # of the smaller blur
    return (_crossing_focus(lens, ideal_mm, in_focus + share * (nearness - in_focus), in_focus),
            DISC * (1 + ratio**2) / 2 * share * square_px)


def _crossing_focus(lens, ideal_mm, nearness, in_focus):
    """Places where chief rays through points at these inverse depths cross the plane of focus, to first order.

    The camera is in the entrance pupil of the picture's height. The width of an anamorphic lens may have another one.
    """
    if lens.prescription is None:
        return ideal_mm
    system = system_of(lens.prescription)
    behind_mm = system.across.entrance_pupil_mm - system.entrance_pupil_mm
    x_mm, y_mm = ideal_mm
    return x_mm * (1 + behind_mm * in_focus) / np.maximum(1 + behind_mm * nearness, LEAST_COSINE), y_mm


def _starts(grid):
    """The first rows, and the first columns, of the cells of a picture."""
    return [np.arange(0, n, CELL_PX) for n in grid.shape_px]


@lru_cache(maxsize=MOST_GRIDS)
def fields_in_cells(lens: Lens, wavelengths_nm: tuple[float, ...], grid: PixelGrid
                    ) -> list[tuple[MonochromaticField, np.ndarray]]:
    """For each wavelength, the lens's field, and how much larger the cells of a picture are on the sensor: array (row,
    column)."""
    x_mm, y_mm = grid.position_mm(*np.meshgrid(*(start + (np.diff(start, append=n) - 1) / 2
                                                 for start, n in zip(_starts(grid), grid.shape_px, strict=True)),
                                               indexing="ij"))
    return [_with_growth(lens, nm, grid, x_mm, y_mm) for nm in wavelengths_nm]


def _with_growth(lens, wavelength_nm, grid, x_mm, y_mm):
    field = field_map(lens).at_wavelength(wavelength_nm)

    def landing_mm(x_mm, y_mm):
        return field.landing_mm(*from_capture(x_mm, y_mm, lens, grid))

    x_mm, y_mm = np.broadcast_arrays(x_mm, y_mm)
    return field, _growth(landing_mm, x_mm, y_mm, STEP * lens.capture_focal_length_mm)


def _growth(landing_mm: Callable, x_mm, y_mm, step_mm):
    """Area on the sensor over area in the picture."""
    across = np.subtract(landing_mm(x_mm + step_mm, y_mm), landing_mm(x_mm - step_mm, y_mm))
    upwards = np.subtract(landing_mm(x_mm, y_mm + step_mm), landing_mm(x_mm, y_mm - step_mm))
    return np.abs(across[0] * upwards[1] - across[1] * upwards[0]) / (2 * step_mm) ** 2


def _places_of_sources(lens, sources: Sources, grid):
    """Places of sources in the ideal image: x_mm, y_mm; and their variance along an axis, in px^2."""
    right, up, towards = sources.directions.T
    cosine, focal_mm = np.maximum(towards, LEAST_COSINE), lens.capture_focal_length_mm
    ideal_mm = focal_mm * np.stack([right / lens.squeeze, up]) / cosine
    nearness, in_focus = 1 / (sources.distance_mm * cosine), focus_nearness(lens, *ideal_mm)
    ideal_mm, blur = _out_of_focus(lens, grid, ideal_mm, nearness, nearness**2, in_focus)
    radius_px = sources.radius_rad * focal_mm / (grid.pitch_um * 1e-3)
    return np.stack(ideal_mm), radius_px**2 / 4 + blur


def _of_sources(lens, field, sources: Sources, irradiance, ideal_mm, grid: PixelGrid):
    """As `_landed`, of sources with this irradiance at the entrance pupil: array (3, source).

    A source of the radiance L and the solid angle w covers the area f^2 w / cos^3 of the ideal image, and its
    irradiance at the pupil is L w. Beyond the lens data, the pupil's area as seen from the source is that of the last
    known place.
    """
    focal_mm, extent_mm = lens.capture_focal_length_mm, field_map(lens).extent_mm
    known_mm = ideal_mm * np.minimum(1, extent_mm / np.maximum(np.hypot(*ideal_mm), np.finfo(float).tiny))
    cosine = 1 / np.sqrt(1 + np.sum(np.square(known_mm / focal_mm * [[lens.squeeze], [1]]), axis=0))
    growth = _growth(field.landing_mm, known_mm[0], known_mm[1], STEP * focal_mm)
    area = focal_mm**2 / lens.squeeze / cosine**4 * growth / (grid.pitch_um * 1e-3) ** 2
    towards = np.maximum(sources.directions[:, 2], 0)
    return _landed(lens, field, ideal_mm, irradiance * towards * area)


def _landed(lens, field: MonochromaticField, ideal_mm, light):
    """x_mm, y_mm and light of spots, from their places in the ideal image and their light without the lens's losses:
    array (3, spot)."""
    x_mm, y_mm = field.landing_mm(*ideal_mm)
    known = np.isfinite(x_mm) & np.isfinite(y_mm)
    x_mm, y_mm = np.where(known, x_mm, 0), np.where(known, y_mm, 0)
    light = light * irradiance_per_radiance(field.transmittance, lens.f_number_effective) * field.relative_flux(
        x_mm, y_mm)
    return np.stack([each.ravel() for each in (x_mm, y_mm, np.where(known, light, 0))])
