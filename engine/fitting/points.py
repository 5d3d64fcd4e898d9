"""Discs of a distant point of light out of focus, in raw pictures: cat's eyes, which rims shape.

Their widths are the root mean square distances of the light from its centroid, along the radius from the middle of the
picture and across it. Unlike an outline, they need no threshold: all light counts, at the edge, too.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy

from ..runtime.errors import ImageError
from .raw_light import LEAST_SIGNAL, TO_SIGMA, check_clipped, read_green

SMOOTHED_PX = 5  # several cells of any filter array
FAINT, EDGE = 0.25, 0.5  # of the brightest light, which may be a bright rim, and of the median over the disc
RIVAL = 0.5  # of the disc's light: another one is as bright
LEAST_PX = 20  # the width of a disc
MARGIN, SURROUNDINGS = 0.15, 0.5  # of a disc's width: faint light at its edge, and the background
PIXEL_PX2 = 1 / 12  # the mean square of places in a pixel
CENTRAL = 0.1  # of the half diagonal, within which a disc is not cut
TO_MEDIAN = np.pi / 2  # from the variance of a mean to a median's


class Widths(NamedTuple):
    """Root mean square widths of a disc: along the radius from the axis, and across it."""

    radial_mm: float
    tangential_mm: float

    @property
    def ratio(self) -> float:
        """Radial by tangential width: 1 for a round disc, less for a cat's eye."""
        return self.radial_mm / self.tangential_mm

    @property
    def area_mm2(self) -> float:
        """Of the evenly lit ellipse with these widths."""
        return 4 * np.pi * self.radial_mm * self.tangential_mm


@dataclass(frozen=True)
class PointDisc:
    """The disc of a point of light in a picture.

    Attributes
    ----------
    path : Path
    f_number : float
    height_mm : float
        Distance of its centroid from the middle of the picture.
    widths : Widths
    ratio_sigma, area_sigma : float
        Standard deviations of the ratio, and of the area relative to itself, by noise and by edges in pixels.
    is_central : bool
        Whether it is close to the middle.
    """

    path: Path
    f_number: float
    height_mm: float
    widths: Widths
    ratio_sigma: float
    area_sigma: float
    is_central: bool


def read_point(path: str | os.PathLike[str], sensor_mm: tuple[float, float], focal_mm: float | None,
               f_number: float | None = None) -> PointDisc:
    """Measure the brightest disc in a raw picture.

    Parameters
    ----------
    path : path
    sensor_mm : (float, float)
        Width and height of the camera's sensor.
    focal_mm, f_number : float or None
        As `read_green`.

    Raises
    ------
    ImageError
        As `read_green`; or the picture is dark, has several discs, or one that is clipped, small or cut by the border.
    """
    path = Path(path)
    picture = read_green(path, focal_mm, f_number)
    inside = _brightest_disc(path, picture.levels)
    check_clipped(path, np.where(inside, picture.levels, np.nan))
    return _measured(path, picture, _light_around(picture.levels, inside), sensor_mm)


def _brightest_disc(path, levels):
    """Whether each pixel is in the brightest disc."""
    light = _smoothed(levels)
    light -= np.median(light)
    if light.max() < LEAST_SIGNAL:
        raise ImageError(path, "exposure", f"{light.max():.1%} of saturation at most", "expose the disc longer")
    inside, _ = _brightest_part(light, FAINT * light.max())
    inside, rival = _brightest_part(light, EDGE * np.median(light[inside]))
    if rival > RIVAL:
        raise ImageError(path, "discs", f"another has {rival:.0%} of the light of the brightest",
                         "photograph one lamp in the dark")
    (top, bottom), (left, right) = ((each.min(), each.max() + 1) for each in np.nonzero(inside))
    inside[top:bottom, left:right] = scipy.ndimage.binary_fill_holes(inside[top:bottom, left:right])
    width_px = _width_px(inside)
    if min(top, left, inside.shape[0] - bottom, inside.shape[1] - right) <= MARGIN * width_px:
        raise ImageError(path, "disc", "cut by the border of the picture", "turn the camera until it is all inside")
    if width_px < LEAST_PX:
        raise ImageError(path, "disc", f"{width_px:.0f} pixels wide",
                         f"expected at least {LEAST_PX}: set the lens to its closest distance")
    return inside


