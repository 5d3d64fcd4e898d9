"""Chief rays of a prescription by a second tracer, rayoptics, for the tests to hold the baked heights against.

    pip install rayoptics
    python benchmarks/second_tracer.py PRESCRIPTION.toml > tests/data/edmund_chief_rays.csv

The rays start at the object points of our heights and are aimed at the middle of the stop by a root finder of ours;
rayoptics traces them. Refractive indices are those of our glasses, for it is the tracing that is compared.
"""

import sys

import numpy as np
from rayoptics.elem.profiles import Spherical
from rayoptics.elem.surface import Surface
from rayoptics.raytr.raytrace import trace_raw
from rayoptics.seq.gap import Gap
from scipy.optimize import brentq

from lensfield.engine.bake.focus import build_system
from lensfield.engine.bake.prescriptions import read_prescription

WAVELENGTHS_NM = (400.0, 486.1, 587.5618, 656.3, 700.0)
HEIGHTS = 7


def ray_path(system, wavelength_nm):
    """Interfaces, gaps and indices as `trace_raw` takes them, from the object plane to the image plane."""
    prescription = system.prescription
    radii = [np.inf, *(surface.radius_mm for surface in prescription.surfaces), np.inf]
    gaps = [prescription.object_distance_mm, *(surface.thickness_mm for surface in prescription.surfaces), 0.0]
    indices = [*system.indices_at([wavelength_nm])[:, 0], 1.0]
    return [[Surface(profile=Spherical(c=0.0 if np.isinf(radius) else 1 / radius)), Gap(t=gap),
             (np.eye(3), np.array([0.0, 0.0, gap])), index, 1.0]
            for radius, gap, index in zip(radii, gaps, indices, strict=True)]


def chief_height_mm(system, height_mm, wavelength_nm):
    """Where the ray from the object point of this paraxial height through the middle of the stop ends."""
    path = ray_path(system, wavelength_nm)
    start = np.array([0.0, height_mm / system.magnification, 0.0])
    stop = system.prescription.stop_index + 1

    def heights_at(surface, aim_mm):
        towards = np.array([0.0, aim_mm, system.prescription.object_distance_mm + system.entrance_pupil_mm]) - start
        ray, _, _ = trace_raw(iter(path), start, towards / np.linalg.norm(towards), wavelength_nm)
        return ray[surface][0][1]

    aim_mm = brentq(lambda aim: heights_at(stop, aim), -1.0, 1.0, xtol=1e-13)
    return heights_at(-1, aim_mm)


def main(path):
    system = build_system(read_prescription(path))
    print(f"# chief-ray heights of {system.prescription.name} in mm, traced with rayoptics by "
          "benchmarks/second_tracer.py")
    print("paraxial_mm," + ",".join(f"{nm:g}nm" for nm in WAVELENGTHS_NM))
    for height_mm in np.linspace(0, system.last_height_mm, HEIGHTS):
        row = [chief_height_mm(system, height_mm, nm) for nm in WAVELENGTHS_NM]
        print(f"{height_mm:.4f}," + ",".join(f"{value:.8f}" for value in row))


if __name__ == "__main__":
    main(sys.argv[1])
