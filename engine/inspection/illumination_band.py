"""Limits of the relative illumination of a lens whose rims are not known exactly."""

from collections.abc import Sequence

import numpy as np

from ..prescription.prescription import ESTIMATED, FITTED, GUESSED, TYPICAL, Prescription

SHARES = 0.0, 0.5, 0.75, 0.9, 0.95  # of the half diagonal
_ESTIMATED = ((0, 0.20, 0.30, 0.35, 0.37), (0, 0.01, 0.12, 0.18, 0.21), (0, 0.00, 0.02, 0.09, 0.12),
              (0, 0.00, 0.00, 0.04, 0.08), (0, 0.00, 0.00, 0.00, 0.03))
_TYPICAL = ((0, 0.08, 0.13, 0.19, 0.22), (0, 0.01, 0.08, 0.12, 0.13), (0, 0.00, 0.02, 0.11, 0.13),
            (0, 0.00, 0.00, 0.04, 0.07), (0, 0.00, 0.00, 0.00, 0.02))
ERRORS = {ESTIMATED: _ESTIMATED, GUESSED: _ESTIMATED, TYPICAL: _TYPICAL}
"""Relative errors of light at `SHARES`, from the widest f-stop to four below, by the origin of the apertures: root mean
squares of ten lenses whose rims are fitted to photographs (`validation/typical_light.py`; docs/photographs.md)."""


def illumination_band(prescription: Prescription | None, shares: Sequence[float] | np.ndarray,
                      light: np.ndarray) -> np.ndarray | None:
    """Limits that contain the light of about two lenses in three.

    Parameters
    ----------
    prescription : Prescription or None
        Set to its f-number.
    shares : array (place,)
        Distances from the middle of the picture in half diagonals.
    light : array (..., place)
        Relative illumination of the prescription.

    Returns
    -------
    array (2, ..., place), or None if the sizes of the rims are figures of the patent or of a publication, or if their
    origin is unknown.
    """
    if prescription is None:
        return None
    photographs = prescription.photographs
    if prescription.aperture_origin == FITTED and photographs and photographs.illumination is not None:
        off = photographs.illumination * np.minimum(np.asarray(shares) / SHARES[1], 1)
        return np.stack([light - off, light + off])
    error = relative_error(prescription, shares)
    if error is None:
        return None
    return np.stack([light * np.exp(-error), np.minimum(light * np.exp(error), np.maximum(light, 1))])


def relative_error(prescription: Prescription, shares: Sequence[float] | np.ndarray) -> np.ndarray | None:
    """Relative error of the light at shares of the half diagonal, where `ERRORS` have the origin of the apertures:
    array (place,), or None."""
    rows = ERRORS.get(prescription.aperture_origin)
    if rows is None:
        return None
    below = min(2 * np.log2(prescription.stop_rim), len(rows) - 1)  # f-stops below the widest
    by_stop = np.array([np.interp(shares, SHARES, row) for row in rows])
    return np.array([np.interp(below, range(len(rows)), column) for column in by_stop.T])
