"""The cost of ghosts, and how much of their light is drawn.

    python benchmarks/ghost_figures.py [LENS ...]

prints processor seconds for ten lamps in and around a picture at 1080p with 12 wavelengths, through lenses with bare
surfaces at f/4; the pairs of surfaces; the ghosts that are drawn, of all lamps; and their light, as a share of the
light of all ghosts and of the lamps' images. The goal is 6 s for a lens of 12 elements.
"""

import sys
import time
from dataclasses import replace

import numpy as np
from cases import HD
from timing import machine

from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.sources import Sources
from lensfield.engine.lens.iris import Iris, opening_within
from lensfield.engine.library import prescription_of
from lensfield.engine.rays.rings import Rings, turned
from lensfield.engine.stray.ghosts import Ghosts, direct_light, ghosts

LENSES = "cooke-triplet-50mm", "pentax-macro-200mm", "arri-master-prime-100mm"
LAMPS, FARTHEST_DEG, SPIRAL_RAD, WAVELENGTHS, F_NUMBER, BLADES = 10, 24.0, 0.65, 12, 4.0, 7
FULL_FRAME_MM = 36.0


def lamps() -> Sources:
    """Points at infinity on a spiral."""
    angle, azimuth = np.radians(np.linspace(2, FARTHEST_DEG, LAMPS)), SPIRAL_RAD * np.arange(LAMPS)
    directions = np.stack([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)], axis=1)
    return Sources(directions, np.full(LAMPS, np.inf), np.ones((LAMPS, WAVELENGTHS)),
                   np.linspace(420, 680, WAVELENGTHS), np.zeros(LAMPS),
                   tuple(f"lamp {number}" for number in range(1, LAMPS + 1)))


def traced(name: str) -> tuple[Ghosts, np.ndarray, float]:
    """The ghosts of the lamps through a lens, the light of their images, and processor seconds of the ghosts."""
    design = prescription_of(name)
    bare = replace(design, coating="none", surfaces=tuple(replace(each, coating="") for each in design.surfaces))
    lens = turned(bare, Rings(f_number=F_NUMBER)).prescription
    grid = PixelGrid(HD, FULL_FRAME_MM / HD[1] * 1e3)
    before = time.process_time()
    opening = opening_within(Iris(BLADES), lens.stop_rim)
    found = ghosts(lens, lamps(), grid, opening)
    seconds = time.process_time() - before
    return found, direct_light(lens, lamps(), opening), seconds


def line(name: str) -> str:
    """A lens's line of the table."""
    found, images, seconds = traced(name)
    drawn, image = np.nansum(found.light), images.sum()
    count = np.count_nonzero(np.isfinite(found.light[:, :, 0]))
    return (f"{name:<26}{seconds:8.1f} s{len(found.pairs):7d}{count:8d}"
            f"{100 * drawn / (drawn + found.neglected.sum()):9.2f} %{100 * drawn / image:9.3f} %")


if __name__ == "__main__":
    print(machine())
    print(f"{'processor seconds':<26}{'':>10}{'pairs':>7}{'ghosts':>8}{'of all':>11}{'of images':>11}")
    for each in sys.argv[1:] or LENSES:
        print(line(each), flush=True)
