"""Position of the image plane: as given, at the paraxial focus, sharpest on the axis, or best over the field."""

from dataclasses import replace

import numpy as np

from ..prescription.prescription import Prescription
from ..prescription.system import System, system_of
from ..runtime.errors import LensError
from .axial_image import eye_response_at, trace_axial_bundles, white_mtf
from .fields import find_fields, trace_fields, view_of
from .rays import FullPupil, HalfPupil, TracedRays, trace_pupil

WHITE_NM = tuple(range(450, 651, 25))  # the eye is much less sensitive beyond
LINES_PER_MM, FULL_FRAME_MM = (20.0, 30.0), np.hypot(36.0, 24.0)  # frequencies to focus on, at this sensor diagonal
FINEST = 0.5  # highest frequency, relative to the diffraction cutoff
STEP = 0.1  # relative to the depth over which contrast changes, 1 / (frequency * numerical aperture)
MARGIN = 5  # steps beyond the points at which rays cross the axis
MOST_STEPS = 2000
ZOOMS, ZOOM = 3, np.linspace(-1, 1, 21)
FIELDS = (0.0, 0.35, 0.5, 0.7)  # relative to the last field: heights that "field" focuses on
FIELD_NM = (486.1, 546.1, 656.3)
PUPIL, COMPLETE_PUPIL = HalfPupil(13, 17), FullPupil(13, 32)
LEAST_PASSING = 0.5  # relative to the aperture's diameter: patents round their apertures
FARTHEST_PUPIL = 1e3  # behind the first surface, in focal lengths
HOPELESS = 0.25  # blur disc relative to the last height: larger ones leave no picture


def build_system(prescription: Prescription) -> System:
    """System of a prescription, focused as the prescription specifies and ready to trace.

    Raises
    ------
    LensError
        A glass that is not in any catalogue, a system without power, or an impossible aperture, object distance or
        focus. Raised before a ray is traced.
    """
    system = system_of(prescription)
    _check_aperture(system, *prescription.aperture)
    _check_object(system)
    if prescription.focus == "as given":
        _check_focus(system)
        return system
    system = _focused_at(system, system.paraxial_focus_mm)
    if prescription.focus == "paraxial":
        return system
    if prescription.radial:
        shift_mm = _sharpest_shift_mm(system) if prescription.focus == "best" else _field_shift_mm(system)
    else:
        shift_mm = _middle_shift_mm(system) if prescription.focus == "best" else _grid_shift_mm(system)
    return _focused_at(system, system.paraxial_focus_mm + shift_mm)


def focused(prescription: Prescription) -> Prescription:
    """The lens with its image plane, stop and image height fixed in mm, so that they stay at other object distances."""
    system = build_system(prescription)
    return replace(system.prescription, field=("image_height_mm", system.last_height_mm))


def axial_contrast(system: System, lines_per_mm: float) -> float:
    """Contrast of lines on the axis in white light, including diffraction.

    Parameters
    ----------
    system : System
    lines_per_mm : float
        On full frame; on other sensors scaled by the diagonal. At most half of the diffraction cutoff.
    """
    bundles = trace_axial_bundles(system, _known_nm(system, WHITE_NM))
    fineness, = _fineness(system, bundles, [lines_per_mm])
    return float(white_mtf(bundles, fineness, [0.0])[0])


def _check_aperture(system, kind, value):
    """Check that the surfaces pass the aperture's paraxial marginal ray, with some tolerance, and that its light is not
    all obstructed."""
    if system.central_obstruction >= 1:
        raise LensError(system.prescription.name, f"aperture, {kind}", value, "its light is as wide as a central "
                        "obstruction: open the aperture")
    heights_mm = np.maximum(np.abs(system.marginal_heights_mm), np.abs(system.across.marginal_heights_mm))
    passing = np.min(system.semi_apertures_mm / np.maximum(heights_mm, 1e-12))
    if passing < LEAST_PASSING:
        most = value / passing if kind.endswith("f_number") else value * passing
        raise LensError(system.prescription.name, f"aperture, {kind}", value,
                        f"the clear apertures of the surfaces pass {most:.3g} at most")


def _check_object(system):
    """Check that the lens forms a real image of its object, and sees it in perspective: the camera is at its entrance
    pupil."""
    for section in (system, system.across):
        if section.magnification > 0 or not np.isfinite(section.magnification):
            raise LensError(system.prescription.name, "object_distance_mm", system.prescription.object_distance_mm,
                            "the lens forms no real image of this object: expected more than "
                            f"{section.front_focus_mm:.4g} mm, its front focal point")
        object_mm, pupil_mm = system.prescription.object_distance_mm, section.entrance_pupil_mm
        if np.isfinite(object_mm) and not -object_mm < pupil_mm < FARTHEST_PUPIL * section.efl_mm:
            raise LensError(system.prescription.name, "entrance pupil", f"{pupil_mm:.4g} mm behind the first surface",
                            "the lens is telecentric towards its object, and pictures are rendered from the entrance "
                            "pupil: move the stop")


def _check_focus(system):
    """Check that the image plane is close enough to the paraxial image."""
    shift_mm = system.paraxial_focus_mm - system.prescription.surfaces[-1].thickness_mm
    blur_mm = 2 * abs(shift_mm * system.marginal_slope)
    if blur_mm > HOPELESS * system.last_height_mm:
        where = "focus" if system.object_at_infinity else "object_distance_mm"
        raise LensError(system.prescription.name, where, getattr(system.prescription, where),
                        f"the image is {abs(shift_mm):.3g} mm {'behind' if shift_mm > 0 else 'in front of'} the image "
                        f"plane, and a point becomes a disc of {blur_mm:.3g} mm: refocus, or move farther away")


