"""Obstacles to a lens render that one click removes: a button next to the refusal."""

import bpy

from .text_wrap import draw_wrapped


def _make_perspective(scene):
    scene.camera.data.type = "PERSP"


def _clear_shift(scene):
    scene.camera.data.shift_x = scene.camera.data.shift_y = 0.0


def _make_square(scene):
    scene.render.pixel_aspect_x = scene.render.pixel_aspect_y = 1.0


def _clear_region(scene):
    scene.render.use_border = False


FIXES = {"type": ("Make Perspective", _make_perspective), "panorama type": ("Make Perspective", _make_perspective),
         "shift": ("Clear Shift", _clear_shift), "pixel aspect": ("Make Pixels Square", _make_square),
         "render region": ("Clear Render Region", _clear_region)}
"""Labels and functions by the field of the refusal."""


class LENSFIELD_OT_fix(bpy.types.Operator):
    """Change the setting that prevents a render through the lens"""

    bl_idname = "lensfield.fix"
    bl_label = "Fix"
    bl_options = {"REGISTER", "UNDO", "INTERNAL"}

    obstacle: bpy.props.EnumProperty(items=[(field, label, "") for field, (label, _) in FIXES.items()],
                                     options={"HIDDEN"})

    def execute(self, context):
        FIXES[self.obstacle][1](context.scene)
        return {"FINISHED"}


def draw_refusal(layout, error):
    """Draw why a scene cannot be rendered, and the button that removes the obstacle, if there is one."""
    draw_wrapped(layout, str(error), "ERROR")
    if error.field == "camera":
        layout.operator("lensfield.add_camera", icon="CAMERA_DATA")
    elif error.field in FIXES:
        layout.operator("lensfield.fix", text=FIXES[error.field][0], icon="MODIFIER").obstacle = error.field


classes = (LENSFIELD_OT_fix,)
