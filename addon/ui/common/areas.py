"""The areas of Blender's windows, and the editors in them."""

import bpy


def areas(*types):
    """The areas of these types, in all windows."""
    return [area for _, area in _placed_areas(*types)]


def _placed_areas(*types):
    """(window, area) of the areas of these types, in all windows."""
    return [(window, area) for window in bpy.context.window_manager.windows for area in window.screen.areas
            if area.type in types]


def image_areas():
    """(window, area) of the Image Editors in all windows."""
    return _placed_areas("IMAGE_EDITOR")


def image_editors():
    """The Image Editors in all windows."""
    return [area.spaces.active for _, area in image_areas()]


def fit_picture(window, area):
    """Zoom an Image Editor so that its picture fits."""
    region = next(region for region in area.regions if region.type == "WINDOW")
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.image.view_all(fit_view=True)


def tool_in_use():
    """Whether the user is in the middle of a modal operation, such as moving an object, in any window."""
    return any(len(window.modal_operators) for window in bpy.context.window_manager.windows)


def redraw_panels():
    """Redraw the panels, which do not follow the progress by themselves."""
    for area in areas("PROPERTIES", "VIEW_3D"):
        for region in area.regions:
            if area.type == "PROPERTIES" or region.type == "UI":
                region.tag_redraw()
