"""The part of the panel for a camera's body, which takes a picture of the lens image."""

from contextlib import suppress

from lensfield.engine.library.bodies import load_camera
from lensfield.engine.photo.photograph import missing_channels, missing_text
from lensfield.engine.runtime.errors import InputError

from ..job.named_files import FROM_FILE
from ..scene.active_camera import camera_data
from .common.lens_worker import lens_request
from .common.listed_settings import draw_listed
from .common.properties import NO_BODY
from .common.shown_exposure import current_exposure, exposure_text
from .common.text_wrap import draw_wrapped


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
    shutter_s, iso = current_exposure(scene, camera)
    if shutter_s or iso:
        layout.label(text=exposure_text(shutter_s, iso, _f_number(scene, camera)))
    column = layout.column(align=True)
    for name, auto, title in (("iso", "auto_iso", "ISO"), ("shutter_s", "auto_shutter", "Shutter (s)")):
        _draw_exposure(column, settings, name, auto, title)
    draw_listed(layout, scene, "camera", settings)
    if missing:
        draw_wrapped(layout, f"{missing[0].upper()}{missing[1:]}", "INFO")


def draw_exposure(layout, scene, camera):
    """Draw the exposure of a camera with a body in a header, if it is known."""
    shutter_s, iso = current_exposure(scene, camera)
    if camera.lensfield.body != NO_BODY and shutter_s and iso:
        layout.label(text=exposure_text(shutter_s, iso))


def _draw_exposure(layout, settings, name, auto, title):
    """Draw a value of the exposure with its switch; the value only if it is fixed."""
    row = layout.row(align=True)
    if getattr(settings, auto):
        row.prop(settings, auto, text=f"Auto {title.partition(' ')[0]}", toggle=True)
    else:
        row.prop(settings, name)
        row.prop(settings, auto, toggle=True)


def _f_number(scene, camera):
    """The f-number of the scene's lens; None for other cameras, and until it is known."""
    with suppress(InputError):  # the panel's status shows it
        if camera == camera_data(scene) and (facts := lens_request(scene).facts):
            return facts.f_number
    return None
