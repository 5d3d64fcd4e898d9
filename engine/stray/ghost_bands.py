"""Bands of wavelengths, whose light takes the paths of one of them: dispersion is slight, and coatings are not."""

from dataclasses import dataclass

import numpy as np

from ..kernels.ghosts import MOST_WAVES

PATHS = 4  # wavelengths whose paths are traced; between them, pictures are blended


@dataclass(frozen=True, eq=False)
class Band:
    """Up to MOST_WAVES wavelengths, by their numbers.

    Attributes
    ----------
    traced : int
        Whose paths the light takes.
    waves : int array (wave,)
    weights : array (wave,)
        The share of each one's light that takes these paths; the shares in all bands are 1 together.
    """

    traced: int
    waves: np.ndarray
    weights: np.ndarray


def sample_of(wavelengths_nm: np.ndarray) -> Band:
    """One band with the paths of the middle one of the wavelengths, for this and the first and the last one."""
    count = len(wavelengths_nm)
    waves = np.unique([0, count // 2, count - 1])
    return Band(count // 2, waves, np.ones(waves.size))


def halves_of(wavelengths_nm: np.ndarray) -> list[Band]:
    """Bands with the paths of the first wavelength, for the lower half of all, and of the last one, for the others."""
    count = len(wavelengths_nm)
    lower, upper = np.split(np.arange(count), [count // 2])
    return [band for traced, waves in ((0, lower), (count - 1, upper))
            for band in _divided(traced, waves, np.ones(waves.size))]


def bands_of(wavelengths_nm: np.ndarray) -> list[Band]:
    """The bands of wavelengths, with paths at even steps of 1 / wavelength^2, which dispersion follows."""
    place = -np.asarray(wavelengths_nm, dtype=float) ** -2.0
    traced = np.arange(place.size)
    if place.size > PATHS:
        evenly = np.linspace(place[0], place[-1], PATHS)
        traced = np.unique(np.argmin(np.abs(place[:, None] - evenly), axis=0))
    bands = []
    for number, unit in zip(traced, np.eye(traced.size), strict=True):
        weights = np.interp(place, place[traced], unit)
        near = np.flatnonzero(weights)
        bands += _divided(int(number), near, weights[near])
    return bands


def _divided(traced, waves, weights):
    """Bands of at most MOST_WAVES of these wavelengths each."""
    parts = (slice(start, start + MOST_WAVES) for start in range(0, waves.size, MOST_WAVES))
    return [Band(traced, waves[part], weights[part]) for part in parts]
