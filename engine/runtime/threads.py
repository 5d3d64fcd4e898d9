"""The engine's threads: one for each core that the process may use."""

import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import lru_cache


def thread_count() -> int:
    """Number of cores that the process may use, as restricted by taskset or a batch system."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def in_main_thread() -> bool:
    """Whether the caller runs in the process's first thread."""
    return threading.current_thread() is threading.main_thread()


@contextmanager
def thread_pool() -> Iterator[ThreadPoolExecutor]:
    """A pool of `thread_count` threads, for a `with` block. numpy and scipy.fft run in parallel in them.

    Every call yields the same pool, because threads have a cost: the C library reserves the memory that a thread has
    freed for that thread. Work that runs in the pool must therefore not submit to it and wait.
    """
    yield _pool(os.getpid(), thread_count())


def in_bands(work: Callable[[slice], object], length: int, step: int) -> None:
    """Call a function for each of the bands that a length is divided into, in parallel."""
    step = max(1, step)
    with thread_pool() as pool:
        list(pool.map(work, (slice(start, min(start + step, length)) for start in range(0, length, step))))


@lru_cache(maxsize=1)
def _pool(process_id, count):
    """The pool of one process: a forked process does not inherit its parent's threads."""
    return ThreadPoolExecutor(count, "Lensfield")
