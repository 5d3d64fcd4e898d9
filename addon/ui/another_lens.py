"""Another lens on the picture that is rendered: the operator, and its place in the panel."""

import bpy

from ..job.refilter import applied_depth, apply_lens, kept_radiance
from ..scene.compositor import laid_fingerprint, lay_into_compositor
from ..scene.rings import rings_for, scene_iris
from . import window_render
from .operators import LensRender


def draw_another_lens(layout):
    """Draw the button that applies what is chosen to the last render."""
    layout.operator("lensfield.apply_lens", icon="FILE_REFRESH")


class LENSFIELD_OT_apply_lens(LensRender, bpy.types.Operator):
    """Put the light that the last render of this frame has kept through the lens and by the quality that are chosen
    now, without rendering again. The picture keeps its field of view: you are told what that is through the lens"""

    bl_idname = "lensfield.apply_lens"
    bl_label = "Apply to Last Render"

    def render(self, scene):
        """Put the kept light through the lens; what there is to tell of it."""
        settings = scene.lensfield
        lens = settings.lens_name_or_path()
        result = apply_lens(kept_radiance(scene), lens, options=settings.to_options(), view=settings.view.lower(),
                            rings=rings_for(scene, lens), iris=scene_iris(scene, lens),
                            lens_quality=settings.to_spectral_options().tier, depth=applied_depth(settings))
        if settings.to_compositor:
            lay_into_compositor(scene, result.lens_image, fingerprint=laid_fingerprint(scene))
        return result

    def start(self, scene):
        """Start putting the kept light through the lens; nothing is left out of the picture."""
        window_render.start_again(scene)
        return ()


classes = (LENSFIELD_OT_apply_lens,)
