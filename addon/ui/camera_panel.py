"""The part of the panel for a camera's body, which takes a picture of the lens image."""

from ...engine.library.bodies import load_camera
from ...engine.runtime.errors import InputError
from ...engine.simulation.photograph import missing_channels, missing_text
from ..job.named_files import FROM_FILE
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
    draw_listed(layout, scene, "camera", settings)
    if settings.iso == 0 or settings.shutter_s == 0:
        draw_wrapped(layout, "0: automatic, by the camera's meter")
    if missing:
        draw_wrapped(layout, f"{missing[0].upper()}{missing[1:]}", "INFO")
