"""Errors in a window's words: for frequent ones, a sentence in place of the object, field, value and remedy."""

from ...engine.runtime.errors import InputError, one_line

PANORAMA = "Panoramic cameras have no lens, unless Match Camera to Lens has set them"
_SENTENCES = {"type": {"ORTHO": "Orthographic cameras have no lens", "PANO": PANORAMA,
                       "CUSTOM": "Custom cameras have no lens"}}
"""By the field and the value of an error."""


def plain(error):
    """An InputError or OSError in one line, as windows show it."""
    if not isinstance(error, InputError):
        return one_line(error)
    if error.field == "image_pose":
        tilt_deg = max(map(abs, error.value))
        return f"Tilt of {tilt_deg:.3g}\u00b0 is too much for this lens: no light reaches the sensor"
    if error.field == "lens" and not error.where:
        return "Choose a lens"
    if error.field == "panorama type":
        return PANORAMA
    return _SENTENCES.get(error.field, {}).get(error.value) or one_line(error)