def _smoothed(levels):
    """Mean of the green pixels around each pixel."""
    green = np.isfinite(levels)
    mean, share = (scipy.ndimage.uniform_filter(each, SMOOTHED_PX, mode="constant")
                   for each in (np.where(green, levels, 0.0), green.astype(float)))
    return mean / share


def _brightest_part(light, least):
    """Whether each pixel is in the connected part above a level that has the most light, and the light of the next
    one relative to it."""
    parts, count = scipy.ndimage.label(light > least)
    totals = scipy.ndimage.sum_labels(light, parts, np.arange(count) + 1)
    brightest = int(np.argmax(totals))
    return parts == brightest + 1, float(max(np.delete(totals, brightest), default=0.0) / totals[brightest])


def _width_px(inside):
    """Diameter of the circle with this area."""
    return 2 * np.sqrt(np.count_nonzero(inside) / np.pi)


class _Light(NamedTuple):
    """Green pixels of a disc and of its faint edge: arrays (pixel,)."""

    x_px: np.ndarray  # from the middle of the picture to the right
    y_px: np.ndarray  # and down
    level: np.ndarray  # above the background
    variance: np.ndarray
    background_variance: float  # the same error in all pixels

    def mean(self, values):
        """Mean over the light."""
        return np.sum(self.level * values) / np.sum(self.level)

    def sigma(self, values):
        """Standard deviation of that mean, of values whose mean is 0."""
        variance = np.sum(self.variance * values**2) + self.background_variance * np.sum(values)**2
        return float(np.sqrt(variance) / np.sum(self.level))


def _light_around(levels, inside):
    """The light of the disc, with the background and the variances that the picture itself shows."""
    width_px = _width_px(inside)
    window = tuple(slice(max(0, each.min() - int(SURROUNDINGS * width_px)), each.max() + int(SURROUNDINGS * width_px))
                   for each in np.nonzero(inside))
    rows, columns = np.nonzero(np.isfinite(levels[window]))
    from_px, into_px = (scipy.ndimage.distance_transform_edt(each)[rows, columns]
                        for each in (~inside[window], inside[window]))
    level, near = levels[window][rows, columns], from_px <= MARGIN * width_px
    background = np.median(level[~near])
    noise, dark_noise = (_noise(levels[window], rows[each], columns[each])
                         for each in (into_px > into_px.max() / 2, ~near))
    # a pixel on the edge is in the disc or not: an even distribution over one level
    at_edge = np.maximum(from_px, into_px) <= 1
    plateau = np.median(level[into_px > 0]) - background
    variance = np.where(into_px > 0, noise, dark_noise)**2 + at_edge * plateau**2 * PIXEL_PX2
    x_px, y_px = (place + part.start + 0.5 - count / 2 for place, part, count in
                  zip((columns, rows), window[::-1], levels.shape[::-1], strict=True))
    return _Light(x_px[near], y_px[near], level[near] - background, variance[near],
                  float(TO_MEDIAN * dark_noise**2 / np.count_nonzero(~near)))


def _noise(levels, rows, columns):
    """Standard deviation of pixels about their surroundings."""
    return TO_SIGMA * np.median(np.abs(levels - _smoothed(levels))[rows, columns])


def _measured(path, picture, light, sensor_mm):
    centre = light.mean(light.x_px), light.mean(light.y_px)
    height_px, half_px = np.hypot(*centre), np.hypot(*picture.levels.shape) / 2
    turn = np.arctan2(*centre[::-1])
    to_x, to_y = np.cos(turn), np.sin(turn)
    x_px, y_px = light.x_px - centre[0], light.y_px - centre[1]
    radial, tangential = (to_x * x_px + to_y * y_px)**2, (to_x * y_px - to_y * x_px)**2
    squares_px2 = [light.mean(each) for each in (radial, tangential)]
    radial, tangential = (each / square - 1 for each, square in zip((radial, tangential), squares_px2, strict=True))
    pixel_mm = np.hypot(*sensor_mm) / (2 * half_px)
    widths = Widths(*(float(pixel_mm * np.sqrt(each - PIXEL_PX2)) for each in squares_px2))
    return PointDisc(path, picture.f_number, float(height_px * pixel_mm), widths,
                     widths.ratio * light.sigma((radial - tangential) / 2), light.sigma((radial + tangential) / 2),
                     bool(height_px < CENTRAL * half_px))
