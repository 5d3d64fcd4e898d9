"""Even samples of the stop."""

from functools import cache
from itertools import permutations
from pathlib import Path

import numpy as np

RAY_COUNTS = tuple(side**2 for side in (4, 8, 12, 16, 20, 24, 28, 32, 40, 48, 64))
"""Numbers of places that fill a square and are multiples of 8."""
MANY = 1024  # places: fewer, which are cast where blur is narrow, keep more of its light in a lattice
FILE = Path(__file__).with_suffix(".npz")
QUARTERS = (1, 1), (-1, 1), (1, -1), (-1, -1)  # of the disc: factors on places


@cache
def stop_places(count: int) -> np.ndarray:
    """Places of the stop, each in the middle of as much of its area: read-only array (2, count), in semi-apertures.

    They are drawn inwards so that cells that are each spread evenly have the second moment of the stop. Every fourth
    place from the first, second, third and fourth one on is nearly even, too.

    Parameters
    ----------
    count : int
        One of `RAY_COUNTS`.
    """
    places = _spread()[count] if count >= MANY else lattice(count)
    dealt = _dealt(_gathered(np.sqrt(1 - np.pi / (3 * count)) * places))
    dealt.flags.writeable = False
    return dealt


@cache
def _spread():
    """Places by their count, as packaging/spread_stop_places.py wrote them: in no lattice, which would show as rings
    and spokes in the disc of a lamp wherever the lens's aberrations stretch it."""
    with np.load(FILE) as file:
        return {int(count): np.concatenate([places * np.array(quarter)[:, None] for quarter in QUARTERS], axis=1)
                for count, places in file.items()}


def lattice(count: int) -> np.ndarray:
    """A square grid, mapped to the disc by squares that become circles (Shirley and Chiu, Journal of Graphics Tools
    2(3), 1997): cells stay nearly square, and those at the rim follow it. Array (2, count), in semi-apertures."""
    side = round(count**0.5)
    across, up = np.meshgrid(*[(2 * np.arange(side) + 1) / side - 1] * 2)
    wide = np.abs(across) > np.abs(up)
    azimuth = np.pi / 4 * np.where(wide, up / across, 2 - across / up)
    radius = np.where(wide, across, up)
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth)]).reshape(2, -1)


def cell_size(count: int) -> float:
    """Side of the part of the stop that each of its places represents, in semi-apertures."""
    return float(np.sqrt(np.pi / count))


def _gathered(places):
    """Places in an order in which each eight is adjacent: its rays mostly meet the same layers."""
    count = places.shape[1]
    if count <= 8:
        return places
    places = places[:, np.argsort(places[np.argmax(np.ptp(places, axis=1))], kind="stable")]
    half = count // 16 * 8
    return np.concatenate([_gathered(places[:, :half]), _gathered(places[:, half:])], axis=1)


def _dealt(places):
    """Places in an order in which every fourth one, from each of the first four on, is far from the others of its
    fourth: each four, which are close together, in the order that suits the places before them best."""
    orders, dealt = np.array(list(permutations(range(4)))), places.copy()
    variance = 2 * cell_size(places.shape[1])**2
    for first in range(4, places.shape[1], 4):
        four, before = dealt[:, first:first + 4], dealt[:, :first].reshape(2, -1, 4)
        squares = ((four[:, :, None, None] - before[:, None])**2).sum(axis=0)
        closeness = np.exp(-squares / variance).sum(axis=1)  # of each of the four to each fourth
        best = orders[np.argmin([sum(closeness[order[fourth], fourth] for fourth in range(4)) for order in orders])]
        dealt[:, first:first + 4] = four[:, best]
    return dealt
