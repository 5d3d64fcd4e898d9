"""Wrapping of text to the width of a panel."""

from textwrap import wrap

import bpy

from .previews import PREVIEW_PX

WIDGET_PX = 20
LETTERS_PER_WIDGET = 3.2
PANEL_MARGINS = 3  # widgets, on both sides of a panel together


def draw_wrapped(layout, text, icon="NONE", reserved=0, widgets=None, least_lines=1):
    """Draw a text wrapped to a width in widgets (default: the panel), less two for each button in the same row; with
    empty lines below it up to the least number of lines."""
    widgets = (widgets or region_widgets()) - PANEL_MARGINS - 2 * (icon != "NONE") - 2 * reserved
    lines = wrap(text, max(8, int(widgets * LETTERS_PER_WIDGET)))
    for index, line in enumerate(lines + [""] * (least_lines - len(lines))):
        layout.label(text=line, icon="BLANK1" if index and icon != "NONE" else icon)


def region_widgets():
    """The region's width in Blender's square widgets, limited to PREVIEW_PX; PREVIEW_PX itself without a region."""
    region, system = bpy.context.region, bpy.context.preferences.system
    width_px = min(region.width, PREVIEW_PX) if region else PREVIEW_PX
    return width_px / (WIDGET_PX * (system.ui_scale or 1))  # ui_scale is 0 in background mode
