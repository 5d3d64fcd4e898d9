"""Readers of lens data: every kind of file becomes one `Lens`."""

import os
from dataclasses import replace
from pathlib import Path

from ...errors import LensError, absence
from ..lens import Lens
from .export import DESCRIPTION, read_export
from .iset import find_parameter_file, is_parameter_file, read_iset
from .iset_mat import read_iset_mat

IMPORT_FIRST = "`lensfield lens import` makes a lens package of another program's export"
IMPORTABLE = f"an ISET bundle (ISETPARMS.TXT), an export folder ({DESCRIPTION}) or an ISETCam .mat"


def is_import(path: str | Path) -> bool:
    """Whether a file is to be imported: one that `import_lens` knows by its name."""
    path = Path(path)
    return path.name == DESCRIPTION or path.suffix.lower() == ".mat" or is_parameter_file(path)


def import_lens(path: str | Path, name: str | None = None) -> Lens:
    """The lens of another program's export: an ISET bundle, an export folder, or an ISETCam .mat.

    Parameters
    ----------
    path : path
        The folder, or in it the file that describes the others: ISETPARMS.TXT or lens.toml; or the .mat.
    name : str, optional
        What to call it instead of what the files say.

    Raises
    ------
    LensError
        Another kind of file; or one that is missing, damaged or at odds with the others.
    """
    try:
        lens = _imported(Path(path))
    except OSError as error:
        raise LensError(path, "file", "not readable", error.strerror or str(error)) from None
    return lens if name is None else replace(lens, name=name)


def _imported(path):
    """The lens by the reader of its kind."""
    if os.path.isdir(path):
        description, parameters = path / DESCRIPTION, find_parameter_file(path)
        if description.is_file():
            return read_export(description)
        if parameters is None:
            raise LensError(path, "folder", "without a description", f"expected {IMPORTABLE}")
        return read_iset(parameters)
    if not os.path.isfile(path):
        raise LensError(path, "lens data", absence(path), f"expected {IMPORTABLE}")
    if path.suffix.lower() == ".toml":
        return read_export(path)
    if is_parameter_file(path):
        return read_iset(path)
    if path.suffix.lower() == ".mat":
        return read_iset_mat(path)
    raise _refusal(path)


def _refusal(path):
    """Why a file by itself is no lens."""
    if path.suffix.lower() == ".npz":
        return LensError(path, "kind of file", path.suffix, "a lens package needs no import; expected " + IMPORTABLE)
    if path.suffix.lower() in (".txt", ".dat", ".json"):
        return LensError(path, "kind of file", "a single listing",
                         "a lens is also made of first-order data, real heights, relative illumination and more PSFs: "
                         f"put a {DESCRIPTION} beside it that names them, and import the folder")
    return LensError(path, "kind of file", path.suffix or "without a suffix", f"expected {IMPORTABLE}")
