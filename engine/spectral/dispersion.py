"""The nine dispersion formulas of refractiveindex.info: refractive index from coefficients C1, C2 … and micrometres.

Source: "Dispersion formulas", part of the database (CC0), and M. N. Polyanskiy, Scientific Data 11, 94 (2024).
Omitted coefficients are zero.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np


def _terms(c, first):
    """Pairs of coefficients from C`first` on, without pairs whose first is zero: a zero term must not have a pole."""
    return [(c[i], c[i + 1]) for i in range(first - 1, len(c) - 1, 2) if c[i]]


def _sellmeier(c, um):
    return np.sqrt(1 + c[0] + sum(b * um**2 / (um**2 - pole**2) for b, pole in _terms(c, 2)))


def _sellmeier_2(c, um):
    return np.sqrt(1 + c[0] + sum(b * um**2 / (um**2 - pole) for b, pole in _terms(c, 2)))


def _polynomial(c, um):
    return np.sqrt(c[0] + sum(b * um**power for b, power in _terms(c, 2)))


def _refractiveindex_info(c, um):
    poles = sum(b * um**power / (um**2 - pole**exponent) for b, power, pole, exponent in (c[1:5], c[5:9]) if b)
    return np.sqrt(c[0] + poles + sum(b * um**power for b, power in _terms(c, 10)))


def _cauchy(c, um):
    return c[0] + sum(b * um**power for b, power in _terms(c, 2))


def _gases(c, um):
    return 1 + c[0] + sum(b / (pole - um**-2) for b, pole in _terms(c, 2))


def _herzberger(c, um):
    pole = 1 / (um**2 - 0.028)
    return c[0] + c[1] * pole + c[2] * pole**2 + c[3] * um**2 + c[4] * um**4 + c[5] * um**6


def _retro(c, um):
    ratio = c[0] + c[1] * um**2 / (um**2 - c[2]) + c[3] * um**2  # (n^2 - 1) / (n^2 + 2)
    return np.sqrt((1 + 2 * ratio) / (1 - ratio))


def _exotic(c, um):
    return np.sqrt(c[0] + c[1] / (um**2 - c[2]) + c[3] * (um - c[4]) / ((um - c[4])**2 + c[5]))


@dataclass(frozen=True)
class _Formula:
    index: Callable
    most_coefficients: int


FORMULAS = {1: _Formula(_sellmeier, 17), 2: _Formula(_sellmeier_2, 17), 3: _Formula(_polynomial, 17),
            4: _Formula(_refractiveindex_info, 17), 5: _Formula(_cauchy, 11), 6: _Formula(_gases, 11),
            7: _Formula(_herzberger, 6), 8: _Formula(_retro, 4), 9: _Formula(_exotic, 6)}


def dispersion(number: int, coefficients: Sequence[float], wavelengths_um: np.ndarray) -> np.ndarray:
    """Refractive indices by one of the formulas; NaN where it is undefined.

    Parameters
    ----------
    number : int, 1 to 9
    coefficients : sequence of at most `FORMULAS[number].most_coefficients`
    wavelengths_um : float64 array
    """
    formula = FORMULAS[number]
    padded = np.zeros(formula.most_coefficients)
    padded[:len(coefficients)] = coefficients
    with np.errstate(all="ignore"):
        return formula.index(padded, wavelengths_um) + np.zeros_like(wavelengths_um)
