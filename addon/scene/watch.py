"""What Blender's render under way has come to, from its handlers."""

import re
from contextlib import contextmanager

import bpy

SAMPLES = re.compile(r"Sample (\d+)/(\d+)")


class RenderWatch:
    """How a render ended, while its `with` block lasts.

    Attributes
    ----------
    ended : None while a render goes on, then "complete" or "cancelled"
    """

    def __init__(self):
        self.ended = None

    def __enter__(self):
        bpy.app.handlers.render_complete.append(self._on_complete)
        bpy.app.handlers.render_cancel.append(self._on_cancel)
        return self

    def __exit__(self, *exception):
        bpy.app.handlers.render_complete.remove(self._on_complete)
        bpy.app.handlers.render_cancel.remove(self._on_cancel)

    # In the user interface Blender calls these on its render thread: they set a flag and leave Blender alone.

    def _on_complete(self, *_):
        self.ended = "complete"

    def _on_cancel(self, *_):
        self.ended = "cancelled"


@contextmanager
def samples_watched(on_progress):
    """Call on_progress(fraction of the samples) during a render that blocks, in background mode.

    In the user interface a handler of render statistics locks Blender up: its render thread waits for Python while
    the main thread, in Python, waits for the render.
    """
    def on_stats(text, *_):
        match = SAMPLES.search(text)
        if match:
            on_progress(int(match[1]) / max(int(match[2]), 1))

    if bpy.app.background:
        bpy.app.handlers.render_stats.append(on_stats)
    try:
        yield
    finally:
        if bpy.app.background:
            bpy.app.handlers.render_stats.remove(on_stats)
