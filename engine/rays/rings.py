"""The focus ring and the aperture ring: a lens set to a focus distance and an f-number."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy

from ..prescription.coatings import BUILT_IN
from ..prescription.prescription import CLOSEST_FOCUS, Prescription
from ..prescription.system import system_of
from ..prescription.tolerances import Copy, as_built
from ..runtime.errors import LensError
from .axial_light import aperture_notes
from .focus import focused
from .view import tilted

SLACK = 1e-4  # relative tolerance of ring values: smaller differences are rounding
PUPIL_STEPS, PUPIL_SETTLED = 20, 1e-9  # iterations for the entrance pupil of an internal-focus lens; per focal length

MOST = 1e300  # limit of every number except a distance
NEAREST_MM, SMALLEST_STOP = 1e-3, 1e9  # a focus distance and an f-number beyond the range of any lens
MOST_LENSES = 8  # in the caches
MOST_TILT_DEG = 45.0
SIZE_STEPS = 4  # iterations until a scaled lens has the requested focus distance


@dataclass(frozen=True)
class Rings:
    """Requested ring settings.

    Attributes
    ----------
    focus_mm : float or None
        Focus distance from the entrance pupil, which is at the position of the camera; None for the prescription's
        object distance, usually infinity.
    f_number : float or None
        Focal length over the entrance pupil's diameter, both for infinity, as engraved; None for the widest.
    focused_wide_open : bool
        Whether the image plane is at the best focus of the widest aperture, as if focused before stopping down;
        otherwise at the best focus of the f-number.
    size : float
        Scale that is applied to the lens afterwards. Distances in messages are scaled, too.
    tilt_deg : (float, float)
        Turns of the sensor about x and about y. A positive turn about x tilts the lens down relative to the sensor: the
        lower part of the picture is in focus nearer. One about y tilts it to the right. The camera's axis is the
        sensor's normal, so the view does not change, and its middle remains in focus.
    copy : Copy or None
        A copy with displaced elements; None for the design.
    coating : str or None
        One of the built-in coatings, which replaces the coatings of the lens; None keeps them.

    Raises
    ------
    LensError
        A value that is not positive, an infinite f-number or size, a tilt of more than MOST_TILT_DEG, or an unknown
        coating.

    Examples
    --------
    >>> from lensfield import Rings, load_lens
    >>> rings = Rings(focus_mm=1200, f_number=8)
    >>> lens = load_lens("tessar-50mm", rings, quality="preview", wavelengths_nm=[550])
    >>> f"f/{lens.f_number_effective:.2f}"  # slower than f/8, because the lens is focused at 1.2 m
    'f/8.35'
    """

    focus_mm: float | None = None
    f_number: float | None = None
    focused_wide_open: bool = False
    size: float = 1.0
    tilt_deg: tuple[float, float] = (0.0, 0.0)
    copy: Copy | None = None
    coating: str | None = None

    def __post_init__(self) -> None:
        for name, most in (("focus_mm", np.inf), ("f_number", MOST), ("size", MOST)):
            value = getattr(self, name)
            if value is not None and not 0 < value <= most:
                raise LensError("rings", name, value, "expected a positive number")
        if self.coating is not None and self.coating not in BUILT_IN:
            raise LensError("rings", "coating", self.coating, f"expected one of {', '.join(BUILT_IN)}")
        if np.shape(self.tilt_deg) != (2,) or not np.all(np.abs(self.tilt_deg) <= MOST_TILT_DEG):
            raise LensError("rings", "tilt_deg", self.tilt_deg,
                            f"expected two angles of at most {MOST_TILT_DEG:g} degrees")


AT_REST = Rings()


@dataclass(frozen=True)
class TurnedLens:
    """A lens at ring settings within its range.

    Attributes
    ----------
    prescription : Prescription
        Without moving parts: image plane, stop and image height are fixed in mm.
    focus_mm, f_number : float
        The actual settings, defined as in `Rings`.
    words : tuple of str
        A warning for each request that the lens cannot meet.
    """

    prescription: Prescription
    focus_mm: float
    f_number: float
    words: tuple[str, ...]


@lru_cache(maxsize=MOST_LENSES)
def turned(prescription: Prescription, rings: Rings = AT_REST) -> TurnedLens:
    """Set a prescription to a focus distance and an f-number, clamped to the lens's range.

    The stop's size is computed for infinity and does not change with focus. Variable gaps of the prescription are
    interpolated linearly over the magnification, between the positions for which they are given. Without variable
    gaps, the lens moves as a unit. Displaced parts do not change the image plane: it is as for the centred lens.

    Raises
    ------
    LensError
        The lens forms no image of an object at this distance.
    """
    design = prescription.centred()
    widest_stop, far = _wide_open(design)
    f_number, stop_warnings = _f_number(design, far, rings.f_number)
    stop = "stop", widest_stop.aperture[1] * (far.f_number / f_number)  # exactly the widest stop at its f-number
    lens, focus_warnings = widest_stop, ()
    if rings.focus_mm is not None:
        lens, focus_warnings = _focused_on(widest_stop, far, rings)
    if rings.focused_wide_open:
        lens = replace(focused(lens), aperture=stop)
    else:
        lens = focused(replace(lens, aperture=stop))
    surfaces = tuple(replace(surface, gaps_mm=(), pose=given.pose)
                     for surface, given in zip(lens.surfaces, prescription.surfaces, strict=True))
    lens = replace(lens, surfaces=surfaces, image_pose=prescription.image_pose, focused_at_mm=(),
                   widest_stop_mm=widest_stop.aperture[1],
                   notes=_noted(prescription.notes, aperture_notes(far.prescription)))
    lens = _tilted(lens, rings.tilt_deg) if any(rings.tilt_deg) else lens
    lens = as_built(lens, rings.copy) if rings.copy else lens
    lens = lens.coated(rings.coating) if rings.coating else lens
    return TurnedLens(lens, _focus_mm(lens), f_number, stop_warnings + focus_warnings)


def _tilted(lens, tilt_deg):
    if lens.image_pose:
        raise LensError(lens.name, "image_pose", lens.image_pose.tilt_deg,
                        "the file tilts or displaces the sensor: set the tilt to 0, or remove it from the file")
    return tilted(system_of(lens), tilt_deg)


def widest_f_number(prescription: Prescription) -> float:
    """The lowest f-number of a prescription's ring, to first order."""
    return _wide_open(prescription)[1].f_number


