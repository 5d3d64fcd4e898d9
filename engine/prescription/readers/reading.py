"""The result of a reader, and the two rules for every reader.

Each word of a file is used, listed as harmless, or reported in the notes. The stated focal length and f-number are
compared with the surfaces.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...runtime.errors import LensError
from ...runtime.unread import unread_note
from ..glasses import INDEX_ALONE, successor
from ..prescription import ALUMINIUM, Prescription, Surface
from ..system import System, system_of

SEMI_DIAMETERS = ("aperture", "ignore")
TOLERANCE = 0.01  # relative, for the stated focal length and f-number
THIRD_OF_A_STOP = 2 ** (1 / 6)  # as a ratio of f-numbers: a stop's clear diameter differs less from its paraxial size
CLIPPED = 0.03  # of the axial beam: patents round their apertures by as much
MOST_NAMED = 12  # surfaces in a note
FIELD_MM = 1.0  # arbitrary: paraxial figures do not depend on it
FOCAL_LENGTH, F_NUMBER = "focal length", "f-number"
UNTRACED = ("Without the indices of all glasses, the focal length and f-number stated in the file cannot be compared "
            "with its surfaces.")
REMEDY = ("a figure in the file is mistyped or missing: correct it, or accept the surfaces as they are "
          "(--allow-mismatch)")
UNOBSTRUCTED = ("The file states no central obstruction: no light is blocked by mirrors in front of others, and "
                "blurred points are discs without a hole.")
ANY_ABBE = 50.0  # for a glass with only an index: it does not matter at the wavelength of that index


class ReadingOptions(NamedTuple):
    """How to read a prescription file: values that it does not state, or that replace its own.

    Attributes
    ----------
    field : (str, float) or None
        End of the field, as `Prescription.field`; None: as in the file.
    which : str or None
        Which zoom and focus position (Optical Bench) or which lens (lentil) to use if the file contains several: its
        number.
    semi_diameters : str or None
        Fixed semi-diameters of Zemax surfaces without CLAP or FLAP: "aperture" (the default) or "ignore".
    glasses : tuple of str
        Glasses to replace, each as "OLD=NEW": OLD is a name in the file, with or without its catalogue, and NEW as
        `Surface.glass`.
    stop : int or None
        Number of the surface that is the aperture stop, from 1; None: as in the file.
    image_plane : str or None
        As `Prescription.focus`; None: as in the file.
    sensor_mm : (float, float) or None
        As `Prescription.sensor_mm`; None: as in the file.
    allow_mismatch : bool
        If the focal length or f-number in the file differs from its surfaces', report it in the notes instead of
        raising an error.

    Examples
    --------
    >>> from lensfield import ReadingOptions, read_prescription
    >>> from lensfield.engine.library import prescription_path
    >>> aps_c = ReadingOptions(sensor_mm=(23.5, 15.6))
    >>> read_prescription(prescription_path("tessar-50mm"), aps_c).sensor_mm
    (23.5, 15.6)
    """

    field: tuple[str, float] | None = None
    which: str | None = None
    semi_diameters: str | None = None
    glasses: tuple[str, ...] = ()
    stop: int | None = None
    image_plane: str | None = None
    sensor_mm: tuple[float, float] | None = None
    allow_mismatch: bool = False


AS_IT_IS = ReadingOptions()


@dataclass(frozen=True)
class Reading:
    """Result of a reader.

    Attributes
    ----------
    prescription : Prescription
        Its `focal_length_mm` is the stated one.
    f_number : float or None
        Stated in the file.
    unread : tuple of str
        Names in the file that the reader neither uses nor lists as harmless.
    native : bool
        Whether the file is in Lensfield's format: its glasses and notes then stay as written.
    """

    prescription: Prescription
    f_number: float | None = None
    unread: tuple[str, ...] = ()
    native: bool = False


def with_stop(path: Path, surfaces: Sequence[Surface], options: ReadingOptions) -> tuple[Surface, ...]:
    """The surfaces, with the stop at the one that the options name, if any.

    Raises
    ------
    LensError
        The lens has fewer surfaces.
    """
    if options.stop is None:
        return tuple(surfaces)
    if not 1 <= options.stop <= len(surfaces):
        raise LensError(path, "--stop", options.stop, f"expected the number of a surface, 1 to {len(surfaces)}")
    return tuple(replace(surface, stop=number == options.stop) for number, surface in enumerate(surfaces, 1))


def checked(path: Path, reading: Reading, allow_mismatch: bool = False) -> Prescription:
    """The prescription of a reading, checked by both rules; its notes report every difference from the file.

    Parameters
    ----------
    path : Path
        For errors.
    reading : Reading
    allow_mismatch : bool
        Report a wrong focal length or f-number in the notes instead of raising an error.

    Raises
    ------
    LensError
        The stated focal length or f-number differs from the surfaces' by more than 1 %; an f-number that sets the
        stop, by more than a third of a stop.
    """
    prescription, renamed = (reading.prescription, []) if reading.native else _with_successors(reading.prescription)
    stated = bool(prescription.focal_length_mm or reading.f_number)
    traced = _traced(path, prescription, stated)
    mismatches = [] if traced is None else list(_mismatches(prescription, reading.f_number, traced))
    if mismatches and not allow_mismatch:
        raise LensError(path, *mismatches[0], REMEDY)
    if any(field == FOCAL_LENGTH for field, _ in mismatches):
        prescription = replace(prescription, focal_length_mm=None)
    notes = [*renamed, unread_note(reading.unread), *_notes(reading.f_number, stated, traced),
             *_mirror_notes(prescription)]
    differences = [f"The file's {field} is {values}." for field, values in mismatches]
    return replace(prescription, notes=" ".join(filter(None, (
        prescription.notes, *differences, *(() if reading.native else notes)))))


def _notes(f_number, stated, traced):
    if traced is None:
        return [UNTRACED] if stated else []
    return [_stop_note(f_number, traced), _clipping_note(traced.system)]


def _mirror_notes(prescription):
    """Notes on what files do not state about mirrors."""
    if not prescription.mirrors:
        return
    yield f"Mirrors count as reflecting {ALUMINIUM:.0%} of the light: the file does not state how much."
    if not any(surface.semi_obstruction_mm for surface in prescription.surfaces):
        yield UNOBSTRUCTED


def _with_successors(prescription):
    """The prescription with discontinued glasses replaced by their successors, and a note for each."""
    private = {glass.name for glass in prescription.glasses}
    unlisted = {surface.glass for surface in prescription.surfaces} - private
    pairs = {name: successor(name) for name in sorted(unlisted)}
    names = {old: new for old, new in pairs.items() if new}
    return prescription.with_glasses(names), [f"{new} is used for the discontinued glass {old}."
                                              for old, new in names.items()]


class Traced(NamedTuple):
    """First-order figures of a prescription.

    Attributes
    ----------
    system : System
        At the file's object distance.
    f_number : float
        For a distant object.
    own_f_number : float or None
        For a distant object, at the stop diameter in the file's row of the stop; None without one.
    """

    system: System
    f_number: float
    row_f_number: float | None


def _traced(path, prescription, needed) -> Traced | None:
    """First-order figures; None if a glass is unknown, or if they are undefined but not needed."""
    indices = {surface.glass: f"{surface.glass}/{ANY_ABBE:g}" for surface in prescription.surfaces
               if INDEX_ALONE.fullmatch(surface.glass)}
    try:
        with np.errstate(all="ignore"):  # damaged values lead to non-finite figures, which are rejected later
            system = system_of(prescription.with_glasses(indices))
            far = system_of(replace(system.prescription, object_distance_mm=np.inf,
                                    field=("image_height_mm", FIELD_MM)))
            row_mm = prescription.surfaces[prescription.stop_index].semi_aperture_mm
            return Traced(system, far.f_number, far.f_number * system.stop_semi_aperture_mm / row_mm
                          if np.isfinite(row_mm) else None)
    except LensError as error:
        if needed and not error.field.endswith(", glass"):
            raise error.at(path) from None
        return None


def _mismatches(prescription, f_number, traced) -> Iterator[tuple[str, str]]:
    """(field, both values) of each stated figure that the surfaces contradict."""
    stated_mm, efl_mm = prescription.focal_length_mm, traced.system.efl_mm
    if stated_mm is not None and not abs(efl_mm - stated_mm) <= TOLERANCE * abs(stated_mm):
        along = "" if prescription.radial else " along y"
        yield FOCAL_LENGTH, f"{stated_mm:g} mm, and its surfaces give {efl_mm:.4g} mm{along}"
    if f_number is None:
        return
    actual, slack = traced.f_number, 1 + TOLERANCE
    if prescription.aperture[0] == "f_number":  # this sets the stop; the diameter in its row is a clear diameter
        actual, slack = traced.row_f_number, THIRD_OF_A_STOP
    if actual is not None and not max(actual, f_number) <= slack * min(actual, f_number):
        yield F_NUMBER, f"{f_number:.4g}, and the diameter of its stop gives {actual:.4g}"


def _stop_note(stated, traced):
    """Note on a stop wider than the diameter in its row or, with a stated f-number, also narrower."""
    if traced.row_f_number is None:
        return ""
    ratio = traced.row_f_number / traced.f_number
    if ratio <= 1 + TOLERANCE and (stated is None or 1 / ratio <= 1 + TOLERANCE):
        return ""  # lenses are stopped down below the clear aperture of their stop
    return f"The stop is set to f/{traced.f_number:.4g}; the diameter in its row gives f/{traced.row_f_number:.4g}."


def _clipping_note(system):
    """Note on surfaces that clip the axial beam to less than the stop."""
    up, across = (np.abs(each.marginal_heights_mm) for each in (system, system.across))
    heights_mm = np.append(up, np.stack([across, up], axis=1)[list(system.prescription.rectangles)])
    passing = 1 / np.sqrt(np.maximum(system.rims(heights_mm**2), 1e-24))
    clipping = np.unique(system.rim_surfaces[passing < 1 - CLIPPED]) + 1
    if not clipping.size:
        return ""
    return (f"Apertures clip the axial beam to {passing.min():.0%} of its radius (surface "
            f"{', '.join(map(str, clipping[:MOST_NAMED]))}).")
