"""Whether a prescription is the lens that it says it is: figures that are lost or mistyped show in what its rays do."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..errors import LensError
from ..lens.checks import beyond_the_field
from ..lens.finding import SEVERITIES, LensFinding
from .focus import axial_contrast, build_system
from .heights import even_heights_mm
from .prescription import CLOSEST_FOCUS, Prescription
from .rays import HalfPupil, trace_pupil
from .rings import at_position
from .system import System, system_of

FOCAL_LENGTH_TOLERANCE = 0.01
LINES_PER_MM = 10.0  # of full frame: the coarsest for which makers tell contrast
LEAST_CONTRAST = 0.4  # measured: 0.47 for the softest fast lens of patents, 0.32 for the least harmed by a lost asphere
SOFT_FOCUS = "soft focus"  # of a lens's character: it is meant to be so
THIRD_OF_A_STOP = 2 ** (1 / 6)  # as a ratio of f-numbers
ROUNDING = 0.03  # of apertures, as patents round them
CHIEF_RAYS = 33
COVERED = 1e-3  # of the sensor's half diagonal
WANDERED = 1 / 150  # of the picture's diagonal: a disc that is seen; measured: up to 1 / 300 by what patents round
FAN, CHIEF = HalfPupil(65, 1), HalfPupil(1, 1)
COLOURS_NM = (430.0, 650.0)


def check_prescription(prescription: Prescription) -> list[LensFinding]:
    """What a prescription's rays tell against it, at each of its focus positions.

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
    try:
        system = build_system(next(_standing(prescription))[0])
        yield from _focal_length(prescription, system)
        yield from _own_pupil(prescription, system)
        yield from _sensor(system)
        yield from _wandering(prescription)
    except LensError as error:
        yield _told(error)
        return
    for standing, told in _standing(prescription):
        try:
            yield from _position(standing, told)
        except LensError as error:
            yield _told(error)


def _standing(prescription) -> Iterator[tuple[Prescription, bool]]:
    """The lens at each distance that it tells gaps for; else as it is told, and as close as it goes, which is not."""
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
        yield LensFinding("note", "focal_length_mm", "missing", "what the lens is called tells whether its figures are "
                          f"right: they make {system.efl_mm:.4g} mm")
    elif abs(system.efl_mm / nominal_mm - 1) > FOCAL_LENGTH_TOLERANCE:
        yield LensFinding("error", "focal_length_mm", f"{nominal_mm:g} mm, and the surfaces make "
                          f"{system.efl_mm:.4g} mm", "expected the same within 1 %: look for a figure that is mistyped "
                          "or scaled")


def _own_pupil(prescription, system):
    """Whether the surfaces let the light through that the aperture asks for."""
    rays = trace_pupil(system, [0.0], [system.prescription.reference_wavelength_nm], FAN)
    reach = np.sqrt(rays.square_height_mm2[:, 0, 0, :, 0]) / system.semi_apertures_mm[:, None]
    reach[:, rays.lost[0, 0, :, 0]] = np.inf
    widest = float(np.interp(1.0, np.maximum.accumulate(reach.max(axis=0)), FAN.radii))
    if widest < 1 - ROUNDING:
        narrow = int(np.argmax(reach[:, -1])) + 1
        kind, value = prescription.aperture
        yield LensFinding("error" if widest * THIRD_OF_A_STOP < 1 else "note", f"aperture, {kind}",
                          f"{value:g}, and {widest:.0%} of its width passes on the axis",
                          f"surface {narrow} is the narrowest: look at its radius and semi-aperture")


def _sensor(system):
    """Whether the picture reaches its corners, in the colour in which it is smallest."""
    if system.prescription.sensor_mm is None:
        return
    nm = sorted({*COLOURS_NM, system.prescription.reference_wavelength_nm})
    covered_mm = trace_pupil(system, [system.last_height_mm], nm, CHIEF).chief_height_mm.min()
    half_mm = max(system.prescription.sensor_mm) / 2
    if covered_mm < (1 - COVERED) * half_mm:
        yield LensFinding("error", "field", f"{covered_mm:.4g} mm high at its end, and the sensor's sides are at "
                          f"{half_mm:.4g} mm", "end the field later, or give a smaller sensor")
    else:
        yield from beyond_the_field(system.prescription.sensor_mm, covered_mm)


def _wandering(prescription):
    """Whether the image stays where it is when parts move for focusing: what is told of them then fits the distance."""
    shifts_mm = []
    for standing, _ in _standing(prescription) if prescription.focused_at_mm else ():
        system = build_system(standing)
        shifts_mm.append(system.prescription.surfaces[-1].thickness_mm - standing.surfaces[-1].thickness_mm)
        off_mm = shifts_mm[-1] - shifts_mm[0]
        if abs(2 * off_mm * system.marginal_slope) > WANDERED * 2 * system.last_height_mm:
            yield LensFinding("warning", "focused_at_mm", f"{standing.object_distance_mm:g} mm, from where the image "
                              f"lies {abs(off_mm):.3g} mm {'behind' if off_mm > 0 else 'before'} that of the first",
                              "look for a thickness or a distance that is mistyped: the image plane goes where it lies")


def _position(standing: Prescription, told: bool):
    """Sharpness on the axis, and chief rays up to the field's end, at one focus position."""
    system = build_system(standing)
    at = "at infinity" if system.object_at_infinity else f"at {standing.object_distance_mm:.4g} mm"
    contrast = axial_contrast(system, LINES_PER_MM)
    if contrast < LEAST_CONTRAST:
        remedy = ("soft focus, as its character says" if SOFT_FOCUS in standing.character else
                  "sharper farther away: how its parts move for focusing is not told" if not told else "")
        yield LensFinding("note" if remedy else "error", "surfaces", f"contrast {contrast:.2f} of {LINES_PER_MM:g} "
                          f"lines per mm of full frame on the axis, focused {at}",
                          remedy or f"expected {LEAST_CONTRAST:g} or more: look for an aspheric term, a gap or a glass "
                          "that is lost")
    yield from _chief_rays(system, at)


def _chief_rays(system: System, at: str):
    heights_mm = even_heights_mm(system, CHIEF_RAYS)
    rays = trace_pupil(system, heights_mm, [system.prescription.reference_wavelength_nm], CHIEF)
    reach = np.sqrt(rays.square_height_mm2[:, 0, :, 0, 0]) / system.semi_apertures_mm[:, None]
    clipped = np.argwhere(reach > 1)
    if clipped.size:
        surface, height = min(clipped, key=lambda at: at[1])
        yield LensFinding("error", f"surface {surface + 1}, semi_aperture_mm",
                          f"{system.semi_apertures_mm[surface]:g}, and stops chief rays from an image height of "
                          f"{rays.chief_height_mm[0, height]:.4g} mm on, focused {at}",
                          "look at its radius and semi-aperture, or end the field there")


def _told(error):
    """An error of tracing as a finding."""
    return LensFinding("error", error.field, str(error.value), error.remedy)
