"""Depth in any renderer's picture: which channel of the file tells it, and what its numbers mean."""

import re

import numpy as np

from ..errors import ImageError
from .rgb_picture import flat_layers

DEPTH = re.compile(r"[a-z]*depth[0-9]*")  # what programs call a layer of depth, or its channel
GREYS = "Z", "V", "Y", "R"  # the channel of a layer that is called so
HALF_LIMIT = 65504.0  # the largest number of half precision: what is farther ends there
NOTHING = 1e9  # and beyond, in any unit: what is written where nothing is seen
MIXED_PX = 1.0  # of blur from a pixel whose depth is mixed to either side of it
STEEPER = 3.0  # times than the sides themselves go on, which a slanted plane never is


def depth_channel(parts: list[tuple[dict, dict]], layer: str = "",
                  wanted: str | None = None) -> tuple[str, dict, np.ndarray] | None:
    """The channel of depth in what `read_parts` gives.

    That is Z, or a layer's Z that is no vector's, or the channel of a layer that is called after depth.

    Parameters
    ----------
    parts : list of (header, {channel: plane})
    layer : str
        The layer that is the picture: of several depths, that of the name most like it is taken, and the shortest.
    wanted : str, optional
        Its name; of ViewLayer.Depth.Z the end, Depth.Z, is enough.

    Returns
    -------
    name, header, plane; or None where there is none

    Raises
    ------
    ImageError
        None of the wanted name, or several that are as near to the picture.
    """
    found = {}
    for name, (header, planes) in flat_layers(parts).items():
        depths = [component for component in planes if DEPTH.fullmatch(component.lower())]
        if any(DEPTH.fullmatch(word) for word in _words(name)):
            depths += [component for component in GREYS if component in planes][:1]
        elif "Z" in planes and "X" not in planes:
            depths.append("Z")
        found |= {f"{name}.{component}".lstrip("."): (header, planes[component]) for component in depths}
    if wanted is not None:
        near = [name for name in found if f".{name}".lower().endswith(f".{wanted}".lower())]
    elif found:
        order = {name: (-len(set(_words(name)) & set(_words(layer))), len(_words(name))) for name in found}
        near = [name for name in found if order[name] == min(order.values())]
    else:
        return None
    if len(near) != 1:
        raise ImageError("image", "depth", ", ".join(near or found) or "missing",
                         f"expected one channel called {wanted}" if wanted else "name one of them as the depth")
    return near[0], *found[near[0]]


def _words(name):
    return re.split(r"[^a-z0-9]+", name.lower())


def numbers_of_depth(plane: np.ndarray) -> tuple[np.ndarray, float]:
    """A plane of depth without what is none: float32 array (row, column), and the fraction of those pixels.

    What is not above 0, no number or at the end of half precision is infinitely far. Where cameras look down a
    negative axis, the sign is turned.
    """
    numbers = plane.astype(np.float32)
    with np.errstate(invalid="ignore"):
        if np.sum(np.sign(numbers), where=np.abs(numbers) < NOTHING) < 0:
            numbers = -numbers
        none = ~(numbers > 0)
        end = plane.dtype == np.float16 and numbers >= HALF_LIMIT
    numbers[none | end] = np.inf
    return numbers, float(none.mean())


@np.errstate(over="ignore", invalid="ignore")  # what lies in the pupil is blurred without end
def without_mixtures(numbers: np.ndarray, blur_per_nearness_px: float) -> np.ndarray:
    """Depth whose pixels at edges, where filters have mixed what is near with what is far, are of the nearer number.

    Such a pixel, or two in a row, lies between two surfaces, from each by more than MIXED_PX of blur and than they
    themselves go on; nothing is there.

    Parameters
    ----------
    numbers : array (row, column)
    blur_per_nearness_px : float
        Blur times depth, in these numbers.
    """
    mended, wide = numbers.copy(), np.pad(numbers, 3, constant_values=np.nan)
    blur = blur_per_nearness_px / wide
    rows, columns = numbers.shape
    for down, across in ((0, 1), (1, 0), (1, 1), (1, -1)):
        def at(plane, steps, down=down, across=across):
            top, left = 3 + steps * down, 3 + steps * across
            return plane[top:top + rows, left:left + columns]

        here = at(blur, 0)
        for apart in (1, 2):
            before, behind = at(blur, -apart) - here, here - at(blur, apart)
            goes_on = [np.abs(at(blur, side * (apart + 1)) - at(blur, side * apart)) for side in (-1, 1)]
            mixed = ((before * behind > 0) & (np.abs(before) > np.maximum(MIXED_PX, STEEPER * goes_on[0]))
                     & (np.abs(behind) > np.maximum(MIXED_PX, STEEPER * goes_on[1])))
            ends = [at(wide, side * apart)[mixed] for side in (-1, 1)]
            off = [np.abs(end - numbers[mixed]) for end in ends]
            mended[mixed] = np.where(off[0] <= off[1], *ends)
    return mended


def depth_in_mm(numbers: np.ndarray, unit_mm: float) -> np.ndarray:
    """Depth in mm, inf where nothing is: float32 array."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.where(numbers < NOTHING, numbers * np.float32(unit_mm), np.float32(np.inf))
