"""Pictures as wide as a panel."""

from lensfield.engine.runtime.errors import InputError

from .text_wrap import PANEL_MARGINS, draw_wrapped, region_widgets


def draw_picture(layout, load, path):
    """Draw the ImagePreview that `load` returns for a file, or its error."""
    try:
        preview = load(path)
    except InputError as error:
        draw_wrapped(layout, str(error), "ERROR")
    else:
        layout.template_icon(icon_value=preview.icon_id, scale=_picture_scale())


def _picture_scale():
    """The scale at which a square icon is as wide as the panel, in Blender's widgets."""
    return max(1, region_widgets() - PANEL_MARGINS)
