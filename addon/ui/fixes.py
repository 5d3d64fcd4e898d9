"""Obstacles to a lens render that one click removes: a button next to the refusal."""

import bpy

from lensfield.engine.runtime.errors import InputError

from ..scene.linked import check_editable
from .common.plain_words import plain
from .common.text_wrap import draw_wrapped


def _make_perspective(camera):
    camera.type = "PERSP"


def _make_square(scene):
    scene.render.pixel_aspect_x = scene.render.pixel_aspect_y = 1.0


def _clear_region(scene):
    scene.render.use_border = False


def _camera_of(scene):
    return scene.camera.data


def _itself(scene):
    return scene


FIXES = {"type": ("Make Perspective", _camera_of, _make_perspective),
         "panorama type": ("Make Perspective", _camera_of, _make_perspective),
         "pixel aspect": ("Make Pixels Square", _itself, _make_square),
         "render region": ("Clear Render Region", _itself, _clear_region)}
"""Labels, data-blocks of a scene and functions that change them, by the field of the refusal."""


class LENSFIELD_OT_fix(bpy.types.Operator):
    """Change the setting that prevents a render through the lens"""

    bl_idname = "lensfield.fix"
    bl_label = "Fix"
    bl_options = {"REGISTER", "UNDO", "INTERNAL"}

    obstacle: bpy.props.EnumProperty(items=[(field, label, "") for field, (label, *_) in FIXES.items()],
                                     options={"HIDDEN"})

    def execute(self, context):
        _, data_block_of, fix = FIXES[self.obstacle]
        data_block = data_block_of(context.scene)
        try:
            check_editable(data_block)
        except InputError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        fix(data_block)
        return {"FINISHED"}


def draw_refusal(layout, error):
    """Draw why a scene cannot be rendered, and the button that removes the obstacle, if there is one."""
    draw_wrapped(layout, plain(error), "ERROR")
    if error.field == "camera":
        layout.operator("lensfield.add_camera", icon="CAMERA_DATA")
    elif error.field in FIXES:
        layout.operator("lensfield.fix", text=FIXES[error.field][0], icon="MODIFIER").obstacle = error.field


classes = (LENSFIELD_OT_fix,)
