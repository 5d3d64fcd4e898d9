"""The exposure of the camera's body: as set, or as its meter has chosen it for the picture of Live or of Preview."""

import bpy

from lensfield.engine.library.bodies import load_camera
from lensfield.engine.photo.photograph import shutter_text
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.sensor.exposure import exposure_value
from lensfield.engine.sensor.metering import usual_exposure

from ...job.photo import ShownExposure
from ...scene.active_camera import camera_data
from .session import session


def metered_exposure(scene):
    """The ShownExposure of the view that shows a scene with its camera's present settings; None without one."""
    for view in (session.live, session.preview):
        if view and view.exposure and view.shows_exposure_of(scene):
            return view.exposure
    return None


def current_exposure(scene, camera):
    """The shutter in seconds and the ISO of a camera: as set, or as metered; None in place of unknown ones."""
    settings = camera.lensfield
    metered = metered_exposure(scene) if camera == camera_data(scene) else None
    return tuple(settings.value_of(name) or getattr(metered, name, None) for name in ("shutter_s", "iso"))


def fixed_value(camera, name):
    """The value that a camera's ISO or shutter has once it is fixed: the metered one, or else a usual one."""
    shutter_s, iso = current_exposure(bpy.context.scene, camera)
    known = {"shutter_s": shutter_s, "iso": iso}[name]
    if known is None:
        known = getattr(_usual(camera.lensfield), name)
    return round(known) if name == "iso" else known


def exposure_text(shutter_s, iso, f_number=None):
    """An exposure as cameras show it: shutter and ISO, without unknown ones; and, if all is known, the exposure value.
    """
    parts = [shutter_text(shutter_s)] if shutter_s else []
    parts += [f"f/{f_number:.3g}"] if f_number else []
    parts += [f"ISO {iso:.0f}"] if iso else []
    if shutter_s and iso and f_number:
        parts.append(f"EV {exposure_value(f_number, shutter_s, iso):.1f}")
    return ", ".join(parts)


def _usual(settings):
    try:
        if body := settings.body_name_or_path():
            usual = usual_exposure(load_camera(body), None, None)
            return ShownExposure(usual.shutter_s, usual.iso)
    except InputError:  # the panel shows it
        pass
    return ShownExposure(1 / 60, 100.0)
