"""The animation through the lens: its operator, and its button in the panel."""

import bpy

from ..render.animation import frames_of, render_animation
from . import window_render
from .operators import LensRender


class LENSFIELD_OT_render_animation(LensRender, bpy.types.Operator):
    """Render the scene's frame range through the lens. Complete frames with the same settings are skipped. In a window,
    this runs in the background and you can keep working"""

    bl_idname = "lensfield.render_animation"
    bl_label = "Render Animation through Lens"

    overwrite: bpy.props.BoolProperty(name="Overwrite", description="Render existing frames again",
                                      options={"SKIP_SAVE"})
    any_build: bpy.props.BoolProperty(
        name="Accept Other Builds", options={"SKIP_SAVE"},
        description="Accept finished frames from other builds of Lensfield instead of rendering them again")

    @classmethod
    def description(cls, context, properties):
        if properties.overwrite:
            return "Render the scene's complete frame range, including existing frames"
        if properties.any_build:
            return "Render the missing frames, and accept finished frames from other builds of Lensfield"
        return ""

    def render(self, scene):
        """Render the scene's range, and return the result."""
        return render_animation(scene, overwrite=self.overwrite, any_build=self.any_build,
                                to_compositor=scene.lensfield.to_compositor)

    def start(self, scene):
        """Start rendering the scene's range, and return remarks on what the pictures will lack."""
        return window_render.start(scene, "--frames", "scene", *["--overwrite"] * self.overwrite,
                                   *["--any-build"] * self.any_build)


class LENSFIELD_MT_animation(bpy.types.Menu):
    """Other ways to render the animation"""

    bl_label = "Animation through Lens"

    def draw(self, context):
        self.layout.operator_context = "INVOKE_DEFAULT"
        self.layout.operator("lensfield.render_animation", text="Overwrite Existing Frames").overwrite = True
        self.layout.operator("lensfield.render_animation", text="Accept Frames from Other Builds").any_build = True


def draw_animation(layout, scene):
    """Draw the animation's button, with the number of frames, and the menu of alternatives."""
    frames = frames_of(scene)
    row = layout.row(align=True)
    row.operator("lensfield.render_animation", icon="RENDER_ANIMATION",
                 text=f"Render Animation ({len(frames)} frame{'s' * (len(frames) != 1)})")
    row.menu("LENSFIELD_MT_animation", text="", icon="DOWNARROW_HLT")


classes = (LENSFIELD_OT_render_animation, LENSFIELD_MT_animation)
