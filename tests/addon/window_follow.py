"""The render of a window, followed without one."""

import time

from lensfield.addon.ui import window_render


def follow(until=lambda render: False, seconds=400):
    """Tick as Blender's timer does, until the render has ended or is as far as wanted."""
    deadline = time.monotonic() + seconds
    while window_render.tick() is not None and not until(window_render.state["render"]):
        assert time.monotonic() < deadline
        time.sleep(0.01)
