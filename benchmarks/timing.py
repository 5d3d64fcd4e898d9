"""How the engine is timed: cold, by the processor's seconds, and what machine that was on.

Processor seconds are those of all threads together, so that a machine that is busy with something else hardly changes
them. Cold is a lens fresh from its data, with its plan, PSFs and OTFs; but modules are imported, and no file is read.
"""

import os
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy

from lensfield.engine import Kept, Lens, Options, Report, SpectralImage, simulate
from lensfield.engine.threads import thread_count

os.environ["LENSFIELD_CACHE"] = "off"  # no plan is remembered


@dataclass(frozen=True, eq=False)
class Run:
    """What came of a picture and of the frames after it, if any, with what the first has kept for them.

    `processor_s` and `waited_s` are of the first, `later_s` are the processor's of the last.
    """

    irradiance: SpectralImage
    report: Report
    processor_s: float
    waited_s: float
    later_s: float


def cold_run(radiance: SpectralImage, lens: Lens, options: Options, frames: int = 1,
             out: np.ndarray | None = None) -> Run:
    """Filter a picture so many times."""
    lens, report = replace(lens), Report()
    kept = Kept() if frames > 1 else None
    seconds = []
    for _ in range(frames):
        begin_s, begin_processor_s = time.perf_counter(), time.process_time()
        result = simulate(radiance, lens, options, report=report, kept=kept, out=out)
        seconds.append((time.process_time() - begin_processor_s, time.perf_counter() - begin_s))
    return Run(result, report, *seconds[0], seconds[-1][0])


def quickest(radiance: SpectralImage, lens: Lens, options: Options, best_of: int = 3, frames: int = 1,
             out: np.ndarray | None = None) -> Run:
    """The quickest of some cold runs."""
    return min((cold_run(radiance, lens, options, frames, out) for _ in range(best_of)),
               key=lambda run: run.processor_s)


def least_s(function: Callable[[], object], best_of: int) -> tuple[float, float]:
    """The least seconds of the processor, and on the clock, of some calls of a function."""
    seconds = []
    for _ in range(best_of):
        begin_s, begin_processor_s = time.perf_counter(), time.process_time()
        function()
        seconds.append((time.process_time() - begin_processor_s, time.perf_counter() - begin_s))
    processor_s, waited_s = (min(each) for each in zip(*seconds, strict=True))
    return processor_s, waited_s


def multiply_adds_per_s() -> float:
    """How many this core does whose values come from the cache, one for each: numpy's product of matrix and vector."""
    matrix = np.random.default_rng(0).random((128, 512), dtype=np.float32)
    vector, repeats = matrix[0].copy(), 1000
    return repeats * matrix.size / least_s(lambda: [matrix @ vector for _ in range(repeats)], 20)[0]


def machine() -> str:
    """What the figures were taken on, and how busy it is."""
    return (f"{_processor()}, {thread_count()} cores, load {os.getloadavg()[0]:.1f}; loops by {loops()}; "
            f"Python {platform.python_version()}, numpy {np.__version__}, scipy {scipy.__version__}")


def loops() -> str:
    """What runs the engine's innermost loops, and what could."""
    try:
        from lensfield.engine import kernels
    except ImportError:  # the engine before there were any
        return "numpy"
    return f"{kernels.running()} (of {', '.join(kernels.available())})"


def _processor():
    """The processor's name, where the system tells."""
    info = Path("/proc/cpuinfo")
    names = [line.partition(":")[2].strip() for line in info.read_text().splitlines() if line.startswith("model name")
             ] if info.exists() else []
    return f"{platform.machine()} ({names[0]})" if names else platform.machine()
