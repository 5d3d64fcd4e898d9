"""Glasses by catalogue name, or by index and Abbe number. An unknown one is an error, never a placeholder."""

import difflib
import io
import re
from collections.abc import Sequence
from contextlib import redirect_stdout
from functools import lru_cache
from importlib import resources
from pathlib import Path

import numpy as np
from optiland.materials import AbbeMaterial, BaseMaterial, IdealMaterial, MaterialFile

from ..errors import LensError

CATALOGUES = Path(str(resources.files("optiland.database"))) / "data-nk" / "glass"
PREFERRED = ("schott", "ohara", "hoya", "hikari", "cdgm", "sumita")
MODEL_GLASS = re.compile(r"(\d+(?:\.\d+)?)\s*/\s*(\d+(?:\.\d+)?)")
CODE = re.compile(r"(\d{3})(\d{3})|(\d{3,6})\.(\d{3,6})")
LEAST_ABBE = 10.0  # of what the model of dispersion was made from, and some more


def find_glass(name: str, where: str, field: str, told: str = "") -> BaseMaterial:
    """Optiland's material of a glass name.

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
        return IdealMaterial(1.0)
    model = MODEL_GLASS.fullmatch(name.strip())
    if model:
        index, abbe = float(model[1]), float(model[2])
        if not (1 < index < 4 and abbe >= LEAST_ABBE):
            raise LensError(where, field, name, f"expected an index above 1 and an Abbe number from {LEAST_ABBE:g}")
        return AbbeMaterial(index, abbe, model="buchdahl")
    if re.fullmatch(r"\d(\.\d+)?", name):
        raise LensError(where, field, name, f"an index without dispersion: give its Abbe number too, as {name}/V")
    *catalogue, glass = name.split() or [name]
    file = _file_of(glass, tuple(word.lower() for word in catalogue))
    if file is None:
        figures = f"n/V, such as the file's own {told}" if told else "n/V"
        raise LensError(where, field, name, f"in no glass catalogue: {_suggestion(glass)}give another name, or its "
                                            f"index and Abbe number as {figures}")
    return MaterialFile(str(file))  # Material would look for it by likeness, and find N-SF11 for SF11


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
    known = tuple(maker.lower() for maker in catalogues if maker.lower() in _makers())
    file = _file_of(name, known) if known else None
    return _full_name(file) if file else name


@lru_cache(maxsize=None)
def _file_of(glass, makers):
    """The data of a glass, of the preferred makers first; None where there are none."""
    known = (_files(maker) for maker in makers or _makers() if maker in _makers())
    return next((files[_bare(glass)] for files in known if _bare(glass) in files), None)


@lru_cache(maxsize=None)
def _makers():
    others = sorted(folder.name for folder in CATALOGUES.iterdir() if folder.name not in PREFERRED)
    return (*PREFERRED, *others)


@lru_cache(maxsize=None)
def _files(maker):
    """{name as compared: file of data} of a catalogue."""
    return {_bare(file.stem): file for file in sorted((CATALOGUES / maker).rglob("*.yml"))}


def _bare(name):
    """Names as they are compared: Code V leaves hyphens out, and nobody agrees on capitals."""
    return name.replace("-", "").upper()


def _full_name(file):
    return f"{file.relative_to(CATALOGUES).parts[0].upper()} {file.stem}"


def _suggestion(glass):
    """Glasses of a similar name, as a part of a sentence."""
    files = {key: file for maker in reversed(_makers()) for key, file in _files(maker).items()}
    wanted = _bare(glass)
    stem = _without_suffix(wanted)
    close = [key for key in files if len(stem) > 2 and _without_suffix(key).endswith(stem)]
    close += difflib.get_close_matches(wanted, files, n=3, cutoff=0.7)
    shown = [_full_name(files[key]) for key in dict.fromkeys(close)][:4]
    return f"perhaps {' or '.join(shown)}? Else " if shown else ""


def _without_suffix(name):
    """LAK10 of LAK10C: letters behind the number tell variants apart."""
    return re.sub(r"(?<=\d)[A-Z]+$", "", name)


def extinction_at(material: BaseMaterial, wavelength_nm: float) -> float:
    """Extinction coefficient of a material; 0 where its catalogue has none."""
    with redirect_stdout(io.StringIO()):  # where Optiland says so
        return float(np.ravel(material.k(wavelength_nm * 1e-3))[0])
