"""The threads that the engine works with: one for each core that the process may use."""

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import lru_cache


def thread_count() -> int:
    """How many cores the process may use: of a machine's, those that taskset or a batch system left to it."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def thread_pool() -> Iterator[ThreadPoolExecutor]:
    """A pool of so many threads, to be used in a `with` block. numpy and scipy.fft let them work side by side.

    It is the same one each time, for threads are not for nothing: the C library keeps what a thread has freed for that
    thread. So nothing that works in it may use it in turn and wait.
    """
    yield _pool(os.getpid(), thread_count())


@lru_cache(maxsize=1)
def _pool(process_id, count):
    """Of one process: a forked one has none of its parent's threads."""
    return ThreadPoolExecutor(count, "Lensfield")