def widest_notes(prescription: Prescription) -> tuple[str, ...]:
    """`aperture_notes` of a prescription as it is in its file."""
    return aperture_notes(_wide_open(prescription)[1].prescription)


def _noted(notes, more):
    """Notes, with the sentences appended that they do not contain yet."""
    return " ".join(filter(None, (notes, *(line for line in more if line not in notes))))


def ring_ends(prescription: Prescription) -> tuple[Rings, Rings]:
    """Limits of the rings: farthest focus and widest aperture, closest focus and highest f-number."""
    farthest = turned(prescription, Rings(np.inf))
    closest = turned(prescription, Rings(NEAREST_MM, SMALLEST_STOP))
    return Rings(farthest.focus_mm, farthest.f_number), Rings(closest.focus_mm, closest.f_number)


def is_stopped_down(prescription: Prescription, rings: Rings) -> bool:
    """Whether the f-number is higher than the lens's lowest, so that its iris blocks light."""
    if rings.f_number is None:
        return False
    _, far = _wide_open(prescription)
    return _f_number(prescription, far, rings.f_number)[0] > far.f_number * (1 + SLACK)


def capture_focal_length_mm(prescription: Prescription, rings: Rings = AT_REST) -> float:
    """`Lens.capture_focal_length_mm` without baking: focal length of the pinhole camera with this view.

    It depends neither on the f-number nor on the image plane, so the sharpest one is not searched for.
    """
    widest_stop, far = _wide_open(prescription)
    lens = widest_stop if rings.focus_mm is None else _focused_on(widest_stop, far, rings)[0]
    return system_of(lens).capture_focal_length_mm


@lru_cache(maxsize=MOST_LENSES)
def resized_rings(prescription: Prescription, rings: Rings, focal_mm: float) -> Rings:
    """Settings of a lens that is scaled to a capture focal length, with `size` and with the focus before scaling.

    Iterative: the focus distance scales with the lens, and the size depends slightly on the focus.
    """
    resized = rings
    if rings.focus_mm is None or np.isinf(rings.focus_mm):
        return rings
    for _ in range(SIZE_STEPS):
        size = focal_mm / capture_focal_length_mm(prescription, resized)
        resized = replace(rings, focus_mm=rings.focus_mm / size, size=size)
    return resized


@lru_cache(maxsize=MOST_LENSES)
def _wide_open(prescription):
    """The prescription with its widest stop and its image height in mm, and its system focused at infinity."""
    system = system_of(prescription)
    widest_stop = replace(prescription, aperture=("stop", system.stop_semi_aperture_mm),
                          field=("image_height_mm", system.last_height_mm))
    return widest_stop, system_of(replace(_moved(widest_stop, 0.0), object_distance_mm=np.inf))


def _f_number(prescription, far, requested):
    """The f-number within the lens's range, and a warning if it is not the requested one. Around a central obstruction,
    there is no iris: it would soon block all light."""
    last = far.f_number if far.central_obstruction else max(far.f_number, prescription.highest_f_number)
    if requested is None:
        return far.f_number, ()
    if far.f_number * (1 - SLACK) <= requested <= last * (1 + SLACK):
        return float(np.clip(requested, far.f_number, last)), ()
    end = far.f_number if requested < far.f_number else last
    if last == far.f_number:
        return end, (f"f/{requested:.4g}: this lens has only f/{end:.3g}",)
    limit = "wider than this lens opens" if requested < far.f_number else "narrower than this lens closes"
    return end, (f"f/{requested:.4g} is {limit}: set to f/{end:.3g}",)


