"""Pictures for the panel: one scene through each lens, lens sheets, and renders in progress."""

import warnings
from contextlib import contextmanager
from functools import cache

import bpy
import bpy.utils.previews
import numpy as np

from lensfield.engine.library import PICTURES
from lensfield.engine.runtime.files import stamp_of

from ...scene.errors import SceneError

PREVIEW_PX = 640  # the longer side; previews that Blender loads have 256, too few for the text
SHEET_MARK = "lensfield_sheet"
ASSET_PX = 256  # the size of Blender's previews

MOST_PIXELS = 40_000_000  # of a file: 8K, at 4 bytes each while it is read

_loaded = {}  # for each preview: its file with the file's stamp, or its subject; and the error if it was not readable


def sheet_preview(path):
    """A sheet's ImagePreview, cached until the file changes, as are errors.

    Raises
    ------
    SceneError
        The file is not a PNG, or it is too large.
    """
    return _preview(str(path), path)


def lens_picture(name):
    """The icon of a bundled lens's picture; 0 without one, or in background mode."""
    path = PICTURES / f"{name}.jpg"
    if bpy.app.background or not path.is_file():
        return 0
    return (_previews().get(name) or _previews().load(name, str(path), "IMAGE")).icon_id


def growing_preview(path):
    """The ImagePreview of the render in progress, which replaces the last one; otherwise like `sheet_preview`."""
    return _preview("growing", path)


def small_picture(path):
    """The ImagePreview of the preview's picture, which replaces the last one; otherwise like `sheet_preview`."""
    return _preview("small", path)


def drawing_preview(subject, draw):
    """The ImagePreview of the drawing of a subject, which replaces the last one; `draw()` returns its uint8 pixels."""
    if _loaded.get("drawing", ())[:1] != (subject,):
        _fill("drawing", draw().astype(np.float32) / 255)
        _loaded["drawing"] = subject, None
    return _previews()["drawing"]


def _preview(name, path):
    file = str(path), stamp_of(path)
    if _loaded.get(name, ())[:1] != (file,):
        try:
            pixels, error = _read(path), None
        except SceneError as refusal:
            pixels, error = np.zeros((1, 1, 4), np.float32), refusal
        _fill(name, pixels)
        _loaded[name] = file, error
    if _loaded[name][1]:
        raise _loaded[name][1].with_traceback(None)  # the traceback would grow with each redraw
    return _previews()[name]


def _fill(name, pixels):
    """Give a preview, new or existing, these pixels."""
    preview = _previews().get(name) or _previews().new(name)
    preview.image_size = pixels.shape[1::-1]
    preview.image_pixels_float.foreach_set(pixels[::-1].ravel())  # bottom row first


def load_sheet(path):
    """Load a sheet as an image of the .blend, or reload it if it already is one.

    Raises
    ------
    SceneError
        The file is not a PNG, or it is too large.
    """
    with open_png(path):
        pass
    known = set(bpy.data.images)
    image = bpy.data.images.load(str(path), check_existing=True)
    image.reload()
    if not all(image.size):
        if image not in known:
            bpy.data.images.remove(image)
        raise _unreadable(path)
    image[SHEET_MARK] = True
    return image


def forget_previews():
    """Free all previews."""
    if _previews.cache_info().currsize:
        bpy.utils.previews.remove(_previews())
    _previews.cache_clear()
    _loaded.clear()


@cache
def _previews():
    return bpy.utils.previews.new()


def _read(path):
    """The picture, scaled down: float32 array (row, column, 4) from 0 to 1."""
    with open_png(path) as picture:
        return _scaled_down(picture, PREVIEW_PX)


def asset_preview(name):
    """The picture of a bundled lens, as of `_read`; None without one."""
    from PIL import Image

    path = PICTURES / f"{name}.jpg"
    if not path.is_file():
        return None
    with Image.open(path) as picture:
        return _scaled_down(picture, ASSET_PX)


def _scaled_down(picture, longest_px):
    from PIL import Image

    picture.thumbnail((longest_px, longest_px), Image.Resampling.LANCZOS)
    return np.asarray(picture.convert("RGBA"), dtype=np.float32) / 255


@contextmanager
def open_png(path):
    """A PNG opened by Pillow; other formats are refused, whatever the file's suffix.

    Raises
    ------
    SceneError
        The file is not a PNG, is damaged, or has more than MOST_PIXELS.
    """
    from PIL import Image  # rarely needed, so not imported with the module

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # MOST_PIXELS is the limit here
            picture = Image.open(path, formats=["PNG"])
        with picture:
            if picture.width * picture.height > MOST_PIXELS:
                raise SceneError(path, "size", "{} x {} px".format(*picture.size),
                                 f"expected at most {MOST_PIXELS // 10**6} million pixels")
            yield picture
    except SceneError:
        raise
    except Exception:  # on damaged bytes Pillow's readers raise a dozen kinds of errors
        raise _unreadable(path) from None


def _unreadable(path):
    return SceneError(path, "picture", "not readable", "expected a PNG; lensfield lens plot draws a lens's sheet again")
