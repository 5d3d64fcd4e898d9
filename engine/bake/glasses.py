"""Glasses by catalogue name, or by index and Abbe number. An unknown one is an error, never a placeholder.

The catalogues are glasses.csv, beside: `packaging/make_glasses.py` makes it from the refractiveindex.info database.
"""

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from ..errors import LensError
from ..spectral.refraction import Formula, Table

CATALOGUE = Path(__file__).parent / "glasses.csv"
PREFERRED = ("SCHOTT", "OHARA", "HOYA", "HIKARI", "CDGM", "SUMITA")
MODEL_GLASS = re.compile(r"(\d+(?:\.\d+)?)\s*/\s*(\d+(?:\.\d+)?)")
CODE = re.compile(r"(\d{3})(\d{3})|(\d{3,6})\.(\d{3,6})")
LARGEST_INDEX = 4.0
LEAST_ABBE = 10.0  # of what the model of dispersion was made from, and some more
D_LINE_UM = 0.5875618
BUCHDAHL_ALPHA = 2.5


@dataclass(frozen=True)
class ModelGlass:
    """A glass known by its index at the d line and its Abbe number: Buchdahl's three terms of dispersion.

    H. A. Buchdahl, Optical Aberration Coefficients, 1954; the terms of an ordinary glass of this index and Abbe number
    are Optiland's regression over catalogue glasses.
    """

    index: float
    abbe: float

    def at(self, wavelengths_nm: np.ndarray) -> np.ndarray:
        """Refractive indices at these wavelengths."""
        n, v = self.index, self.abbe
        first = np.dot((0.004160, 4.462559, 2.326660, 0.002330, -0.003697, -4.697604),
                       (1, 1 / v, 1 / v**2, n, n**2, n / v))
        second, third = (np.dot(terms, (1, 1 / v, 1 / v**2, n**2, n / v)) for terms in (
            (0.066434, -7.636396, 12.597434, -0.037014, 5.551013),
            (-0.032218, 2.230357, -103.318994, -0.009654, 1.934983)))
        change = np.asarray(wavelengths_nm, dtype=float) * 1e-3 - D_LINE_UM
        omega = change / (1 + BUCHDAHL_ALPHA * change)
        return n + omega * (first + omega * (second + omega * third))


@dataclass(frozen=True)
class Glass:
    """What follows a surface.

    Attributes
    ----------
    name : str
        "" for air.
    dispersion : Formula, Table or ModelGlass
    absorption : Table or None
        Extinction coefficients over the visible; None where nothing is known.
    """

    name: str
    dispersion: Formula | Table | ModelGlass
    absorption: Table | None = None

    def index_at(self, wavelengths_nm: Sequence[float] | np.ndarray) -> np.ndarray:
        """Refractive indices; NaN where the catalogue does not know them."""
        nm = np.asarray(wavelengths_nm, dtype=float)
        first, last = getattr(self.dispersion, "range_nm", (0.0, np.inf))
        return np.where((nm >= first) & (nm <= last), self.dispersion.at(nm), np.nan)

    def extinction_at(self, wavelengths_nm: Sequence[float] | np.ndarray) -> np.ndarray:
        """Extinction coefficients; 0 where nothing is known of them."""
        nm = np.asarray(wavelengths_nm, dtype=float)
        return np.zeros_like(nm) if self.absorption is None else self.absorption.at(nm)


AIR = Glass("", Formula(5, (1.0,), (0.0, np.inf)))


