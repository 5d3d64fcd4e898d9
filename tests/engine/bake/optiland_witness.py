"""Optiland as a reference: its tracer, on the same prescriptions, through the same points of the stop."""

import numpy as np
from optiland.coordinate_system import CoordinateSystem
from optiland.geometries.even_asphere import EvenAsphere
from optiland.materials import IdealMaterial
from optiland.optic import Optic
from optiland.rays import RealRays

from lensfield.engine.prescription.prescription import Pose

AIM_TOLERANCE = 1e-10  # mm on the stop
TOLERANCE = 1e-12  # of Optiland's search for intersections with toroids


class Asphere(EvenAsphere):
    """Conic and even powers, intersected from the vertex plane: Optiland's own asphere loses rays at steep surfaces."""

    def __init__(self, surface):
        self._curvature, self._conic, self._terms = 1 / surface.radius_mm, surface.conic, np.array(surface.aspheric)
        at_vertex = self._curvature + 2 * self._terms[0]
        super().__init__(CoordinateSystem(), 1 / at_vertex if at_vertex else np.inf, -1.0)

    def _sag_and_slope(self, square):
        root = np.sqrt(np.maximum(1 - (1 + self._conic) * self._curvature**2 * square, 1e-12))
        powers = np.arange(1, self._terms.size + 1)
        raised = square[..., None] ** (powers - 1)
        return (self._curvature * square / (1 + root) + square * (raised @ self._terms),
                self._curvature / (2 * root) + raised @ (powers * self._terms))

    def sag(self, x=0, y=0):
        return self._sag_and_slope(np.asarray(x**2 + y**2, dtype=float))[0]

    def _surface_normal(self, x, y):
        slope = 2 * self._sag_and_slope(x**2 + y**2)[1]
        length = np.sqrt(1 + slope**2 * (x**2 + y**2))
        return slope * x / length, slope * y / length, -1 / length

    def distance(self, rays, aperture=None):
        distance = -rays.z / rays.N
        for _ in range(100):
            x, y, z = (start + distance * along for start, along in
                       ((rays.x, rays.L), (rays.y, rays.M), (rays.z, rays.N)))
            sag, slope = self._sag_and_slope(x**2 + y**2)
            step = (sag - z) / (2 * slope * (x * rays.L + y * rays.M) - rays.N)
            distance = distance - step
        return distance


def optic_of(system, wavelength_nm):
    """Optiland's system at one wavelength, with the indices, stop and fields of the engine's System."""
    prescription = system.prescription
    indices = system.indices_at([wavelength_nm])[:, 0]
    optic = Optic()
    optic.surfaces.add(index=0, thickness=prescription.object_distance_mm)
    for number, surface in enumerate(prescription.surfaces, 1):
        optic.surfaces.add(index=number, radius=surface.radius_mm, conic=surface.conic, thickness=surface.thickness_mm,
                           material=material_of(surface, indices[number]), is_stop=surface.stop)
        if surface.aspheric:
            _replace_by_asphere(optic.surfaces[number], surface)
    optic.surfaces.add(index=len(prescription.surfaces) + 1)
    optic.set_aperture("float_by_stop_size", 2 * system.stop_semi_aperture_mm)
    optic.surfaces[prescription.stop_index + 1].set_semi_aperture(system.stop_semi_aperture_mm)
    optic.fields.set_type("angle" if system.object_at_infinity else "object_height")
    last, = system.fields_of([system.last_height_mm])
    optic.fields.add(y=0.0)
    optic.fields.add(y=np.degrees(last) if system.object_at_infinity else abs(last))
    optic.wavelengths.add(wavelength_nm * 1e-3, is_primary=True)
    optic.ray_tracer.set_aiming("robust", tol=AIM_TOLERANCE)
    return optic


def material_of(surface, index):
    """Optiland's medium behind a surface; the engine's index is negative where light travels backwards."""
    return "mirror" if surface.mirror else IdealMaterial(abs(index))


def witness_rays(optic, system, height_mm, wavelength_nm, pupil):
    """Position (2, ...), direction (3, ...), path and squared heights (surface, ...) of rays over the stop."""
    field, last = system.fields_of([height_mm, system.last_height_mm])
    share = np.full(pupil.x.size, field / abs(last))
    rays = optic.ray_tracer.ray_generator.generate_rays(0 * share, share, pupil.x.ravel(), pupil.y.ravel(),
                                                        wavelength_nm * 1e-3)
    start = np.stack([rays.x, rays.y, rays.z, rays.L, rays.M, rays.N])
    rays = RealRays(*start, np.ones(share.size), np.full(share.size, wavelength_nm * 1e-3))
    optic.surfaces.trace(rays)
    wave = np.sum(start[:3] * start[3:], axis=0) if system.object_at_infinity else 0.0
    inner = slice(1, -1)
    square = np.stack([x**2 + y**2 for x, y in zip(optic.surfaces.x[inner], optic.surfaces.y[inner], strict=True)])
    return [np.reshape(values, (*np.shape(values)[:-1], *pupil.shape)) for values in (
        np.stack([rays.x, rays.y]), np.stack([rays.L, rays.M, rays.N]), rays.opd + wave, square)]


def displaced_optic(prescription, indices):
    """Optiland's system at one wavelength, with displaced surfaces, and the distance of the image plane."""
    optic, vertex_mm = Optic(), 0.0
    optic.surfaces.add(index=0, z=-np.inf)
    for number, surface in enumerate(prescription.surfaces, 1):
        optic.surfaces.add(index=number, material=material_of(surface, indices[number]), is_stop=surface.stop,
                           **_shaped(surface), **_placed(surface.pose, vertex_mm))
        if surface.aspheric and not surface.profile:
            _replace_by_asphere(optic.surfaces[number], surface)
        vertex_mm += surface.thickness_mm
    optic.surfaces.add(index=len(prescription.surfaces) + 1, **_placed(prescription.image_pose, vertex_mm))
    return optic, vertex_mm


def _placed(pose, vertex_mm):
    """Optiland's words for a pose."""
    pose = pose or Pose()
    (x, y, z), turns = pose.offset_mm, np.radians(pose.tilt_deg)
    return {"x": x, "y": y, "z": vertex_mm + z} | dict(zip(("rx", "ry", "rz"), turns, strict=True))


def _shaped(surface):
    """Optiland's words for a shape; cylinders are toroids."""
    if surface.radius_x_mm is None:
        return {"radius": surface.radius_mm, "conic": surface.conic}
    sections = {"radius_x": surface.radius_x_mm, "radius_y": surface.radius_mm, "tol": TOLERANCE}
    if surface.profile or not (surface.conic_x or np.isfinite([surface.radius_mm, surface.radius_x_mm]).all()):
        return sections | {"surface_type": "toroidal", "conic": surface.conic,
                           "toroidal_coeffs_poly_y": surface.aspheric}
    return sections | {"surface_type": "biconic", "conic_x": surface.conic_x, "conic_y": surface.conic}


def _replace_by_asphere(theirs, surface):
    geometry = Asphere(surface)
    geometry.cs = theirs.geometry.cs
    theirs.geometry = geometry
