"""The project's own lens package: one .npz of plain arrays and a JSON header, never a pickle."""

import json
from dataclasses import fields

import numpy as np

from ..atomic import atomic_path
from ..errors import LensError
from ..lens import Lens

FORMAT = "lensfield-lens"
VERSION = 1
ARRAYS = ("wavelengths_nm", "heights_mm", "real_height_mm", "relative_illumination", "psf", "enclosed_energy",
          "transmittance")
SCALARS = tuple(field.name for field in fields(Lens) if field.name not in ARRAYS)


def write_package(lens, path):
    """Write `lens` to `path`, whole or not at all."""
    header = {"format": FORMAT, "version": VERSION} | {name: getattr(lens, name) for name in SCALARS}
    with atomic_path(path) as temporary, open(temporary, "wb") as stream:
        arrays = {name: getattr(lens, name) for name in ARRAYS}
        np.savez_compressed(stream, header=np.array(json.dumps(header)), **arrays)


def read_package(path):
    """Read a lens package.

    Raises
    ------
    LensError
        A file that is no package, of a later version, or with a field that is missing or cannot be right.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            contents = {name: archive[name] for name in archive.files}
    except Exception as error:  # damaged bytes lead numpy's and zip's readers to errors of a dozen kinds
        raise LensError(path, "lens package", "not readable", f"expected a .npz lens package ({error})") from None
    header = _header(contents, path)
    missing = [name for name in ARRAYS if name not in contents] + [name for name in SCALARS if name not in header]
    if missing:
        raise LensError(path, missing[0], "missing", f"a lens package of version {VERSION} has it")
    try:
        return Lens(**{name: header[name] for name in SCALARS}, **{name: contents[name] for name in ARRAYS})
    except LensError as error:
        raise LensError(path, error.field, error.value, error.remedy) from None
    except (TypeError, ValueError) as error:
        raise LensError(path, "lens package", "damaged", str(error)) from None


def _header(contents, path):
    try:
        header = json.loads(str(contents["header"]))
        kind, version = header["format"], header["version"]
    except (KeyError, TypeError, ValueError):
        raise LensError(path, "header", "missing or damaged", "expected a Lensfield lens package") from None
    if kind != FORMAT or version != VERSION:
        raise LensError(path, "format", f"{kind} {version}", f"expected {FORMAT} {VERSION}")
    return header
