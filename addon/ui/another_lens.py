"""Applying another lens to the last render: the operator, and its button in the panel."""

import bpy

from ..render.refilter import applied_fields, apply_lens, may_have_radiance, rendered_state, saved_radiance
from ..scene.compositor import lay_into_compositor
from . import window_render
from .operators import LensRender


def draw_another_lens(layout):
    """Draw the button that applies the current lens and quality to the last render."""
    layout.operator("lensfield.apply_lens", icon="FILE_REFRESH")


class LENSFIELD_OT_apply_lens(LensRender, bpy.types.Operator):
    """Apply the current lens and quality to the stored light of this frame's last render, without rendering again. The
    picture keeps its field of view, and Last Render reports the lens's sensor size or scale"""

    bl_idname = "lensfield.apply_lens"
    bl_label = "Apply to Last Render"

    @classmethod
    def poll(cls, context):
        if not super().poll(context):
            return False
        if may_have_radiance(context.scene):
            return True
        cls.poll_message_set("Render this frame through the lens first, with its radiance among the Spectral Files")
        return False

    def render(self, scene):
        """Apply the lens to the saved radiance, and return the result."""
        request = scene.lensfield.to_request()
        radiance = saved_radiance(scene)
        result = apply_lens(radiance, **applied_fields(scene, request))
        if request.to_compositor:
            lay_into_compositor(scene, result.lens_image, fingerprint=rendered_state(scene, radiance))
        return result

    def start(self, scene):
        """Start applying the lens to the saved radiance. Returns an empty tuple: the picture will be complete."""
        window_render.start_again(scene)
        return ()


classes = (LENSFIELD_OT_apply_lens,)
