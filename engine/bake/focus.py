"""Where the image plane lies: as given, at the paraxial focus, where the axis is sharpest, or best for the field."""

from dataclasses import replace

import numpy as np

from ..errors import LensError
from .axial_image import trace_axial_bundles, white_mtf
from .prescription import Prescription
from .rays import HalfPupil, trace_pupil
from .system import System, system_of

WHITE_NM = tuple(range(450, 651, 25))  # beyond them the eye sees little
LINES_PER_MM, FULL_FRAME_MM = (20.0, 30.0), np.hypot(36.0, 24.0)  # what is to be sharp, and on what diagonal
FINEST = 0.5  # of the frequencies that diffraction passes
STEP = 0.1  # of the depth over which contrast changes, one over frequency and numerical aperture
MARGIN = 5  # steps, beyond where rays cross the axis
MOST_STEPS = 2000
ZOOMS, ZOOM = 3, np.linspace(-1, 1, 21)
FIELDS = (0.0, 0.35, 0.5, 0.7)  # of the last field: where "field" looks at the light
FIELD_NM = (486.1, 546.1, 656.3)
PUPIL = HalfPupil(13, 17)
LEAST_PASSING = 0.5  # of the aperture's diameter: patents round their apertures
HOPELESS = 0.25  # of the last height: discs of which a picture holds a few


def build_system(prescription: Prescription) -> System:
    """Trace-ready system of a prescription, focused as it asks.

    Raises
    ------
    LensError
        A glass that no catalogue has, a system without power, or what no lens can do: told before a ray is traced.
    """
    system = system_of(prescription)
    _check_aperture(system, *prescription.aperture)
    _check_object(system)
    if prescription.focus == "as given":
        _check_focus(system)
        return system
    system = _focused_at(system, system.image_distance_mm)
    if prescription.focus == "paraxial":
        return system
    shift_mm = _sharpest_shift_mm(system) if prescription.focus == "best" else _field_shift_mm(system)
    return _focused_at(system, system.image_distance_mm + shift_mm)


def axial_contrast(system: System, lines_per_mm: float) -> float:
    """Contrast that lines keep on the axis in white light, diffraction included.

    Parameters
    ----------
    system : System
    lines_per_mm : float
        On full frame: on another sensor they are as fine on its diagonal, or half as fine as diffraction passes.
    """
    bundles = trace_axial_bundles(system, _known_nm(system, WHITE_NM))
    fineness, = _fineness(system, bundles, [lines_per_mm])
    return float(white_mtf(bundles, fineness, [0.0])[0])


def _check_aperture(system, kind, value):
    """The surfaces let the light through that the aperture asks for: by the paraxial marginal ray, with some slack."""
    passing = np.min(system.semi_apertures_mm / np.maximum(np.abs(system.marginal_heights_mm), 1e-12))
    if passing < LEAST_PASSING:
        most = value / passing if kind.endswith("f_number") else value * passing
        raise LensError(system.prescription.name, f"aperture, {kind}", value,
                        f"the surfaces' own apertures let {most:.3g} through at most")


def _check_object(system):
    """A lens has a real image of its object."""
    if system.magnification > 0 or not np.isfinite(system.magnification):
        raise LensError(system.prescription.name, "object_distance_mm", system.prescription.object_distance_mm,
                        "no image of it lies behind the lens: expected more than "
                        f"{system.front_focus_mm:.4g} mm, its front focal point")


def _check_focus(system):
    """The image plane lies where the paraxial image is not all blur."""
    shift_mm = system.image_distance_mm - system.prescription.surfaces[-1].thickness_mm
    blur_mm = 2 * abs(shift_mm * system.marginal_slope)
    if blur_mm > HOPELESS * system.last_height_mm:
        where = "focus" if system.object_at_infinity else "object_distance_mm"
        raise LensError(system.prescription.name, where, getattr(system.prescription, where),
                        f"the image lies {abs(shift_mm):.3g} mm {'behind' if shift_mm > 0 else 'before'} the image "
                        f"plane, and a point becomes a disc of {blur_mm:.3g} mm: focus on it, or go farther away")


