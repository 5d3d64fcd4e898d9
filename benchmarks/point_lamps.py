"""Lamps near focus: errors of the in-focus PSF, of rays, and of their blend, against diffraction at the lamp's depth.

    python benchmarks/point_lamps.py [LENS:WIDTH_MM:PIXELS[:F,F...] ...]

Lamps are squares of pixels; each pixel emits from its centre. L1 is the sum of the absolute differences between the
pixels of two pictures, relative to the lamp's light: 2 if all light is misplaced. Each row is a depth in front of the
plane of focus, in waves of defocus: the blur; the share of the in-focus PSF in the blend; L1 of the in-focus PSF, of
rays and of the blend, for lamps of 1 and of 4 pixels a side in light of 550 nm; and L1 of the blend in a band of 40 nm.
Each error is the larger of those on the axis and at 60 % of the field. The last lines are the time of a PSF at a depth.
"""

import argparse
import time

import numpy as np
from scipy.signal import fftconvolve
from scipy.stats import qmc
from timing import machine

from lensfield.engine.bake.through_focus import landings_mm, psf_at_depth
from lensfield.engine.depth.depth_range import blur_per_nearness_px, focus_range_px, focus_share
from lensfield.engine.lens.entrance_pupil import focus_nearness
from lensfield.engine.library import load_lens
from lensfield.engine.library.rays import lens_rays
from lensfield.engine.rays.rings import AT_REST, Rings

CASES = ("nikkor-z-50mm-f1.8:36:1920:2,2.8,4,5.6,8", "edmund-54852:4.8:3428")
FOCUS_MM = 2000.0
BAND_NM, MIDDLE = (530.0, 540.0, 550.0, 560.0, 570.0), 2
WAVES = 0.125, 0.25, 0.5, 1, 2, 4, 8
SHARES = 0.0, 0.6
LAMPS = 1, 4
REPEATS = 5
RAYS = 2**15


def psf_of_rays(rays, nm, height_mm, depth_mm, pitch_um, samples):
    """Geometric PSF: each pixel's fraction of the light through a densely sampled stop."""
    across = qmc.Sobol(2, seed=1).random(RAYS).T
    stop = np.sqrt(across[0]) * np.stack([np.sin(2 * np.pi * across[1]), np.cos(2 * np.pi * across[1])])
    landed_mm, passing = landings_mm(rays, nm, height_mm, depth_mm, stop)
    u_mm, v_mm = landed_mm[:, passing]
    ends_mm = (np.arange(samples + 1) - samples / 2) * pitch_um * 1e-3
    return np.histogram2d(v_mm, u_mm, [ends_mm, ends_mm])[0] / np.count_nonzero(passing)


def psfs(rays, height_mm, depth_mm, focus_mm, pitch_um, samples):
    """PSFs by diffraction, at a depth and in focus, and by rays, over the band: arrays (wavelength, v, u)."""
    arguments = [(rays, nm, height_mm, depth_mm, pitch_um, samples) for nm in BAND_NM]
    return (np.array([psf_at_depth(*each) for each in arguments]),
            np.array([psf_at_depth(rays, nm, height_mm, focus_mm, pitch_um, samples) for nm in BAND_NM]),
            np.array([psf_of_rays(*each) for each in arguments]))


def defocused(lens, pitch_um, waves):
    """Blur in pixels, and the depth in mm, for a number of waves."""
    blur = waves * 8e-3 * BAND_NM[MIDDLE] * lens.f_number_effective / pitch_um
    return blur, 1 / (focus_nearness(lens) + blur / blur_per_nearness_px(lens, pitch_um))


def off(psf, truth, lamp_px):
    return np.abs(fftconvolve(psf - truth, np.full((lamp_px, lamp_px), lamp_px**-2))).sum()


def row(lens, rays, pitch_um, waves):
    (blur, depth_mm), (_, focus_mm) = defocused(lens, pitch_um, waves), defocused(lens, pitch_um, 0)
    samples = 2 * int(blur * (1 + 0.75 / waves) + 16) + 1
    in_focus = float(focus_share(blur, focus_range_px(lens, pitch_um)))
    errors = []
    for share in SHARES:
        truth, focus, by_rays = psfs(rays, share * rays.last_height_mm, depth_mm, focus_mm, pitch_um, samples)
        blend = in_focus * focus + (1 - in_focus) * by_rays
        errors.append([[*(off(each[MIDDLE], truth[MIDDLE], lamp) for each in (focus, by_rays, blend)),
                        off(blend.mean(axis=0), truth.mean(axis=0), lamp)] for lamp in LAMPS])
    texts = [" ".join(f"{each:5.2f}" for each in lamp) for lamp in np.max(errors, axis=0)]
    return f"{waves:6.3f} waves {blur:6.2f} px {in_focus:5.2f}   " + "   ".join(texts)


def print_table(lens, pitch_um):
    rays = lens_rays(lens)
    print(f"\n{lens.name} at f/{lens.f_number_effective:.2g}, {pitch_um:.3g} um; focus, rays, blend, in the band: "
          + ", ".join(f"{lamp} px" for lamp in LAMPS), flush=True)
    for waves in WAVES:
        print(row(lens, rays, pitch_um, waves), flush=True)
    for waves in (1, 32):
        print(f"a PSF of 65 x 65 at {waves} waves: {1e3 * seconds(lens, rays, pitch_um, waves):.0f} ms")


def seconds(lens, rays, pitch_um, waves):
    """Processor seconds for one PSF: the minimum of several runs."""
    (_, depth_mm), taken = defocused(lens, pitch_um, waves), []
    for _ in range(REPEATS):
        start = time.process_time()
        psf_at_depth(rays, BAND_NM[MIDDLE], 0.5 * rays.last_height_mm, depth_mm, pitch_um, 65)
        taken.append(time.process_time() - start)
    return min(taken)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", default=CASES, metavar="LENS:WIDTH_MM:PIXELS[:F,...]",
                        help="focused at 2 m if f-numbers are given (default: %(default)s)")
    print(machine())
    for case in parser.parse_args().cases:
        name, width_mm, pixels, *stops = case.split(":")
        pitch_um = 1e3 * float(width_mm) / int(pixels)
        for stop in stops[0].split(",") if stops else [None]:
            print_table(load_lens(name, Rings(FOCUS_MM, float(stop)) if stop else AT_REST, "preview"), pitch_um)


if __name__ == "__main__":
    main()
