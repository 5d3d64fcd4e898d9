"""What a way of filtering will cost: seconds and memory, from counts of the work and a short look at the machine."""

import time

import numpy as np
from scipy import fft

from ..blur.method import Workload
from .plan import Plan

# Nanoseconds on an x86-64 machine of two cores, fitted by benchmarks/calibrate_cost.py; `machine_factor` brings them to
# the machine at hand.
NANOSECONDS = {
    "picture pixel": 65,  # distortion, relative illumination, joining the planes, cutting out the frame
    "step": 3.9e5,  # whatever its size
    "transformed value": 1.0,  # and doubling of the space
    "spectrum value": 1.7,  # weighed, filtered and summed
    "patch pixel": 6.6,  # added to the others
    "tap": 2.7,  # of a pixel's PSF
    "mixed tap": 0.5,  # of a PSF that is mixed from a table
    "turned sample": 65,  # of a PSF
    "table sample": 90,  # of a PSF, at one azimuth, for all heights
    "table tap": 4.7,  # at one azimuth and height, at every wavelength
}
REFERENCE_S, RUNS = 2.8e-4, 6  # of what `machine_factor` runs, there
MEGABYTE = 1e6
OF_SPECTRA, DOUBLE_SLOWNESS = {"transformed value", "spectrum value"}, 1.9  # of double precision
PICTURES, TABLES = 6, 3  # of their size at once


LOOKS, LOOK_AGAIN_S = 8, 1.0
_looks: tuple[tuple[float, float], ...] = ()  # when, and what was found


def machine_factor() -> float:
    """How much slower this machine is than the one of the constants: the least that its last looks have found.

    It looks again whenever some time has gone by, so that what a burst of load has slowed does not stay.
    """
    global _looks
    now_s = time.monotonic()
    if not _looks or now_s - _looks[-1][0] > LOOK_AGAIN_S:
        _looks = (*_looks[1 - LOOKS:], (now_s, _look()))
    return min(found for _, found in _looks)


def _look():
    """The quickest of some short runs, of which other programs can hardly interrupt every one."""
    rng = np.random.default_rng(0)
    spaces, light = rng.random((6, 96, 96), dtype=np.float32), rng.random(1 << 14, dtype=np.float32)
    best = np.inf
    for _ in range(RUNS):
        begin = time.perf_counter()
        fft.irfft2(fft.rfft2(spaces))
        for _ in range(20):
            light * light
        best = min(best, time.perf_counter() - begin)
    return best / REFERENCE_S


def counts(work: Workload, plan: Plan) -> dict[str, float]:
    """How much of each kind of work a plan comes to at one wavelength: a dict with keys of NANOSECONDS."""
    azimuths = plan.method.azimuths * (1 if plan.folded else 2)
    common = {"picture pixel": work.pixels, "table sample": azimuths * work.samples * work.tables,
              "table tap": azimuths * work.heights * work.taps}
    own = plan.method.counts(work)
    slowness = DOUBLE_SLOWNESS if plan.single_range == 0 else 1.0
    return common | {name: count * (slowness if name in OF_SPECTRA else 1.0) for name, count in own.items()}


def nanoseconds(work: Workload, plan: Plan) -> float:
    """Work that a plan comes to at one wavelength, on the machine of the constants: what plans are chosen by, so that
    every machine chooses the same."""
    return sum(NANOSECONDS[name] * count for name, count in counts(work, plan).items())


def seconds(work: Workload, plan: Plan) -> float:
    """Seconds that a plan will take at one wavelength, on this machine."""
    return machine_factor() * nanoseconds(work, plan) * 1e-9


def memory_mb(work: Workload, plan: Plan) -> float:
    """Memory beyond radiance and irradiance, with one wavelength in work."""
    table = work.heights * 2 * work.planes.quarter_turns * plan.method.azimuths * work.taps
    values = PICTURES * work.pixels + TABLES * table + plan.method.kept_values(work)
    return values * np.dtype(plan.precision).itemsize / MEGABYTE
