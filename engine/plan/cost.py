"""What a way of filtering will cost: seconds and memory, from counts of the work and a short look at the machine."""

import time
from dataclasses import replace

import numpy as np
from scipy import fft

from .. import kernels
from ..blur.method import Workload
from ..memory import check_room, taken_bytes
from ..threads import thread_count
from .plan import Plan

COMPILED = "compiled"
# Processor nanoseconds that each thing takes, what one thread does alone and what all threads share, fitted by
# benchmarks/calibrate_cost.py on an AMD EPYC of two cores; `machine_factor` brings them to the machine at hand.
NANOSECONDS = {
    kernels.NUMPY: {
        "wavelength": (3.8e6, 6.9e6),  # whatever its size
        "picture pixel": (13, 46),  # distortion, relative illumination, joining the planes, cutting out the frame
        "window sample": (13, 0),  # of a whole PSF: interpolated, trimmed, normalised
        "table sample": (2.9, 63),  # of a PSF, at one azimuth, for all heights
        "table pixel": (0, 0),  # of the square of a PSF, at one azimuth and height, mixed between wavelengths
        "table tap": (1.6, 1.7),  # of a PSF, at one azimuth and height
        "step": (3e4, 1.9e5),  # of a section, or a row of them
        "transformed value": (0.027, 0.71),  # and doubling of the space
        "spectrum value": (0, 0),  # weighed, filtered and summed
        "tap": (0, 1.1),  # of a pixel's PSF
        "mixed tap": (0, 0.57),  # of a PSF that is mixed from a table
        "tap of a run": (0, 9e3),  # of pixels that are done together
        "turned sample": (1.3, 44),  # of a PSF that is turned for one place
    },
    COMPILED: {
        "wavelength": (4.1e6, 6e6),
        "picture pixel": (16, 27),
        "window sample": (13, 0),
        "table sample": (0, 12),
        "table pixel": (4.6, 0),
        "table tap": (4.7, 5.5),
        "step": (3e4, 8.8e4),
        "transformed value": (0.02, 0.5),
        "spectrum value": (0, 3.5),
        "tap": (0, 0.1),  # of a pixel's PSF, mixed and all
        "turned sample": (0.93, 41),
    },
}
LOOPS, SLOWNESS = ("tap", "table sample"), {"avx2": 1.5, "base": 2.4, "neon": 2.4}  # beside AVX-512's
REFERENCE_S, RUNS = 2.4e-4, 6  # of what `machine_factor` runs, there
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
    """How much of each kind of work a plan comes to at one wavelength: a dict with names of NANOSECONDS."""
    azimuths = plan.method.azimuths
    turned = work.tables * azimuths * (1 if work.mirror_symmetric else 2)
    cells = 2 * work.planes.quarter_turns * azimuths * work.heights
    common = {"wavelength": 1, "picture pixel": work.pixels,
              "window sample": work.heights * work.window_samples * (1 + (work.tables if azimuths else 0)),
              "table sample": turned * work.samples, "table tap": cells * work.taps,
              "table pixel": turned * work.heights * (2 * work.psf_radius_px) ** 2}
    own = plan.method.counts(work)
    slowness = DOUBLE_SLOWNESS if plan.single_range == 0 else 1.0
    return common | {name: count * (slowness if name in OF_SPECTRA else 1.0) for name, count in own.items()}


def nanoseconds(work: Workload, plan: Plan) -> float:
    """Of a processor, at one wavelength, on the machine of the constants, where the loops are compiled: what plans are
    chosen by, so that every machine chooses the same."""
    return sum(_alone_and_shared(work, plan, COMPILED))


def seconds(work: Workload, plan: Plan) -> float:
    """What one waits for a wavelength on this machine, by what does its loops, on all its cores."""
    running = kernels.running()
    alone, shared = _alone_and_shared(work, plan, kernels.NUMPY if running == kernels.NUMPY else COMPILED,
                                      SLOWNESS.get(running, 1.0))
    return machine_factor() * 1e-9 * (alone + shared / thread_count())


def _alone_and_shared(work, plan, loops, slowness=1.0):
    """Nanoseconds of what one thread does, and of what all share. Compiled loops take single precision alone."""
    own = NANOSECONDS[loops if plan.precision == "float32" else kernels.NUMPY]
    done = counts(work, plan)
    return [sum(of_one[thread] * done.get(name, 0) * (slowness if name in LOOPS else 1.0)
                for name, of_one in own.items()) for thread in range(2)]


def memory_mb(work: Workload, plan: Plan) -> float:
    """Memory beyond radiance and irradiance, with one wavelength in work."""
    table = work.heights * 2 * work.planes.quarter_turns * plan.method.azimuths * work.taps
    values = PICTURES * work.pixels + TABLES * table + plan.method.kept_values(work)
    return values * np.dtype(plan.precision).itemsize / MEGABYTE


def in_process(plan: Plan, beside_bytes: float) -> Plan:
    """A plan with the most memory that this process will hold by it: what it holds by now, what filtering takes, and
    what will lie beside.

    Raises
    ------
    ImageError
        There is not as much.
    """
    to_come = plan.memory_mb * MEGABYTE + beside_bytes
    check_room("image", to_come, "give a smaller picture, larger pixels, a lower accuracy or fewer azimuths")
    return replace(plan, peak_mb=(taken_bytes() + to_come) / MEGABYTE)
