"""Lens data: what a lens-design program knows about a lens, the files that hold it, and what can be said of it."""

from .lens import Lens
from .readers import bundled_lenses, bundled_names, import_lens, load

__all__ = ["Lens", "bundled_lenses", "bundled_names", "import_lens", "load"]
