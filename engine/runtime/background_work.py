"""Work in threads, for a caller that must not wait for it, such as a window that draws its panels."""

import traceback
from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from threading import Lock
from typing import Any

from .errors import InputError, LensError, Stopped


class Work:
    """A call of a function in a thread: its result, or its error, once the call has ended."""

    def __init__(self, future: Future) -> None:
        self._future = future

    def done(self) -> bool:
        """Whether the call has ended."""
        return self._future.done()

    def cancel(self) -> bool:
        """Drop the call, unless a thread has begun it; returns whether it is dropped."""
        return self._future.cancel()

    def wait(self, longest_s: float | None = None) -> None:
        """Wait until the call has ended, or at most this time."""
        wait([self._future], longest_s)

    def exception(self, longest_s: float | None = None) -> BaseException | None:
        """The error of the call, or None, when it has ended.

        Raises
        ------
        TimeoutError
            It has not ended within this time.
        """
        return self._future.exception(longest_s)

    def result(self, longest_s: float | None = None) -> Any:
        """The result of the call, when it has ended; raises its error, or a TimeoutError as `exception` does."""
        if error := self.exception(longest_s):
            raise error.with_traceback(None)  # the traceback would grow with each call of this method
        return self._future.result()


class Worker:
    """Threads for one kind of work, which begins in the order of its requests."""

    def __init__(self, kind: str, threads: int = 1) -> None:
        self._pool = ThreadPoolExecutor(threads, f"Lensfield {kind}")

    def run(self, function: Callable[..., object], *arguments: object) -> Work:
        """Begin to call a function. The error of the Work, if any, is an InputError, or Stopped."""
        return Work(self._pool.submit(_run, function, *arguments))


class Answers:
    """What a function of hashable arguments returns, for the newest questions.

    Parameters
    ----------
    function : callable
    most : int
        Number of answers to keep. A new question drops older ones that no thread has begun.
    worker : Worker
    """

    def __init__(self, function: Callable[..., object], most: int, worker: Worker) -> None:
        self._function, self._most, self._worker = function, most, worker
        self._works: dict[tuple[Hashable, ...], Work] = {}

    def to(self, *question: Hashable) -> Work:
        """The Work of the answer to a question."""
        if question not in self._works:
            for older, work in list(self._works.items()):
                if work.cancel() or len(self._works) >= self._most:
                    self._works.pop(older)
            self._works[question] = self._worker.run(self._function, *question)
        return self._works[question]

    def forget(self) -> None:
        """Drop all questions and answers."""
        for work in self._works.values():
            work.cancel()
        self._works.clear()

    @property
    def newest(self) -> Work:
        """The answer to the newest question."""
        return next(reversed(self._works.values()))


class Newest:
    """A cache of the values that were stored last, which several threads may use at once.

    Parameters
    ----------
    most : int
        Number of values to keep.
    """

    def __init__(self, most: int) -> None:
        self._most, self._lock = most, Lock()
        self._values: dict[Hashable, Any] = {}  # the newest at the end

    def get(self, key: Hashable) -> Any:
        """The value of a key; None without one."""
        return self._values.get(key)

    def store(self, key: Hashable, value: object) -> None:
        """Store a value as the newest one, and drop the oldest if there are too many."""
        with self._lock:
            self._values.pop(key, None)
            self._values[key] = value
            if len(self._values) > self._most:
                self._values.pop(next(iter(self._values)))

    def clear(self) -> None:
        """Drop all values."""
        with self._lock:
            self._values.clear()


def _run(function, *arguments):
    try:
        return function(*arguments)
    except (InputError, Stopped):
        raise
    except Exception as error:
        traceback.print_exc()  # in a thread, it would be lost
        raise LensError("this lens", "result", f"not available ({type(error).__name__})", str(error)) from None
