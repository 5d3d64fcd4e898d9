"""Work that drawing does not wait for: facts and bakes of lenses, tables of views, the cost of a render, sheets.

The engine's threads do it, without Blender's data. While any is awaited, a timer redraws the panels when it progresses,
and the viewports too when it ends.
"""

import bpy

from lensfield.engine.runtime import background_work
from lensfield.engine.runtime.background_work import Work
from lensfield.engine.runtime.waiting import Flag

from .areas import areas, redraw_panels

TICK_S = 0.05

_awaited: set[Work] = set()
_progressed = Flag()


class Worker(background_work.Worker):
    """The engine's threads for one kind of work, whose end redraws the window."""

    def run(self, function, *arguments) -> Work:
        work = super().run(function, *arguments)
        if not bpy.app.background:
            _awaited.add(work)
            if not bpy.app.timers.is_registered(_tick):
                bpy.app.timers.register(_tick, first_interval=TICK_S, persistent=True)
        return work


class Answers(background_work.Answers):
    """The engine's Answers, by a Worker of their own."""

    def __init__(self, function, most):
        super().__init__(function, most, Worker(function.__name__))


def note_progress():
    """Let the panels show how far some work is; for the work's thread."""
    _progressed.set()


def forget_work():
    """Do not redraw for any work that is awaited."""
    _awaited.clear()
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


def _tick():
    """Returns the seconds until the next call; None when no work is awaited."""
    ended = {work for work in _awaited if work.done()}
    _awaited.difference_update(ended)
    if ended:
        for area in areas("PROPERTIES", "VIEW_3D"):
            area.tag_redraw()
    elif _progressed.is_set():
        redraw_panels()
    _progressed.clear()
    return TICK_S if _awaited else None
