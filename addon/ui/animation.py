"""The animation through the lens: its operator, and its button in the panel."""

import bpy

from ..job.animation import frames_of, render_animation
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
    any_build: bpy.props.BoolProperty(
        name="Accept Other Builds", options={"SKIP_SAVE"},
        description="Accept finished frames from other builds of Lensfield instead of rendering them again")

    @classmethod
    def description(cls, context, properties):
        if properties.overwrite:
            return "Render all of the scene's frame range, whatever is there already"
        if properties.any_build:
            return "Render the missing frames, and accept finished ones from other builds of Lensfield"
        return ""

    def render(self, scene):
        """Render the scene's range, and return the result."""
        return render_animation(scene, overwrite=self.overwrite, any_build=self.any_build,
                                to_compositor=scene.lensfield.to_compositor)

    def start(self, scene):
        """Start rendering the scene's range, and return remarks on what the pictures will lack."""
        return window_render.start(scene, "--frames", "scene", *["--overwrite"] * self.overwrite,
                                   *["--any-build"] * self.any_build,
                                   lens_quality=quality_at_hand(scene))


class LENSFIELD_MT_animation(bpy.types.Menu):
    """How else the animation can be rendered"""

    bl_label = "Animation through Lens"

    def draw(self, context):
        self.layout.operator_context = "INVOKE_DEFAULT"
        self.layout.operator("lensfield.render_animation", text="Overwrite Frames That Are There").overwrite = True
        self.layout.operator("lensfield.render_animation", text="Accept Frames of Other Builds").any_build = True
        draw_flamenco(self.layout)


def draw_animation(layout, scene):
    """Draw the animation's button, with the number of frames, and the menu of alternatives."""
    frames = frames_of(scene)
    row = layout.row(align=True)
    row.operator("lensfield.render_animation", icon="RENDER_ANIMATION",
                 text=f"Render Animation ({len(frames)} frame{'s' * (len(frames) != 1)})")
    row.menu("LENSFIELD_MT_animation", text="", icon="DOWNARROW_HLT")


classes = (LENSFIELD_OT_render_animation, LENSFIELD_MT_animation)
