"""Glasses by catalogue name, or by index and Abbe number. Unknown names are errors, never placeholders.

`glasses.csv` contains the catalogues. `packaging/make_glasses.py` generates it from the refractiveindex.info database.
"""

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from ..runtime.errors import LensError
from ..spectral.refraction import Formula, Table

CATALOGUE = Path(__file__).parent / "glasses.csv"
PREFERRED = ("SCHOTT", "OHARA", "HOYA", "HIKARI", "CDGM", "SUMITA")
MODEL_GLASS = re.compile(r"(\d+(?:\.\d+)?)\s*/\s*(\d+(?:\.\d+)?)")
INDEX_ALONE = re.compile(r"\d(\.\d+)?")
CODE = re.compile(r"(\d{3})(\d{3})|(\d{3,6})\.(\d{3,6})")
LARGEST_INDEX = 4.0
LEAST_ABBE = 10.0  # limit of the glasses that the dispersion model was fitted to, with a margin
D_LINE_UM = 0.5875618
F_D_C_NM = (486.13, 1e3 * D_LINE_UM, 656.27)  # the lines of Abbe numbers
BUCHDAHL_ALPHA = 2.5
SAME_INDEX = 5e-3  # pbrt's files have two or three decimals


@dataclass(frozen=True)
class ModelGlass:
    """A glass defined by its index at the d line and its Abbe number: Buchdahl's dispersion with three terms.

    H. A. Buchdahl, Optical Aberration Coefficients, 1954. The terms for an index and Abbe number are Optiland's
    regression over catalogue glasses.
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
    """The medium behind a surface.

    Attributes
    ----------
    name : str
        "" for air.
    dispersion : Formula, Table or ModelGlass
    absorption : Table or None
        Extinction coefficients over the visible range; None if unknown.
    """

    name: str
    dispersion: Formula | Table | ModelGlass
    absorption: Table | None = None

    @property
    def range_nm(self) -> tuple[float, float]:
        """First and last wavelength at which the index is known."""
        return getattr(self.dispersion, "range_nm", (0.0, np.inf))

    @property
    def figures(self) -> str:
        """Index at the d line and Abbe number as "n/V"; "" for a glass that is not known at these lines."""
        of_f, of_d, of_c = self.index_at(F_D_C_NM)
        return f"{of_d:.6g}/{(of_d - 1) / (of_f - of_c):.4g}" if of_f > of_c else ""

    def index_at(self, wavelengths_nm: Sequence[float] | np.ndarray) -> np.ndarray:
        """Refractive indices; NaN outside the catalogue's range."""
        nm = np.asarray(wavelengths_nm, dtype=float)
        first, last = self.range_nm
        return np.where((nm >= first) & (nm <= last), self.dispersion.at(nm), np.nan)

    def extinction_at(self, wavelengths_nm: Sequence[float] | np.ndarray) -> np.ndarray:
        """Extinction coefficients; 0 if unknown."""
        nm = np.asarray(wavelengths_nm, dtype=float)
        return np.zeros_like(nm) if self.absorption is None else self.absorption.at(nm)


AIR = Glass("", Formula(5, (1.0,), (0.0, np.inf)))


def find_glass(name: str, where: str, field: str, file_figures: str = "") -> Glass:
    """Look up a glass by name.

    Parameters
    ----------
    name : str
        "" for air; "N-BK7"; "SCHOTT N-BK7", with its catalogue; or "1.5168/64.2", its index at the d line and Abbe
        number, with the dispersion of Buchdahl's model.
    where, field : str
        For the error: the lens and its surface.
    file_figures : str
        Index and Abbe number in the lens's file, as "n/V", if any: also for the error.

    Raises
    ------
    LensError
        The glass is not in any catalogue; the error suggests similar names and quotes `file_figures`.
    """
    if not name:
        return AIR
    model = MODEL_GLASS.fullmatch(name.strip())
    if model:
        index, abbe = float(model[1]), float(model[2])
        if not (1 < index < LARGEST_INDEX and abbe >= LEAST_ABBE):
            raise LensError(where, field, name, f"expected an index above 1 and an Abbe number from {LEAST_ABBE:g}")
        return Glass(name, ModelGlass(index, abbe))
    if INDEX_ALONE.fullmatch(name):
        raise LensError(where, field, name, f"an index without dispersion: give its Abbe number too, as {name}/V "
                                           "(--glass OLD=NEW)")
    *makers, glass = name.split() or [name]
    full_name = _full_name(glass, tuple(word.upper() for word in makers))
    if full_name is None:
        figures = f"n/V, such as the file's {file_figures}" if file_figures else "n/V"
        raise LensError(where, field, name, f"in no glass catalogue: {_suggestion(glass)}give another name, or its "
                                            f"index and Abbe number as {figures} (--glass OLD=NEW)")
    return _read(full_name)


