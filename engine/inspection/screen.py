"""Checks of a prescription by its rays, to detect missing or mistyped figures."""

import re
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np

from ..prescription.prescription import CLOSEST_FOCUS, Prescription
from ..prescription.system import System, system_of
from ..rays.focus import FULL_FRAME_MM, axial_contrast, build_system
from ..rays.rays import FullPupil, trace_pupil
from ..rays.rings import at_position, widest_f_number, widest_notes
from ..runtime.errors import LensError
from .field_lines import CHIEF, chief_ray_lines, light_lines, spot_contrast
from .finding import SEVERITIES, LensFinding
from .radial_checks import beyond_the_field

FOCAL_LENGTH_TOLERANCE = 0.01
NAME_TOLERANCE = 0.02  # of the engraved focal length and f-number, which are rounded
FIGURES = re.compile(r"(?<![-\d.])(\d+(?:\.\d+)?) mm(?:.*? f/(\d+(?:\.\d+)?))?")  # in a title
LINES_PER_MM = 10.0  # of full frame: the coarsest frequency for which makers state contrast
LEAST_CONTRAST = 0.4  # measured: 0.47 for the softest fast patent lens, 0.32 for the mildest loss of an asphere
SOFT_FOCUS = "soft focus"  # in a lens's character: intentional softness
THIRD_OF_A_STOP = 2 ** (1 / 6)  # as a ratio of f-numbers
ROUNDING = 0.03  # of apertures in patents
CHIEF_RAYS = 33
COVERED = 1e-3  # of the sensor's half diagonal
WANDERED = 1 / 150  # of the picture's diagonal: a visible disc; measured: up to 1 / 300 from rounding in patents
STEEPEST = 0.2  # fall of the passing share of the stop from one of LIGHT_PLACES to the next; measured: up to 0.124
ROUGHEST = 0.01  # rise of the same; measured: up to 0.002
DARKEST = 0.03  # the same at the field's end; measured: 0.051 or more
LEAST_CLOSE_UP = 0.5  # the same on the axis, at any focus; measured: 0.69 or more
LIGHT_PLACES = 25
FAN, CROSS = FullPupil(65, 1), FullPupil(65, 4)
COLOURS_NM = (430.0, 650.0)


def check_prescription(prescription: Prescription) -> list[LensFinding]:
    """Find errors in a prescription by tracing rays at each of its focus positions.

    Parameters
    ----------
    prescription : Prescription

    Returns
    -------
    list of LensFinding, errors first
    """
    findings = list(_findings(prescription))
    return sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity))


def _findings(prescription):
    built = lru_cache(None)(build_system)  # several checks need the same focus, whose search is the longest part
    try:
        system = built(next(_focus_positions(prescription))[0])
        yield from _focal_length(prescription, system)
        yield from _name(prescription, system)
        yield from _aperture(prescription, system)
        yield from _mirrors(prescription)
        yield from _sensor(system)
        yield from _wandering(prescription, built)
        yield from _wide_open_light(prescription)
    except LensError as error:
        yield _tracing_finding(error)
        return
    for focused, stated in _focus_positions(prescription):
        try:
            yield from _position(built(focused), stated)
        except LensError as error:
            yield _tracing_finding(error)


def _focus_positions(prescription) -> Iterator[tuple[Prescription, bool]]:
    """The lens at each focus position, and whether the prescription states its gaps.

    A prescription without gaps for focusing yields its only stated position, and the closest focus, which is not
    stated.
    """
    for number in range(len(prescription.focused_at_mm)):
        yield at_position(prescription, number), True
    if not prescription.focused_at_mm:
        yield prescription, True
        if np.isinf(prescription.object_distance_mm):
            closest_mm = prescription.closest_focus_mm or CLOSEST_FOCUS * system_of(prescription).efl_mm
            yield replace(prescription, object_distance_mm=closest_mm,
                          focus="best" if prescription.focus == "as given" else prescription.focus), False


