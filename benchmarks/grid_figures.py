"""The cost of a lens without rotational symmetry, relative to a rotationally symmetric one with the same PSFs.

    python benchmarks/grid_figures.py [LENS ...]

prints processor seconds of both, cold, for a picture at 1080p with 12 wavelengths and an accuracy of 0.01, as the
quickest of alternate runs. The ratio may be at most 2.
"""

import sys

import numpy as np
from cases import HD, night_street
from on_grid import on_grid
from timing import cold_run, machine

from lensfield.engine import Options, load_lens

LENSES = "cooke-triplet-50mm", "nikkor-28mm", "angenieux-50mm"
WAVELENGTHS, ACCURACY, BEST_OF, MOST = 12, 0.01, 2, 2.0
KINDS = {"four quadrants alike": (True, True), "two halves alike": (False, True), "nothing alike": (False, False)}


def line(name: str) -> str:
    """A lens's line of the table."""
    lens, nm = load_lens(name), np.linspace(420, 680, WAVELENGTHS)
    radiance = night_street(lens, HD, nm)
    lenses = [lens, *(on_grid(lens, mirrored=mirrored) for mirrored in KINDS.values())]
    radial_s, *grid_s = np.min([[cold_run(radiance, each, Options(accuracy=ACCURACY)).processor_s for each in lenses]
                                for _ in range(BEST_OF)], axis=0)
    figures = (f"{seconds:10.1f} s, {seconds / radial_s:5.2f} x{'!' if seconds > MOST * radial_s else ' '}"
               for seconds in grid_s)
    return f"{name:<24}{radial_s:10.1f} s" + "".join(figures)


if __name__ == "__main__":
    print(machine())
    print(f"{'processor seconds':<24}{'symmetric':>12}" + "".join(f"{kind:>22}" for kind in KINDS))
    for each in sys.argv[1:] or LENSES:
        print(line(each), flush=True)
