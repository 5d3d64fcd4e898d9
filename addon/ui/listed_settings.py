"""Settings that a subpanel lists as they are."""

from ...request import CAMERA
from .properties import SETTINGS


def draw_listed(layout, scene, panel, of_camera=None):
    """Draw the settings of a scene, and those of a camera, that belong to a subpanel."""
    for name, each in SETTINGS.items():
        if each.panel == panel:
            layout.prop(of_camera if each.owner == CAMERA else scene.lensfield, name)
