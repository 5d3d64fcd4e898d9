"""A cache of lenses by name or path, and of scaled lenses: panels request them many times a second."""

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from threading import Lock

import numpy as np

from ...engine import Lens, library
from ...engine.library.baked import needed_wavelengths_nm
from ...engine.rays.rings import AT_REST, Rings
from ...engine.runtime.files import stamp_of

MOST_LENSES = 6

_lenses: dict[tuple, Lens] = {}  # the newest at the end
_lock = Lock()  # a thread may bake a lens while the window requests another


def load_lens(name_or_path: str | os.PathLike, rings: Rings = AT_REST, quality: str = "standard",
              progress: Callable[[float, str], object] = lambda fraction, label: None,
              wavelengths_nm: Sequence[float] | np.ndarray | None = None) -> Lens:
    """The lens of `library.load_lens`: the same value as before unless the file has changed."""
    key = _key(name_or_path, rings, quality, wavelengths_nm)
    lens = _lenses.get(key) or library.load_lens(name_or_path, rings, quality, progress, wavelengths_nm)
    with _lock:
        _lenses.pop(key, None)
        _lenses[key] = lens
        if len(_lenses) > MOST_LENSES:
            _lenses.pop(next(iter(_lenses)))
    return lens


def loaded_lens(name_or_path: str | os.PathLike, rings: Rings, quality: str,
                wavelengths_nm: Sequence[float] | np.ndarray | None = None) -> Lens | None:
    """The lens of `load_lens` if it is cached, else None."""
    return _lenses.get(_key(name_or_path, rings, quality, wavelengths_nm))


def _key(name_or_path, rings, quality, wavelengths_nm):
    return str(name_or_path), stamp_of(name_or_path), rings, quality, needed_wavelengths_nm(wavelengths_nm)


@lru_cache(maxsize=4)
def scaled_lens(lens: Lens, factor: float, sensor_mm: tuple[float, float]) -> Lens:
    """A lens `factor` times as large, on a sensor of these sides in mm (width, height)."""
    return replace(lens.scaled(factor), sensor_mm=sensor_mm)


def forget_lenses() -> None:
    """Clear the cache."""
    _lenses.clear()
    scaled_lens.cache_clear()
