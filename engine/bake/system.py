"""A prescription as an Optiland system: first-order figures, focus, fields, bulk transmittance."""

from dataclasses import dataclass, replace

import numpy as np
from optiland.optic import Optic

from ..errors import LensError
from .asphere import Asphere
from .glasses import extinction_at, find_glass
from .rays import HalfPupil, trace_pupil

FOCUS_FIELDS = (0.0, 0.35, 0.5, 0.7)  # of the last field: where "best" focus looks at the light
FOCUS_WAVELENGTHS_NM = (486.1, 546.1, 656.3)
AIM_TOLERANCE = 1e-10  # of the place on the stop, mm: the chief ray errs by some times this
FOCUS_PUPIL = HalfPupil(13, 17)


@dataclass(frozen=True, eq=False)
class System:
    """A lens ready to be traced.

    Attributes
    ----------
    optic : optiland.optic.Optic
        Without apertures but for the stop: what they cut off is decided by `semi_apertures_mm`, smoothly.
    prescription : Prescription
        As built: its last thickness is the distance to the image plane.
    materials : list
        Optiland's, one for each surface.
    efl_mm, magnification, entrance_pupil_mm, exit_pupil_distance_mm : float
        Paraxial, at the reference wavelength; the magnification is 0 for an object at infinity, the exit pupil's
        distance is from the image plane.
    stop_semi_aperture_mm : float
    last_height_mm : float
        Paraxial image height where the field ends.
    """

    optic: Optic
    prescription: object
    materials: list
    efl_mm: float
    magnification: float
    entrance_pupil_mm: float
    exit_pupil_distance_mm: float
    stop_semi_aperture_mm: float
    last_height_mm: float

    @property
    def semi_apertures_mm(self):
        """Of each surface: array, inf where nothing stops light but the stop itself."""
        sizes = np.array([surface.semi_aperture_mm for surface in self.prescription.surfaces])
        sizes[self.prescription.stop_index] = np.inf
        return sizes

    def field_of_height(self, height_mm):
        """Optiland's normalised field that has this paraxial image height, on the side where images have +y."""
        if np.isinf(self.prescription.object_distance_mm):
            last = np.arctan(self.last_height_mm / self.efl_mm)
            return float(np.arctan(height_mm / self.efl_mm) / last)
        return float(np.sign(self.magnification) * height_mm / self.last_height_mm)

    def transmittance(self, wavelengths_nm):
        """T of the bulk glass along the axis: array (wavelength,). Model glasses and coatings take nothing."""
        def absorption(nm):
            return sum(4 * np.pi * extinction_at(material, nm) * abs(surface.thickness_mm) / (nm * 1e-6)
                       for material, surface in zip(self.materials, self.prescription.surfaces) if surface.glass)

        return np.exp([-absorption(nm) for nm in wavelengths_nm])


def build_system(prescription):
    """Trace-ready system of a prescription, focused as it asks.

    Raises
    ------
    LensError
        A glass that no catalogue has, or a system without power or without a pupil.
    """
    materials = [find_glass(surface.glass, prescription.name, f"surface {number}, glass")
                 for number, surface in enumerate(prescription.surfaces, 1)]
    optic = _optic(prescription, materials)
    stop_mm = _stop_semi_aperture_mm(optic, prescription)
    system = _system(optic, prescription, materials, stop_mm)
    if prescription.focus == "as given":
        return system
    for focus in ("paraxial", "best"):
        distance_mm = prescription.surfaces[-1].thickness_mm
        shift_mm = _paraxial_focus_mm(optic) - distance_mm if focus == "paraxial" else _best_focus_shift_mm(system)
        last = replace(prescription.surfaces[-1], thickness_mm=distance_mm + shift_mm)
        prescription = replace(prescription, surfaces=(*prescription.surfaces[:-1], last))
        optic = _optic(prescription, materials)
        system = _system(optic, prescription, materials, stop_mm)
        if focus == prescription.focus:
            return system


def _optic(prescription, materials):
    """The surfaces, the reference wavelength, and a field and stop of size one until they are known."""
    optic = Optic()
    optic.surfaces.add(index=0, thickness=prescription.object_distance_mm)
    for index, (surface, material) in enumerate(zip(prescription.surfaces, materials), 1):
        optic.surfaces.add(index=index, radius=surface.radius_mm, conic=surface.conic, material=material,
                           thickness=surface.thickness_mm, is_stop=surface.stop)
        if surface.aspheric:
            optic.surfaces[index].geometry = Asphere(optic.surfaces[index].geometry.cs, surface)
    optic.surfaces.add(index=len(materials) + 1)
    optic.set_aperture("float_by_stop_size", 2.0)
    optic.fields.set_type("angle" if np.isinf(prescription.object_distance_mm) else "object_height")
    optic.fields.add(y=0.0)
    optic.fields.add(y=1.0)
    optic.wavelengths.add(prescription.reference_wavelength_nm * 1e-3, is_primary=True)
    return optic


def _system(optic, prescription, materials, stop_mm):
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
        for rays in trace_pupil(system, field * system.last_height_mm, FOCUS_WAVELENGTHS_NM, FOCUS_PUPIL):
            inside = rays.square_height_mm2 <= system.semi_apertures_mm[:, None, None] ** 2
            passing = inside.all(axis=0) & ~rays.lost
            weight = FOCUS_PUPIL.radii[:, None] * passing  # rings hold light by their radius
            if not weight.any():
                raise LensError(system.prescription.name, "field height", f"{field * system.last_height_mm:.4g} mm",
                                "no light gets through here, by which to focus: end the field earlier")
            place, slope = rays.position_mm[:2], rays.direction[:2] / rays.direction[2]
            place, slope = ([part[0], part[1] - np.average(part[1][passing], weights=weight[passing])]
                            for part in (place, slope))  # about the centroid: in x it is the axis
            rise -= sum(np.average((a * b)[passing], weights=weight[passing]) for a, b in zip(place, slope))
            run += sum(np.average((b * b)[passing], weights=weight[passing]) for b in slope)
    return rise / run


def _number(value):
    return float(np.ravel(value)[0])
