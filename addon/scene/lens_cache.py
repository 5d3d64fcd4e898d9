"""Lenses by name or path, each read once; and scaled, each made once: panels ask for theirs many times a second."""

import os
from dataclasses import replace
from functools import lru_cache

from ...engine import Lens
from ...engine.bake.rings import AT_REST, Rings
from ...engine.library import load


def load_lens(name_or_path: str | os.PathLike, rings: Rings = AT_REST, quality: str = "standard") -> Lens:
    """What `engine.library.load` gives, and the same Lens as before unless the file has changed."""
    path = str(name_or_path)
    return _load(path, rings, quality, os.stat(path).st_mtime_ns if os.path.isfile(path) else None)


@lru_cache(maxsize=4)
def scaled_lens(lens: Lens, factor: float, sensor_mm: tuple[float, float]) -> Lens:
    """A lens `factor` times as large, on a sensor of these sides in mm (width, height)."""
    return replace(lens.scaled(factor), sensor_mm=sensor_mm)


def forget_lenses() -> None:
    """Free them."""
    _load.cache_clear()
    scaled_lens.cache_clear()


@lru_cache(maxsize=4)
def _load(path, rings, quality, changed_ns):
    return load(path, rings, quality)
