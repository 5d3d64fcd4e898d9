"""Readers of lens data: every kind of file becomes one `Lens`."""

import os
from pathlib import Path

from ..errors import LensError, absence
from ..lens import Lens
from .package import read_package

BUNDLED = Path(__file__).resolve().parent.parent / "lenses"


def bundled_names():
    """Names of the lenses that come with the project."""
    return sorted(path.stem for path in BUNDLED.glob("*.npz"))


def load(name_or_path) -> Lens:
    """The bundled lens of this name, or the lens data in this file."""
    text = str(name_or_path)
    if text in bundled_names():
        return read_package(BUNDLED / f"{text}.npz")
    path = Path(text)
    if not os.path.isfile(path):  # of a text too long to be a name, Path.is_file raises
        raise LensError(text, "lens", absence(path),
                        f"give a .npz lens package or one of: {', '.join(bundled_names())}")
    if path.suffix.lower() != ".npz":
        raise LensError(path, "kind of file", path.suffix or "without a suffix", "expected a .npz lens package")
    return read_package(path)
