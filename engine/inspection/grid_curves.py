"""A lens at places (x, y) of its sensor: paths across the picture, PSFs, lateral colour and distortion there."""

from dataclasses import dataclass, replace

import numpy as np

from ..field.field_map import MonochromaticField, field_map
from ..lens import GridLens
from ..lens.spline import Spline
from .curves import GRID_CELLS, MOST_GRID_LINES, POINTS_PER_LINE, reference_nm

PATH_POINTS = 33
SEARCHED = 65  # places across and up a sensor, for the extent of its ideal image


@dataclass(frozen=True, eq=False)
class Path:
    """A straight line through the middle of the picture, on the part of the sensor that the lens data cover.

    Attributes
    ----------
    name : str
    direction : (float, float)
        x and y per mm along it.
    along_mm : array (place,), ascending
        Distances from the middle, negative on the left or, along y, below.
    """

    name: str
    direction: tuple[float, float]
    along_mm: np.ndarray

    def places_mm(self, along_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x and y of places along it."""
        return along_mm * self.direction[0], along_mm * self.direction[1]


def paths(lens: GridLens) -> list[Path]:
    """Paths along x, along y and along diagonals, without those that are mirror images of others."""
    width, height = lens.sensor_mm
    up, right = lens.mirrored
    lines = [("x", (width, 0.0), right), ("y", (0.0, height), up)]
    if up or right:
        lines.append(("diagonal", (width, height), up and right))
    else:
        lines += [("↗", (width, height), False), ("↘", (width, -height), False)]
    return [_path(lens, name, np.array(side_mm), mirrored) for name, side_mm, mirrored in lines]


def _path(lens, name, side_mm, mirrored):
    length_mm = np.hypot(*side_mm)
    share = np.linspace(0 if mirrored else -1, 1, PATH_POINTS)
    complete = Path(name, tuple(side_mm / length_mm), share * length_mm / 2)
    known = reference_field(lens).within(*complete.places_mm(complete.along_mm))
    return replace(complete, along_mm=complete.along_mm[known])


def reference_field(lens: GridLens) -> MonochromaticField:
    """The lens at its reference wavelength, as a function of the place."""
    return field_map(lens).at_wavelength(reference_nm(lens))


def angle_rad(lens: GridLens, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """Object-side angle between the camera's axis and the light that lands at places of the sensor."""
    ideal_x_mm, ideal_y_mm = reference_field(lens).source_mm(x_mm, y_mm)
    return np.arctan(np.hypot(lens.squeeze * ideal_x_mm, ideal_y_mm) / lens.capture_focal_length_mm)


def half_angles_rad(lens: GridLens, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Distances from the middle along a path, and half the angles between the light that lands there on both sides."""
    along_mm = path.along_mm[path.along_mm >= 0]
    return along_mm, np.mean([angle_rad(lens, *path.places_mm(sign * along_mm)) for sign in (1, -1)], axis=0)


def distortion_percent(lens: GridLens, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """Distortion: a place's distance from the middle beyond the one in the ideal image, in per cent of that; 0 in the
    middle."""
    place_mm, ideal_mm = np.hypot(x_mm, y_mm), np.hypot(*reference_field(lens).source_mm(x_mm, y_mm))
    return 100 * np.divide(place_mm - ideal_mm, ideal_mm, out=np.zeros_like(ideal_mm), where=place_mm > 0)


def relative_illumination(lens: GridLens, wavelengths_nm: np.ndarray, x_mm: np.ndarray,
                          y_mm: np.ndarray) -> np.ndarray:
    """The relative illumination of pictures at places of the sensor: array (wavelength, place)."""
    return np.stack([field_map(lens).at_wavelength(nm).relative_illumination(x_mm, y_mm) for nm in wavelengths_nm])


def displacement_um(lens: GridLens, wavelengths_nm: np.ndarray, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """Lateral colour: where the light lands that lands at these places at the reference wavelength.

    Wavelengths beyond the lens data are clipped to its first or last.

    Returns
    -------
    array (wavelength, place, 2)
        To the right and upwards, relative to the place.
    """
    by_wavelength, source_mm = field_map(lens), reference_field(lens).source_mm(x_mm, y_mm)
    landing_mm = Spline.through(lens.wavelengths_nm, np.stack(
        [np.stack(by_wavelength.at_wavelength(nm).landing_mm(*source_mm), axis=-1) for nm in lens.wavelengths_nm]))
    return 1e3 * (landing_mm(lens.nearest_nm(wavelengths_nm)) - landing_mm(reference_nm(lens)))


def psfs_at(lens: GridLens, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """PSFs at places of the sensor, mixed from the four nodes around each: array (wavelength, place, v, u)."""
    corners = [_nodes_around(nodes_mm, np.abs(place_mm) if mirrored else place_mm)
               for nodes_mm, mirrored, place_mm in zip((lens.y_mm, lens.x_mm), lens.mirrored, (y_mm, x_mm),
                                                       strict=True)]
    psfs = np.zeros((lens.wavelengths_nm.size, x_mm.size, *lens.psf.shape[-2:]))
    for rows, row_weights in corners[0]:
        for columns, column_weights in corners[1]:
            psfs += (row_weights * column_weights)[:, None, None] * lens.psf[:, rows, columns]
    for mirrored, place_mm, axis in zip(lens.mirrored, (y_mm, x_mm), (-2, -1), strict=True):
        other = np.flatnonzero(mirrored & (place_mm < 0))
        psfs[:, other] = mirror_image(psfs[:, other], axis)
    return psfs


def _nodes_around(nodes_mm, place_mm):
    """Indices of the nodes below and above places, and their weights; beyond the ends, as at the ends."""
    position = np.interp(place_mm, nodes_mm, np.arange(nodes_mm.size))
    below = np.minimum(position.astype(int), nodes_mm.size - 2)
    return (below, 1 - (position - below)), (below + 1, position - below)


def mirror_image(psf: np.ndarray, axis: int) -> np.ndarray:
    """PSFs mirrored about their chief rays along an axis."""
    return np.roll(np.flip(psf, axis), 1 - psf.shape[axis] % 2, axis)


def distortion_lines(lens: GridLens) -> tuple[np.ndarray, np.ndarray]:
    """Lines of a grid in the ideal image on the sensor, and their images at the reference wavelength.

    The ideal grid has GRID_CELLS cells along the sensor's short side, and extends to all light on the sensor.

    Returns
    -------
    ideal_mm, real_mm : arrays (line, point, 2)
        x and y about the axis; NaN in `real_mm` beyond the lens data.
    """
    field, sides_mm = reference_field(lens), np.array(lens.sensor_mm)
    x_mm, y_mm = (np.linspace(-side, side, SEARCHED) / 2 for side in sides_mm)
    reach_mm = [max(np.abs(source).max(), side / 2) for source, side in
                zip(field.source_mm(x_mm, y_mm[:, None]), sides_mm, strict=True)]
    step_mm = sides_mm / np.maximum(2, np.rint(GRID_CELLS * sides_mm / sides_mm.min()))
    lines = []
    for across, (reach, step, side) in enumerate(zip(reach_mm, step_mm, sides_mm, strict=True)):
        beyond = min(MOST_GRID_LINES, int((reach - side / 2) / step + 1e-9))
        along_mm = np.linspace(-reach_mm[1 - across], reach_mm[1 - across], POINTS_PER_LINE)
        for place_mm in np.arange(-beyond, round(side / step) + beyond + 1) * step - side / 2:
            pair = [np.full(POINTS_PER_LINE, place_mm), along_mm]
            lines.append(np.stack(pair[::-1] if across else pair, axis=-1))
    ideal_mm = np.stack(lines)
    landing_mm = np.stack(field.landing_mm(ideal_mm[..., 0], ideal_mm[..., 1]), axis=-1)
    known = field.within(landing_mm[..., 0], landing_mm[..., 1])
    return ideal_mm, np.where(np.asarray(known)[..., None], landing_mm, np.nan)