def _focal_length(prescription, system):
    nominal_mm = prescription.focal_length_mm
    if nominal_mm is None:
        yield LensFinding("note", "focal_length_mm", "missing", "give the nominal focal length to check the surfaces: "
                          f"they give {system.efl_mm:.4g} mm")
    elif abs(system.efl_mm / nominal_mm - 1) > FOCAL_LENGTH_TOLERANCE:
        yield LensFinding("error", "focal_length_mm", f"{nominal_mm:g} mm, and the surfaces give "
                          f"{system.efl_mm:.4g} mm", "expected the same within 1 %: look for a mistyped or scaled "
                          "figure")


def _name(prescription, system):
    """Whether the surfaces have the focal length and the f-number in the title, or the notes state the difference."""
    named = FIGURES.search(prescription.title)
    if not named:
        return
    traced = (("{} mm", system.efl_mm), ("f/{}", widest_f_number(prescription)))
    for figure, (form, value) in zip(named.groups(), traced, strict=True):
        engraved = form.format(figure)
        if figure and abs(value / float(figure) - 1) > NAME_TOLERANCE and engraved not in prescription.notes:
            yield LensFinding("warning", "title", f"{engraved}, and the surfaces give {form.format(f'{value:.3g}')}",
                              f'correct it, or state in the notes: "Engraved {engraved}; the design has ..."')


def _aperture(prescription, system):
    """Whether the surfaces transmit the bundle that the aperture specifies."""
    pupil = FAN if prescription.radial else CROSS
    rays = trace_pupil(system, [0.0], [system.prescription.reference_wavelength_nm], pupil)
    reach = np.sqrt(system.rims(rays.square_height_mm2[:, 0, 0]))
    reach = np.where(rays.lost[0, 0], np.inf, reach).max(axis=-1)
    widest = float(np.interp(1.0, np.maximum.accumulate(reach.max(axis=0)), FAN.radii))
    if widest < 1 - ROUNDING:
        narrow = system.rim_surfaces[np.argmax(reach[:, -1])] + 1
        kind, value = prescription.aperture
        yield LensFinding("error" if widest * THIRD_OF_A_STOP < 1 else "note", f"aperture, {kind}",
                          f"{value:g}, and {widest:.0%} of its width passes on the axis",
                          f"surface {narrow} is the narrowest: check its radius and aperture")


def _mirrors(prescription):
    """Whether mirrors block light on its way to others."""
    if prescription.mirrors and not any(surface.semi_obstruction_mm for surface in prescription.surfaces):
        yield LensFinding("note", "semi_obstruction_mm", "0 at all surfaces of a mirror lens",
                          "the mirrors block no light, and blurred points have no hole: give the obstructions, if you "
                          "know them")


def _wide_open_light(prescription):
    """Whether the stop and the light on the axis agree with the f-number."""
    for note in widest_notes(prescription):
        yield LensFinding("note", "aperture", note.rstrip("."),
                          "pictures follow the traced rays: give the size of the stop as the aperture, if you know it")


def _sensor(system):
    """Whether the image circle covers the sensor, in the colour in which it is smallest."""
    if system.prescription.sensor_mm is None:
        return
    nm = sorted({*COLOURS_NM, system.prescription.reference_wavelength_nm})
    covered_mm = trace_pupil(system, [system.last_height_mm], nm, CHIEF).chief_height_mm.min()
    half_mm = max(system.prescription.sensor_mm) / 2
    if covered_mm < (1 - COVERED) * half_mm:
        yield LensFinding("error", "field", f"{covered_mm:.4g} mm high at its end, less than the {half_mm:.4g} mm to "
                          "the sensor's edge", "end the field later, or give a smaller sensor")
    else:
        yield from beyond_the_field(system.prescription.sensor_mm, covered_mm)


