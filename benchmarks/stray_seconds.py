"""Processor seconds of stray light: ten lamps in a 1080p picture of 12 wavelengths.

    python benchmarks/stray_seconds.py [LENS]
"""

import sys
import time

import numpy as np

from lensfield.engine import Rings, SpectralImage, load_lens
from lensfield.engine.lens.iris import Iris
from lensfield.engine.stray.options import PARTS, StrayOptions
from lensfield.engine.stray.stray_light import stray_light

LENS, COATING, F_NUMBER = "nikkor-50mm-f1.2", "multi", 4.0
SHAPE_PX, NM = (1080, 1920), np.linspace(400, 700, 12)
LAMPS, LAMP_PX, LAMP, GROUND = 10, 6, 1e4, 1.0  # number, side, radiances


def picture(lens):
    cube = np.full((NM.size, *SHAPE_PX), GROUND, np.float32)
    for row, column in np.random.default_rng(1).integers(0, np.array(SHAPE_PX) - LAMP_PX, (LAMPS, 2)):
        cube[:, row:row + LAMP_PX, column:column + LAMP_PX] = LAMP
    return SpectralImage(cube, NM, pitch_um=lens.sensor_mm[0] / SHAPE_PX[1] * 1e3,
                         focal_mm=lens.capture_focal_length_mm)


def main(name=LENS):
    lens = load_lens(name, Rings(f_number=F_NUMBER, coating=COATING), "preview")
    light, elements = picture(lens), sum(bool(surface.glass) for surface in lens.prescription.surfaces)
    print(f"{name}: {elements} elements, {LAMPS} lamps, {SHAPE_PX[1]} x {SHAPE_PX[0]} px, {NM.size} wavelengths")
    for parts in (*PARTS, ",".join(PARTS)):
        start = time.process_time()
        found = stray_light(light, lens, StrayOptions(parts), 0.01, iris=Iris(6))
        print(f"{parts:<18} {time.process_time() - start:5.1f} processor seconds; {found.sources} sources of ghosts")


if __name__ == "__main__":
    main(*sys.argv[1:])
