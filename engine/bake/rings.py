"""Rings: a lens turned to a focus distance and an f-number, as a photographer turns it."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq

from ..errors import LensError
from .bake import focused
from .prescription import CLOSEST_FOCUS, Prescription
from .system import system_of

SLACK = 1e-4  # of what rings are turned to: less is rounding
PUPIL_STEPS, PUPIL_SETTLED = 20, 1e-9  # until the entrance pupil of a lens that moves inside stays where it is

NEAREST_MM, SMALLEST_STOP = 1e-3, 1e9  # a focus distance and an f-number that no lens has
SIZE_STEPS = 4  # until a lens that is made larger is focused where it is to be


@dataclass(frozen=True)
class Rings:
    """What a lens is turned to.

    Attributes
    ----------
    focus_mm : float or None
        Distance of what is in focus from the entrance pupil, where a camera stands; None for the distance that the
        prescription is given at, mostly infinity.
    f_number : float or None
        Focal length over the entrance pupil's diameter, both for infinity, as it is engraved; None for the widest.
    focused_wide_open : bool
        Whether the image plane is where the widest aperture has its best focus, as for one who focuses before stopping
        down; else it is focused at the f-number.
    size : float
        How many times as large the lens is made after that, and with it the distances that people are told.
    """

    focus_mm: float | None = None
    f_number: float | None = None
    focused_wide_open: bool = False
    size: float = 1.0


AT_REST = Rings()


@dataclass(frozen=True)
class TurnedLens:
    """A lens turned as far as its rings go.

    Attributes
    ----------
    prescription : Prescription
        As it stands then: with its image plane, its stop and its picture's end in mm, and nothing that moves.
    focus_mm, f_number : float
        What it is turned to, as `Rings` tells it.
    words : tuple of str
        A line for each thing that was asked for and cannot be.
    """

    prescription: Prescription
    focus_mm: float
    f_number: float
    words: tuple[str, ...]


def turned(prescription: Prescription, rings: Rings = AT_REST) -> TurnedLens:
    """A prescription turned to a focus distance and an f-number, or as near to these as it goes.

    The stop's size is that for infinity, and stays when the focus changes. Gaps that the prescription names follow the
    magnification, linearly between the positions for which they are given; where it names none, all of the lens moves.

    Raises
    ------
    LensError
        A distance or an f-number that is none, or a lens that has no image of what is there.
    """
    for name, asked in (("focus_mm", rings.focus_mm), ("f_number", rings.f_number)):
        if asked is not None and not asked > 0:
            raise LensError(prescription.name, name, asked, "expected a positive number")
    widest_stop, far = _wide_open(prescription)
    f_number, of_stop = _f_number(prescription, far, rings.f_number)
    stop = "stop", widest_stop.aperture[1] * far.f_number / f_number
    there, of_focus = widest_stop, ()
    if rings.focus_mm is not None:
        there, of_focus = _focused_on(widest_stop, far, rings)
    if rings.focused_wide_open:
        there = replace(focused(there), aperture=stop)
    else:
        there = focused(replace(there, aperture=stop))
    still = tuple(replace(surface, gaps_mm=()) for surface in there.surfaces)
    return TurnedLens(replace(there, surfaces=still, focused_at_mm=()), _focus_mm(there), f_number, of_stop + of_focus)


def ring_ends(prescription: Prescription) -> tuple[Rings, Rings]:
    """How far rings go: farthest and widest, closest and highest."""
    farthest = turned(prescription, Rings(np.inf))
    closest = turned(prescription, Rings(NEAREST_MM, SMALLEST_STOP))
    return Rings(farthest.focus_mm, farthest.f_number), Rings(closest.focus_mm, closest.f_number)


def is_stopped_down(prescription: Prescription, rings: Rings) -> bool:
    """Whether a lens is turned to an f-number beyond its widest: whether its iris is in the way of light."""
    if rings.f_number is None:
        return False
    _, far = _wide_open(prescription)
    return _f_number(prescription, far, rings.f_number)[0] > far.f_number * (1 + SLACK)


def capture_focal_length_mm(prescription: Prescription, rings: Rings = AT_REST) -> float:
    """What `Lens.capture_focal_length_mm` will be, without baking: the pinhole camera with this view."""
    there = system_of(turned(prescription, rings).prescription)
    if there.object_at_infinity:
        return there.efl_mm
    return abs(there.magnification) * (there.prescription.object_distance_mm + there.entrance_pupil_mm)


def resized_rings(prescription: Prescription, rings: Rings, focal_mm: float) -> Rings:
    """For a lens to be made as large as gives it a capture focal length: what to turn it to before that.

    Its focus distance grows with it; and how large it has to be follows a little from where it is focused.
    """
    there = rings
    if rings.focus_mm is None or np.isinf(rings.focus_mm):
        return rings
    for _ in range(SIZE_STEPS):
        size = focal_mm / capture_focal_length_mm(prescription, there)
        there = replace(rings, focus_mm=rings.focus_mm / size, size=size)
    return there


def _wide_open(prescription):
    """A prescription with its widest stop and its picture's end in mm, and its system focused far away."""
    standing = system_of(prescription)
    widest_stop = replace(prescription, aperture=("stop", standing.stop_semi_aperture_mm),
                          field=("image_height_mm", standing.last_height_mm))
    return widest_stop, system_of(replace(_moved(widest_stop, 0.0), object_distance_mm=np.inf))


