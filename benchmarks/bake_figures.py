"""Measure the processor seconds of baking lenses and of tracing their tables of rays: a line for each lens.

    python benchmarks/bake_figures.py [QUALITY [LENS ...]]

The rings are at rest. Without arguments, all rotationally symmetric lenses of the library are baked at preview. Nothing
is cached.
"""

import sys

import numpy as np
from timing import least_s, machine

from lensfield.engine.bake.bake import bake
from lensfield.engine.library import bundled_lenses
from lensfield.engine.library.baked import WAVELENGTHS_NM
from lensfield.engine.prescription.prescription import Prescription
from lensfield.engine.rays.ray_table import ray_table
from lensfield.engine.rays.rings import turned


def seconds(prescription: Prescription, quality: str) -> tuple[float, float]:
    """Processor seconds of a bake, with its rings, and of a table of rays."""
    lens = turned(prescription).prescription
    bake_s, _ = least_s(lambda: bake(turned(prescription).prescription, quality=quality,
                                     wavelengths_nm=WAVELENGTHS_NM), 1)
    rays_s, _ = least_s(lambda: ray_table(lens), 1)
    return bake_s, rays_s


def main(quality: str = "preview", *names: str) -> None:
    """Print the figures of each lens, and their median and worst."""
    print(machine())
    lenses, figures = bundled_lenses(), {}
    for name in names or [name for name, lens in lenses.items() if lens.radial]:
        figures[name] = seconds(lenses[name], quality)
        print(f"{name:30}  bake {figures[name][0]:6.2f} s  rays {figures[name][1]:5.2f} s", flush=True)
    for which, label in enumerate((f"bake at {quality}", "table of rays")):
        worst = max(figures, key=lambda name: figures[name][which])
        print(f"{label}: median {np.median([each[which] for each in figures.values()]):.2f} s, "
              f"worst {figures[worst][which]:.2f} s ({worst})")


if __name__ == "__main__":
    main(*sys.argv[1:])
