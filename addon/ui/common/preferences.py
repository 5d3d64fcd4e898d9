"""The add-on's preferences, in Blender's *Preferences > Add-ons*."""

import bpy

PACKAGE = __package__.rsplit(".", 3)[0]
IN_CAMERA, IN_PANEL = "CAMERA", "PANEL"


class LensfieldPreferences(bpy.types.AddonPreferences):
    """What the user prefers in all files."""

    bl_idname = PACKAGE

    preview_place: bpy.props.EnumProperty(
        name="Show Preview in", default=IN_CAMERA, description="Where the preview appears",
        items=[(IN_CAMERA, "Camera View", "Over the camera's view in the 3D viewport, which Preview turns to it, and "
                                          "in Image Editors"),
               (IN_PANEL, "Panel", "In the Lensfield panel and in Image Editors; no 3D viewport changes")])

    favourite_lenses: bpy.props.StringProperty(options={"HIDDEN"})  # names, separated by spaces

    def draw(self, context):
        self.layout.use_property_split = True
        self.layout.prop(self, "preview_place")
        self.layout.operator("lensfield.write_lens_assets", icon="ASSET_MANAGER")


def addon_preferences():
    """The LensfieldPreferences; None if Lensfield is not enabled as an add-on, as in scripts."""
    addon = bpy.context.preferences.addons.get(PACKAGE)
    return addon.preferences if addon else None


def preview_place():
    """Where the preview appears."""
    preferences = addon_preferences()
    return preferences.preview_place if preferences else IN_CAMERA


def favourite_lenses():
    """The names of the user's favourite lenses."""
    preferences = addon_preferences()
    return frozenset(preferences.favourite_lenses.split()) if preferences else frozenset()


classes = (LensfieldPreferences,)
