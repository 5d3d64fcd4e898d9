"""The threads that the engine works with: one for each core that the process may use."""

import os
from concurrent.futures import ThreadPoolExecutor


def thread_count() -> int:
    """How many cores the process may use: of a machine's, those that taskset or a batch system left to it."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def thread_pool() -> ThreadPoolExecutor:
    """A pool of so many threads, to be used in a `with` block. numpy and scipy.fft let them work side by side."""
    return ThreadPoolExecutor(thread_count())
