"""Another lens on the picture that is rendered: the operator, and its place in the panel."""

import bpy

from ...engine.errors import InputError
from ..job.refilter import apply_lens, kept_radiance
from ..scene.compositor import laid_fingerprint, lay_into_compositor
from . import window_render


def draw_another_lens(layout):
    """Draw the button that applies what is chosen to the last render."""
    layout.operator("lensfield.apply_lens", icon="FILE_REFRESH")


class LENSFIELD_OT_apply_lens(bpy.types.Operator):
    """Put the light that the last render of this frame has kept through the lens and by the quality that are chosen
    now, without rendering again. The picture keeps its field of view: you are told what that is through the lens"""

    bl_idname = "lensfield.apply_lens"
    bl_label = "Apply to Last Render"

    @classmethod
    def poll(cls, context):
        if window_render.state["render"]:
            cls.poll_message_set("A lens render is under way: wait for it, or cancel it")
            return False
        return not bpy.app.is_job_running("RENDER")

    def execute(self, context):
        scene, settings = context.scene, context.scene.lensfield
        try:
            result = apply_lens(kept_radiance(scene), settings.lens_name_or_path(), options=settings.to_options(),
                                view=settings.view.lower())
        except (InputError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if settings.to_compositor:
            lay_into_compositor(scene, result.lens_image, fingerprint=laid_fingerprint(scene))
        self.report({"INFO"}, "; ".join(result.told))
        return {"FINISHED"}

    def invoke(self, context, event):
        try:
            window_render.start_again(context.scene)
        except (InputError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


classes = (LENSFIELD_OT_apply_lens,)
