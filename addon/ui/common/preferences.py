"""The add-on's preferences, in Blender's *Preferences > Add-ons*."""

import bpy

from lensfield.engine.kernels.library import use_gpu

PACKAGE = __package__.rsplit(".", 3)[0]
IN_CAMERA, IN_PANEL = "CAMERA", "PANEL"
AUTO, OFF = "AUTO", "OFF"


class LensfieldPreferences(bpy.types.AddonPreferences):
    """What the user prefers in all files."""

    bl_idname = PACKAGE

    preview_place: bpy.props.EnumProperty(
        name="Show Preview in", default=IN_CAMERA, description="Where the preview appears",
        items=[(IN_CAMERA, "Camera View", "Over the camera's view in the 3D viewport, which Preview turns to it, and "
                                          "in Image Editors"),
               (IN_PANEL, "Panel", "In the Lensfield panel and in Image Editors; no 3D viewport changes")])

    lens_on_gpu: bpy.props.EnumProperty(
        name="Lens on GPU", default=AUTO, update=lambda self, context: follow_gpu(),
        description="Where out-of-focus light is cast through the lens, and wide blur of in-focus light is computed",
        items=[(AUTO, "Auto", "On the graphics card, if its pictures agree with the CPU's"),
               (OFF, "Off", "On the CPU")])

    def draw(self, context):
        self.layout.use_property_split = True
        self.layout.prop(self, "preview_place")
        self.layout.prop(self, "lens_on_gpu")
        self.layout.operator("lensfield.write_lens_assets", icon="ASSET_MANAGER")


def addon_preferences():
    """The LensfieldPreferences; None if Lensfield is not enabled as an add-on, as in scripts."""
    addon = bpy.context.preferences.addons.get(PACKAGE)
    return addon.preferences if addon else None


def preview_place():
    """Where the preview appears."""
    preferences = addon_preferences()
    return preferences.preview_place if preferences else IN_CAMERA


def follow_gpu():
    """Let this Blender and the processes that it starts use the graphics card as preferred."""
    preferences = addon_preferences()
    use_gpu(not preferences or preferences.lens_on_gpu == AUTO)


classes = (LensfieldPreferences,)
