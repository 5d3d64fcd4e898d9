"""Follows a window's render without a window."""

from lensfield.addon.ui import window_render
from lensfield.addon.ui.common.session import session
from waiting import wait_until


def follow(until=lambda render: False):
    """Tick as Blender's timer does, until the render has ended or reached the given point."""
    wait_until(lambda: window_render.tick() is None or until(session.render), 0.01)
