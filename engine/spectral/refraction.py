"""Refractive indices of glasses, liquids, crystals and metals, from files of the refractiveindex.info database.

The database and its nine dispersion formulas: M. N. Polyanskiy, Refractiveindex.info database of optical constants,
Scientific Data 11, 94 (2024), doi:10.1038/s41597-023-02898-2. Wavelengths are in micrometres there, in nm here.
"""

import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..runtime.errors import InputError
from ..runtime.inputs import check_input, read_limited, reading
from ..runtime.values import Value
from ..runtime.yaml_text import parse_yaml
from .dispersion import FORMULAS, dispersion
from .spectra import BAND_NM, Wavelengths

LIBRARY = Path(__file__).resolve().parent / "data" / "refraction"
MOST_BYTES = 1 << 20  # the largest file of the database has 0.8 MB
NM_PER_UM = 1000.0
D_LINE_NM = 587.6  # the yellow lines of sodium and helium, for which indices are quoted
METAL = 0.1  # extinction coefficient above which a material is opaque within a wavelength or two
MOST_NODES = 1000  # of a YAML file; the tables of the database are one text each
_COLUMNS = {"tabulated n": ("n",), "tabulated k": ("k",), "tabulated nk": ("n", "k")}


@dataclass(frozen=True, eq=False, repr=False)
class Table(Value):
    """Values at ascending wavelengths, linear between them."""

    wavelengths_nm: np.ndarray
    values: np.ndarray

    @property
    def range_nm(self) -> tuple[float, float]:
        """First and last wavelength."""
        return float(self.wavelengths_nm[0]), float(self.wavelengths_nm[-1])

    def at(self, wavelengths_nm: Wavelengths) -> np.ndarray:
        """Values at these wavelengths."""
        return np.interp(wavelengths_nm, self.wavelengths_nm, self.values)


@dataclass(frozen=True)
class Formula:
    """One of the database's dispersion formulas, by number, with its coefficients (micrometres)."""

    number: int
    coefficients: tuple[float, ...]
    range_nm: tuple[float, float]

    def at(self, wavelengths_nm: Wavelengths) -> np.ndarray:
        """Refractive indices at these wavelengths."""
        return dispersion(self.number, self.coefficients, np.asarray(wavelengths_nm, dtype=np.float64) / NM_PER_UM)


@dataclass(frozen=True, eq=False, repr=False)
class Refraction(Value):
    """The complex refractive index n + ik of a material.

    Attributes
    ----------
    name : str
        Name in the library, or of the file.
    source : str
        The publication named in the file, without markup.
    n : Table or Formula
    k : Table or None
        None if the file does not contain extinction.
    """

    name: str
    source: str
    n: Table | Formula
    k: Table | None = None

    @property
    def range_nm(self) -> tuple[float, float]:
        """First and last wavelength of n."""
        return self.n.range_nm

    @property
    def dispersive(self) -> bool:
        """Whether n varies over the known visible wavelengths, or over the full range if none is visible."""
        visible = np.clip(BAND_NM, *self.range_nm)
        first, last = visible if visible[0] < visible[1] else self.range_nm
        return bool(np.ptp(self.n_at(np.linspace(first, last, 101))) > 0)

    @property
    def metal(self) -> bool:
        """Whether it absorbs like a metal; raises InputError if k is unknown at the D line."""
        return bool(self.k_at(D_LINE_NM) > METAL)

    def n_at(self, wavelengths_nm: Wavelengths) -> np.ndarray:
        """Refractive indices; raises InputError outside range_nm."""
        return self._at(self.n, "n", wavelengths_nm)

    def k_at(self, wavelengths_nm: Wavelengths) -> np.ndarray:
        """Extinction coefficients, zero if the file has none; raises InputError outside their range."""
        if self.k is None:
            return np.zeros_like(self.n_at(wavelengths_nm))
        return self._at(self.k, "k", wavelengths_nm)

    def reflectance_at(self, wavelengths_nm: Wavelengths) -> np.ndarray:
        """Fresnel reflectance at normal incidence from vacuum; raises InputError if n or k is unknown."""
        n, k = self.n_at(wavelengths_nm), self.k_at(wavelengths_nm)
        return ((n - 1)**2 + k**2) / ((n + 1)**2 + k**2)

    def _at(self, quantity, letter, wavelengths_nm):
        nm = np.asarray(wavelengths_nm, dtype=np.float64)
        first, last = quantity.range_nm
        outside = nm[~((nm >= first) & (nm <= last))]
        if outside.size:
            raise InputError(self.name, f"wavelength of {letter}", f"{outside[0]:g} nm",
                             f"it is known from {first:g} to {last:g} nm")
        values = quantity.at(nm)
        if not np.all(np.isfinite(values)):
            raise InputError(self.name, letter, f"no number at {nm[~np.isfinite(values)].flat[0]:g} nm",
                             "the formula's coefficients do not fit its range")
        return values


