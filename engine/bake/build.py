"""A prescription built as a system that rays go through: glasses, stop, focus and fields."""

from dataclasses import replace

import numpy as np
from optiland.optic import Optic

from ..errors import LensError
from .asphere import Asphere
from .glasses import find_glass
from .prescription import Prescription
from .rays import HalfPupil, trace_pupil
from .system import System

FOCUS_FIELDS = (0.0, 0.35, 0.5, 0.7)  # of the last field: where "best" focus looks at the light
FOCUS_WAVELENGTHS_NM = (486.1, 546.1, 656.3)
FOCUS_PUPIL = HalfPupil(13, 17)
LEAST_PASSING = 0.5  # of the aperture's diameter: patents' own apertures let up to a fifth less through
HOPELESS = 0.25  # of the last height: discs of which a picture holds a few
AIM_TOLERANCE = 1e-10  # of the place on the stop, mm: the chief ray errs by some times this


def build_system(prescription: Prescription) -> System:
    """Trace-ready system of a prescription, focused as it asks.

    Raises
    ------
    LensError
        A glass that no catalogue has, or a system without power or without a pupil.
    """
    materials = [find_glass(surface.glass, prescription.name, f"surface {number}, glass", surface.glass_figures)
                 for number, surface in enumerate(prescription.surfaces, 1)]
    optic = _optic(prescription, materials)
    system = _system(optic, prescription, materials, _stop_semi_aperture_mm(optic, prescription))
    _check_aperture(system)
    _check_object(system)
    if prescription.focus == "as given":
        _check_focus(system)
        return system
    system = _refocused(system, _paraxial_focus_mm(optic) - prescription.surfaces[-1].thickness_mm)
    return system if prescription.focus == "paraxial" else _refocused(system, _best_focus_shift_mm(system))


def _check_aperture(system):
    """The surfaces let the light through that the aperture asks for: by the paraxial marginal ray, with some slack."""
    kind, value = system.prescription.aperture
    heights_mm = np.abs(_marginal_ray(system)[0][1:-1])
    passing = np.min(system.semi_apertures_mm / np.maximum(heights_mm, 1e-12))
    if passing < LEAST_PASSING:
        most = value / passing if kind.endswith("f_number") else value * passing
        raise LensError(system.prescription.name, f"aperture, {kind}", value,
                        f"the surfaces' own apertures let {most:.3g} through at most")


def _check_object(system):
    """A lens has a real image of its object."""
    if system.magnification > 0 or not np.isfinite(system.magnification):
        raise LensError(system.prescription.name, "object_distance_mm", system.prescription.object_distance_mm,
                        "no image of it lies behind the lens: expected more than "
                        f"{-_number(system.optic.paraxial.F1()):.4g} mm, its front focal point")


def _check_focus(system):
    """The image plane lies where the paraxial image is not all blur."""
    slope = abs(_marginal_ray(system)[1][-1])
    shift_mm = _paraxial_focus_mm(system.optic) - system.prescription.surfaces[-1].thickness_mm
    blur_mm = 2 * abs(shift_mm) * slope
    if blur_mm > HOPELESS * system.last_height_mm:
        where = "object_distance_mm" if system.magnification else "focus"
        value = system.prescription.object_distance_mm if system.magnification else system.prescription.focus
        raise LensError(system.prescription.name, where, value,
                        f"the image lies {abs(shift_mm):.3g} mm {'behind' if shift_mm > 0 else 'before'} the image "
                        f"plane, and a point becomes a disc of {blur_mm:.3g} mm: focus on it, or go farther away")


def _marginal_ray(system):
    """Heights in mm and slopes of the paraxial marginal ray, from the object to the image plane."""
    return tuple(np.ravel(part) for part in system.optic.paraxial.marginal_ray())


def _refocused(system, shift_mm):
    """The system with its image plane that much farther behind."""
    *before, last = system.prescription.surfaces
    surfaces = (*before, replace(last, thickness_mm=last.thickness_mm + shift_mm))
    prescription = replace(system.prescription, surfaces=surfaces, focus="as given")
    return _system(_optic(prescription, system.materials), prescription, system.materials,
                   system.stop_semi_aperture_mm)


def _optic(prescription, materials):
    """The surfaces, the reference wavelength, and a field and stop of size one until they are known."""
    optic = Optic()
    optic.surfaces.add(index=0, thickness=prescription.object_distance_mm)
    for index, (surface, material) in enumerate(zip(prescription.surfaces, materials, strict=True), 1):
        optic.surfaces.add(index=index, radius=surface.radius_mm, conic=surface.conic, material=material,
                           thickness=surface.thickness_mm, is_stop=surface.stop)
        if surface.aspheric or surface.odd_aspheric:
            optic.surfaces[index].geometry = Asphere(optic.surfaces[index].geometry.cs, surface)
    optic.surfaces.add(index=len(materials) + 1)
    optic.set_aperture("float_by_stop_size", 2.0)
    optic.fields.set_type("angle" if np.isinf(prescription.object_distance_mm) else "object_height")
    optic.fields.add(y=0.0)
    optic.fields.add(y=1.0)
    optic.wavelengths.add(prescription.reference_wavelength_nm * 1e-3, is_primary=True)
    return optic


