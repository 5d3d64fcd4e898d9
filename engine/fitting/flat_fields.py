"""Flat fields: the light of an even field in raw pictures, with the tilt of its illumination taken out."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..prescription.photographs import Vignetting
from ..prescription.prescription import Prescription
from ..runtime.errors import ImageError
from .raw_light import LEAST_SIGNAL, TO_SIGMA, camera_sensor_mm, check_clipped, read_green

TILES = 60  # along the longer side, each with the median of its green pixels
LEAST_TILE_PX = 6  # several cells of any filter array
STEEPEST = 0.3  # tilt from the middle to a corner
ROUGHEST = 0.03  # scatter of tiles as far from the middle
RINGS, OUTERMOST, LEAST_TILES = 20, 0.97, 8  # of tiles, up to a share of the half diagonal
MIDDLE = 0.12  # of the half diagonal, where a parabola gives the light on the axis


@dataclass(frozen=True)
class FlatField:
    """A flat field.

    Attributes
    ----------
    path : Path
    curve : Vignetting
        Its light without the tilt.
    tilt : float
        Change of the illumination from the middle to the brightest point on the circle through the corners.
    towards_deg : float
        Direction of that point: from the right, upwards.
    roughness : float
        Scatter of the light as far from the middle, relative.
    """

    path: Path
    curve: Vignetting
    tilt: float
    towards_deg: float
    roughness: float

    def __str__(self):
        return (f"{self.path.name}: f/{self.curve.f_number:g}, illumination tilted by {self.tilt:.1%} towards "
                f"{self.towards_deg:.0f} degrees, uneven by {self.roughness:.1%}")


def read_flat_fields(paths: Sequence[Path], prescription: Prescription, f_numbers: Sequence[float | None],
                     sensor_mm: tuple[float, float] | None = None, focus_mm: float = np.inf) -> Iterator[FlatField]:
    """Read raw pictures of an even field through a lens, one after the other.

    Parameters
    ----------
    paths : sequence of path
    prescription : Prescription
    f_numbers : sequence of float or None
        Of each picture; None for the one in EXIF.
    sensor_mm : (float, float), optional
        Width and height of the camera's sensor; by default, the sensor of the lens.
    focus_mm : float
        Distance at which the lens was focused.

    Raises
    ------
    InputError
        As `read_flat_field` and `camera_sensor_mm`.
    """
    sensor_mm = camera_sensor_mm(prescription, sensor_mm)
    for path, f_number in zip(paths, f_numbers, strict=True):
        yield read_flat_field(path, sensor_mm, prescription.focal_length_mm, f_number, focus_mm)


def read_flat_field(path: str | os.PathLike[str], sensor_mm: tuple[float, float], focal_mm: float | None,
                    f_number: float | None = None, focus_mm: float = np.inf) -> FlatField:
    """Read a raw picture of an even field: a DNG, or any other file that LibRaw opens.

    Parameters
    ----------
    path : path
    sensor_mm : (float, float)
        Width and height of the camera's sensor.
    focal_mm : float or None
        Of the lens; EXIF with another one is of another lens.
    f_number : float, optional
        For a lens that does not report it.
    focus_mm : float
        Distance at which the lens was focused.

    Raises
    ------
    ImageError
        The file is not a raw picture, is clipped, dark or not even, states no f-number, or is of another lens.
    """
    path = Path(path)
    picture = read_green(path, focal_mm, f_number)
    check_clipped(path, picture.levels)
    light = _tiles(picture.levels)
    if light.max() < LEAST_SIGNAL:
        raise ImageError(path, "exposure", f"{light.max():.1%} of saturation at most", "expose longer: a half in the "
                         "middle")
    down, right = np.meshgrid(*(_places(count) for count in light.shape), indexing="ij")
    side = np.array(light.shape) / np.hypot(*light.shape)
    x, y = right * side[1], -down * side[0]  # 1 in the corners
    tilt_x, tilt_y = _tilt(light, x, y)
    tilt = float(np.hypot(tilt_x, tilt_y))
    if tilt > STEEPEST:
        raise ImageError(path, "illumination", f"tilted by {tilt:.0%} from the middle to a corner",
                         f"expected at most {STEEPEST:.0%}: light the field more evenly")
    light = light / (1 + tilt_x * x + tilt_y * y)
    shares, curve, roughness = _over_rings(light, np.hypot(x, y))
    if roughness > ROUGHEST:
        raise ImageError(path, "field", f"uneven by {roughness:.1%}",
                         f"expected at most {ROUGHEST:.0%}: photograph an even surface out of focus")
    half_mm = np.hypot(*sensor_mm) / 2
    return FlatField(path, Vignetting(picture.f_number, focus_mm, shares * half_mm, curve), tilt,
                     float(np.degrees(np.arctan2(tilt_y, tilt_x))), roughness)


def _tiles(levels):
    """Medians of squares of pixels: array (row, column)."""
    side_px = max(max(levels.shape) // TILES, LEAST_TILE_PX)
    rows, columns = (count // side_px for count in levels.shape)
    top, left = ((count - number * side_px) // 2 for count, number in
                 zip(levels.shape, (rows, columns), strict=True))
    inner = levels[top:top + rows * side_px, left:left + columns * side_px]
    return np.nanmedian(inner.reshape(rows, side_px, columns, side_px), axis=(1, 3))


def _places(count):
    """Middles of tiles, from -1 to 1 over all of them."""
    return (2 * np.arange(count) + 1) / count - 1


def _tilt(light, x, y):
    """Slopes of the illumination along x and y, by opposite tiles: the lens darkens these alike."""
    opposite = light[::-1, ::-1]
    uneven = (light - opposite) / (light + opposite)
    return np.linalg.lstsq(np.stack([x.ravel(), y.ravel()], axis=1), uneven.ravel(), rcond=None)[0]


def _over_rings(light, radius):
    """Shares of the half diagonal, medians of the light there relative to the axis, and the scatter of the tiles."""
    near = radius < MIDDLE
    parabola = np.polynomial.polynomial.polyfit(radius[near]**2, light[near], 1)
    edges = np.linspace(0, OUTERMOST, RINGS + 1)
    rings = [ring for ring in (np.flatnonzero((radius >= inner) & (radius < outer))
                               for inner, outer in zip(edges, edges[1:], strict=False)) if ring.size >= LEAST_TILES]
    shares = np.array([radius.flat[ring].mean() for ring in rings])
    curve = np.array([np.median(light.flat[ring]) for ring in rings]) / parabola[0]
    inside = radius < shares[-1]
    off = light[inside] / parabola[0] / np.interp(radius[inside], np.append(0, shares), np.append(1, curve)) - 1
    return shares, curve, float(TO_SIGMA * np.median(np.abs(off)))