def _f_number(prescription, far, asked):
    """What the f-stop ring is turned to, and words where that is not what was asked for."""
    last = max(far.f_number, prescription.highest_f_number)
    if asked is None:
        return far.f_number, ()
    if far.f_number * (1 - SLACK) <= asked <= last * (1 + SLACK):
        return float(np.clip(asked, far.f_number, last)), ()
    end = far.f_number if asked < far.f_number else last
    if last == far.f_number:
        return end, (f"f/{asked:.4g}: this lens has f/{end:.3g} alone",)
    return end, (f"f/{asked:.4g}: this lens goes from f/{far.f_number:.3g} to f/{last:.3g}: set to f/{end:.3g}",)


def _focused_on(lens, far, rings):
    """The lens with its gaps and its object at a distance, or as near to it as it goes; and words where it does not.

    Where things inside move, so does the entrance pupil, from which the distance is told.
    """
    farthest_mm, closest_mm = _range_mm(lens, far)
    pupil_mm = far.entrance_pupil_mm
    for _ in range(PUPIL_STEPS):
        distance_mm = float(np.clip(rings.focus_mm - pupil_mm, closest_mm, farthest_mm))
        there = replace(_moved(lens, _reduction(lens, distance_mm)), object_distance_mm=distance_mm)
        before_mm, pupil_mm = pupil_mm, system_of(there).entrance_pupil_mm
        if abs(pupil_mm - before_mm) <= PUPIL_SETTLED * far.efl_mm:
            break
    there = _with_image_plane(there, lens)
    reached_mm = distance_mm + pupil_mm
    if np.isclose(reached_mm, rings.focus_mm, rtol=SLACK):
        return there, ()
    limit = "closer" if reached_mm > rings.focus_mm else "farther"
    asked, reached = (in_metres(rings.size * each_mm) for each_mm in (rings.focus_mm, reached_mm))
    return there, (f"focus at {asked}: this lens focuses no {limit} than {reached}: focused there",)


def _with_image_plane(there, lens):
    """An image plane that is given keeps its distance from the paraxial image, its maker's choice; others are found."""
    if lens.focus != "as given":
        return there
    shift_mm = lens.surfaces[-1].thickness_mm - system_of(lens).image_distance_mm
    *before, last = there.surfaces
    return replace(there, surfaces=(*before, replace(last, thickness_mm=system_of(there).image_distance_mm + shift_mm)))


def _range_mm(lens, far):
    """The farthest and the closest object distance from the first surface."""
    if lens.focused_at_mm:
        return lens.focused_at_mm[0], max(lens.focused_at_mm[-1], lens.closest_focus_mm or 0.0)
    return np.inf, lens.closest_focus_mm or CLOSEST_FOCUS * far.efl_mm


def _reduction(lens, distance_mm):
    """The magnification, without its sign, for which the gaps of an object distance are those between its positions."""
    if not lens.focused_at_mm:
        return 0.0
    ends = _reductions(lens)

    def excess(reduction):
        there = replace(_moved(lens, reduction), object_distance_mm=distance_mm)
        return -system_of(there).magnification - reduction

    if excess(ends[0]) <= 0 or excess(ends[-1]) >= 0:  # at an end, but for rounding
        return ends[0] if excess(ends[0]) <= 0 else ends[-1]
    return brentq(excess, ends[0], ends[-1], xtol=1e-12)


@lru_cache(maxsize=8)  # each step of a search asks for them
def _reductions(lens):
    """The magnification, without its sign, at each of the positions for which gaps are given: ascending."""
    reductions = [-system_of(at_position(lens, number)).magnification for number in range(len(lens.focused_at_mm))]
    if not np.all(np.diff(reductions) > 0):
        raise LensError(lens.name, "focused_at_mm", lens.focused_at_mm,
                        "magnifications do not rise with them: one of the thicknesses may be wrong")
    return reductions


def at_position(lens: Prescription, number: int) -> Prescription:
    """The lens at one of the distances that it tells gaps for."""
    surfaces = tuple(replace(surface, thickness_mm=surface.gaps_mm[number]) if surface.gaps_mm else surface
                     for surface in lens.surfaces)
    return replace(lens, surfaces=surfaces, object_distance_mm=lens.focused_at_mm[number])


def _moved(lens, reduction):
    """The lens with its gaps as they are at a magnification."""
    if not lens.focused_at_mm:
        return lens
    ends = _reductions(lens)

    def surface_there(surface):
        if not surface.gaps_mm:
            return surface
        return replace(surface, thickness_mm=float(np.interp(reduction, ends, surface.gaps_mm)))

    return replace(lens, surfaces=tuple(map(surface_there, lens.surfaces)))


def _focus_mm(lens):
    return lens.object_distance_mm + system_of(lens).entrance_pupil_mm


def in_metres(distance_mm: float) -> str:
    """A focus distance as people say it."""
    return "infinity" if np.isinf(distance_mm) else f"{distance_mm * 1e-3:.3g} m"
