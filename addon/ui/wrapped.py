"""Texts in panels, wrapped to their width."""

from textwrap import wrap

import bpy

from .previews import PREVIEW_PX

WIDGET_PX = 20
LETTERS_PER_WIDGET = 3.2
PANEL_MARGINS = 3  # in widgets: what a panel keeps free on its sides


def draw_wrapped(layout, text, icon="NONE", beside=0):
    """A text in as many lines as the panel's width takes, but for some widgets of it that stand beside."""
    widgets = region_widgets() - PANEL_MARGINS - 2 * (icon != "NONE") - 2 * beside
    for index, line in enumerate(wrap(text, max(8, int(widgets * LETTERS_PER_WIDGET)))):
        layout.label(text=line, icon="BLANK1" if index and icon != "NONE" else icon)


def region_widgets():
    """How many of Blender's square widgets a region is wide; a picture's width where there is no region."""
    region, system = bpy.context.region, bpy.context.preferences.system
    width_px = min(region.width, PREVIEW_PX) if region else PREVIEW_PX
    return width_px / (WIDGET_PX * (system.ui_scale or 1))  # 0 where Blender has no window