def refraction_names() -> list[str]:
    """Names of the materials that come with the project."""
    return sorted(path.stem for path in LIBRARY.glob("*.yml"))


def load_refraction(text: str, folder: str | os.PathLike = ".") -> Refraction:
    """The refractive index of a material by library name, or from a YAML file of refractiveindex.info.

    Parameters
    ----------
    text : str
    folder : path
        Base of a relative path.

    Returns
    -------
    Refraction
        If a file has several sets of data, the first with n and the first with k are used.

    Raises
    ------
    InputError
    """
    text = text.strip()
    if text in refraction_names():
        return _read(LIBRARY / f"{text}.yml")
    path = Path(folder) / os.path.expanduser(text)
    check_input(path, "refraction", "give a library name or a YAML file of refractiveindex.info", where=text)
    return _read(path)


def _read(path):
    with reading(path):
        return _refraction_of(path, _parse(path))


def _refraction_of(path, document):
    data = document.get("DATA") if isinstance(document, dict) else None
    if not isinstance(data, list) or not all(isinstance(entry, dict) for entry in data):
        raise InputError(path, "DATA", "missing or not a list", "expected a file of refractiveindex.info")
    curves = {}
    for entry in data:
        if not curves.keys() >= set(_COLUMNS.get(_without_markup(entry.get("type")), "n")):
            curves = _curves(path, entry) | curves
    if "n" not in curves:
        raise InputError(path, "DATA", "without n", "expected a formula, tabulated n or tabulated nk")
    return Refraction(Path(path).stem, _without_markup(document.get("REFERENCES")), **curves)


def _parse(path):
    text = read_limited(path, "refraction", MOST_BYTES, "expected one material of refractiveindex.info")
    try:
        return parse_yaml(text, MOST_NODES)
    except ValueError:
        raise InputError(path, "refraction", "not YAML", "expected a file of refractiveindex.info") from None


def _curves(path, entry):
    """The n and k of an entry of DATA, by letter."""
    kind = _without_markup(entry.get("type"))
    if kind in _COLUMNS:
        um, *columns = _rows(path, entry.get("data"), 1 + len(_COLUMNS[kind])).T
        return {letter: Table(_nm(um), values) for letter, values in zip(_COLUMNS[kind], columns, strict=True)}
    match = re.fullmatch(r"formula ([1-9])", kind)
    if not match:
        raise InputError(path, "type", kind, "expected formula 1 to 9, tabulated n, tabulated k or tabulated nk")
    coefficients = _numbers(path, "coefficients", entry.get("coefficients"))
    span = _numbers(path, "wavelength_range", entry.get("wavelength_range"))
    if len(span) != 2 or not 0 < span[0] < span[1]:
        raise InputError(path, "wavelength_range", _without_markup(entry["wavelength_range"]),
                         "expected two ascending micrometres")
    return {"n": _formula(path, int(match[1]), coefficients, span)}


def _formula(path, number, coefficients, span_um):
    most = FORMULAS[number].most_coefficients
    if not 1 <= len(coefficients) <= most:
        raise InputError(path, "coefficients", f"{len(coefficients)} numbers",
                         f"formula {number} has between 1 and {most}")
    return Formula(number, tuple(coefficients), tuple(_nm(np.array(span_um)).tolist()))


def _nm(um):
    """Nanometres, rounded so that 0.57 is exactly 570: it may be the end of a range."""
    return np.round(um * NM_PER_UM, 6)


def _rows(path, text, columns):
    """Rows of `columns` numbers, in ascending micrometres; the first row of a repeated wavelength counts."""
    lines = text.splitlines() if isinstance(text, str) else []
    rows = [_numbers(path, "data", line) for line in lines if line.strip()]
    if not rows or any(len(row) != columns for row in rows):
        raise InputError(path, "data", "not in rows" if rows else "empty", f"expected rows of {columns} numbers")
    rows = np.array(rows)
    um, first_of_each = np.unique(rows[:, 0], return_index=True)
    if um[0] <= 0:
        raise InputError(path, "data", f"{um[0]:g} um", "expected wavelengths above 0")
    return rows[first_of_each]


def _numbers(path, field, text):
    words = text.split() if isinstance(text, str) else []
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if not numbers or not np.all(np.isfinite(numbers)):
        raise InputError(path, field, _without_markup(text), "expected finite numbers")
    return numbers


def _without_markup(text):
    """Text on one line without HTML markup; an empty string for other types."""
    return " ".join(re.sub(r"<[^<>]*>", "", text.replace("<br>", " ")).split()) if isinstance(text, str) else ""
