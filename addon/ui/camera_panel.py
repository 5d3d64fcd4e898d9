"""The part of the panel for a camera's body, which takes a picture of the lens image."""

from contextlib import suppress

from ...engine.library.bodies import load_camera
from ...engine.runtime.errors import InputError
from ...engine.sensor.exposure import exposure_value
from ...engine.simulation.photograph import missing_channels, missing_text, shutter_text
from ..job.named_files import FROM_FILE
from ..scene.active_camera import camera_data
from .lens_worker import lens_request
from .listed_settings import draw_listed
from .text_wrap import draw_wrapped


def draw_camera(layout, scene, camera):
    """Draw the body of a camera, its sensor, and the exposure."""
    settings = camera.lensfield
    layout.prop(settings, "body")
    if settings.body == FROM_FILE:
        layout.prop(settings, "body_file")
    try:
        name = settings.body_name_or_path()
        if not name:
            return
        body = load_camera(name)
        missing = missing_text(missing_channels(body, scene.lensfield.wavelengths_nm()))
    except InputError as error:
        draw_wrapped(layout, str(error), "ERROR")
        return
    layout.label(text="{:.3g} \u00d7 {:.3g} mm, {} \u00d7 {} pixels".format(*body.size_mm, *reversed(body.shape_px)))
    if settings.shutter_s:
        layout.label(text=_exposure_text(settings, _f_number(scene, camera)))
    draw_listed(layout, scene, "camera", settings)
    if settings.iso == 0 or settings.shutter_s == 0:
        draw_wrapped(layout, "0: automatic, by the camera's meter")
    if missing:
        draw_wrapped(layout, f"{missing[0].upper()}{missing[1:]}", "INFO")


def _exposure_text(settings, f_number):
    """The shutter as cameras show it and, once all is known, the exposure value."""
    shutter = shutter_text(settings.shutter_s)
    if not f_number or not settings.iso:
        return shutter
    ev = exposure_value(f_number, settings.shutter_s, settings.iso)
    return f"{shutter} at f/{f_number:.3g} and ISO {settings.iso:.0f}: EV100 {ev:.1f}"


def _f_number(scene, camera):
    """The f-number of the scene's lens; None for other cameras, and until it is known."""
    with suppress(InputError):  # the panel's status shows it
        if camera == camera_data(scene) and (facts := lens_request(scene).facts):
            return facts.f_number
    return None
