"""The sheet of a lens at its focus and f-stop: drawn in a thread, and cached by the lens's digest.

If `lensfield lens plot` has written a sheet next to a lens package, it is shown unchanged.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from io import BytesIO
from pathlib import Path

import bpy
from PIL import Image

from ...engine.inspection.sheet import write_lens_plot
from ...engine.library import has_rings
from ...engine.runtime import cache
from ...engine.runtime.files import atomic_path
from ..render.child import work_folder
from .common.areas import redraw_panels

TICK_S = 0.2
KIND, MOST_BYTES = "sheets", 2**26
MOST_SHEETS = 8

_worker = ThreadPoolExecutor(1, "Lensfield sheet")
_sheets = {}  # Futures of the files by the lens's digest, newest last


def stored_sheet(name_or_path):
    """The path of the sheet next to a lens package, or None."""
    path = Path(os.path.splitext(name_or_path)[0] + ".png")
    return path if not has_rings(name_or_path) and path.is_file() else None


def drawn_sheet(lens):
    """The file of a lens's sheet; None until it is drawn.

    Raises
    ------
    InputError
        The sheet cannot be drawn.
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
    """The file of a lens's sheet, for operators: blocks until it is drawn."""
    return _drawn(lens, _folder().name)


def forget_sheets():
    """Cancel pending sheets and remove the session's sheets."""
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
    """The folder of the session's sheets, which its images refer to."""
    return work_folder()


def _draw_soon(lens):
    for digest, drawing in list(_sheets.items()):
        if drawing.cancel() or len(_sheets) >= MOST_SHEETS:  # pending sheets are obsolete
            _sheets.pop(digest)
    _sheets[lens.digest] = _worker.submit(_drawn, lens, _folder().name)
    if not bpy.app.background and not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=TICK_S, persistent=True)
    return _sheets[lens.digest]


def _tick():
    finished = all(drawing.done() for drawing in _sheets.values())
    if finished:
        redraw_panels()
    return None if finished else TICK_S


def _png(content):
    """The bytes of a PNG; raises an error for any others."""
    with Image.open(BytesIO(content), formats=["PNG"]) as picture:
        picture.verify()
    return content


def _drawn(lens, folder):
    """Draw a sheet into a folder, or take it from the cache, and return its path."""
    path = Path(folder, f"Lens Sheet {lens.digest.hex()[:8]}.png")
    known = cache.load(KIND, lens.digest, _png)
    if known is not None:
        with atomic_path(path, overwrite=True) as temporary:
            temporary.write_bytes(known)
        return path
    write_lens_plot(lens, path)
    cache.store(KIND, lens.digest, path.read_bytes(), MOST_BYTES)
    return path
