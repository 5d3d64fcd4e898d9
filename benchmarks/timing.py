"""Timing in processor seconds, cold runs of the engine, and a description of the machine.

Processor seconds are the sum over all threads, so other load on the machine hardly changes them. A cold run starts from
the lens data and computes the plan, the PSFs and the OTFs; modules are already imported, and no file is read.
"""

import os
import platform
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy

from lensfield.engine import ChannelCache, Lens, Options, Report, SpectralImage, simulate
from lensfield.engine.kernels.library import available, running
from lensfield.engine.runtime.threads import thread_count

LENSFIELD = [sys.executable, "-c", "from lensfield.cli import console; console()"]
"""The command line of `lensfield`."""


def without_cache() -> None:
    """From now on, read no plans and no lens data from the disk, in this process and its children."""
    os.environ["LENSFIELD_CACHE"] = "off"


@dataclass(frozen=True, eq=False)
class Run:
    """Result and times of a picture and of the frames after it, if any, which use the first one's cached channels.

    `processor_s` and `waited_s` are processor and wall-clock seconds of the first frame, `later_s` are processor
    seconds of the last.
    """

    irradiance: SpectralImage
    report: Report
    processor_s: float
    waited_s: float
    later_s: float


def cold_run(radiance: SpectralImage, lens: Lens, options: Options, frames: int = 1,
             out: np.ndarray | None = None) -> Run:
    """Filter a picture `frames` times from a cold start."""
    lens, report = replace(lens), Report()
    cache = ChannelCache() if frames > 1 else None
    seconds = []
    for _ in range(frames):
        begin_s, begin_processor_s = time.perf_counter(), time.process_time()
        result = simulate(radiance, lens, options, report=report, cache=cache, out=out)
        seconds.append((time.process_time() - begin_processor_s, time.perf_counter() - begin_s))
    return Run(result, report, *seconds[0], seconds[-1][0])


def quickest(radiance: SpectralImage, lens: Lens, options: Options, best_of: int = 3, frames: int = 1,
             out: np.ndarray | None = None) -> Run:
    """The fastest of several cold runs."""
    return min((cold_run(radiance, lens, options, frames, out) for _ in range(best_of)),
               key=lambda run: run.processor_s)


def least_s(function: Callable[[], object], best_of: int) -> tuple[float, float]:
    """Minimum processor seconds and wall-clock seconds of several calls of a function."""
    seconds = []
    for _ in range(best_of):
        begin_s, begin_processor_s = time.perf_counter(), time.process_time()
        function()
        seconds.append((time.process_time() - begin_processor_s, time.perf_counter() - begin_s))
    processor_s, waited_s = (min(each) for each in zip(*seconds, strict=True))
    return processor_s, waited_s


def children_s(work: Callable[[], object]) -> float:
    """Processor seconds of all child processes that end during a call of `work`."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    work()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def marked(text: str, missed: bool) -> str:
    """A figure with a mark if it misses its target."""
    return f"{text}{'!' if missed else ' '}"


def machine() -> str:
    """Description of the machine, its load, and the versions in use."""
    return (f"{_processor()}, {thread_count()} cores, load {os.getloadavg()[0]:.1f}; "
            f"loops by {running()} (of {', '.join(available())}); "
            f"Python {platform.python_version()}, numpy {np.__version__}, scipy {scipy.__version__}")


def _processor():
    """The processor's name, if the system provides it."""
    info = Path("/proc/cpuinfo")
    names = [line.partition(":")[2].strip() for line in info.read_text().splitlines() if line.startswith("model name")
             ] if info.exists() else []
    return f"{platform.machine()} ({names[0]})" if names else platform.machine()
