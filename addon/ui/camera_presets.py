"""Presets of a camera's lens and body: in Blender's own menu, as files that Blender stores with its other presets."""

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from lensfield.engine.runtime.files import atomic_path

from ..scene.active_camera import camera_in
from ..scene.linked import stated_path

KEPT = ("lens", "lens_file", "view", "sensor_mm", "copy", "copy_grade", "coating", "focused_wide_open",
        "iris_roundness", "body", "body_file")
"""Settings of a camera that describe its lens and its body, rather than a picture taken with them."""
FILES = "lens_file", "body_file"
DEFINES = '''import bpy

camera = getattr(bpy.context, "camera", None) or bpy.context.scene.camera.data
settings = camera.lensfield
'''


class LENSFIELD_OT_add_camera_preset(AddPresetBase, bpy.types.Operator):
    """Add or remove a preset of this camera's lens and body"""

    bl_idname = "lensfield.add_camera_preset"
    bl_label = "Add Lens and Body Preset"
    preset_menu = "LENSFIELD_PT_camera_presets"
    preset_subdir = "lensfield/camera"

    @classmethod
    def poll(cls, context):
        return camera_in(context) is not None

    def add(self, context, filepath):
        """Write the preset's file, with complete paths: the preset is for all .blends."""
        camera = camera_in(context)
        settings = camera.lensfield
        values = {name: getattr(settings, name) for name in KEPT} | {
            name: stated_path(camera, name) for name in FILES}
        lines = [f"settings.{name} = {tuple(value) if hasattr(value, 'foreach_get') else value!r}"
                 for name, value in values.items() if value != ""]
        lines.append(f"camera.dof.aperture_blades = {camera.dof.aperture_blades}\n")
        with atomic_path(filepath, overwrite=True) as temporary:
            temporary.write_text("\n".join([DEFINES, *lines]), encoding="utf-8")


class LENSFIELD_PT_camera_presets(PresetPanel, bpy.types.Panel):
    bl_label = "Lens and Body Presets"
    preset_subdir = LENSFIELD_OT_add_camera_preset.preset_subdir
    preset_operator = "script.execute_preset"
    preset_add_operator = LENSFIELD_OT_add_camera_preset.bl_idname

    def draw(self, context):
        bpy.utils.user_resource("SCRIPTS", path=f"presets/{self.preset_subdir}", create=True)  # else Blender misses it
        super().draw(context)


def draw_presets(layout, context):
    """Draw the button of the menu, for a camera that can be changed."""
    camera = camera_in(context)
    if camera and camera.is_editable:
        LENSFIELD_PT_camera_presets.draw_panel_header(layout)


classes = (LENSFIELD_OT_add_camera_preset, LENSFIELD_PT_camera_presets)
