"""Spectra: reading them, sampling them, and making them from linear Rec. 709 colours.

Emission spectra are spectral densities: they are scaled to unit integral over `BAND_NM`, so that a lamp's watts are
the watts that it gives off in that band.
"""

import os
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from scipy.integrate import trapezoid

from .errors import InputError, absence

DATA = Path(__file__).resolve().parent / "data"
LIBRARY = DATA / "spectra"
BAND_NM = (380.0, 780.0)
MOST_WAVELENGTHS = 10000
CHANNEL_NM = (611.4, 549.1, 464.2)  # dominant wavelengths of the Rec. 709 primaries
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Values at ascending wavelengths; linear between them, held beyond the ends (a reflectance)."""

    wavelengths_nm: np.ndarray
    values: np.ndarray

    def at(self, wavelengths_nm):
        """Values at these wavelengths."""
        return np.interp(wavelengths_nm, self.wavelengths_nm, self.values)

    def density_at(self, wavelengths_nm):
        """Spectral density per nm at these wavelengths: unit integral over BAND_NM, no light beyond the ends.

        Raises
        ------
        InputError
            There is no light within BAND_NM.
        """
        first, last = np.clip(self.wavelengths_nm[[0, -1]], *BAND_NM)
        inside = self.wavelengths_nm[(self.wavelengths_nm > first) & (self.wavelengths_nm < last)]
        grid = np.concatenate([[first], inside, [last]])
        total = trapezoid(self.at(grid), grid)
        if not total > 0:
            raise InputError("spectrum", "light between {:g} and {:g} nm".format(*BAND_NM), "none",
                             "a light needs power over more than a single wavelength of that band")
        emitted = np.interp(wavelengths_nm, self.wavelengths_nm, self.values, left=0.0, right=0.0)
        return emitted / total


def library_names():
    """Names of the spectra that come with the project."""
    return sorted(path.stem for path in LIBRARY.glob("*.spd"))


def load_spectrum(text, folder="."):
    """A spectrum by library name, from a two-column file, or from inline pairs as `400:0.1, 700:0.2`.

    Parameters
    ----------
    text : str
    folder : path
        Where a relative path starts from.

    Raises
    ------
    InputError
    """
    text = text.strip()
    if text in library_names():
        return _read_columns(LIBRARY / f"{text}.spd")
    if re.match(rf"^{_NUMBER}\s*(?:nm)?\s*:", text):
        return _parse_pairs(text)
    path = Path(folder) / Path(text).expanduser()
    if not os.path.isfile(path):  # of a text too long to be a name, Path.is_file raises
        raise InputError(text, "spectrum", absence(path),
                         "give a library name, a two-column file (nm, value) or pairs such as 400:0.1, 700:0.2")
    return _read_columns(path)


def _parse_pairs(text):
    pairs = []
    for item in filter(None, (part.strip() for part in re.split(r"[,;]", text))):
        match = re.fullmatch(rf"({_NUMBER})\s*(?:nm)?\s*:\s*({_NUMBER})", item)
        if not match:
            raise InputError(text, "spectrum", item, "expected wavelength:value, such as 400:0.1")
        pairs.append((float(match[1]), float(match[2])))
    return _spectrum(text, pairs)


def _read_columns(path):
    pairs = []
    try:
        lines = Path(path).read_text(encoding="utf-8-sig", errors="replace").splitlines()
    except OSError as error:
        raise InputError(path, "spectrum", "not readable", str(error)) from None
    for number, line in enumerate(lines, 1):
        words = re.split(r"[\s,;]+", line.split("#")[0].strip())
        if words == [""]:
            continue
        try:
            nm, value = map(float, words[:2])
        except ValueError:
            raise InputError(path, f"line {number}", line.strip(), "expected a wavelength in nm and a value") from None
        pairs.append((nm, value))
    return _spectrum(path, pairs)


def _spectrum(where, pairs):
    if not pairs:
        raise InputError(where, "spectrum", "empty", "expected pairs of a wavelength in nm and a value")
    wavelengths, values = np.array(pairs, dtype=np.float64).T
    if not np.all(np.isfinite(values)) or np.any(values < 0):
        raise InputError(where, "spectrum", f"{values.min():g} at the least", "expected finite values of 0 or more")
    if not np.all(np.isfinite(wavelengths)) or np.any(wavelengths <= 0) or np.any(np.diff(wavelengths) <= 0):
        raise InputError(where, "wavelengths", "not ascending", "expected positive nm in ascending order")
    return Spectrum(wavelengths, values)


def parse_wavelengths(text):
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
    ascending = wavelengths.size and np.all(np.isfinite(wavelengths)) and wavelengths[0] > 0
    if not ascending or np.any(np.diff(wavelengths) <= 0):
        raise InputError("options", "wavelengths", text,
                         f"expected first:last:number such as 400:700:31, ascending and of at most {MOST_WAVELENGTHS}, "
                         "or an ascending list such as 450,550,650")
    return wavelengths


def blackbody(temperature_k):
    """Planck's law over BAND_NM, in arbitrary units."""
    wavelengths_nm = np.arange(BAND_NM[0], BAND_NM[1] + 1)
    second_radiation_constant_nm_k = 1.438776877e7
    power = wavelengths_nm**-5.0 / np.expm1(second_radiation_constant_nm_k / (wavelengths_nm * temperature_k))
    return Spectrum(wavelengths_nm, power / power.max())


def reflectance_basis(wavelengths_nm):
    """Reflectance of each linear Rec. 709 primary (Mallett and Yuksel 2019).

    Returns
    -------
    array (wavelength, 3); rows times a colour in [0, 1] give its reflectance, and white gives 1
    """
    nm, *basis = _table("mallett_yuksel_2019.csv").T
    return np.stack([np.interp(wavelengths_nm, nm, curve) for curve in basis], axis=-1)


def emission_basis(wavelengths_nm):
    """Spectral density per nm of each linear Rec. 709 primary, as a light: its reflectance under D65.

    White gives D65 with unit integral over BAND_NM: a surface of Blender emission strength s radiates s W m^-2 sr^-1
    in that band.
    """
    return reflectance_basis(wavelengths_nm) * white_density(wavelengths_nm)[:, None]


def channel_basis(wavelengths_nm):
    """Share of red, green and blue in a quantity that is no colour, such as a scattering length given for each.

    Linear between CHANNEL_NM and held beyond; array (wavelength, 3), rows sum to 1.
    """
    return np.stack([np.interp(wavelengths_nm, CHANNEL_NM[::-1], unit) for unit in np.eye(3)[:, ::-1]], axis=-1)


def white_density(wavelengths_nm):
    """D65 scaled to unit integral over BAND_NM, per nm."""
    return _d65().density_at(np.atleast_1d(wavelengths_nm))


@cache
def _d65():
    return _read_columns(LIBRARY / "illuminant-d65.spd")


def colour_matching(wavelengths_nm):
    """CIE 1931 2-degree colour-matching functions: array (wavelength, 3), zero outside 360 to 830 nm."""
    nm, *curves = _table("cie1931_2deg.csv").T
    return np.stack([np.interp(wavelengths_nm, nm, curve, left=0.0, right=0.0) for curve in curves], axis=-1)


@cache
def _table(name):
    return np.loadtxt(DATA / name, delimiter=",", skiprows=2)
