"""Settings that a subpanel lists as they are."""

from ....request import CAMERA
from .properties import SETTINGS


def draw_listed(layout, scene, panel, of_camera=None):
    """Draw the settings of a subpanel: of the scene, and of a camera if it has any."""
    for name, each in SETTINGS.items():
        if each.panel == panel:
            layout.prop(of_camera if each.owner == CAMERA else scene.lensfield, name)
