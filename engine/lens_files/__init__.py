"""Readers of lens data: every kind of file becomes one `Lens`."""

import os
from dataclasses import replace
from pathlib import Path

from ..lens.lens import Lens
from ..runtime.errors import LensError, explain
from ..runtime.inputs import check_input
from .export import DESCRIPTION, read_export
from .iset import find_parameter_file, is_parameter_file, read_iset
from .iset_mat import read_iset_mat

IMPORT_FIRST = "`lensfield lens import` converts another program's export to a lens package"
IMPORTABLE = ("an ISET bundle (its folder or ISETPARMS.TXT), a folder written by a macro of export-macro (or its "
              f"{DESCRIPTION}), or an ISETCam .mat")
"""The files that `import_lens` reads, for help and errors."""


def is_import(path: str | Path) -> bool:
    """Whether `import_lens` reads a file, judged by its name."""
    path = Path(path)
    return path.name == DESCRIPTION or path.suffix.lower() == ".mat" or is_parameter_file(path)


def import_lens(path: str | Path, name: str | None = None) -> Lens:
    """Read a lens from another program's export: an ISET bundle, an export folder, or an ISETCam .mat.

    Parameters
    ----------
    path : path
        The folder; or the file in it that describes the others, ISETPARMS.TXT or lens.toml; or the .mat.
    name : str, optional
        A name to use instead of the one in the files.

    Raises
    ------
    LensError
        The file is of another kind; or a file is missing, damaged or inconsistent with the others.
    """
    try:
        lens = _imported(Path(path))
    except OSError as error:
        raise LensError(path, "file", "not readable", explain(error)) from None
    return lens if name is None else replace(lens, name=name)


def _imported(path):
    """The lens, read by the reader for its kind of file."""
    if os.path.isdir(path):
        description, parameters = path / DESCRIPTION, find_parameter_file(path)
        if description.is_file():
            return read_export(description)
        if parameters is None:
            raise LensError(path, "folder", "without a description", f"expected {IMPORTABLE}")
        return read_iset(parameters)
    check_input(path, "lens data", f"expected {IMPORTABLE}", error=LensError)
    if path.suffix.lower() == ".toml":
        return read_export(path)
    if is_parameter_file(path):
        return read_iset(path)
    if path.suffix.lower() == ".mat":
        return read_iset_mat(path)
    raise _refusal(path)


def _refusal(path):
    """The error for a file that cannot be imported by itself."""
    if path.suffix.lower() == ".npz":
        return LensError(path, "kind of file", path.suffix, "a lens package needs no import; expected " + IMPORTABLE)
    if path.suffix.lower() in (".txt", ".dat", ".json"):
        return LensError(path, "kind of file", "a single listing",
                         "a lens also needs first-order data, real heights, relative illumination and more PSFs: "
                         f"put a {DESCRIPTION} next to it that names them, and import the folder")
    return LensError(path, "kind of file", path.suffix or "without a suffix", f"expected {IMPORTABLE}")
