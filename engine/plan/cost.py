"""Predict the seconds and memory of a method, from counts of its work and a short speed test of the machine."""

import time
from dataclasses import replace

import numpy as np
import scipy

from ..blur.method import Workload
from ..kernels.library import NUMPY, running
from ..runtime.memory import check_room, taken_bytes
from ..runtime.threads import thread_count
from .plan import Plan

COMPILED = "compiled"
# Processor nanoseconds of each kind of work: the part of a single thread, and the part that all threads share. Fitted
# by benchmarks/figures.py cost on an AMD EPYC with two cores; `machine_factor` converts them to this machine.
NANOSECONDS = {
    NUMPY: {
        "wavelength": (3.8e6, 6.9e6),  # independent of its size
        "picture pixel": (13, 46),  # distortion, relative illumination, joining the planes, cutting out the frame
        "window sample": (13, 0),  # of a complete PSF: interpolated, trimmed, normalised
        "table sample": (2.9, 63),  # of a PSF, at one azimuth, for all heights
        "table pixel": (0, 0),  # of the square of a PSF, at one azimuth and height, mixed between wavelengths
        "table tap": (1.6, 1.7),  # of a PSF, at one azimuth and height
        "step": (3e4, 1.9e5),  # of a section, or a row of them
        "transformed value": (0.027, 0.71),  # times log2 of the side of the space
        "spectrum value": (0, 0),  # weighted, filtered and summed
        "tap": (0, 1.1),  # of a pixel's PSF
        "mixed tap": (0, 0.57),  # of a PSF that is mixed from a table
        "tap of a run": (0, 9e3),  # of pixels that are processed together
        "turned sample": (1.3, 44),  # of a PSF that is turned for one place
        "grid node": (5e4, 6.4e4),  # of lens data without rotational symmetry: interpolated, unfolded
        "grid pixel": (10, 17),  # of a plane, by the splines between nodes
    },
    COMPILED: {
        "wavelength": (3.7e6, 1.3e6),
        "picture pixel": (5.8, 13),
        "window sample": (5.7, 0.37),
        "table sample": (2.3, 50),
        "table pixel": (7.8, 4.3),
        "table tap": (0.11, 0),
        "step": (1.3e4, 1.8e5),
        "transformed value": (0, 0.63),
        "spectrum value": (0.1, 0),
        "tap": (0.0066, 0.11),  # of a pixel's PSF, including its mixing
        "turned sample": (2, 34),
        "grid node": (5e4, 6.4e4),
        "grid pixel": (10, 17),
    },
}
LOOPS, SLOWNESS = ("tap", "table sample"), {"avx2": 1.5, "base": 2.4, "neon": 2.4}  # compared with AVX-512
REFERENCE_S, RUNS = 2.4e-4, 6  # time of `_look` on the machine of the constants, and its repetitions
MEGABYTE = 1e6
OF_SPECTRA, DOUBLE_SLOWNESS = {"transformed value", "spectrum value"}, 1.9  # time in double precision over single
PICTURES, TABLES = 6, 3  # arrays of their size in memory at the same time
LOOKS, LOOK_AGAIN_S = 8, 1.0
_looks: tuple[tuple[float, float], ...] = ()  # time and result of the last tests


def machine_factor() -> float:
    """This machine's time relative to that on the machine of the constants: the minimum of its last speed tests.

    The test is repeated after LOOK_AGAIN_S, so a burst of load has no lasting effect.
    """
    global _looks
    now_s = time.monotonic()
    if not _looks or now_s - _looks[-1][0] > LOOK_AGAIN_S:
        _looks = (*_looks[1 - LOOKS:], (now_s, _look()))
    return min(factor for _, factor in _looks)


def _look():
    """Relative time of the fastest of several short runs; other programs can hardly interrupt all of them."""
    rng = np.random.default_rng(0)
    spaces, light = rng.random((6, 96, 96), dtype=np.float32), rng.random(1 << 14, dtype=np.float32)
    best = np.inf
    for _ in range(RUNS):
        begin = time.perf_counter()
        scipy.fft.irfft2(scipy.fft.rfft2(spaces))
        for _ in range(20):
            light * light
        best = min(best, time.perf_counter() - begin)
    return best / REFERENCE_S


def counts(work: Workload, plan: Plan) -> dict[str, float]:
    """The amount of each kind of work of a plan at one wavelength: a dict with names of NANOSECONDS."""
    steps, tabulated = plan.method.azimuths, plan.method.tabulated
    turned, psfs = work.tables * work.layout.turned(steps) * tabulated, work.layout.psfs
    nodes = work.layout.nodes(steps, work.planes) * tabulated
    common = {"wavelength": 1, "picture pixel": work.pixels,
              "window sample": psfs * work.window_samples * (1 + (work.tables if tabulated else 0)),
              "table sample": turned * work.samples, "table tap": nodes * work.taps,
              "table pixel": turned * psfs * (2 * work.psf_radius_px) ** 2,
              **work.layout.extra_counts(work.pixels / work.planes.count)}
    method_counts = plan.method.counts(work)
    slowness = DOUBLE_SLOWNESS if plan.single_range == 0 else 1.0
    return common | {name: count * (slowness if name in OF_SPECTRA else 1.0) for name, count in method_counts.items()}


def nanoseconds(work: Workload, plan: Plan) -> float:
    """Processor nanoseconds at one wavelength, with compiled loops on the machine of the constants.

    Plans are chosen by this figure, so every machine chooses the same plan.
    """
    return sum(_alone_and_shared(work, plan, COMPILED))


def seconds(work: Workload, plan: Plan) -> float:
    """Wall-clock seconds for a wavelength on this machine, with its implementation of the loops and all its cores."""
    variant = running()
    alone, shared = _alone_and_shared(work, plan, NUMPY if variant == NUMPY else COMPILED, SLOWNESS.get(variant, 1.0))
    return machine_factor() * 1e-9 * (alone + shared / thread_count())


def _alone_and_shared(work, plan, loops, slowness=1.0):
    """Nanoseconds of a single thread, and shared by all threads. Compiled loops support only single precision."""
    nanoseconds = NANOSECONDS[loops if plan.precision == "float32" else NUMPY]
    alone = shared = 0.0
    for name, amount in counts(work, plan).items():
        alone_of_one, shared_of_one = nanoseconds.get(name, (0, 0))
        amount *= slowness if name in LOOPS else 1.0
        alone, shared = alone + alone_of_one * amount, shared + shared_of_one * amount
    return alone, shared


def memory_mb(work: Workload, plan: Plan) -> float:
    """Memory in addition to radiance and irradiance, with one wavelength processed at a time."""
    table = work.layout.nodes(plan.method.azimuths, work.planes) * plan.method.tabulated * work.taps
    values = PICTURES * work.pixels + TABLES * table + plan.method.cached_values(work)
    return values * np.dtype(plan.precision).itemsize / MEGABYTE


def in_process(plan: Plan, extra_bytes: float) -> Plan:
    """A plan with the predicted peak memory of this process: in use now, for filtering, and for other data.

    Raises
    ------
    ImageError
        If there is not enough memory.
    """
    to_come = plan.memory_mb * MEGABYTE + extra_bytes
    check_room("image", to_come, "give a smaller picture, larger pixels, a lower accuracy or fewer azimuths")
    return replace(plan, peak_mb=(taken_bytes() + to_come) / MEGABYTE)
