"""What is known of a lens as it is turned before it is baked: a fraction of a second's work, not many."""

import os
from dataclasses import dataclass
from functools import lru_cache

from ...engine.bake.rays import HalfPupil, trace_pupil
from ...engine.bake.rings import AT_REST, Rings, resized_rings, ring_ends, turned
from ...engine.bake.system import system_of
from ...engine.files import stamp_of
from ...engine.lens.readers.assembly import four_by_three
from ...engine.library import has_rings, prescription_of
from .lens_cache import load_lens

MOST_FACTS = 64


@dataclass(frozen=True)
class LensFacts:
    """A lens as it is turned.

    Attributes
    ----------
    rings : Rings
        What it is turned to; for a lens that is made larger or smaller, before that.
    efl_mm, capture_focal_length_mm, sensor_mm
        As `Lens` has them.
    f_number, focus_mm : float
        As `TurnedLens` has them.
    reach : (float, float, float) or None
        The widest and the highest f-number, and the closest focus in mm; None for a package, which has no rings.
    words : tuple of str
        What is asked of its rings and cannot be, a line each.
    """

    rings: Rings
    efl_mm: float
    capture_focal_length_mm: float
    sensor_mm: tuple[float, float]
    f_number: float
    focus_mm: float
    reach: tuple[float, float, float] | None
    words: tuple[str, ...]


def lens_facts(name_or_path: str | os.PathLike, rings: Rings = AT_REST, focal_mm: float | None = None) -> LensFacts:
    """What is known of a lens, by name or path.

    Parameters
    ----------
    name_or_path : str or path
    rings : Rings
        What it is to be turned to, which a package cannot be.
    focal_mm : float or None
        The capture focal length that it is made larger or smaller for; None for a lens as large as it is.

    Raises
    ------
    LensError
        No such lens, or one that has no image of what is there.
    """
    return _facts(str(name_or_path), stamp_of(name_or_path), rings, focal_mm)


@lru_cache(maxsize=MOST_FACTS)
def _facts(path, changed, rings, focal_mm):
    if not has_rings(path):
        return _of_package(load_lens(path))
    prescription = prescription_of(path)
    if focal_mm is not None:
        rings = resized_rings(prescription, rings, focal_mm)
    there = turned(prescription, rings)
    system = system_of(there.prescription)
    pupil_mm = there.prescription.object_distance_mm + system.entrance_pupil_mm
    return LensFacts(
        rings, system.efl_mm, system.efl_mm if system.object_at_infinity else abs(system.magnification) * pupil_mm,
        there.prescription.sensor_mm or four_by_three(_last_height_mm(system)), there.f_number, there.focus_mm,
        _reach(path, changed), there.words)


@lru_cache(maxsize=MOST_FACTS)
def _reach(path, changed):
    widest, closest = ring_ends(prescription_of(path))
    return widest.f_number, closest.f_number, closest.focus_mm


def _last_height_mm(system):
    """Where the last chief ray really lands."""
    nm = system.prescription.reference_wavelength_nm
    return abs(trace_pupil(system, [system.last_height_mm], [nm], HalfPupil(1, 1)).chief_height_mm[0, 0])


def _of_package(lens):
    return LensFacts(AT_REST, lens.efl_mm, lens.capture_focal_length_mm, lens.sensor_mm, lens.f_number_effective,
                     lens.object_distance_mm + lens.entrance_pupil_mm, None, ())
