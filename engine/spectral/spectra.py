"""Spectra: loading, sampling, and upsampling from linear Rec. 709 colours.

Emission spectra are spectral densities, scaled to unit integral over `BAND_NM`: a lamp's watts are its power in that
band.
"""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from ..runtime.errors import InputError
from ..runtime.values import Value
from .spectrum_text import are_pairs, check_spectrum, read_columns, read_spectrum_text

Wavelengths = float | Sequence[float] | np.ndarray  # one, or several

DATA = Path(__file__).resolve().parent / "data"
LIBRARY = {"light": DATA / "spectra" / "lights", "reflectance": DATA / "spectra" / "reflectances"}
BAND_NM = (380.0, 780.0)
MOST_WAVELENGTHS = 10000
CHANNEL_NM = (611.4, 549.1, 464.2)  # dominant wavelengths of the Rec. 709 primaries
LUMENS_PER_WATT = 683.0  # at 555 nm


@dataclass(frozen=True, eq=False, repr=False)
class Spectrum(Value):
    """Values of 0 or more at ascending wavelengths; linear between them, held beyond the ends (a reflectance).

    Raises
    ------
    InputError
        Arrays of different lengths, or with invalid values.
    """

    wavelengths_nm: np.ndarray
    values: np.ndarray

    def __post_init__(self) -> None:
        check_spectrum("spectrum", self.wavelengths_nm, self.values)
        super().__post_init__()

    def at(self, wavelengths_nm: Wavelengths) -> np.ndarray:
        """Values at these wavelengths."""
        return np.interp(wavelengths_nm, self.wavelengths_nm, self.values)

    def density_at(self, wavelengths_nm: Wavelengths) -> np.ndarray:
        """Spectral density per nm at these wavelengths: unit integral over BAND_NM, no light beyond the ends.

        Raises
        ------
        InputError
            The spectrum is dark within BAND_NM.
        """
        emitted = np.interp(wavelengths_nm, self.wavelengths_nm, self.values, left=0.0, right=0.0)
        return emitted / self._power_in_band()

    def band_means(self, wavelengths_nm: Wavelengths) -> np.ndarray:
        """Mean of the density per nm around each of these wavelengths, which preserves the power of spiky lamps.

        Each mean is weighted by a hat function: 1 at its wavelength, 0 at its neighbours, and half a hat at the ends.
        The trapezoidal rule over the means is therefore the light between the first and the last wavelength; light
        beyond is left out. A single wavelength returns the density there.

        Parameters
        ----------
        wavelengths_nm : ascending sequence

        Returns
        -------
        float64 array, W nm^-1 per watt within BAND_NM

        Raises
        ------
        InputError
            The spectrum is dark within BAND_NM.
        """
        nm = np.atleast_1d(np.asarray(wavelengths_nm, dtype=np.float64))
        if nm.size == 1:
            return self.density_at(nm)
        return self._hat_integrals(nm) / trapezoid_weights(nm) / self._power_in_band()

    def luminous_flux_per_watt(self) -> float:
        """Lumens per watt within BAND_NM: 683 lm/W times the mean of the CIE 1931 y-bar (V).

        Raises
        ------
        InputError
            The spectrum is dark within BAND_NM.
        """
        nm, _, y_bar, _ = _table("cie1931_2deg.csv").T
        inside = (nm >= BAND_NM[0]) & (nm <= BAND_NM[1])
        return LUMENS_PER_WATT * (y_bar[inside] @ self._hat_integrals(nm[inside])) / self._power_in_band()

    def _power_in_band(self):
        power = self._hat_integrals(np.array(BAND_NM)).sum()
        if not power > 0:
            raise InputError("spectrum", "light between {:g} and {:g} nm".format(*BAND_NM), "none",
                             "a light needs power at more than one wavelength in that band")
        return power

    def _hat_integrals(self, nm):
        """Integrals of this light times the hat functions of two or more ascending wavelengths; the hats sum to 1.

        Simpson's rule is exact: between adjacent wavelengths of the two grids, the product is a parabola.
        """
        first, last = np.clip(self.wavelengths_nm[[0, -1]], nm[0], nm[-1])
        grid = np.unique(np.concatenate([self.wavelengths_nm, nm]).clip(first, last))
        middle = (grid[1:] + grid[:-1]) / 2
        left = np.searchsorted(nm, middle) - 1
        total = rising = 0.0
        for where, weight in ((grid[:-1], 1), (middle, 4), (grid[1:], 1)):
            light = self.at(where) * weight * np.diff(grid) / 6
            total += light
            rising += light * (where - nm[left]) / (nm[left + 1] - nm[left])
        return np.bincount(left, total - rising, nm.size) + np.bincount(left + 1, rising, nm.size)


def library_names(kind: str | None = None) -> list[str]:
    """Names of the spectra that come with the project: of a kind, "light" or "reflectance", or all."""
    folders = LIBRARY.values() if kind is None else [LIBRARY[kind]]
    return sorted(path.stem for folder in folders for path in folder.glob("*.spd"))


