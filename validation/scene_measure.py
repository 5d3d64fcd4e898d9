"""Compare a picture with two plain renders of the same scene, whose difference shows the noise.

Pictures are float arrays (4, row, column): linear R, G, B, and alpha, row 0 at the top. The light of marks is what a
picture has in addition to a render without them, so that other things near a mark do not matter.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation, maximum_filter, uniform_filter

from lensfield.engine.spectral.colour_difference import ciede2000, lab_from_xyz

BLOCK_PX = 8
SIGMAS = 5
LENS_NOISE = 1.3
"""Noise of Lensfield's picture, relative to the noise of a plain render: its passes share most samples."""
MOST_OFF_PX = 0.3
MOST_NOISE = 0.1  # 5 sigma of the mean: more would hide errors
NOISE_TIMES = 2  # the variance of few pixels is uncertain
WINDOW_PX = 5
MARK_SHARE = 0.25  # of the brightest pixel around: a mark with less light is not visible
SUPPORT_SHARE, SUPPORT_PX = 0.02, 2  # of a mark's brightest pixel: brighter pixels and those around them are the mark
MISSING = 0.5  # of a mark's light
COLOUR_FLOOR = 0.5
"""CIEDE2000 beyond the predicted error: pure colours at 21 wavelengths are off by up to 1 % in a channel."""
COLOUR_TIMES = 2  # of the predicted error, which 95 % of the possible colours keep, in the worst block
ALPHA_OFF = 0.005
DARK = 0.01  # of the brightest pixel: a block with less light counts as this bright
XYZ = np.array([[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750],
                [0.0193339, 0.1191920, 0.9503041]])  # of linear Rec. 709
WHITE_PERCENTILE = 90  # of the luminance: lamps are brighter than white
BLACK = 1e-3  # of the mean luminance: darker pixels show nothing


@dataclass(frozen=True)
class Limits:
    """What a picture may differ by, in addition to the noise.

    Attributes
    ----------
    colour_error : float
        CIEDE2000 that 95 % of the scene's possible colours keep: the predicted one.
    paint_error : float
        CIEDE2000 of the colour in the scene that is known to differ most.
    misplaced : float
        Share of the light of a block and of those around it that may be in another.
    detail : float
        RMS difference of the luminances of a block, relative to their RMS.
    """

    colour_error: float = 0.0
    paint_error: float = 0.0
    misplaced: float = 0.0
    detail: float = 0.2


@dataclass(frozen=True, eq=False)
class Marks:
    """Small lamps whose places and sizes are measured.

    Attributes
    ----------
    places_px : dict
        (row, column) near each, by name.
    without : array (4, row, column)
        A plain render in which the camera does not see them.
    samples : int
        Of each pixel of the renders: the noise of a mark's edge is that of counting samples.
    """

    places_px: dict
    without: np.ndarray
    samples: int


@dataclass(frozen=True)
class Comparison:
    """How a picture differs from plain renders.

    Attributes
    ----------
    means : tuple of float
        R, G and B over the plain ones; 1 where both are black.
    colour, worst_colour : float
        CIEDE2000 that noise does not explain, of the picture's mean and of the worst block.
    worst_block : (int, int)
        Row and column of the block.
    detail : float
        Largest RMS difference of the pixels of a block that noise does not explain, relative to their RMS light.
    alpha : float
        Largest difference of the mean alpha of a block that noise does not explain.
    off_px : dict
        For each visible mark, the distance from its place in the plain renders, or the difference of its RMS radius if
        that is larger; inf for a missing one.
    most_off_px : dict
        The limit of each: that of all marks, or 5 sigma of noise if that is more.
    noise : float
        5 sigma of noise of the mean luminance, relative to it.
    faults : tuple of str
        What exceeds its limit.
    """

    means: tuple[float, ...]
    colour: float
    worst_colour: float
    worst_block: tuple[int, int]
    detail: float
    alpha: float
    off_px: dict
    most_off_px: dict
    noise: float
    faults: tuple[str, ...]


