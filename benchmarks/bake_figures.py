"""What baking takes, and how far from the reference quality it is: some of the library in each quality.

    python benchmarks/bake_figures.py [--quality NAME] [LENS ...]
    python benchmarks/bake_figures.py --reference [LENS ...]

Seconds are the processor's, of all cores together, with 16 wavelengths and PSFs of 81 x 81. "Sums": light in the wrong
place (L1) of PSFs against the reference quality's, at the same heights, wavelengths and pitch. "Between": of PSFs half
way between two heights, interpolated, against those baked there; both on a picture 1920 pixels wide, mean and largest.

With --reference: how much of the light lies elsewhere once the reference quality itself takes twice as many rays along
each side and higher polynomials, twice as many parts of a sample, or repeats its sums twice as far away.
"""

import argparse
import time
from dataclasses import replace

import numpy as np
from timing import machine

from lensfield.engine.bake.bake import bake
from lensfield.engine.bake.diffraction import point_spread
from lensfield.engine.bake.focus import build_system
from lensfield.engine.bake.heights import even_heights_mm
from lensfield.engine.bake.prescriptions import read_prescription
from lensfield.engine.bake.quality import QUALITIES
from lensfield.engine.bake.rays import HalfPupil
from lensfield.engine.bake.wavefront import trace_wavefronts
from lensfield.engine.bake.window import needed_width_um, pitch_for_um
from lensfield.engine.errors import LensError
from lensfield.engine.library import BUNDLED

LENSES = ("angenieux-50mm", "apple-phone-4mm", "cooke-speed-panchro-35mm", "cooke-triplet-50mm", "edmund-54852",
          "kodak-petzval-100mm", "muller-fisheye-25mm", "nikkor-28mm", "tessar-50mm")
WAVELENGTHS_NM = (400, 410, 420, 430, 441, 453, 467, 482, 499, 518, 539, 562, 588, 618, 655, 700)
SEEN = slice(1, None, 7)  # of the wavelengths, where PSFs are compared
PLACES = 6
SAMPLES = 81
PICTURE_PX = 1920
REFERENCE_HEIGHTS, REFERENCE_NM = 4, (420.0, 620.0)
MORE_DEGREES = 6


def psfs_at(system, heights_mm, wavelengths_nm, pitch_um, quality):
    """PSFs of unit sum: array (wavelength, height, v, u)."""
    wavefronts = trace_wavefronts(system, heights_mm, wavelengths_nm, quality.pupil)
    psfs = np.array([[point_spread(wavefronts.one(wavelength, height), pitch_um, SAMPLES, quality.sums)
                      for height in range(len(heights_mm))] for wavelength in range(len(wavelengths_nm))])
    return psfs / psfs.sum(axis=(2, 3), keepdims=True)


def misplaced(lens, ours, theirs):
    """Mean and largest L1 in percent, on pixels of a picture 1920 wide."""
    group = max(1, round(lens.sensor_mm[0] * 1e3 / PICTURE_PX / lens.psf_pitch_um))
    side = SAMPLES // group * group
    off = (ours - theirs)[..., :side, :side].reshape(*ours.shape[:2], side // group, group, side // group, group)
    share = 100 * np.abs(off.sum(axis=(3, 5))).sum(axis=(2, 3))
    return f"{share.mean():5.2f} / {share.max():5.2f} %"


def figures(path, name):
    prescription, quality = read_prescription(path), QUALITIES[name]
    start = time.process_time()
    lens = bake(prescription, quality=name, wavelengths_nm=WAVELENGTHS_NM, samples=SAMPLES)
    took = time.process_time() - start
    system = build_system(prescription)
    nm, at = lens.wavelengths_nm[SEEN], np.linspace(0, lens.heights_mm.size - 1, PLACES).round().astype(int)
    psf = lens.psf[SEEN].astype(float)
    sums = misplaced(lens, psf[:, at], psfs_at(system, lens.heights_mm[at], nm, lens.psf_pitch_um,
                                               QUALITIES["reference"]))
    middle_mm = (lens.heights_mm[1:] + lens.heights_mm[:-1]) / 2
    between = misplaced(lens, (psf[:, 1:] + psf[:, :-1]) / 2,
                        psfs_at(system, middle_mm, nm, lens.psf_pitch_um, quality))
    return f"{path.stem:20s} {name:9s} {lens.heights_mm.size:2d} heights: {took:6.1f} s; sums {sums}, between {between}"


def reference_figures(path):
    """The reference quality against finer ones."""
    reference, system = QUALITIES["reference"], build_system(read_prescription(path))
    heights_mm, sums = even_heights_mm(system, REFERENCE_HEIGHTS), reference.sums
    wavefronts = trace_wavefronts(system, heights_mm, REFERENCE_NM, reference.pupil)
    pitch_um = pitch_for_um(needed_width_um(wavefronts, sums), SAMPLES)
    ours = psfs_at(system, heights_mm, REFERENCE_NM, pitch_um, reference)
    radii, azimuths = reference.pupil.shape
    finer = {"rays": replace(reference, pupil=HalfPupil(2 * radii - 1, 2 * azimuths - 1),
                             sums=replace(sums, degree=sums.degree + MORE_DEGREES)),
             "parts": replace(reference, sums=replace(sums, oversampling=2 * sums.oversampling)),
             "repeat": replace(reference, sums=replace(sums, repeat=2 * sums.repeat))}
    said = []
    for name, quality in finer.items():
        try:
            off = np.abs(ours - psfs_at(system, heights_mm, REFERENCE_NM, pitch_um, quality)).sum(axis=(2, 3))
        except LensError:  # too large a sum, of a fast lens
            said.append(f"{name} not to be had")
        else:
            said.append(f"{name} {100 * off.mean():.3f} / {100 * off.max():.3f} %")
    return f"{path.stem:26s} reference: " + ", ".join(said)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quality", choices=QUALITIES, help="default: preview and standard")
    parser.add_argument("--reference", action="store_true", help="how good that quality is itself")
    parser.add_argument("lenses", nargs="*", metavar="LENS", default=LENSES, help="default: %(default)s")
    asked = parser.parse_args()
    print(machine())
    for path in [BUNDLED / "prescriptions" / f"{lens}.toml" for lens in asked.lenses]:
        if asked.reference:
            print(reference_figures(path), flush=True)
            continue
        for name in [asked.quality] if asked.quality else ("preview", "standard"):
            print(figures(path, name), flush=True)


if __name__ == "__main__":
    main()
