"""Depth in a picture from any renderer: the channel that contains it, and the meaning of its numbers."""

import re

import numpy as np

from ..runtime.errors import ImageError
from .rgb_picture import flat_layers

DEPTH = re.compile(r"[a-z]*depth[0-9]*")  # names that programs give to a layer of depth, or to its channel
GREYS = "Z", "V", "Y", "R"  # the channel of depth in a layer with such a name
HALF_LIMIT = 65504.0  # the largest number in half precision, used for anything farther
NOTHING = 1e9  # numbers from here on, in any unit, mean an empty pixel
MIXED_PX = 1.0  # least difference in blur between a pixel of mixed depth and its neighbours on both sides
STEEPER = 3.0  # least ratio of that difference to the slope of the surfaces beyond; a slanted plane never reaches it


def depth_channel(parts: list[tuple[dict, dict]], layer: str = "",
                  wanted: str | None = None) -> tuple[str, dict, np.ndarray] | None:
    """The channel of depth in the result of `read_parts`.

    It is Z, or a layer's Z that is not part of a vector, or the channel of a layer that is named after depth.

    Parameters
    ----------
    parts : list of (header, {channel: plane})
    layer : str
        The layer of the picture: among several depths, the one with the most similar and then the shortest name is
        used.
    wanted : str, optional
        Its name, or the end of it: Depth.Z for ViewLayer.Depth.Z.

    Returns
    -------
    name, header, plane; or None for a picture without depth

    Raises
    ------
    ImageError
        The wanted name does not exist, or several names match equally well.
    """
    candidates = {}
    for name, (header, planes) in flat_layers(parts).items():
        depths = [component for component in planes if DEPTH.fullmatch(component.lower())]
        if any(DEPTH.fullmatch(word) for word in _words(name)):
            depths += [component for component in GREYS if component in planes][:1]
        elif "Z" in planes and "X" not in planes:
            depths.append("Z")
        candidates |= {f"{name}.{component}".lstrip("."): (header, planes[component]) for component in depths}
    if wanted is not None:
        matches = [name for name in candidates if f".{name}".lower().endswith(f".{wanted}".lower())]
    elif candidates:
        order = {name: (-len(set(_words(name)) & set(_words(layer))), len(_words(name))) for name in candidates}
        matches = [name for name in candidates if order[name] == min(order.values())]
    else:
        return None
    if len(matches) != 1:
        raise ImageError("image", "depth", ", ".join(matches or candidates) or "missing",
                         f"expected one channel named {wanted}" if wanted else "name one of them as the depth")
    return matches[0], *candidates[matches[0]]


def _words(name):
    return re.split(r"[^a-z0-9]+", name.lower())


def numbers_of_depth(plane: np.ndarray) -> tuple[np.ndarray, float]:
    """A plane of depth with invalid pixels set to inf: float32 array (row, column); and the invalid fraction.

    Numbers that are NaN or not above 0 are invalid. The largest number of half precision also becomes inf. The sign is
    reversed for cameras that look along a negative axis.
    """
    numbers = plane.astype(np.float32)
    with np.errstate(invalid="ignore"):
        if np.sum(np.sign(numbers), where=np.abs(numbers) < NOTHING) < 0:
            numbers = -numbers
        invalid = ~(numbers > 0)
        at_limit = plane.dtype == np.float16 and numbers >= HALF_LIMIT
    numbers[invalid | at_limit] = np.inf
    return numbers, float(invalid.mean())


@np.errstate(over="ignore", invalid="ignore")  # blur is infinite for points in the pupil
def without_mixtures(numbers: np.ndarray, blur_per_nearness_px: float) -> np.ndarray:
    """Depth in which pixels at edges, where filters have mixed near and far, take the closer neighbour's number.

    The depth of such a pixel, or of two in a row, is between two surfaces, where nothing exists. Its blur differs from
    both neighbours' by more than MIXED_PX, and by more than STEEPER times the change within each surface.

    Parameters
    ----------
    numbers : array (row, column)
    blur_per_nearness_px : float
        Blur times depth, in the unit of `numbers`.
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
    """Depth in mm, inf for empty pixels: float32 array."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.where(numbers < NOTHING, numbers * np.float32(unit_mm), np.float32(np.inf))
