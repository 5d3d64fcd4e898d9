"""Pictures for the panel: what lenses make of the sample scene, their sheets, and renders as they grow."""

import warnings
from contextlib import contextmanager
from functools import cache

import bpy
import bpy.utils.previews
import numpy as np

from ...engine.files import stamp_of
from ...engine.library import PICTURES
from ..scene.errors import SceneError

PREVIEW_PX = 640  # the longer side; previews that Blender reads by itself have 256, too few for the text
SHEET_MARK = "lensfield_sheet"

MOST_PIXELS = 40_000_000  # of a file: 8K; they take 4 bytes each while it is read

_seen = {}  # of each preview, its file and that one's stamp, and the error that it could not be read by


def sheet_preview(path):
    """A sheet's ImagePreview, the same as before unless the file has changed; so is an error.

    Raises
    ------
    SceneError
        The file is no PNG, or a huge one.
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
    previews, file = _previews(), (str(path), stamp_of(path))
    if _seen.get(name, ())[:1] != (file,):
        try:
            pixels, error = _read(path), None
        except SceneError as refusal:
            pixels, error = np.zeros((1, 1, 4), np.float32), refusal
        preview = previews.get(name) or previews.new(name)
        preview.image_size = pixels.shape[1::-1]
        preview.image_pixels_float.foreach_set(pixels[::-1].ravel())  # from the bottom upwards
        _seen[name] = file, error
    if _seen[name][1]:
        raise _seen[name][1].with_traceback(None)  # which would grow with each drawing
    return previews[name]


def load_sheet(path):
    """A sheet as an image of the .blend, read anew where it is one already.

    Raises
    ------
    SceneError
        The file is no PNG, or a huge one.
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
    """Free them."""
    if _previews.cache_info().currsize:
        bpy.utils.previews.remove(_previews())
    _previews.cache_clear()
    _seen.clear()


@cache
def _previews():
    return bpy.utils.previews.new()


def _read(path):
    """The picture, made smaller: float32 array (row, column, 4) from 0 to 1."""
    from PIL import Image

    with open_png(path) as picture:
        picture.thumbnail((PREVIEW_PX, PREVIEW_PX), Image.Resampling.LANCZOS)
        return np.asarray(picture.convert("RGBA"), dtype=np.float32) / 255


@contextmanager
def open_png(path):
    """A PNG as Pillow has it, which takes no other kind for one whatever it is called.

    Raises
    ------
    SceneError
        It is none, it is damaged, or so large that it is not to be decoded.
    """
    from PIL import Image  # only pictures need it, and they are few

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # by its own measure
            picture = Image.open(path, formats=["PNG"])
        with picture:
            if picture.width * picture.height > MOST_PIXELS:
                raise SceneError(path, "size", "{} x {} px".format(*picture.size),
                                 f"pictures of up to {MOST_PIXELS // 10**6} million pixels are shown")
            yield picture
    except SceneError:
        raise
    except Exception:  # damaged bytes lead Pillow's readers to errors of a dozen kinds
        raise _unreadable(path) from None


def _unreadable(path):
    return SceneError(path, "picture", "not readable", "expected a PNG: lensfield lens plot draws a lens's sheet anew")
