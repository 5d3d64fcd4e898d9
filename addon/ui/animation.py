"""The animation through the lens: its operator, and its place in the panel."""

import bpy

from ..job.animation import own_frames, render_animation
from . import window_render
from .flamenco import draw_flamenco
from .lens_worker import quality_at_hand
from .operators import LensRender


class LENSFIELD_OT_render_animation(LensRender, bpy.types.Operator):
    """Render the scene's frame range through the lens. Frames that are there already, whole and by the same settings,
    stay as they are. In a window this goes on in the background, and you can go on working"""

    bl_idname = "lensfield.render_animation"
    bl_label = "Render Animation through Lens"

    overwrite: bpy.props.BoolProperty(name="Overwrite", description="Render frames anew that are there already",
                                      options={"SKIP_SAVE"})

    @classmethod
    def description(cls, context, properties):
        return "Render all of the scene's frame range, whatever is there already" if properties.overwrite else ""

    def render(self, scene):
        """Render the scene's range; what there is to tell of it."""
        return render_animation(scene, overwrite=self.overwrite, to_compositor=scene.lensfield.to_compositor)

    def start(self, scene):
        """Start rendering the scene's range; what the pictures will be without."""
        return window_render.start(scene, "--frames", "scene", *["--overwrite"] * self.overwrite,
                                   lens_quality=quality_at_hand(scene))


class LENSFIELD_MT_animation(bpy.types.Menu):
    """How else the animation can be rendered"""

    bl_label = "Animation through Lens"

    def draw(self, context):
        self.layout.operator_context = "INVOKE_DEFAULT"
        self.layout.operator("lensfield.render_animation", text="Overwrite Frames That Are There").overwrite = True
        draw_flamenco(self.layout)


def draw_animation(layout, scene):
    """The button of the animation, with its frames, and a menu of how else."""
    frames = own_frames(scene)
    row = layout.row(align=True)
    row.operator("lensfield.render_animation", icon="RENDER_ANIMATION",
                 text=f"Render Animation ({len(frames)} frame{'s' * (len(frames) != 1)})")
    row.menu("LENSFIELD_MT_animation", text="", icon="DOWNARROW_HLT")


classes = (LENSFIELD_OT_render_animation, LENSFIELD_MT_animation)