def _focused_at(system, distance_mm):
    """The system with its image plane so far behind the last surface, and with the field that it had."""
    *before, last = system.prescription.surfaces
    prescription = replace(system.prescription, surfaces=(*before, replace(last, thickness_mm=distance_mm)),
                           focus="as given")
    return system_of(prescription)


def _sharpest_shift_mm(system):
    """How far the image plane has to go for the highest mean contrast of fine lines on the axis, in white light."""
    bundles = trace_axial_bundles(system, _known_nm(system, WHITE_NM))
    lines_per_mm = _fineness(system, bundles, LINES_PER_MM)
    shifts_mm = _scan_mm(bundles, STEP / (lines_per_mm.max() * max(bundle.aperture for bundle in bundles)))
    for _ in range(ZOOMS):
        contrast = sum(white_mtf(bundles, each, shifts_mm) for each in lines_per_mm)
        best_mm, step_mm = shifts_mm[np.argmax(contrast)], shifts_mm[1] - shifts_mm[0]
        shifts_mm = best_mm + step_mm * ZOOM
    return best_mm


def _fineness(system, bundles, lines_per_mm):
    """Lines per mm that lines of full frame are on this sensor, no finer than diffraction makes sense of."""
    passed = min(bundle.cutoff_lp_mm for bundle in bundles)
    return np.minimum(np.array(lines_per_mm) * FULL_FRAME_MM / _diagonal_mm(system), FINEST * passed)


def _scan_mm(bundles, step_mm):
    """Image planes from the first to the last that a ray crosses the axis in, and a little beyond."""
    crossings_mm = np.concatenate([bundle.crossings_mm for bundle in bundles])
    first, last = crossings_mm.min() - MARGIN * step_mm, crossings_mm.max() + MARGIN * step_mm
    return np.linspace(first, last, min(int(np.ceil((last - first) / step_mm)), MOST_STEPS) + 1)


def _diagonal_mm(system):
    """Of the sensor, or of the picture."""
    if system.prescription.sensor_mm:
        return np.hypot(*system.prescription.sensor_mm)
    rays = trace_pupil(system, [system.last_height_mm], [system.prescription.reference_wavelength_nm], HalfPupil(1, 1))
    return 2 * abs(rays.chief_height_mm[0, 0])


def _known_nm(system, wavelengths_nm):
    """Those of the wavelengths that all glasses are known at; the reference wavelength where there are none."""
    nm = np.array(wavelengths_nm)
    known = ~np.any([np.isnan(glass.index_at(nm)) for glass in system.glasses], axis=0)
    return nm[known] if known.any() else np.array([system.prescription.reference_wavelength_nm])


def _field_shift_mm(system):
    """How far the image plane has to go for the least mean square spot over the inner field.

    A ray that is moved on by dz goes aside by dz times its slope, so the mean square is a parabola in dz.
    """
    heights_mm = np.array(FIELDS) * system.last_height_mm
    rays = trace_pupil(system, heights_mm, _known_nm(system, FIELD_NM), PUPIL)
    inside = rays.square_height_mm2 <= system.semi_apertures_mm[:, None, None, None, None] ** 2
    light = PUPIL.radii[:, None] * (inside.all(axis=0) & ~rays.lost)  # rings hold light by their radius
    dark = np.argwhere(light.sum(axis=(2, 3)) == 0)
    if dark.size:
        raise LensError(system.prescription.name, "field height", f"{heights_mm[dark[0, 1]]:.4g} mm",
                        "no light gets through here, by which to focus: end the field earlier")
    light = light / light.sum(axis=(2, 3), keepdims=True)
    passing = light > 0
    place, slope = (np.where(passing, values, 0.0) for values in
                    (rays.position_mm, rays.direction[:2] / rays.direction[2]))
    for values in (place, slope):  # in x the centroid is the axis
        values[1] -= np.sum(light * values[1], axis=(2, 3), keepdims=True)
    return -np.sum(light * place * slope) / np.sum(light * slope**2)
