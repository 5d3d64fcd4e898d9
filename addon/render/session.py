"""Session state that a child process needs and no file contains: painted pixels and render devices.

An image with unsaved paint is in the .blend as it was before.
"""

import json
from io import BytesIO

import bpy
import numpy as np

from lensfield.engine.runtime.files import atomic_path


def lost_images():
    """Names of images whose pixels are lost to a child, such as painted tiles: Python reaches only the first tile."""
    return [image.name for image in _unsaved_images() if not _can_be_taken(image)]


def _unsaved_images():
    return [image for image in bpy.data.images
            if image.is_dirty and image.users and image.type not in ("RENDER_RESULT", "COMPOSITING")]


def _can_be_taken(image):
    return image.source != "TILED" and image.library is None and all(image.size)


def write_session(path):
    """Write the state that a copy of this file would lack.

    Parameters
    ----------
    path : path
        .npz
    """
    images = [image for image in _unsaved_images() if _can_be_taken(image)]
    facts = {"images": [(image.name, image.is_float) for image in images], "devices": _devices()}
    stream = BytesIO()  # numpy does not close a file that it cannot write completely
    np.savez(stream, *map(_pixels, images), facts=json.dumps(facts))
    with atomic_path(path, overwrite=True) as temporary, stream.getbuffer() as held:
        temporary.write_bytes(held)


def take_session(path):
    """Restore the state from `write_session`, in another process that has opened the copy."""
    with np.load(path) as session:
        facts = json.loads(str(session["facts"]))
        for index, (name, is_float) in enumerate(facts["images"]):
            _paint(bpy.data.images[name], is_float, session[f"arr_{index}"])
    _choose(**facts["devices"])


def _pixels(image):
    pixels = np.empty((image.size[1], image.size[0], image.channels), np.float32)
    image.pixels.foreach_get(pixels.ravel())
    return pixels


def _paint(image, is_float, pixels):
    """Give an image these pixels, without a file: Cycles would read the file instead."""
    if image.packed_file:
        image.unpack(method="REMOVE")
    image.source = "GENERATED"
    image.use_generated_float = is_float
    image.generated_height, image.generated_width = pixels.shape[:2]
    image.pixels.foreach_set(pixels.ravel())
    image.update()


def _devices():
    """The kind of device that Cycles uses, and which devices are on."""
    preferences = bpy.context.preferences.addons["cycles"].preferences
    return {"kind": preferences.compute_device_type,
            "used": {device.id: device.use for device in preferences.devices}}


def _choose(kind, used):
    preferences = bpy.context.preferences.addons["cycles"].preferences
    if used and {device.id for device in preferences.devices} != set(used):
        preferences.refresh_devices()
    preferences.compute_device_type = kind
    for device in preferences.devices:
        device.use = used.get(device.id, device.use)
