"""Pictures for the panel: what lenses make of the sample scene, their sheets, and renders as they grow."""

import os
from functools import cache

import bpy
import bpy.utils.previews
import numpy as np

from ...engine.library import PICTURES
from ..scene.errors import SceneError

PREVIEW_PX = 640  # the longer side; previews that Blender reads by itself have 256, too few for the text
SHEET_MARK = "lensfield_sheet"

_changed = {}  # of each preview, its file and when that was last changed


def sheet_preview(path):
    """A sheet's ImagePreview, the same as before unless the file has changed.

    Raises
    ------
    SceneError
        The file is no picture.
    """
    return _preview(str(path), path)


def lens_picture(name):
    """The icon of what a bundled lens makes of the sample scene; 0 where Blender has no window to show it in."""
    path = PICTURES / f"{name}.jpg"
    if bpy.app.background or not path.is_file():
        return 0
    return (_previews().get(name) or _previews().load(name, str(path), "IMAGE")).icon_id


def growing_preview(path):
    """The ImagePreview of a picture of which there is one at a time; as `sheet_preview`."""
    return _preview("growing", path)


def _preview(name, path):
    previews, changed = _previews(), (str(path), os.stat(path).st_mtime_ns)
    if _changed.get(name) != changed:
        pixels = _read(path)
        preview = previews.get(name) or previews.new(name)
        preview.image_size = pixels.shape[1::-1]
        preview.image_pixels_float.foreach_set(pixels[::-1].ravel())  # from the bottom upwards
        _changed[name] = changed
    return previews[name]


def load_sheet(path):
    """A sheet as an image of the .blend, read anew where it is one already.

    Raises
    ------
    SceneError
        The file is no picture.
    """
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
    """Free them."""
    if _previews.cache_info().currsize:
        bpy.utils.previews.remove(_previews())
    _previews.cache_clear()
    _changed.clear()


@cache
def _previews():
    return bpy.utils.previews.new()


def _read(path):
    """The picture, made smaller: float32 array (row, column, 4) from 0 to 1."""
    from PIL import Image  # only pictures need it, and they are few

    try:
        with Image.open(path) as picture:
            picture = picture.convert("RGBA")
    except Exception:  # damaged bytes lead Pillow's readers to errors of a dozen kinds
        raise _unreadable(path) from None
    picture.thumbnail((PREVIEW_PX, PREVIEW_PX), Image.Resampling.LANCZOS)
    return np.asarray(picture, dtype=np.float32) / 255


def _unreadable(path):
    return SceneError(path, "lens sheet", "not readable", "draw it anew: lensfield lens plot")
