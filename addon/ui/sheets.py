"""The sheet of a lens as it is turned: drawn in a thread, and remembered by the lens's digest.

A sheet that `lensfield lens plot` has written beside a package is shown as it is.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path

import bpy

from ...engine import cache
from ...engine.files import atomic_path
from ...engine.library import has_rings
from ...engine.sheet.sheet import write_lens_plot
from ...engine.values import digest_of
from ..job.child import work_folder
from . import window_render

TICK_S = 0.2
KIND, MOST_BYTES = "sheets", 2**26
ROOMS = "lens", "sheet"  # whose code draws them
MOST_SHEETS = 8

_worker = ThreadPoolExecutor(1, "Lensfield sheet")
_sheets = {}  # of lenses by their digest, a Future of each one's file; the newest at the end


def own_sheet(name_or_path):
    """The sheet that lies beside a lens package; None where there is none."""
    path = Path(os.path.splitext(name_or_path)[0] + ".png")
    return path if not has_rings(name_or_path) and path.is_file() else None


def drawn_sheet(lens):
    """The file of a lens's sheet; None as long as it is drawn.

    Raises
    ------
    InputError
        It cannot be drawn.
    """
    drawing = _sheets.get(lens.digest)
    if drawing is None or (drawing.done() and not drawing.exception() and not drawing.result().is_file()):
        drawing = _draw_soon(lens)
    if not drawing.done():
        return None
    if drawing.exception():
        raise drawing.exception().with_traceback(None)
    return drawing.result()


def draw_sheet(lens):
    """The file of a lens's sheet, drawn while all waits: for operators."""
    return _drawn(lens, _folder().name)


def forget_sheets():
    """Free what is known of them, and draw no more."""
    for drawing in _sheets.values():
        drawing.cancel()
    _sheets.clear()
    if _folder.cache_info().currsize:
        _folder().cleanup()
    _folder.cache_clear()
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


@lru_cache
def _folder():
    """Where the session's sheets lie, which images of it show."""
    return work_folder()


def _draw_soon(lens):
    for digest, drawing in list(_sheets.items()):
        if drawing.cancel() or len(_sheets) >= MOST_SHEETS:  # those that wait are of no use any more
            _sheets.pop(digest)
    _sheets[lens.digest] = _worker.submit(_drawn, lens, _folder().name)
    if not bpy.app.background and not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=TICK_S, persistent=True)
    return _sheets[lens.digest]


def _tick():
    done = all(drawing.done() for drawing in _sheets.values())
    if done:
        window_render.redraw_panels()
    return None if done else TICK_S


def _drawn(lens, folder):
    """Draw or recall a sheet, into a folder; the file."""
    key = digest_of((cache.code_version(*ROOMS), lens.digest.hex()))
    path = Path(folder, f"Lens Sheet {key.hex()[:8]}.png")
    known = cache.recall(KIND, key)
    if known is not None:
        with atomic_path(path, own=True) as temporary:
            temporary.write_bytes(known)
        return path
    write_lens_plot(lens, path)
    cache.remember(KIND, key, path.read_bytes(), MOST_BYTES)
    return path
