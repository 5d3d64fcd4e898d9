"""Even samples of the stop."""

import numpy as np

RAY_COUNTS = tuple(side**2 for side in (4, 8, 12, 16, 20, 24, 28, 32, 40, 48, 64))
"""Numbers of places that fill a square and are multiples of 8."""


def stop_places(count: int) -> np.ndarray:
    """Places of the stop, each in the middle of as much of its area: array (2, count), in semi-apertures.

    A square grid, mapped to the disc by squares that become circles (Shirley and Chiu, Journal of Graphics Tools 2(3),
    1997): cells stay nearly square, and those at the rim follow it. The places are drawn inwards so that cells that are
    each spread evenly have the second moment of the stop.

    Parameters
    ----------
    count : int
        One of `RAY_COUNTS`.
    """
    side = round(count**0.5)
    across, up = np.meshgrid(*[(2 * np.arange(side) + 1) / side - 1] * 2)
    wide = np.abs(across) > np.abs(up)
    azimuth = np.pi / 4 * np.where(wide, up / across, 2 - across / up)
    radius = np.sqrt(1 - np.pi / (3 * count)) * np.where(wide, across, up)
    places = radius * np.stack([np.cos(azimuth), np.sin(azimuth)])
    return _gathered(places.reshape(2, -1))


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
