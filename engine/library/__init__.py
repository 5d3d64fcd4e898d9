"""The lenses that come with the project, and `load`: which lens a name or a path is."""

import os
import tomllib
from os import PathLike
from pathlib import Path
from typing import NamedTuple

from ..errors import LensError, absence
from ..lens.lens import Lens
from ..lens.readers import IMPORT_FIRST
from ..lens.readers.package import read_header, read_package

BUNDLED = Path(__file__).resolve().parent
PRESCRIPTIONS = BUNDLED / "prescriptions"


def bundled_names() -> list[str]:
    """Names of the lenses that come with the project."""
    return sorted(path.stem for path in BUNDLED.glob("*.npz"))


class BundledLens(NamedTuple):
    """What is told of a bundled lens where people choose one: texts, `title` being what it is called there."""

    title: str
    maker: str
    story: str


def bundled_lenses() -> dict[str, BundledLens]:
    """The lenses that come with the project, by name."""
    titles = tomllib.loads((BUNDLED / "titles.toml").read_text(encoding="utf-8"))
    headers = {name: read_header(BUNDLED / f"{name}.npz") for name in bundled_names()}
    return {name: BundledLens(titles[name], header["maker"], header["story"]) for name, header in headers.items()}


def load(name_or_path: str | PathLike[str]) -> Lens:
    """The bundled lens of this name, or the lens data in this file."""
    text = str(name_or_path)
    if text in bundled_names():
        return read_package(BUNDLED / f"{text}.npz")
    path = Path(text)
    if not os.path.isfile(path):  # of a text too long to be a name, Path.is_file raises
        raise LensError(text, "lens", absence(path), IMPORT_FIRST if os.path.isdir(path) else
                        f"give a .npz lens package or one of: {', '.join(bundled_names())}")
    if path.suffix.lower() != ".npz":
        raise LensError(path, "kind of file", path.suffix or "without a suffix",
                        f"expected a .npz lens package; {IMPORT_FIRST}")
    return read_package(path)