def _focused_at(system, distance_mm):
    """The system with its image plane at a distance behind the last surface, and with the same field."""
    *before, last = system.prescription.surfaces
    prescription = replace(system.prescription, surfaces=(*before, replace(last, thickness_mm=distance_mm)),
                           focus="as given")
    return system_of(prescription)


def _sharpest_shift_mm(system):
    """Shift of the image plane to the highest mean contrast of fine lines on the axis, in white light."""
    bundles = trace_axial_bundles(system, _known_nm(system, WHITE_NM))
    lines_per_mm = _fineness(system, bundles, LINES_PER_MM)
    shifts_mm = _scan_mm(bundles, STEP / (lines_per_mm.max() * max(bundle.aperture for bundle in bundles)))
    for _ in range(ZOOMS):
        contrast = sum(white_mtf(bundles, each, shifts_mm) for each in lines_per_mm)
        best_mm, step_mm = shifts_mm[np.argmax(contrast)], shifts_mm[1] - shifts_mm[0]
        shifts_mm = best_mm + step_mm * ZOOM
    return best_mm


def _fineness(system, bundles, lines_per_mm):
    """Full-frame lines per mm scaled to this sensor, and limited relative to the diffraction cutoff."""
    cutoff_lp_mm = min(bundle.cutoff_lp_mm for bundle in bundles)
    return np.minimum(np.array(lines_per_mm) * FULL_FRAME_MM / _diagonal_mm(system), FINEST * cutoff_lp_mm)


def _scan_mm(bundles, step_mm):
    """Image planes from the first to the last axis crossing of a ray, plus a margin."""
    crossings_mm = np.concatenate([bundle.crossings_mm for bundle in bundles])
    first, last = crossings_mm.min() - MARGIN * step_mm, crossings_mm.max() + MARGIN * step_mm
    return np.linspace(first, last, min(int(np.ceil((last - first) / step_mm)), MOST_STEPS) + 1)


def _diagonal_mm(system):
    """Diagonal of the sensor or, without one, diameter of the image."""
    if system.prescription.sensor_mm:
        return np.hypot(*system.prescription.sensor_mm)
    rays = trace_pupil(system, [system.last_height_mm], [system.prescription.reference_wavelength_nm], HalfPupil(1, 1))
    return 2 * abs(rays.chief_height_mm[0, 0])


def _known_nm(system, wavelengths_nm):
    """Wavelengths at which the index of every glass is known, or the reference wavelength if none is."""
    nm = np.array(wavelengths_nm)
    known = ~np.any([np.isnan(glass.index_at(nm)) for glass in system.glasses], axis=0)
    return nm[known] if known.any() else np.array([system.prescription.reference_wavelength_nm])


def _field_shift_mm(system):
    """Shift of the image plane to the least mean square spot over the inner field."""
    heights_mm = np.array(FIELDS) * system.last_height_mm
    rays = trace_pupil(system, heights_mm, _known_nm(system, FIELD_NM), PUPIL)
    return _least_spot_shift_mm(system, rays, heights_mm)


def _grid_shift_mm(system):
    """As `_field_shift_mm`, without rotational symmetry: in the middle, and on both sides of it along x and y."""
    heights_mm = np.array(FIELDS[1:]) * system.last_height_mm
    sides = np.array([[1, -1, 0, 0], [0, 0, 1, -1]])
    places_mm = np.concatenate([np.zeros((2, 1)), np.multiply.outer(sides, heights_mm).reshape(2, -1)], axis=1)
    return _spot_shift_mm(system, places_mm, _known_nm(system, FIELD_NM))


def _middle_shift_mm(system):
    """Shift of the image plane to the least mean square spot in the middle of the picture, in white light."""
    nm = _known_nm(system, WHITE_NM)
    return _spot_shift_mm(system, np.zeros((2, 1)), nm, eye_response_at(nm)[:, None, None, None])


def _spot_shift_mm(system, places_mm, wavelengths_nm, weights=1.0):
    """Shift of the image plane along the axis of the lens to the least mean square spot at places on the sensor."""
    view = view_of(system)
    rays = trace_fields(system, view, find_fields(system, view, places_mm, wavelengths_nm), COMPLETE_PUPIL)
    return _least_spot_shift_mm(system, rays, np.hypot(*places_mm), weights) / view.axes[2, 2]


def _least_spot_shift_mm(system, rays: TracedRays, heights_mm, weights=1.0):
    """Shift along the normal of the image plane to the least mean square spot, over all fields and wavelengths.

    A shift of dz moves a ray sideways by dz times its slope, so the mean square is a parabola in dz.
    """
    inside = np.all(system.limits(rays.square_height_mm2) <= 1, axis=0)
    light = rays.pupil.radii[:, None] * (inside & ~rays.lost)  # proportional to the radius of a ring
    dark = np.argwhere(light.sum(axis=(2, 3)) == 0)
    if dark.size:
        raise LensError(system.prescription.name, "field height", f"{heights_mm[dark[0, 1]]:.4g} mm",
                        "no light for focusing passes here: reduce the field")
    light = light / light.sum(axis=(2, 3), keepdims=True)
    passing = light > 0
    place = np.where(passing, rays.position_mm, 0.0)
    slope = np.where(passing, rays.direction[:2] / rays.direction[2], 0.0)
    for values in (place, slope):
        for along in values[1:] if rays.pupil.mirrored else values:  # the centroid of both halves is on the axis in x
            along -= np.sum(light * along, axis=(2, 3), keepdims=True)
    light = weights * light
    return -np.sum(light * place * slope) / np.sum(light * slope**2)
