"""What is sharp: over the preview in the camera's view, what the lens blurs by more than a pixel of the render is
tinted, orange before what is in focus and blue behind it.

It goes by the depth that the preview has kept and by what the camera's rings are turned to now: so it follows them
while they are dragged. Okabe and Ito's orange and blue are told apart by nearly all who are colour-blind.
"""

from concurrent.futures import ThreadPoolExecutor, wait
from functools import lru_cache

import numpy as np

from ...engine.errors import InputError
from ...engine.files import stamp_of
from ...engine.image.spectral_exr import read_parts
from ..scene.focus import focus_now
from ..scene.lens_facts import lens_facts

NEARER, FARTHER = (0.90, 0.60, 0.0), (0.0, 0.45, 0.70)
SHARP_PX = 1.0
FAINTEST, STRONGEST = 0.25, 0.6  # from where sharpness ends
LONGEST_S = 0.5  # that a lens is waited for, for the first tints not to wait for another drawing
LEGEND = "Blurred by over a pixel: orange nearer, blue farther"

state = {"on": False}
"""Whether it is on: of the session, in no file."""

_worker = ThreadPoolExecutor(1, "Lensfield focus")


def tints(depth_m, focus):
    """What is laid over a picture: array (row, column, 4), the last its opacity.

    Parameters
    ----------
    depth_m : array (row, column)
    focus : Focus
    """
    blur = focus.blur_px(depth_m)
    size = np.abs(blur)
    opacity = FAINTEST + (STRONGEST - FAINTEST) * (1 - SHARP_PX / np.maximum(size, SHARP_PX))
    colours = np.where((blur > 0)[..., None], NEARER, FARTHER)
    return np.concatenate([colours, np.where(size > SHARP_PX, opacity, 0.0)[..., None]], axis=-1, dtype=np.float32)


def switch(scene):
    """Switch it on or off."""
    state["on"] = not state["on"]
    if state["on"]:
        lens = scene.lensfield.lens_name_or_path()
        wait([_facts_at_rest(lens, stamp_of(lens))], LONGEST_S)


def focus_tints(scene, path):
    """The tints of a scene as its camera is set now, by the depths in a file; None as long as too little is known, and
    the same array as before where nothing has changed.

    Parameters
    ----------
    scene : bpy.types.Scene
    path : Path or None
    """
    lens = scene.lensfield.lens_name_or_path()
    at_rest = _facts_at_rest(lens, stamp_of(lens))
    try:
        if path is None or not at_rest.done() or not path.is_file():
            return None
        return _tints(path, path.stat().st_mtime_ns, focus_now(scene, at_rest.result()))
    except (InputError, OSError):  # the panel tells of it
        return None


@lru_cache(maxsize=1)
def _tints(path, changed, focus):
    return tints(_depth_m(path, changed), focus)


@lru_cache(maxsize=1)
def _depth_m(path, changed):
    (_, channels), = read_parts(path)
    plane, = channels.values()
    return plane


@lru_cache(maxsize=4)
def _facts_at_rest(lens, changed):
    """A Future: to read a lens takes a fraction of a second, and nothing waits here."""
    return _worker.submit(lens_facts, lens)


def forget():
    """Free what is kept, and switch it off."""
    state["on"] = False
    for kept in (_tints, _depth_m, _facts_at_rest):
        kept.cache_clear()
