"""Which lens a name or a path is: a bundled one, a prescription or a package."""

import os
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from os import PathLike
from pathlib import Path

from ..bake.prescription import Prescription
from ..bake.prescriptions import READERS, read_prescription
from ..bake.prescriptions.toml import read_lensfield
from ..bake.rings import AT_REST, Rings, is_stopped_down, turned
from ..errors import LensError, absence
from ..lens.lens import Lens
from ..lens.readers import IMPORT_FIRST, is_import
from ..lens.readers.package import read_package
from .baked import baked_lens

BUNDLED = Path(__file__).resolve().parent
PRESCRIPTIONS, PICTURES = BUNDLED / "prescriptions", BUNDLED / "pictures"
ALL_LENSES = "`lensfield lens list` tells the bundled ones"


@lru_cache
def bundled_names() -> tuple[str, ...]:
    """Names of the lenses that come with the project."""
    return tuple(sorted(path.stem for path in PRESCRIPTIONS.glob("*.toml")))


@lru_cache
def bundled_lenses() -> dict[str, Prescription]:
    """The lenses that come with the project, by name."""
    return {name: read_lensfield(PRESCRIPTIONS / f"{name}.toml") for name in bundled_names()}


def find_bundled(words: list[str]) -> dict[str, Prescription]:
    """The bundled lenses of which every word is told: of name, maker, year, focal length ("50mm") or character."""
    wanted = [word.casefold() for word in words]
    return {name: lens for name, lens in bundled_lenses().items() if all(word in _told(name, lens) for word in wanted)}


def _told(name, lens):
    focal = f"{lens.focal_length_mm:g}mm" if lens.focal_length_mm else ""
    return " ".join((name, lens.title, lens.maker, str(lens.year or ""), focal, *lens.character, lens.story,
                     lens.source)).casefold()


def load(name_or_path: str | PathLike[str], rings: Rings = AT_REST, quality: str = "standard",
         progress: Callable[[float, str], object] = lambda fraction, label: None) -> Lens:
    """The lens of this name, or in this file, turned to a focus distance and an f-number.

    Parameters
    ----------
    name_or_path : str or path
        A bundled lens, a lens package, or a prescription of any kind that `read_prescription` reads.
    rings : Rings
        What it is turned to, which a package cannot be.
    quality : str
        How finely a prescription is baked: one of `QUALITIES`.
    progress : function (fraction, label)

    Raises
    ------
    LensError
        No such lens; one that is damaged or of no known kind; or one without rings, that is to be turned.
    """
    package = package_path(name_or_path)
    if package and (rings == AT_REST or not has_rings(name_or_path)):
        if rings != AT_REST:
            raise LensError(name_or_path, "focus and f-number", "fixed",
                            "a package holds for one of each: leave them out, or give the lens's prescription")
        return _as_it_stands(package, name_or_path)
    prescription = prescription_of(name_or_path)
    try:
        return baked_lens(prescription, rings, quality, progress)
    except LensError as error:
        raise error.at(name_or_path) from None


def _as_it_stands(package, name_or_path):
    """A package; with the prescription that it was baked from, where that is bundled, too."""
    lens = read_package(package)
    if not has_rings(name_or_path):
        return lens
    return replace(lens, prescription=turned(prescription_of(name_or_path)).prescription)


def cannot_be(name_or_path: str | PathLike[str], rings: Rings) -> tuple[str, ...]:
    """What is asked of a lens's rings and is out of their reach, and what they are set to instead: a line each."""
    return turned(prescription_of(name_or_path), rings).words


def iris_shows(name_or_path: str | PathLike[str], rings: Rings) -> bool:
    """Whether a lens is stopped down below its widest aperture, so that the shape of its iris counts."""
    return has_rings(name_or_path) and is_stopped_down(prescription_of(name_or_path), rings)


def has_rings(name_or_path: str | PathLike[str]) -> bool:
    """Whether a lens can be focused and stopped down: whether there is a prescription of it."""
    return str(name_or_path) in bundled_names() or Path(name_or_path).suffix.lower() in READERS


def package_path(name_or_path: str | PathLike[str]) -> Path | None:
    """The lens package that a lens is read from as it is told; None where it is baked."""
    baked_before = BUNDLED / f"{name_or_path}.npz"
    if str(name_or_path) in bundled_names():
        return baked_before if baked_before.is_file() else None
    path = Path(name_or_path)
    if not os.path.isfile(path):  # of a text too long to be a name, Path.is_file raises
        raise LensError(name_or_path, "lens", absence(path), IMPORT_FIRST if os.path.isdir(path) else
                        f"give a lens package, a prescription or the name of a bundled lens: {ALL_LENSES}")
    if is_import(path):
        raise LensError(path, "lens data", "another program's", IMPORT_FIRST)
    if path.suffix.lower() != ".npz" and not has_rings(path):
        raise LensError(path, "kind of file", path.suffix or "without a suffix",
                        f"expected a .npz lens package or a prescription ({', '.join(READERS)}); {IMPORT_FIRST}")
    return None if has_rings(path) else path


def prescription_of(name_or_path: str | PathLike[str], field: tuple[str, float] | None = None) -> Prescription:
    """The prescription of this name, or in this file; of a field that ends elsewhere, where that is told.

    Raises
    ------
    LensError
        As `read_prescription`.
    """
    name = str(name_or_path)
    if name in bundled_names():
        return read_lensfield(PRESCRIPTIONS / f"{name}.toml", field) if field else bundled_lenses()[name]
    return read_prescription(name, field)