def compare(picture, plain, marks, limits=Limits()):
    """Compare a picture with two plain renders with different seeds: Comparison.

    Parameters
    ----------
    picture : array (4, row, column)
    plain : sequence of two arrays (4, row, column)
    marks : Marks
    limits : Limits
    """
    first, second = plain
    if picture.shape != first.shape:
        return _of_another_size(picture, first)
    true = (first + second) / 2
    blocks, true_blocks = _means(picture), _means(true)
    slack = SIGMAS * _sigma(first, second) + limits.misplaced * _around(true_blocks)
    white = _white(_luminance(true))
    colours = _colour_difference(blocks[:3], true_blocks[:3], slack[:3], white)
    rest = _beyond(blocks[3] - true_blocks[3], slack[3])
    mean, true_mean, slack_mean = (planes.mean(axis=(1, 2))[:, None, None] for planes in (picture, true, true))
    slack_mean = SIGMAS * _sigma_of_mean(first, second)[:, None, None]
    colour = float(_colour_difference(mean[:3], true_mean[:3], slack_mean[:3], white).max())
    off = _marks_off(picture, first, second, marks)
    worst = np.unravel_index(np.argmax(colours), colours.shape)
    means = tuple(float(m / t) if t > 0 else 1.0 if m == 0 else np.inf
                  for m, t in zip(mean.ravel()[:3], true_mean.ravel()[:3], strict=True))
    of_mean = float(_luminance(slack_mean).item() / max(_luminance(true_mean).item(), 1e-9))
    found = Comparison(means, colour, float(colours.max()), tuple(map(int, worst)), _detail(picture, first, second),
                       float(np.abs(rest).max()), {name: found for name, (found, _) in off.items()},
                       {name: most for name, (_, most) in off.items()}, of_mean, ())
    return _judged(found, limits)


def _white(luminance):
    """The luminance of bright surfaces. Black pixels do not count: they may be nearly all of the picture."""
    lit = luminance[luminance > BLACK * luminance.mean()]
    return max(np.percentile(lit, WHITE_PERCENTILE), 1e-9) if lit.size else 1e-9


def _judged(found, limits):
    """The comparison with its faults."""
    faults, most = [], limits.colour_error + COLOUR_FLOOR
    if not found.colour <= most:
        faults.append(f"mean colour off by CIEDE2000 {found.colour:.2g} (at most {most:.2g})")
    most = max(COLOUR_TIMES * limits.colour_error, limits.paint_error) + COLOUR_FLOOR
    if not found.worst_colour <= most:
        faults.append(f"block {found.worst_block[0]}, {found.worst_block[1]} off by CIEDE2000 "
                      f"{found.worst_colour:.2g} (at most {most:.2g})")
    if not found.detail <= limits.detail:
        faults.append(f"pixels of a block off by {found.detail:.1%} (at most {limits.detail:.0%})")
    if not found.noise <= MOST_NOISE:
        faults.append(f"noise of {found.noise:.0%} of the light (at most {MOST_NOISE:.0%})")
    if not found.alpha <= ALPHA_OFF + limits.misplaced:
        faults.append(f"alpha off by {found.alpha:.2g}")
    faults += [f"{name} is missing" if off == np.inf else f"{name} off by {off:.2g} px"
               for name, off in found.off_px.items() if not off <= found.most_off_px[name]]
    return Comparison(**vars(found) | {"faults": tuple(faults)})


def _of_another_size(picture, plain):
    size, true = ("{2} x {1} px".format(*planes.shape) for planes in (picture, plain))
    nan = float("nan")
    words = f"the picture has {size}, the plain one {true}"
    return Comparison((nan,) * 3, nan, nan, (0, 0), nan, nan, {}, {}, nan, (words,))


def _means(planes):
    """Means of blocks: array (..., row, column). The last ones may be smaller."""
    return _over_blocks(planes) / _over_blocks(np.ones_like(planes))


def _over_blocks(planes):
    rows, columns = (np.arange(0, n, BLOCK_PX) for n in planes.shape[-2:])
    return np.add.reduceat(np.add.reduceat(planes, rows, axis=-2), columns, axis=-1)


def _largest(plane):
    rows, columns = (np.arange(0, n, BLOCK_PX) for n in plane.shape)
    return np.maximum.reduceat(np.maximum.reduceat(plane, rows, axis=0), columns, axis=1)


def _sigma(first, second):
    """Standard deviation of the difference of block means between Lensfield's picture and the mean of two plain ones.

    Few pixels may miss a rare event that their neighbours show, so the variance is at least the mean of the blocks
    around.
    """
    variance = _over_blocks((first - second) ** 2 / 2) / _over_blocks(np.ones_like(first)) ** 2
    around = uniform_filter(variance, (0, 3, 3), mode="nearest")
    return np.sqrt((LENS_NOISE**2 + 0.5) * np.maximum(variance, around))


def _sigma_of_mean(first, second):
    pixels = np.prod(first.shape[-2:])
    return np.sqrt((LENS_NOISE**2 + 0.5) * ((first - second) ** 2 / 2).mean(axis=(1, 2)) / pixels)


def _around(blocks):
    """The brightest of each block and its neighbours."""
    return maximum_filter(blocks, (0, 3, 3), mode="nearest")


def _beyond(off, slack):
    """The part of differences that slack does not explain."""
    return np.sign(off) * np.maximum(np.abs(off) - slack, 0)


def _colour_difference(blocks, true, slack, white):
    """CIEDE2000 of the part of differences that slack does not explain: array (row, column)."""
    near = true + _beyond(blocks - true, slack)
    first, second = (lab_from_xyz(np.maximum(np.einsum("xc,c...->...x", XYZ, planes), 0), white * XYZ.sum(axis=1))
                     for planes in (near, true))
    return ciede2000(first, second)