def _focused_on(lens, far, rings):
    """The lens focused at a distance within its range, and a warning if that is not the requested one.

    Iterative, because distances are measured from the entrance pupil, which moves in an internal-focus lens.
    """
    farthest_mm, closest_mm = _range_mm(lens, far)
    pupil_mm = far.entrance_pupil_mm
    for _ in range(PUPIL_STEPS):
        distance_mm = float(np.clip(rings.focus_mm - pupil_mm, closest_mm, farthest_mm))
        moved = replace(_moved(lens, _reduction(lens, distance_mm)), object_distance_mm=distance_mm)
        before_mm, pupil_mm = pupil_mm, system_of(moved).entrance_pupil_mm
        if abs(pupil_mm - before_mm) <= PUPIL_SETTLED * far.efl_mm:
            break
    moved = _with_image_plane(moved, lens)
    reached_mm = distance_mm + pupil_mm
    if np.isclose(reached_mm, rings.focus_mm, rtol=SLACK):
        return moved, ()
    limit = "closer" if reached_mm > rings.focus_mm else "farther"
    requested, reached = (in_metres(rings.size * each_mm) for each_mm in (rings.focus_mm, reached_mm))
    return moved, (f"focus at {requested}: this lens focuses no {limit} than {reached}: set to that",)


def _with_image_plane(moved, lens):
    """Keep the distance of a given image plane from the paraxial image, the designer's choice; others are computed."""
    if lens.focus != "as given":
        return moved
    shift_mm = lens.surfaces[-1].thickness_mm - system_of(lens).paraxial_focus_mm
    *before, last = moved.surfaces
    return replace(moved, surfaces=(*before, replace(last, thickness_mm=system_of(moved).paraxial_focus_mm + shift_mm)))


def _range_mm(lens, far):
    """The farthest and the closest object distance from the first surface."""
    if lens.focused_at_mm:
        return lens.focused_at_mm[0], max(lens.focused_at_mm[-1], lens.closest_focus_mm or 0.0)
    return np.inf, lens.closest_focus_mm or CLOSEST_FOCUS * far.efl_mm


def _reduction(lens, distance_mm):
    """Absolute magnification of an object distance: with the gaps interpolated for it, the lens has it."""
    if not lens.focused_at_mm:
        return 0.0
    ends = _reductions(lens)

    def excess(reduction):
        """By Newton's equation: positive even if the lens with these gaps forms no real image so close."""
        moved = system_of(_moved(lens, reduction))
        return moved.efl_mm / distance_mm - reduction * (1 - moved.front_focus_mm / distance_mm)

    if excess(ends[0]) <= 0 or excess(ends[-1]) >= 0:  # at an end, except for rounding
        return ends[0] if excess(ends[0]) <= 0 else ends[-1]
    return scipy.optimize.brentq(excess, ends[0], ends[-1], xtol=1e-12)


@lru_cache(maxsize=8)  # used in each step of a search
def _reductions(lens):
    """Absolute magnifications at the positions for which gaps are given: ascending."""
    reductions = [-system_of(at_position(lens, number)).magnification for number in range(len(lens.focused_at_mm))]
    if not np.all(np.diff(reductions) > 0):
        raise LensError(lens.name, "focused_at_mm", lens.focused_at_mm,
                        "expected magnifications that rise in this order: one of the thicknesses may be wrong")
    return reductions


def at_position(lens: Prescription, number: int) -> Prescription:
    """The lens at one of the distances for which its gaps are given."""
    surfaces = tuple(replace(surface, thickness_mm=surface.gaps_mm[number]) if surface.gaps_mm else surface
                     for surface in lens.surfaces)
    return replace(lens, surfaces=surfaces, object_distance_mm=lens.focused_at_mm[number])


def _moved(lens, reduction):
    """The lens with its gaps interpolated at a magnification."""
    if not lens.focused_at_mm:
        return lens
    ends = _reductions(lens)

    def interpolated(surface):
        if not surface.gaps_mm:
            return surface
        return replace(surface, thickness_mm=float(np.interp(reduction, ends, surface.gaps_mm)))

    return replace(lens, surfaces=tuple(map(interpolated, lens.surfaces)))


def _focus_mm(lens):
    return lens.object_distance_mm + system_of(lens).entrance_pupil_mm


def in_metres(distance_mm: float) -> str:
    """Text of a focus distance, in metres."""
    return "infinity" if np.isinf(distance_mm) else f"{distance_mm * 1e-3:.3g} m"
