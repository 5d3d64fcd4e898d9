"""Lens data: what a lens-design program knows about a lens, the files that hold it, and what can be said of it."""

from .lens import Lens
from .readers import import_lens

__all__ = ["Lens", "import_lens"]
