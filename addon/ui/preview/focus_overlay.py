"""Focus overlay: tints blurred parts of the preview in the camera's view, orange in front of the focus and blue behind.

Blurred means by more than a pixel of the render. The overlay combines the preview's saved depth with the camera's
current focus and f-stop, so it follows them while they are dragged. Nearly all people with colour blindness can
distinguish Okabe and Ito's orange and blue.
"""

from contextlib import suppress
from functools import lru_cache

import numpy as np

from lensfield.engine.pictures.spectral_exr import read_parts
from lensfield.engine.runtime.errors import InputError

from ...scene.active_camera import camera_settings
from ...scene.camera import view_tangents
from ...scene.focus import focus_now
from ..common.lens_at_rest import facts_at_rest, forget_facts
from ..common.session import session

NEARER, FARTHER = (0.90, 0.60, 0.0), (0.0, 0.45, 0.70)
SHARP_PX = 1.0
FAINTEST, STRONGEST = 0.25, 0.6  # opacity at SHARP_PX, and its limit for large blur
LONGEST_S = 0.5  # wait for the lens, so that the first redraw can already show tints
LEGEND = "Blurred by more than a pixel: orange nearer, blue farther"


def tints(depth_m, focus, edges=(0.0, 0.0, 0.0, 0.0)):
    """The overlay of a picture: RGBA array (row, column, 4).

    Parameters
    ----------
    depth_m : array (row, column)
    focus : Focus
    edges : (float, float, float, float)
        Tangents of the angles from the axis to the picture's left, lower, right and upper edge.
    """
    rows, columns = ((np.arange(n) + 0.5) / n for n in depth_m.shape)
    left, lower, right, upper = edges
    blur = focus.blur_px(depth_m, (left + (right - left) * columns, (upper + (lower - upper) * rows)[:, None]))
    size = np.abs(blur)
    opacity = FAINTEST + (STRONGEST - FAINTEST) * (1 - SHARP_PX / np.maximum(size, SHARP_PX))
    colours = np.where((blur > 0)[..., None], NEARER, FARTHER)
    return np.concatenate([colours, np.where(size > SHARP_PX, opacity, 0.0)[..., None]], axis=-1, dtype=np.float32)


def switch(scene):
    """Switch the overlay on or off."""
    session.focus_overlay = not session.focus_overlay
    if session.focus_overlay:
        with suppress(InputError):  # the panel reports it
            facts_at_rest(scene, LONGEST_S)


def focus_tints(scene, path):
    """The tints of a scene for its camera's current focus and f-stop, from the depths in a file.

    None until the lens and the depths are available. The same array as before if nothing has changed.

    Parameters
    ----------
    scene : bpy.types.Scene
    path : Path or None
    """
    try:
        at_rest = facts_at_rest(scene)
        if path is None or at_rest is None or not path.is_file():
            return None
        settings = camera_settings(scene)
        edges = view_tangents(scene, settings.lens_name_or_path(), settings.view_text())
        return _tints(path, path.stat().st_mtime_ns, focus_now(scene, at_rest), edges)
    except (InputError, OSError):  # the panel reports it
        return None


@lru_cache(maxsize=1)
def _tints(path, changed, focus, edges):
    return tints(_depth_m(path, changed), focus, edges)


@lru_cache(maxsize=1)
def _depth_m(path, changed):
    (_, channels), = read_parts(path)
    plane, = channels.values()
    return plane


def forget():
    """Clear the caches and switch the overlay off."""
    session.focus_overlay = False
    forget_facts()
    for cached in (_tints, _depth_m):
        cached.cache_clear()
