"""Work that one thread does ahead of its use, while its caller waits for something else."""

from collections.abc import Iterator
from threading import Event, Thread
from types import TracebackType
from typing import Self


class Ahead:
    """A thread that takes steps, one after the other, for a `with` block, whose end stops them.

    Steps leave their results in caches, which the block must not use until `wait` or `stop` has returned.
    """

    def __init__(self) -> None:
        self._thread: Thread | None = None
        self._stopped = Event()
        self._error: BaseException | None = None

    def begin(self, steps: Iterator[object]) -> None:
        """Begin to take steps, in place of earlier ones."""
        self.stop()
        self._stopped = Event()
        self._thread = Thread(target=self._take, args=(steps,), name="Lensfield ahead", daemon=True)
        self._thread.start()

    def wait(self) -> None:
        """Wait for the last step, and raise the error that ended the steps, if any."""
        self._end()
        error, self._error = self._error, None
        if error is not None:
            raise error

    def stop(self) -> None:
        """End the steps after the present one, without an error."""
        self._stopped.set()
        self._end()
        self._error = None

    def _end(self):
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _take(self, steps):
        try:
            for _ in steps:
                if self._stopped.is_set():
                    return
        except BaseException as error:  # for the thread that needs the work
            self._error = error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.stop()
