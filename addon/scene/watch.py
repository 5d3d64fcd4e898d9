"""Progress of Blender's current render, from its handlers."""

import re
from contextlib import contextmanager, suppress

import bpy

from lensfield.engine.runtime.errors import Stopped

SAMPLES, KERNELS = re.compile(r"Sample (\d+)/(\d+)"), "Loading render kernels"
LOADING = "Loading Cycles for this GPU, which takes minutes the first time"


@contextmanager
def samples_watched(on_progress, on_gpu=False):
    """Call on_progress(fraction of the samples) during a blocking render, in background mode; on a GPU, also
    on_progress(0.0, label) while Cycles loads its kernels, which it may have to compile for minutes.

    In the user interface, a handler of render statistics deadlocks Blender: its render thread waits for Python while
    the main thread, in Python, waits for the render.
    """
    def on_stats(text, *_):
        match = SAMPLES.search(text)
        with suppress(Stopped):  # a handler cannot stop the render: the next step does
            if match:
                on_progress(int(match[1]) / max(int(match[2]), 1))
            elif on_gpu and KERNELS in text:
                on_progress(0.0, LOADING)

    if bpy.app.background:
        bpy.app.handlers.render_stats.append(on_stats)
    try:
        yield
    finally:
        if bpy.app.background:
            bpy.app.handlers.render_stats.remove(on_stats)
