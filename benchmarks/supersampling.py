"""Measure the effect of supersampling by lens: misplaced light at 1 x 1 to 4 x 4, compared with 8 x 8.

    python benchmarks/supersampling.py

The pictures are a patch in the middle of a 1080p frame of each lens, at 550 nm: single lit pixels, 12 apart, and a
checkerboard of 8 px squares. Errors are sums of |error| as fractions of the light, like `accuracy`, and include its
error, at most 0.003. Processor seconds are for one patch. (Away from the axis, 8 x 8 would need a table of 40 GB.)
"""

import time

import numpy as np

from lensfield.engine import Options, SpectralImage, load_lens, simulate
from lensfield.engine.lens.pinhole import fitting_pitch_um

LENSES = "tessar-50mm", "edmund-54852", "cooke-triplet-50mm", "nikkor-28mm"
FRAME_PX, SIDE_PX, MARGIN_PX = (1080, 1920), 48, 12
APART_PX, SQUARE_PX = 12, 8
TIMES, MOST = (1, 2, 3, 4), 8
ACCURACY, NM = 3e-3, 550.0


def pictures():
    """Points and a checkerboard, with a margin to avoid loss of light: dict of arrays."""
    side = np.arange(SIDE_PX)
    points = np.outer(side % APART_PX == APART_PX // 2, side % APART_PX == APART_PX // 2)
    board = (np.add.outer(side // SQUARE_PX, side // SQUARE_PX) % 2).astype(bool)
    return {name: np.pad(picture, MARGIN_PX).astype(np.float32) for name, picture in
            (("points", points), ("board", board))}


def filtered(picture, pitch_um, lens, times):
    begin = time.process_time()
    radiance = SpectralImage(picture, [NM], pitch_um=pitch_um)
    result = simulate(radiance, lens, Options(accuracy=ACCURACY, supersampling=times))
    return result.cube[0].astype(float), time.process_time() - begin


def main():
    print(f"{'':<20}{'um/px':>6}  {'':<8}" + "".join(f"{f'{n} x {n}':>9}" for n in TIMES) + "   processor s")
    for name in LENSES:
        lens = load_lens(name)
        pitch_um = fitting_pitch_um(lens, FRAME_PX)
        for what, picture in pictures().items():
            true = filtered(picture, pitch_um, lens, MOST)[0]
            results = [filtered(picture, pitch_um, lens, times) for times in TIMES]
            errors = "".join(f"{np.abs(result - true).sum() / true.sum():9.4f}" for result, _ in results)
            seconds = ", ".join(f"{took:.2f}" for _, took in results)
            print(f"{name:<20}{pitch_um:6.2f}  {what:<8}{errors}   {seconds}", flush=True)


if __name__ == "__main__":
    main()
