"""Progress of Blender's current render, from its handlers."""

import re
from contextlib import contextmanager, suppress

import bpy

from ...engine.runtime.errors import Stopped

SAMPLES = re.compile(r"Sample (\d+)/(\d+)")


@contextmanager
def samples_watched(on_progress):
    """Call on_progress(fraction of the samples) during a blocking render, in background mode.

    In the user interface, a handler of render statistics deadlocks Blender: its render thread waits for Python while
    the main thread, in Python, waits for the render.
    """
    def on_stats(text, *_):
        match = SAMPLES.search(text)
        if match:
            with suppress(Stopped):  # a handler cannot stop the render: the next step does
                on_progress(int(match[1]) / max(int(match[2]), 1))

    if bpy.app.background:
        bpy.app.handlers.render_stats.append(on_stats)
    try:
        yield
    finally:
        if bpy.app.background:
            bpy.app.handlers.render_stats.remove(on_stats)
