"""Glasses by catalogue name, or by index and Abbe number. An unknown one is an error, never a placeholder."""

import difflib
import re
from functools import lru_cache

import numpy as np
from optiland.materials import AbbeMaterial, IdealMaterial, Material
from optiland.materials.registry import MaterialRegistry
from optiland.materials.catalog import MaterialCatalog

from ..errors import LensError

PREFERRED = ("schott", "ohara", "hoya", "hikari", "cdgm", "sumita")
MODEL_GLASS = re.compile(r"(\d\.\d+)\s*/\s*(\d+(?:\.\d+)?)")


def find_glass(name, where, field):
    """Optiland's material of a glass name.

    Parameters
    ----------
    name : str
        "" for air; "N-BK7"; "SCHOTT N-BK7", with its catalogue; or "1.5168/64.2", its index at the d line and Abbe
        number, whose dispersion then follows Buchdahl's model.
    where, field : str
        For the error: the lens and its surface.

    Raises
    ------
    LensError
        No catalogue has it; close names are suggested.
    """
    if not name:
        return IdealMaterial(1.0)
    model = MODEL_GLASS.fullmatch(name.strip())
    if model:
        return AbbeMaterial(float(model[1]), float(model[2]), model="buchdahl")
    if re.fullmatch(r"\d\.\d+", name):
        raise LensError(where, field, name, f"an index without dispersion: give its Abbe number too, as {name}/V")
    *catalogue, glass = name.split()
    found = _catalogues_with(glass, tuple(word.lower() for word in catalogue))
    if not found:
        raise LensError(where, field, name, f"in no glass catalogue: {_suggestion(glass)}give another name, or its "
                                            "index and Abbe number as n/V")
    return Material(found[1], catalog=found[0])


def best_name(name, catalogues):
    """A glass's name with the first of these catalogues that has it; alone where none does."""
    found = _catalogues_with(name, tuple(maker.lower() for maker in catalogues if maker.lower() in _makers()))
    return f"{found[0].upper()} {found[1]}" if catalogues and found else name


@lru_cache(maxsize=None)
def _catalogues_with(glass, catalogue):
    """(catalogue, name as spelt there) of a glass, of the preferred makers first; None where there is none."""
    for maker in catalogue or _makers():
        for name in _names(maker):
            if _bare(name) == _bare(glass):
                return maker, name
    return None


@lru_cache(maxsize=None)
def _makers():
    others = [maker for maker in MaterialCatalog.available() if maker not in PREFERRED]
    return (*PREFERRED, *others)


@lru_cache(maxsize=None)
def _names(maker):
    return tuple(MaterialRegistry.instance().list_materials(maker))


def _bare(name):
    """Names as they are compared: Code V leaves hyphens out, and nobody agrees on capitals."""
    return name.replace("-", "").upper()


def _suggestion(glass):
    """Glasses of a similar name, as a part of a sentence."""
    names = {_bare(name): f"{maker.upper()} {name}" for maker in reversed(_makers()) for name in _names(maker)}
    wanted = _bare(glass)
    close = [key for key in names if len(wanted) > 3 and key.endswith(wanted.rstrip("ABC"))]
    close += difflib.get_close_matches(wanted, names, n=3, cutoff=0.7)
    shown = list(dict.fromkeys(names[key] for key in close))[:4]
    return f"perhaps {' or '.join(shown)}? Else " if shown else ""


def extinction_at(material, wavelength_nm):
    """Extinction coefficient of a material; 0 where its catalogue has none."""
    return float(np.ravel(material.k(wavelength_nm * 1e-3))[0])
