"""Measure the processor seconds of the lens in a rack focus: a line for each lens and number of wavelengths.

    python benchmarks/rack_figures.py [QUALITY [LENS ...]]

Focus moves from infinity to the closest distance in 24 frames, in equal steps of reciprocal distance. Nothing is
cached, and the table of rays is not included. Without arguments, some fast and some slow lenses are baked at preview.
"""

import sys
from functools import partial

import numpy as np
from timing import least_s, machine

from lensfield.engine.library import load_lens, prescription_of
from lensfield.engine.rays.rings import Rings, ring_ends

LENSES = ("zeiss-s-biogon-40mm", "tessar-50mm", "apple-phone-4mm", "canon-50mm-f0.95", "nikkor-58mm-f1.4",
          "arri-signature-prime-58mm", "nikkor-z-35mm-f1.2", "angenieux-50mm")
FRAMES = 24
PICTURES_NM = np.linspace(400, 700, 21), np.linspace(400, 700, 9), np.linspace(450, 650, 3)


def rack(name: str) -> list[Rings]:
    """The rings in each frame."""
    far, near = ring_ends(prescription_of(name))
    with np.errstate(divide="ignore"):
        return [Rings(focus_mm) for focus_mm in 1 / np.linspace(1 / far.focus_mm, 1 / near.focus_mm, FRAMES)]


def main(quality: str = "preview", *names: str) -> None:
    """Print the mean and the worst frame of each rack."""
    print(machine())
    for name in names or LENSES:
        for wavelengths_nm in PICTURES_NM:
            frames_s = [least_s(partial(load_lens, name, rings, quality, wavelengths_nm=wavelengths_nm), 1)[0]
                        for rings in rack(name)]
            print(f"{name:30}  {wavelengths_nm.size:3} wavelengths: {np.mean(frames_s):.2f} s a frame, "
                  f"worst {max(frames_s):.2f} s", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