def _luminance(planes):
    return np.tensordot(XYZ[1], planes[:3], 1)


def _detail(picture, first, second):
    """The largest RMS difference of a block's luminances that noise does not explain, relative to their RMS.

    The pixel that differs most is left out of each block: a single one may have a rare, bright path, such as a caustic.
    """
    picture, first, second = (_luminance(planes) for planes in (picture, first, second))
    true = (first + second) / 2
    expected = NOISE_TIMES * (LENS_NOISE**2 + 0.5) * _means((first - second) ** 2 / 2)
    squares = (picture - true) ** 2
    excess = _means(squares) - _largest(squares) / _over_blocks(np.ones_like(squares))
    excess -= maximum_filter(expected, 3, mode="nearest")
    light = np.maximum(_means(true**2), max(DARK * true.max(), 1e-12) ** 2)
    return float(np.sqrt(np.maximum(excess, 0) / light).max())


def _marks_off(picture, first, second, marks):
    """For each visible mark, by name, its distance and the limit, in px."""
    windows = {name: _window(place, picture.shape[1:]) for name, place in marks.places_px.items()}
    without = _luminance(marks.without)
    light, of_first, of_second = (_luminance(planes) - without for planes in (picture, first, second))
    brightest = max((np.abs(of_first[window]).max() for window in windows.values() if window), default=0)
    found = {name: _mark_off(*(plane[window] for plane in (light, of_first, of_second, without)), brightest,
                             marks.samples) for name, window in windows.items() if window}
    return {name: off for name, off in found.items() if off}


def _window(place, shape_px):
    """Slices of rows and columns around a place; None outside the picture."""
    window = tuple(slice(max(round(at) - WINDOW_PX, 0), max(round(at) + WINDOW_PX + 1, 0)) for at in place)
    sides = [len(range(n)[side]) for n, side in zip(shape_px, window, strict=True)]
    return window if min(sides) >= 3 else None


def _mark_off(light, first, second, without, brightest, samples):
    """Distance between the places of a mark in a picture and in two plain renders, or the difference of its radii if
    that is larger, and the limit, in px. It is inf if only one of them shows the mark; None if neither does.

    Parameters
    ----------
    light, first, second : array (row, column)
        The mark's light in a window.
    without : array (row, column)
        The other light.
    brightest : float
        Light of a mark that covers a pixel.
    samples : int
    """
    true = (first + second) / 2
    support = _support(true)
    light = light - without * _tint(light, without, ~support)
    light, true, first, second = (np.where(support, plane, 0) for plane in (light, true, first, second))
    covered = np.clip(np.abs(true) / max(brightest, 1e-12), 0, 1)
    by_count, by_renders = brightest**2 / samples * covered * (1 - covered), (first - second)**2 / 2

    def five_sigma(weight=1.0, least=0.0):
        """Of a sum over the pixels; at least of one sample."""
        return SIGMAS * np.sqrt((LENS_NOISE**2 + 0.5) * (least**2 + max(
            np.sum(weight**2 * variance) for variance in (by_count, by_renders))))

    total, true_total, of_total = light.sum(), true.sum(), five_sigma(least=brightest / samples)
    if abs(_beyond(total - true_total, of_total)) > MISSING * max(abs(total), abs(true_total)):
        return np.inf, MOST_OFF_PX
    least = min(total * np.sign(true_total), abs(true_total))
    faint = abs(true_total) <= of_total or least < MISSING * abs(true_total)  # as far as noise explains
    if faint or np.abs(true).max() <= MARK_SHARE * np.max(true + without):
        return None
    (at, radius), (true_at, true_radius) = _moments(light), _moments(true)
    away = np.indices(true.shape) - true_at[:, None, None]
    of_place = max(five_sigma(along) for along in away) / least
    of_radius = five_sigma((away**2).sum(axis=0) - true_radius**2) / least / max(radius + true_radius, 1e-6)
    off = max(np.hypot(*(at - true_at)), abs(radius - true_radius))
    return float(off), float(max(MOST_OFF_PX, of_place, of_radius))


def _support(light):
    """The pixels that belong to a mark; all of a window without one."""
    size = np.abs(light)
    return binary_dilation(size > SUPPORT_SHARE * size.max(), iterations=SUPPORT_PX) if size.any() else size == 0


def _tint(light, without, around):
    """How much brighter a picture is around a mark, relative to the light there."""
    other = without[around].sum()
    return light[around].sum() / other if other > 0 else 0.0


def _moments(light):
    """Centroid and RMS radius."""
    rows, columns = np.indices(light.shape)
    at = np.array([np.sum(rows * light), np.sum(columns * light)]) / light.sum()
    square = np.sum(((rows - at[0])**2 + (columns - at[1])**2) * light) / light.sum()
    return at, np.sqrt(max(square, 0))
