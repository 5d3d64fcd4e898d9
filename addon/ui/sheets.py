"""The sheet of a lens at its focus and f-stop: drawn in a thread, and cached by its contents.

If `lensfield lens plot` has written a sheet next to a lens package, it is shown unchanged.
"""

import os
from functools import lru_cache
from io import BytesIO
from pathlib import Path

from PIL import Image

from lensfield.engine.inspection.sheet import write_lens_plot
from lensfield.engine.library import has_rings
from lensfield.engine.runtime import cache
from lensfield.engine.runtime.files import atomic_path
from lensfield.engine.runtime.values import digest_of

from ..render.child import work_folder
from .common.background import Answers

KIND, MOST_BYTES = "sheets", 2**26
MOST_SHEETS = 8


def stored_sheet(name_or_path):
    """The path of the sheet next to a lens package, or None."""
    path = Path(os.path.splitext(name_or_path)[0] + ".png")
    return path if not has_rings(name_or_path) and path.is_file() else None


def drawn_sheet(lens, photographs):
    """The file of a lens's sheet, with its agreement with photographs; None until it is drawn.

    Raises
    ------
    InputError
        The sheet cannot be drawn.
    """
    drawing = _sheets.to(lens, photographs, _folder().name)
    if drawing.done() and not drawing.exception() and not drawing.result().is_file():
        _sheets.forget()
        drawing = _sheets.to(lens, photographs, _folder().name)
    return drawing.result() if drawing.done() else None


def draw_sheet(lens, photographs):
    """Like `drawn_sheet`, for operators: blocks until it is drawn."""
    return _drawn(lens, photographs, _folder().name)


def forget_sheets():
    """Cancel pending sheets and remove the session's sheets."""
    _sheets.forget()
    if _folder.cache_info().currsize:
        _folder().cleanup()
    _folder.cache_clear()


@lru_cache
def _folder():
    """The folder of the session's sheets, which its images refer to."""
    return work_folder()


def _png(content):
    """The bytes of a PNG; raises an error for any others."""
    with Image.open(BytesIO(content), formats=["PNG"]) as picture:
        picture.verify()
    return content


def _drawn(lens, photographs, folder):
    """Draw a sheet into a folder, or take it from the cache, and return its path."""
    provenance = lens.prescription and lens.prescription.provenance
    key = digest_of((lens.digest.hex(), photographs, provenance))  # lenses that differ only in the latter are equal
    path = Path(folder, f"Lens Sheet {key.hex()[:8]}.png")
    known = cache.load(KIND, key, _png)
    if known is not None:
        with atomic_path(path, overwrite=True) as temporary:
            temporary.write_bytes(known)
        return path
    write_lens_plot(lens, path, photographs=photographs)
    cache.store(KIND, key, path.read_bytes(), MOST_BYTES)
    return path


_sheets = Answers(_drawn, MOST_SHEETS)