def best_name(name: str, catalogues: Sequence[str]) -> str:
    """Lensfield's name of another program's glass: n/V of a code, or the name in the first catalogue that lists it.

    A name that is not in these catalogues does not change. Codes are glass makers' six digits, such as 517642, and
    Code V's longer ones, such as 516800.641673.
    """
    code = CODE.fullmatch(name)
    if code:
        index, abbe = filter(None, code.groups())
        integer = 2 if index < "300" else 1  # indices are at least 1.3, and a few exceed 2
        return f"{float(f'{integer}.{index}'):g}/{100 * float(f'0.{abbe}'):.6g}"
    known = tuple(maker.upper() for maker in catalogues if maker.upper() in _catalogues())
    return (_full_name(name, known) if known else None) or name


def name_in(catalogue: str, name: str) -> str:
    """Lensfield's name of a glass that another program names with its catalogue, even if the catalogue lacks it.

    A glass from an unknown catalogue keeps its bare name.
    """
    known_name = best_name(name, [catalogue])
    return f"{catalogue.upper()} {name}" if known_name == name and catalogue.upper() in _catalogues() else known_name


def successor(name: str) -> str | None:
    """The SCHOTT glass that replaced a delisted one, as N-BK7 replaced BK7; None without one.

    Glasses with N- in their names contain no lead or arsenic. Their indices match their predecessors' within 1e-4,
    except where SCHOTT still lists both.
    """
    *makers, glass = name.split() or [name]
    if makers not in ([], ["SCHOTT"]) or _full_name(glass, tuple(makers)):
        return None
    return _full_name(f"N-{glass}", ("SCHOTT",))


@lru_cache(maxsize=1)
def _lines():
    """{full name: the rest of its line}."""
    rows = (line.split(",", 1) for line in CATALOGUE.read_text(encoding="utf-8").splitlines())
    return dict(rows)


@lru_cache(maxsize=1)
def _catalogues():
    """{maker: {normalized name: full name}}, the preferred makers first."""
    makers = {maker: {} for maker in PREFERRED}
    for name in _lines():
        maker, _, glass = name.partition(" ")
        makers.setdefault(maker, {})[_bare(glass)] = name
    return makers


@lru_cache(maxsize=None)
def _read(name):
    """The glass of a full name."""
    number, terms, span, absorbed = _lines()[name].split(",")
    numbers = [float(word) for word in terms.split()]
    dispersion = (_table(numbers) if number == "n" else
                  Formula(int(number), tuple(numbers), tuple(float(nm) for nm in span.split())))
    return Glass(name, dispersion, _table([float(word) for word in absorbed.split()]) if absorbed else None)


def _table(numbers):
    return Table(np.array(numbers[::2]), np.array(numbers[1::2]))


def _full_name(glass, makers):
    """Full name of a glass by one of these makers, or by any maker if none is given; None if unknown."""
    catalogues = _catalogues()
    known = (catalogues[maker] for maker in makers or catalogues if maker in catalogues)
    return next((names[_bare(glass)] for names in known if _bare(glass) in names), None)


def _bare(name):
    """Name normalized for comparison: Code V omits hyphens, and capitalization varies."""
    return name.replace("-", "").upper()


def glass_names() -> list[str]:
    """Full names of all catalogue glasses, the preferred makers' first."""
    return [name for names in _catalogues().values() for name in names.values()]


def similar_glasses(name: str) -> list[str]:
    """Catalogue glasses that may be meant by an unknown name, the likeliest first: those with similar names or, for an
    index, those with this index at the d line."""
    if not INDEX_ALONE.fullmatch(name):
        return _similar_names(name.split()[-1])
    errors = {glass: abs(index - float(name)) for glass, index in _d_indices().items()}
    return sorted((glass for glass, error in errors.items() if error < SAME_INDEX), key=errors.__getitem__)


@lru_cache(maxsize=1)
def _d_indices():
    """{full name: index at the d line} of the preferred makers' glasses."""
    names = [name for maker in PREFERRED for name in _catalogues()[maker].values()]
    return {name: float(_read(name).index_at([1e3 * D_LINE_UM])[0]) for name in names}


def _suggestion(glass):
    """Glasses with similar names, as a part of a sentence."""
    shown = _similar_names(glass)
    return f"perhaps {' or '.join(shown)}? Otherwise " if shown else ""


def _similar_names(glass):
    names = {}
    for known in _catalogues().values():  # preferred makers first
        names = names | {key: name for key, name in known.items() if key not in names}
    wanted = _bare(glass)
    stem = _without_suffix(wanted)
    close = [key for key in names if len(stem) > 2 and _without_suffix(key).endswith(stem)]
    close += difflib.get_close_matches(wanted, names, n=3, cutoff=0.7)
    return [names[key] for key in dict.fromkeys(close)][:4]


def _without_suffix(name):
    """LAK10 for LAK10C: letters after the number distinguish variants."""
    return re.sub(r"(?<=\d)[A-Z]+$", "", name)
