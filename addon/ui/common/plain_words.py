"""Errors in a window's words: for frequent ones, a sentence in place of the object, field, value and remedy."""

import re

from lensfield.engine.runtime.errors import InputError, one_line

PANORAMA = "Panoramic cameras have no lens, unless Match Camera to Lens has set them"
_SENTENCES = {"type": {"ORTHO": "Orthographic cameras have no lens", "PANO": PANORAMA,
                       "CUSTOM": "Custom cameras have no lens"}, "lenses": {"none": "Tick at least one lens"}}
"""By the field and the value of an error."""

_DEPTH = re.compile(r"In focus: (?P<near>\S+(?: m)?) to (?P<far>\S+(?: m)?)(?P<axis> on the axis)?, within \S+ um; "
                    r"out of focus: (?P<rest>\S+%) of the frame[^:]*(?:: (?P<layers>one|\d+) slabs?\b)?.*")
_COLOURS = re.compile(r"; colours within a CIEDE2000 of about \S+")


def plain_line(line):
    """A line of a render's report, as windows show it: without the figures that only the report's readers need."""
    line = _COLOURS.sub("; colours are approximate", line)
    depth = _DEPTH.fullmatch(line)
    if not depth:
        return line
    near, far, axis, rest, layers = depth.group("near", "far", "axis", "rest", "layers")
    blurred = {None: "is blurred less than by the real lens", "one": "is blurred in 1 layer"}.get(
        layers, f"is blurred in {layers} layers")
    return f"In focus{axis or ''}: {near} to {far}. The rest ({rest} of the frame) {blurred}"


def sentence(text):
    """A text with a capital letter."""
    return text[:1].upper() + text[1:]


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
