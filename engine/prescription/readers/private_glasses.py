"""Code V's private glasses: indices at the file's wavelengths, or coefficients of a Laurent series."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...runtime.errors import LensError
from ...spectral.refraction import Formula
from ..glasses import Glass
from .lines import Line

SERIES = 3  # refractiveindex.info's formula n^2 = c1 + c2 L^c3 + c4 L^c5 ..., L in micrometres
POWERS = (0, -2, 2, -4)  # of L, fitted to the indices; no more of them than indices
LAURENT, LAURENT_POWERS = "LAU", (0, 2, -2, -4, -6, -8)
MOST_RESIDUAL = 1e-3  # of an index: tables are rounded to four decimals
VISIBLE_NM = (380.0, 750.0)
EVERYWHERE_NM = (0.0, np.inf)


class PrivateGlass(NamedTuple):
    """A private glass of the file, and a note on it."""

    glass: Glass
    note: str


def private_glasses(lines: Sequence[Line]) -> list[PrivateGlass]:
    """Read the glasses between PRV and END.

    Parameters
    ----------
    lines : sequence of Line
        `PWL` and wavelengths in nm; then `'NAME'` and an index at each, or `'NAME' LAU` and coefficients.

    Raises
    ------
    LensError
        A word that is not a number, a wrong count of indices, or indices that are impossible for a glass.
    """
    glasses, nm = [], np.empty(0)
    for line in lines:
        name = line.words[0].strip("'\"").upper()
        if name == "PWL":
            nm = np.array(line.figures())
        elif line.words[1:2] and line.words[1].upper() == LAURENT:
            glasses.append(PrivateGlass(Glass(name, _series(LAURENT_POWERS, line.figures(2), EVERYWHERE_NM)), ""))
        else:
            glasses.append(_fitted(name, line, nm, np.array(line.figures())))
    return glasses


def _fitted(name, line, nm, indices):
    """A glass whose squared index is a least-squares series through the file's squared indices."""
    if indices.size != nm.size or nm.size < 2 or np.any(nm <= 0) or np.any(indices <= 1):
        raise line.refusal("expected LAU and coefficients, or an index above 1 at each of two or more PWL wavelengths")
    powers = POWERS[:nm.size]
    terms = np.stack([(nm * 1e-3) ** power for power in powers], axis=1)
    scale = np.linalg.norm(terms, axis=0)
    coefficients = np.linalg.lstsq(terms / scale, indices**2, rcond=None)[0] / scale
    residual = np.max(np.abs(np.sqrt(np.maximum(terms @ coefficients, 0)) - indices))
    if not residual < MOST_RESIDUAL:
        raise LensError(line.path, f"private glass {name}", f"{residual:.2g} off a smooth curve",
                        "expected indices that fall slowly with wavelength: one may be mistyped")
    within = nm.min() <= VISIBLE_NM[0] and nm.max() >= VISIBLE_NM[1]
    note = "" if within else (f"The indices of {name}, which the file gives for {nm.min():g} to {nm.max():g} nm, are "
                              "extrapolated over the visible range.")
    known_nm = (min(nm.min(), VISIBLE_NM[0]), max(nm.max(), VISIBLE_NM[1]))
    return PrivateGlass(Glass(name, _series(powers, coefficients, known_nm)), note)


def _series(powers, coefficients, range_nm):
    """The formula of a power series; missing coefficients are 0."""
    values = np.zeros(len(powers))
    values[:len(coefficients)] = coefficients
    pairs = [(float(value), float(power)) for value, power in zip(values[1:], powers[1:], strict=True)]
    return Formula(SERIES, (float(values[0]), *(number for pair in pairs for number in pair)), range_nm)
