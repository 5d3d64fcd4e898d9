"""What Blender's render under way has come to, from its handlers."""

import re

import bpy

SAMPLES = re.compile(r"Sample (\d+)/(\d+)")


class RenderWatch:
    """Follows renders while its `with` block lasts.

    Attributes
    ----------
    ended : None while a render goes on, then "complete" or "cancelled"
    done : float
        Fraction of the samples of the render under way.
    """

    def __init__(self, on_progress=None):
        self._on_progress = on_progress
        self._handlers = ((bpy.app.handlers.render_stats, self._on_stats),
                          (bpy.app.handlers.render_complete, self._on_complete),
                          (bpy.app.handlers.render_cancel, self._on_cancel))
        self.start()

    def start(self):
        """A new render begins."""
        self.ended, self.done = None, 0.0

    def __enter__(self):
        for handlers, handler in self._handlers:
            handlers.append(handler)
        return self

    def __exit__(self, *exception):
        for handlers, handler in self._handlers:
            handlers.remove(handler)

    # Blender calls these on its render thread: they set flags and leave Blender alone.

    def _on_stats(self, text, *_):
        match = SAMPLES.search(text)
        if match:
            self.done = int(match[1]) / max(int(match[2]), 1)
            if self._on_progress:
                self._on_progress(self.done)

    def _on_complete(self, *_):
        self.ended = "complete"

    def _on_cancel(self, *_):
        self.ended = "cancelled"
