"""A cache of lenses by name, path or prescription, and of scaled lenses: panels request them many times a second."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from lensfield.engine import Lens, library
from lensfield.engine.bake.bake import bake
from lensfield.engine.bake.quality import SKETCH
from lensfield.engine.library.baked import Edges, needed_ends_mm, needed_wavelengths_nm
from lensfield.engine.prescription.prescription import Prescription
from lensfield.engine.rays.rings import AT_REST, Rings, turned
from lensfield.engine.runtime.background_work import Newest
from lensfield.engine.runtime.errors import LensError
from lensfield.engine.runtime.files import stamp_of

MOST_LENSES = 6
SKETCHED = "sketched"  # a quality of `load_lens`: at a few wavelengths, and not cached on disk
SKETCHED_SAMPLES, SKETCHED_WAVELENGTHS = 33, 3

_lenses = Newest(MOST_LENSES)  # a thread may bake a lens while the window requests another


def unwatched(fraction: float, label: str) -> None:
    """The progress function of work whose progress is not shown."""


def load_lens(source: library.LensSource, rings: Rings = AT_REST, quality: str = "standard",
              progress: Callable[[float, str], object] = unwatched,
              wavelengths_nm: Sequence[float] | np.ndarray | None = None, edges_mm: Edges | None = None) -> Lens:
    """The lens of `library.load_lens`: the same value as before unless the file has changed.

    With the quality SKETCHED, a lens with rings is baked for pixels that are larger than its PSFs.
    """
    if quality == SKETCHED and library.has_rings(source):
        return _sketched(*identity_of(source), rings, needed_wavelengths_nm(wavelengths_nm),
                         _ends_mm(source, rings, edges_mm))
    key = _key(source, rings, quality, wavelengths_nm, edges_mm)
    lens = _lenses.get(key) or library.load_lens(source, rings, quality, progress, wavelengths_nm, edges_mm)
    _lenses.store(key, lens)
    return lens


@lru_cache(maxsize=4)
def _sketched(source, changed, rings, wavelengths_nm, ends_mm):
    few_nm = np.linspace(wavelengths_nm[0], wavelengths_nm[-1], min(len(wavelengths_nm), SKETCHED_WAVELENGTHS))
    prescription = turned(library.prescription_of(source), rings).prescription
    try:
        lens = bake(prescription, quality=SKETCH, samples=SKETCHED_SAMPLES, wavelengths_nm=few_nm, ends_mm=ends_mm)
    except LensError as error:
        raise error.at(error.where if isinstance(source, Prescription) else source) from None
    return replace(lens, prescription=prescription)


def loaded_lens(source: library.LensSource, rings: Rings, quality: str,
                wavelengths_nm: Sequence[float] | np.ndarray | None = None, edges_mm: Edges | None = None
                ) -> Lens | None:
    """The lens of `load_lens` if it is cached, else None."""
    return _lenses.get(_key(source, rings, quality, wavelengths_nm, edges_mm))


def _key(source, rings, quality, wavelengths_nm, edges_mm):
    return (*identity_of(source), rings, quality, needed_wavelengths_nm(wavelengths_nm),
            _ends_mm(source, rings, edges_mm))


def _ends_mm(source, rings, edges_mm):
    """The ends of the grid that the lens is baked on, if it is, for pictures with these edges."""
    if edges_mm is None or not library.has_rings(source):
        return None
    return needed_ends_mm(turned(library.prescription_of(source), rings).prescription, edges_mm)


def identity_of(source: library.LensSource) -> tuple[str | Prescription, object]:
    """What identifies a lens: its prescription and None; or its name or path and, for a file, its stamp."""
    return (source, None) if isinstance(source, Prescription) else (str(source), stamp_of(source))


@lru_cache(maxsize=4)
def scaled_lens(lens: Lens, factor: float, sensor_mm: tuple[float, float]) -> Lens:
    """A lens `factor` times as large, on a sensor of these sides in mm (width, height)."""
    return replace(lens.scaled(factor), sensor_mm=sensor_mm)


@lru_cache(maxsize=4)
def lens_on_sensor(lens: Lens, sensor_mm: tuple[float, float]) -> Lens:
    """The lens in its own size, on a sensor of these sides in mm (width, height)."""
    return replace(lens, sensor_mm=sensor_mm)


def forget_lenses() -> None:
    """Clear the cache."""
    _lenses.clear()
    lens_on_sensor.cache_clear()
    scaled_lens.cache_clear()
    _sketched.cache_clear()