def _wandering(prescription, built):
    """Whether focusing leaves the image in place: the stated gaps then agree with the distance."""
    shifts_mm = []
    for focused, _ in _focus_positions(prescription) if prescription.focused_at_mm else ():
        system = built(focused)
        shifts_mm.append(system.prescription.surfaces[-1].thickness_mm - focused.surfaces[-1].thickness_mm)
        off_mm = shifts_mm[-1] - shifts_mm[0]
        if abs(2 * off_mm * system.marginal_slope) > WANDERED * 2 * system.last_height_mm:
            yield LensFinding("warning", "focused_at_mm", f"{focused.object_distance_mm:g} mm, whose image is "
                              f"{abs(off_mm):.3g} mm {'behind' if off_mm > 0 else 'before'} the first position's",
                              "look for a mistyped thickness or distance: the image plane follows the image")


def _position(system: System, stated: bool):
    """Sharpness on the axis, and chief rays up to the field's end, at one focus position."""
    focused = system.prescription
    at = "at infinity" if system.object_at_infinity else f"at {focused.object_distance_mm:.4g} mm"
    contrast = _contrast(system)
    if contrast < LEAST_CONTRAST:
        remedy = ("soft focus, as stated in its character" if SOFT_FOCUS in focused.character else
                  "sharper farther away: the file does not state how its parts move for focusing" if not stated else "")
        yield LensFinding("note" if remedy else "error", "surfaces", f"contrast {contrast:.2f} at {LINES_PER_MM:g} "
                          f"lines per mm (at full-frame size) on the axis, focused {at}",
                          remedy or f"expected {LEAST_CONTRAST:g} or more: look for a missing aspheric term, gap or "
                          "glass")
    yield from list(_chief_rays(system, at)) or _light(system, at)


def _contrast(system):
    """Contrast on the axis, of LINES_PER_MM on full frame."""
    if system.prescription.radial:
        return axial_contrast(system, LINES_PER_MM)
    sensor_mm = system.prescription.sensor_mm
    diagonal_mm = np.hypot(*sensor_mm) if sensor_mm else 2 * system.last_height_mm
    return spot_contrast(system, LINES_PER_MM * FULL_FRAME_MM / diagonal_mm)


def _chief_rays(system: System, at: str):
    for line in chief_ray_lines(system, CHIEF_RAYS):
        clipped = np.argwhere(line.values > 1)
        if clipped.size:
            limit, place = min(clipped, key=lambda at: at[1])
            surface, size_mm = system.rim_surfaces[limit], np.append(system.semi_apertures_mm, system.half_widths_mm)
            field = "semi_aperture_mm" if limit < len(system.glasses) else "half_widths_mm"
            yield LensFinding("error", f"surface {surface + 1}, {field}",
                              f"{size_mm[limit]:g}, and blocks chief rays from {line.kind}"
                              f"{line.places[place]}, focused {at}",
                              "check its radius and aperture, or end the field there")
            return


def _light(system: System, at: str):
    """Whether light falls smoothly towards the corners, without a jump or notch from a mistyped aperture."""
    for line in light_lines(system, LIGHT_PLACES):
        yield from (findings := list(_light_along(line, at)))
        if findings:
            return


def _light_along(line, at):
    passing = line.values
    steps = np.diff(passing)
    if passing[0] < LEAST_CLOSE_UP:
        yield LensFinding("error", "semi_aperture_mm", f"{passing[0]:.0%} of the stop has light on the axis, focused "
                          f"{at}", "look for a mistyped aperture or gap")
    for suspect, number in ((steps.min() < -STEEPEST, steps.argmin()), (steps.max() > ROUGHEST, steps.argmax()),
                            (passing[-1] < DARKEST, -2)):
        if suspect:
            yield LensFinding("warning", "semi_aperture_mm", f"{passing[number]:.0%} of the stop has light at "
                              f"{line.kind}{line.places[number]}, and {passing[number + 1]:.0%} at "
                              f"{line.places[number + 1]}, focused {at}",
                              "expected a smooth fall towards the corners: look for a mistyped aperture")
            return


def _tracing_finding(error):
    """An error of tracing as a finding."""
    return LensFinding("error", error.field, str(error.value), error.remedy)
