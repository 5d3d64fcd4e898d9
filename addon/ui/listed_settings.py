"""Settings that a subpanel lists as they are."""

from .properties import SETTINGS


def draw_listed(layout, settings, panel):
    """Draw the settings that belong to a subpanel."""
    for name, each in SETTINGS.items():
        if each.panel == panel:
            layout.prop(settings, name)
