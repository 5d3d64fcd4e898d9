"""The look of a scene's pictures: Blender's colour management, from scene-linear light to the pixels of a display."""

import json
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import bpy
import numpy as np

from lensfield.engine.pictures.spectral_exr import write_planes_exr
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.runtime.files import temporary_folder

from .errors import SceneError
from .working_space import REC709

PNG = {"media_type": "IMAGE", "file_format": "PNG", "color_mode": "RGBA", "color_depth": "8", "compression": 0,
       "color_management": "FOLLOW_SCENE"}  # in this order; Blender 5.0 added the first
WHITE_BALANCE = "use_white_balance", "white_balance_temperature", "white_balance_tint"  # since Blender 4.3


@dataclass(frozen=True)
class Look:
    """Blender's colour management of a scene, except curves.

    Attributes
    ----------
    display_device, view_transform, look : str
    exposure, gamma : float
    white_balance : (bool, float, float) or None
        Whether it is on, temperature and tint; None before Blender 4.3.
    """

    display_device: str
    view_transform: str
    look: str
    exposure: float
    gamma: float
    white_balance: tuple[bool, float, float] | None = None


def look_of(scene):
    """The Look of a scene."""
    view = scene.view_settings
    balance = tuple(getattr(view, name) for name in WHITE_BALANCE) if hasattr(view, WHITE_BALANCE[0]) else None
    return Look(scene.display_settings.display_device, view.view_transform, view.look, view.exposure, view.gamma,
                balance)


def to_text(look):
    """The text of a Look, for files and command lines."""
    return json.dumps(asdict(look))


def look_from(text, where):
    """The Look of a text from `to_text`.

    Raises
    ------
    InputError
        The text is damaged.
    """
    try:
        stored = json.loads(text)
        balance = stored.pop("white_balance")
        return Look(**stored, white_balance=balance and tuple(balance))
    except (AttributeError, KeyError, RecursionError, TypeError, ValueError):
        names = ", ".join(each.name for each in fields(Look))
        raise InputError(where, "look", "damaged", f"expected JSON text with {names}") from None


def shown_pixels(rec709, look):
    """A linear Rec. 709 picture (row, column, 3) as a scene with this Look shows it: uint8 array of the same shape.

    Raises
    ------
    SceneError
        This Blender lacks the Look's display, view transform or look.
    """
    with temporary_folder() as folder:
        path, picture = Path(folder) / "light.exr", Path(folder) / "shown.png"
        write_planes_exr(dict(zip("RGB", np.moveaxis(rec709, -1, 0), strict=True)), path, {})
        image = bpy.data.images.load(str(path))
        try:
            space = image.colorspace_settings
            if REC709 in space.bl_rna.properties["name"].enum_items:
                space.name = REC709
            save_shown(image, picture, look)
        finally:
            bpy.data.images.remove(image)
        return _pixels(picture)


def _pixels(path):
    from PIL import Image

    with Image.open(path, formats=["PNG"]) as picture:
        return np.asarray(picture.convert("RGB"))


def save_shown(image, path, look):
    """Save an image as a scene with this Look shows it, as an uncompressed PNG of 8 bits."""
    with _scene_with(look) as scene:
        save_as_shown(image, path, scene)


def save_as_shown(image, path, scene):
    """Save an image as a scene shows it, as an uncompressed PNG of 8 bits, without a temporary scene: after the
    removal of one, Blender announces all objects as changed."""
    settings, dither = scene.render.image_settings, scene.render.dither_intensity
    before = {name: getattr(settings, name) for name in PNG if hasattr(settings, name)}
    try:
        scene.render.dither_intensity = 0
        _set(settings, PNG)
        image.save_render(str(path), scene=scene)
    finally:
        _set(settings, before)
        scene.render.dither_intensity = dither


def _set(settings, values):
    """Set values that differ: setting a file format has side effects."""
    for name, value in values.items():
        if getattr(settings, name, value) != value:
            setattr(settings, name, value)


@contextmanager
def _scene_with(look):
    """A temporary scene with this Look."""
    scene = bpy.data.scenes.new("Lensfield Look")
    try:
        _assign(scene, look)
        yield scene
    finally:
        bpy.data.scenes.remove(scene)


def _assign(scene, look):
    view = scene.view_settings
    try:
        scene.display_settings.display_device = look.display_device
        view.view_transform, view.look = look.view_transform, look.look
    except TypeError:
        raise SceneError("look", "view", f"{look.display_device}, {look.view_transform}, {look.look}",
                         "not in this Blender's colour management: choose others, or use --look standard") from None
    view.exposure, view.gamma = look.exposure, look.gamma
    if look.white_balance and hasattr(view, WHITE_BALANCE[0]):
        for name, value in zip(WHITE_BALANCE, look.white_balance, strict=True):
            setattr(view, name, value)