def load_spectrum(text: str, folder: str | os.PathLike = ".") -> Spectrum:
    """A spectrum by library name, from a two-column file, or from pairs: `400:0.1, 700:0.2` or `[400 0.1 700 0.2]`.

    Parameters
    ----------
    text : str
    folder : path
        Base of a relative path.

    Raises
    ------
    InputError
    """
    text = text.strip()
    if text in _library():
        return Spectrum(*read_columns(_library()[text]))
    return Spectrum(*read_spectrum_text(text, folder))


def is_user_file(text: str) -> bool:
    """Whether a text for `load_spectrum` is the path of a user's file."""
    return text.strip() not in _library() and not are_pairs(text.strip())


@cache
def _library():
    return {path.stem: path for folder in LIBRARY.values() for path in folder.glob("*.spd")}


def parse_wavelengths(text: str) -> np.ndarray:
    """Wavelengths in nm from `first:last:number` or from a list `450, 550, 650`.

    Returns
    -------
    float64 array, ascending

    Raises
    ------
    InputError
    """
    try:
        if ":" in text:
            first, last, number = text.split(":")
            count = int(number)
            if not np.isfinite(float(last)) or not 1 <= count <= MOST_WAVELENGTHS \
                    or (float(last) > float(first)) != (count > 1):
                raise ValueError
            wavelengths = np.linspace(float(first), float(last), count)
        else:
            wavelengths = np.array([float(word) for word in re.split(r"[\s,;]+", text.strip()) if word])
    except ValueError:
        wavelengths = np.empty(0)
    ascending = 0 < wavelengths.size <= MOST_WAVELENGTHS and np.all(np.isfinite(wavelengths)) and wavelengths[0] > 0
    if not ascending or np.any(np.diff(wavelengths) <= 0):
        raise InputError("options", "wavelengths", text,
                         f"expected first:last:number such as 400:700:31, ascending and of at most {MOST_WAVELENGTHS}, "
                         "or an ascending list such as 450,550,650")
    return wavelengths


def blackbody(temperature_k: float) -> Spectrum:
    """Planck's law over BAND_NM, in arbitrary units."""
    wavelengths_nm = np.arange(BAND_NM[0], BAND_NM[1] + 1)
    second_radiation_constant_nm_k = 1.438776877e7
    power = wavelengths_nm**-5.0 / np.expm1(second_radiation_constant_nm_k / (wavelengths_nm * temperature_k))
    return Spectrum(wavelengths_nm, power / power.max())


def reflectance_basis(wavelengths_nm: Wavelengths) -> np.ndarray:
    """Reflectance of each linear Rec. 709 primary.

    As in Mallett and Yuksel (2019), the three curves are between 0 and 1, sum to 1, and reproduce every colour under
    D65. Theirs are the smoothest such curves. These are the closest to 123 measured reflectances, which is more
    accurate under lamps other than daylight (packaging/fit_basis.py fits them, and `benchmarks/figures.py upsampling`
    compares them).

    Returns
    -------
    array (wavelength, 3); rows times a colour in [0, 1] give its reflectance, and white gives 1
    """
    nm, *basis = _table("reflectance_basis.csv").T
    return np.stack([np.interp(wavelengths_nm, nm, curve) for curve in basis], axis=-1)


def emission_basis(wavelengths_nm: Wavelengths) -> np.ndarray:
    """Spectral density per nm of each linear Rec. 709 primary as a light: its reflectance under D65.

    White is D65 with unit integral over BAND_NM: a surface with Blender's emission strength s radiates s W m^-2 sr^-1
    in that band.
    """
    return reflectance_basis(wavelengths_nm) * white_density(wavelengths_nm)[:, None]


def channel_basis(wavelengths_nm: Wavelengths) -> np.ndarray:
    """Weights of red, green and blue for a quantity that is not a colour, such as scattering lengths per channel.

    Linear between CHANNEL_NM and held beyond; array (wavelength, 3), rows sum to 1.
    """
    return linear_weights(CHANNEL_NM[::-1], wavelengths_nm)[:, ::-1]


def linear_weights(nodes_nm: Wavelengths, wavelengths_nm: Wavelengths) -> np.ndarray:
    """Weights of node values for linear interpolation, held beyond the ends: array (wavelength, node)."""
    return np.stack([np.interp(wavelengths_nm, nodes_nm, unit) for unit in np.eye(np.size(nodes_nm))], axis=-1)


def trapezoid_weights(wavelengths_nm: np.ndarray) -> np.ndarray:
    """Weights of the trapezoidal rule: array (wavelength,), in nm."""
    steps = np.diff(wavelengths_nm)
    return (np.append(steps, 0) + np.insert(steps, 0, 0)) / 2


def white_density(wavelengths_nm: Wavelengths) -> np.ndarray:
    """D65 scaled to unit integral over BAND_NM, per nm."""
    return _d65().density_at(np.atleast_1d(wavelengths_nm))


@cache
def _d65():
    return load_spectrum("illuminant-d65")


def colour_matching(wavelengths_nm: Wavelengths) -> np.ndarray:
    """CIE 1931 2-degree colour-matching functions: array (wavelength, 3), zero outside 360 to 830 nm."""
    nm, *curves = _table("cie1931_2deg.csv").T
    return np.stack([np.interp(wavelengths_nm, nm, curve, left=0.0, right=0.0) for curve in curves], axis=-1)


@cache
def _table(name):
    return np.loadtxt(DATA / name, delimiter=",", skiprows=2)
