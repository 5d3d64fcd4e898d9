"""What baking takes: the paper's lens at 21 heights and 31 wavelengths, and one PSF summed up in two ways.

    make bench-bake
"""

import os
import platform
import time

import numpy as np

from lensfield.engine.bake.bake import bake
from lensfield.engine.bake.build import build_system
from lensfield.engine.bake.diffraction import point_spread
from lensfield.engine.bake.prescriptions import read_prescription
from lensfield.engine.bake.wavefront import sample_pupil, trace_wavefronts
from lensfield.engine.lens.readers import BUNDLED

PITCH_UM, SAMPLES = 0.4, 65
PUPIL = (96, 128)  # the quadrature that the window of the PSF asks for, for the sum done plainly


def seconds(function, repeats=5):
    """Least time of some calls, and the last one's result."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        result = function()
        times.append(time.perf_counter() - start)
    return min(times), result


def plain_sum(wavefront):
    """The same PSF by a product of matrices: every plane wave at every sample."""
    pupil = sample_pupil(wavefront, *PUPIL)
    offset = 2 * np.pi * PITCH_UM / (wavefront.wavelength_nm * 1e-3) * (np.arange(SAMPLES) - SAMPLES // 2)
    amplitude = (np.sqrt(pupil.source_area * pupil.cosine_area) * np.exp(-2j * np.pi * pupil.path)).ravel()
    rows = np.exp(-1j * np.outer(offset, pupil.cosine_y.ravel())) * amplitude
    columns = np.exp(-1j * np.outer(offset, pupil.cosine_x.ravel()))
    field = rows @ columns.T + rows @ columns.conj().T
    return np.abs(field) ** 2


def main():
    prescription = read_prescription(BUNDLED / "prescriptions" / "edmund-54852.toml")
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, numpy {np.__version__}")
    wavefront, = trace_wavefronts(build_system(prescription), 1.5, [550.0])
    plain, expected = seconds(lambda: plain_sum(wavefront))
    ours, (psf, _) = seconds(lambda: point_spread(wavefront, PITCH_UM, SAMPLES))
    difference = np.abs(psf / psf.sum() - expected / expected.sum()).sum()
    print(f"one PSF of {SAMPLES} x {SAMPLES}: {ours * 1e3:.0f} ms; by a product of matrices {plain / ours:.1f} times "
          f"that, different by {difference:.1e} of the light")
    start = time.perf_counter()
    lens = bake(prescription)
    took = time.perf_counter() - start
    print(f"{prescription.name}, 21 heights x 31 wavelengths: {took:.0f} s with its start, "
          f"{took / 651 / ours:.1f} times what 651 such PSFs take on one core")
    print(f"  pitch {lens.psf_pitch_um:g} um, at least {lens.enclosed_energy.min():.2%} of the light inside")


if __name__ == "__main__":
    main()