def _system(optic, prescription, materials, stop_mm):
    """The system with its stop, its first-order figures and its fields."""
    paraxial = optic.paraxial
    efl_mm, pupil_mm = _number(paraxial.f2()), _number(paraxial.EPL())
    if not (np.isfinite(efl_mm) and efl_mm > 0):
        raise LensError(prescription.name, "focal length", f"{efl_mm:g} mm", "expected a lens of positive power")
    magnification = 0.0 if np.isinf(prescription.object_distance_mm) else _number(paraxial.magnification())
    last_mm = _last_height_mm(prescription, efl_mm, magnification, pupil_mm)
    optic.set_aperture("float_by_stop_size", 2 * stop_mm)
    optic.surfaces[prescription.stop_index + 1].set_semi_aperture(stop_mm)
    optic.fields.fields.clear()
    optic.fields.add(y=0.0)
    angle = np.degrees(np.arctan(last_mm / efl_mm))
    optic.fields.add(y=angle if magnification == 0 else last_mm / abs(magnification))
    optic.ray_tracer.set_aiming("robust", tol=AIM_TOLERANCE)
    return System(optic, prescription, materials, efl_mm, magnification, pupil_mm,
                  _number(paraxial.XPL()), stop_mm, last_mm)


def _last_height_mm(prescription, efl_mm, magnification, pupil_mm):
    """Paraxial image height of the field's end."""
    kind, value = prescription.field
    if kind == "image_height_mm":
        return value
    if kind == "object_height_mm":
        return abs(magnification) * value
    tangent = np.tan(np.radians(value))
    if np.isinf(prescription.object_distance_mm):
        return efl_mm * tangent
    return abs(magnification) * tangent * (prescription.object_distance_mm + pupil_mm)


def _stop_semi_aperture_mm(optic, prescription):
    """Semi-aperture of the stop that gives the lens its aperture: the marginal ray's height there, in proportion."""
    kind, value = prescription.aperture
    if kind == "stop":
        return value
    optic.set_aperture("EPD", 1.0)
    heights, slopes = (np.ravel(part) for part in optic.paraxial.marginal_ray())
    at_stop = abs(heights[prescription.stop_index + 1])
    if kind == "entrance_pupil_diameter_mm":
        return at_stop * value
    if kind == "f_number":
        return at_stop * _number(optic.paraxial.f2()) / value
    if kind == "working_f_number":
        return at_stop * 0.5 / (abs(slopes[-1]) * value)
    return at_stop * np.tan(np.arcsin(value)) / abs(slopes[0])


def _paraxial_focus_mm(optic):
    """Distance from the last surface to where the marginal ray meets the axis."""
    heights, slopes = (np.ravel(part) for part in optic.paraxial.marginal_ray())
    return float(-heights[-2] / slopes[-2])


def _best_focus_shift_mm(system):
    """How far the image plane has to go for the least mean square spot over the inner field.

    A ray that is moved on by dz goes aside by dz times its slope, so the mean square is a parabola in dz.
    """
    rise = run = 0.0
    for field in FOCUS_FIELDS:
        height_mm = field * system.last_height_mm
        for rays in trace_pupil(system, height_mm, FOCUS_WAVELENGTHS_NM, FOCUS_PUPIL):
            place, slope, light = _spot(system, rays, height_mm)
            rise -= sum(np.average(a * b, weights=light) for a, b in zip(place, slope, strict=True))
            run += sum(np.average(b * b, weights=light) for b in slope)
    return rise / run


def _spot(system, rays, height_mm):
    """Of the rays that get through: place and slope (x, y) about the centroid, and light, arrays (..., ray)."""
    inside = rays.square_height_mm2 <= system.semi_apertures_mm[:, None, None] ** 2
    passing = inside.all(axis=0) & ~rays.lost
    light = (FOCUS_PUPIL.radii[:, None] * passing)[passing]  # rings hold light by their radius
    if not light.any():
        raise LensError(system.prescription.name, "field height", f"{height_mm:.4g} mm",
                        "no light gets through here, by which to focus: end the field earlier")
    place, slope = rays.position_mm[:2, passing], rays.direction[:2, passing] / rays.direction[2, passing]
    place[1] -= np.average(place[1], weights=light)  # in x the centroid is the axis
    slope[1] -= np.average(slope[1], weights=light)
    return place, slope, light


def _number(value):
    return float(np.ravel(value)[0])
