"""Work that drawing does not wait for: facts and bakes of lenses, tables of views, the cost of a render, sheets.

Threads do it. While any is awaited, a timer redraws the panels when it progresses, and the viewports too when it ends.
"""

import traceback
from concurrent.futures import Future, ThreadPoolExecutor
from threading import Event

import bpy

from ....engine.runtime.errors import InputError, LensError, Stopped
from .areas import areas, redraw_panels

TICK_S = 0.05

_awaited: set[Future] = set()
_progressed = Event()


class Worker:
    """Threads for one kind of work, which begins in the order of its requests."""

    def __init__(self, kind, threads=1):
        self._pool = ThreadPoolExecutor(threads, f"Lensfield {kind}")

    def run(self, function, *arguments) -> Future:
        """The Future of a function's result. Its error, if any, is an InputError, or Stopped."""
        future = self._pool.submit(_run, function, *arguments)
        if not bpy.app.background:
            _awaited.add(future)
            if not bpy.app.timers.is_registered(_tick):
                bpy.app.timers.register(_tick, first_interval=TICK_S, persistent=True)
        return future


class Answers:
    """What a function of hashable arguments returns, for the newest questions.

    Parameters
    ----------
    function : callable
    most : int
        Number of answers to keep. A new question drops older ones that no thread has begun.
    """

    def __init__(self, function, most):
        self._function, self._most = function, most
        self._worker, self._futures = Worker(function.__name__), {}

    def to(self, *question) -> Future:
        """The Future of the answer to a question."""
        if question not in self._futures:
            for older, future in list(self._futures.items()):
                if future.cancel() or len(self._futures) >= self._most:
                    self._futures.pop(older)
            self._futures[question] = self._worker.run(self._function, *question)
        return self._futures[question]

    def forget(self):
        """Drop all questions and answers."""
        for future in self._futures.values():
            future.cancel()
        self._futures.clear()

    @property
    def newest(self) -> Future:
        """The answer to the newest question."""
        return next(reversed(self._futures.values()))


def result(future: Future):
    """The result of work, which is awaited; raises its error."""
    if error := future.exception():
        raise error.with_traceback(None)  # the traceback would grow with each redraw
    return future.result()


def note_progress():
    """Let the panels show how far some work is; for the work's thread."""
    _progressed.set()


def forget_work():
    """Do not redraw for any work that is awaited."""
    _awaited.clear()
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


def _run(function, *arguments):
    try:
        return function(*arguments)
    except (InputError, Stopped):
        raise
    except Exception as error:
        traceback.print_exc()  # in a thread, it would be lost
        raise LensError("this lens", "result", f"not available ({type(error).__name__})", str(error)) from None


def _tick():
    """Returns the seconds until the next call; None when no work is awaited."""
    ended = {future for future in _awaited if future.done()}
    _awaited.difference_update(ended)
    if ended:
        for area in areas("PROPERTIES", "VIEW_3D"):
            area.tag_redraw()
    elif _progressed.is_set():
        redraw_panels()
    _progressed.clear()
    return TICK_S if _awaited else None
