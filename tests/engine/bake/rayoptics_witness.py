"""rayoptics as a second reference: the same prescriptions by its tracer, aimed at the stop by scipy's root finder.

    python tests/engine/bake/rayoptics_witness.py PRESCRIPTION.toml > tests/data/edmund_chief_rays.csv

prints chief rays, in the environment of `make test-bake`, for tests that run without rayoptics. Refractive indices are
the engine's, because the comparison is about ray tracing.
"""

import sys

import numpy as np
from rayoptics.elem.profiles import EvenPolynomial
from rayoptics.elem.surface import DecenterData, Surface
from rayoptics.elem.transform import forward_transform
from rayoptics.parax.firstorder import paraxial_trace
from rayoptics.raytr.raytrace import trace_raw
from rayoptics.seq.gap import Gap
from scipy.optimize import root

from lensfield.engine.prescription.readers import read_prescription
from lensfield.engine.rays.focus import build_system

WAVELENGTHS_NM = (400.0, 486.1, 587.5618, 656.3, 700.0)
HEIGHTS = 7


def path_of(system, wavelength_nm, object_gap_mm):
    """Interfaces, gaps and indices for rayoptics, from a plane this far in front of the lens to the image plane."""
    prescription = system.prescription
    indices = [1.0, *system.indices_at([wavelength_nm])[:, 0], 1.0]
    profiles = [EvenPolynomial(), *(EvenPolynomial(c=1 / surface.radius_mm, cc=surface.conic,
                                                   coefs=list(surface.aspheric) or None)
                                    for surface in prescription.surfaces), EvenPolynomial()]
    poses = [None, *(surface.pose for surface in prescription.surfaces), prescription.image_pose]
    mirrors = [False, *(surface.mirror for surface in prescription.surfaces), False]
    interfaces = [Surface(profile=profile, delta_n=behind - before, decenter=displacement(pose),
                          interact_mode="reflect" if mirror else "transmit")
                  for profile, before, behind, pose, mirror in
                  zip(profiles, indices, indices[1:], poses, mirrors, strict=False)]
    gaps_mm = [object_gap_mm, *(surface.thickness_mm for surface in prescription.surfaces), 0.0]
    steps = [forward_transform(here, gap_mm, ahead) for here, gap_mm, ahead in
             zip(interfaces, gaps_mm, [*interfaces[1:], interfaces[-1]], strict=True)]
    return [[interface, Gap(t=gap_mm), (turn.T, offset_mm), abs(index), np.sign(index)]
            for interface, gap_mm, (turn, offset_mm), index in
            zip(interfaces, gaps_mm, steps, indices[1:], strict=True)]


def displacement(pose):
    """rayoptics' words for a pose: angles in Code V's convention, about turned axes and left-handed about x and y."""
    if pose is None:
        return None
    turn = pose.rotation
    about_x, about_y, about_z = (np.arctan2(-turn[1, 2], turn[2, 2]), np.arcsin(turn[0, 2]),
                                 np.arctan2(-turn[0, 1], turn[0, 0]))
    decentre = DecenterData("dec and return", 0.0, 0.0, *np.degrees([-about_x, -about_y, about_z]))
    decentre.dec = np.array(pose.offset_mm)
    decentre.update()
    return decentre


def focal_length_mm(system, wavelength_nm):
    """The paraxial focal length."""
    rays, _ = paraxial_trace(iter(path_of(system, wavelength_nm, 1.0)), 0, [1.0, 0.0], [0.0, 1.0])
    return -1 / rays[-1][1]


def witness_ray(system, height_mm, wavelength_nm, x_mm, y_mm):
    """The landing point (x, y) and the optical path of a ray from a field height through a point of the stop.

    The path starts at the object point, or at the plane wave through the middle of the first surface.
    """
    prescription, stop = system.prescription, system.prescription.stop_index + 1
    field, = system.fields_of([height_mm])
    before_mm = 10 * system.efl_mm if system.object_at_infinity else prescription.object_distance_mm
    path = path_of(system, wavelength_nm, before_mm)
    pupil_mm = before_mm + system.entrance_pupil_mm

    def trace(aim):
        aim_mm = np.array([*aim, pupil_mm])
        if system.object_at_infinity:
            towards = np.array([0.0, np.sin(field), np.cos(field)])
            start = aim_mm - towards * pupil_mm / towards[2]
        else:
            start = np.array([0.0, field, 0.0])
            towards = (aim_mm - start) / np.linalg.norm(aim_mm - start)
        return trace_raw(iter(path), start, towards, wavelength_nm)[0]

    place_mm = np.array([x_mm, y_mm])
    guess_mm = place_mm * abs(system.marginal_heights_mm[0]) / system.stop_semi_aperture_mm
    aim = root(lambda aim: trace(aim)[stop][0][:2] - place_mm, guess_mm, tol=1e-13, options={"factor": 0.1}).x
    ray = trace(aim)
    np.testing.assert_allclose(ray[stop][0][:2], place_mm, atol=1e-9)
    path_mm = sum(piece[3] * each[2] for piece, each in zip(path, ray[:-1], strict=False))
    if system.object_at_infinity:
        path_mm += (ray[0][0] - [0.0, 0.0, before_mm]) @ ray[0][1]
    return *ray[-1][0][:2], path_mm


def main(path):
    system = build_system(read_prescription(path))
    print(f"# chief-ray heights of {system.prescription.name} in mm, traced with rayoptics by "
          "tests/engine/bake/rayoptics_witness.py")
    print("paraxial_mm," + ",".join(f"{nm:g}nm" for nm in WAVELENGTHS_NM))
    for height_mm in np.linspace(0, system.last_height_mm, HEIGHTS):
        row = [witness_ray(system, height_mm, nm, 0.0, 0.0)[1] for nm in WAVELENGTHS_NM]
        print(f"{height_mm:.4f}," + ",".join(f"{value:.8f}" for value in row))


if __name__ == "__main__":
    main(sys.argv[1])