def find_glass(name: str, where: str, field: str, told: str = "") -> Glass:
    """The glass of a name.

    Parameters
    ----------
    name : str
        "" for air; "N-BK7"; "SCHOTT N-BK7", with its catalogue; or "1.5168/64.2", its index at the d line and Abbe
        number, whose dispersion then follows Buchdahl's model.
    where, field : str
        For the error: the lens and its surface.
    told : str
        What the lens's file tells of the glass, as "n/V", where it does: for the error, too.

    Raises
    ------
    LensError
        No catalogue has it; close names are suggested, and what the file tells.
    """
    if not name:
        return AIR
    model = MODEL_GLASS.fullmatch(name.strip())
    if model:
        index, abbe = float(model[1]), float(model[2])
        if not (1 < index < LARGEST_INDEX and abbe >= LEAST_ABBE):
            raise LensError(where, field, name, f"expected an index above 1 and an Abbe number from {LEAST_ABBE:g}")
        return Glass(name, ModelGlass(index, abbe))
    if re.fullmatch(r"\d(\.\d+)?", name):
        raise LensError(where, field, name, f"an index without dispersion: give its Abbe number too, as {name}/V")
    *makers, glass = name.split() or [name]
    found = _full_name(glass, tuple(word.upper() for word in makers))
    if found is None:
        figures = f"n/V, such as the file's own {told}" if told else "n/V"
        raise LensError(where, field, name, f"in no glass catalogue: {_suggestion(glass)}give another name, or its "
                                            f"index and Abbe number as {figures}")
    return _read(found)


def best_name(name: str, catalogues: Sequence[str]) -> str:
    """What we call another program's glass: n/V of a code, or its name with the first of these catalogues that has it.

    Where none of them does it stays as it is. Codes are those of glass makers, such as 517642, and Code V's finer
    516800.641673.
    """
    code = CODE.fullmatch(name)
    if code:
        index, abbe = filter(None, code.groups())
        whole = 2 if index < "300" else 1  # no glass has an index below 1.3, and a few have one above 2
        return f"{float(f'{whole}.{index}'):g}/{100 * float(f'0.{abbe}'):.6g}"
    known = tuple(maker.upper() for maker in catalogues if maker.upper() in _catalogues())
    return (_full_name(name, known) if known else None) or name


@lru_cache(maxsize=1)
def _lines():
    """{full name: the rest of its line}."""
    rows = (line.split(",", 1) for line in CATALOGUE.read_text(encoding="utf-8").splitlines())
    return dict(rows)


@lru_cache(maxsize=1)
def _catalogues():
    """{maker: {name as compared: full name}}, the preferred makers first."""
    makers = {maker: {} for maker in PREFERRED}
    for name in _lines():
        maker, _, glass = name.partition(" ")
        makers.setdefault(maker, {})[_bare(glass)] = name
    return makers


@lru_cache(maxsize=None)
def _read(name):
    """The glass of a full name."""
    number, told, span, absorbed = _lines()[name].split(",")
    numbers = [float(word) for word in told.split()]
    dispersion = (_table(numbers) if number == "n" else
                  Formula(int(number), tuple(numbers), tuple(float(nm) for nm in span.split())))
    return Glass(name, dispersion, _table([float(word) for word in absorbed.split()]) if absorbed else None)


def _table(numbers):
    return Table(np.array(numbers[::2]), np.array(numbers[1::2]))


def _full_name(glass, makers):
    """Of a glass of these makers, or of any; None where there is none."""
    catalogues = _catalogues()
    known = (catalogues[maker] for maker in makers or catalogues if maker in catalogues)
    return next((names[_bare(glass)] for names in known if _bare(glass) in names), None)


def _bare(name):
    """Names as they are compared: Code V leaves hyphens out, and nobody agrees on capitals."""
    return name.replace("-", "").upper()


def _suggestion(glass):
    """Glasses of a similar name, as a part of a sentence."""
    names = {}
    for known in _catalogues().values():  # of the preferred makers first
        names = names | {key: name for key, name in known.items() if key not in names}
    wanted = _bare(glass)
    stem = _without_suffix(wanted)
    close = [key for key in names if len(stem) > 2 and _without_suffix(key).endswith(stem)]
    close += difflib.get_close_matches(wanted, names, n=3, cutoff=0.7)
    shown = [names[key] for key in dict.fromkeys(close)][:4]
    return f"perhaps {' or '.join(shown)}? Else " if shown else ""


def _without_suffix(name):
    """LAK10 of LAK10C: letters behind the number tell variants apart."""
    return re.sub(r"(?<=\d)[A-Z]+$", "", name)
