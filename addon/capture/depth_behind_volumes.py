"""Depth of the surfaces behind volumes, from a render without these."""

from ..job.steps import RenderPass
from ..scene.render_state import read_again, show_samples, show_slab
from ..scene.undo import Journal
from ..scene.volumes import hide_volumes
from .slabs import LOOK


def depth_behind_volumes(ready, lights, capture_px, fraction):
    """Steps that render the depth of a scene with volumes again, without these.

    Parameters
    ----------
    ready : Ready
    lights : sequence of GatheredLight
        Of all passes; their depth is modified.
    capture_px : PixelGrid
    fraction : float
        Of the job so far.
    """
    scene = ready.scene
    with Journal() as journal:
        if not hide_volumes(scene, journal):
            return
        for name, value in LOOK.items():
            journal.set(scene.cycles, name, value)
        show_samples(scene, 0, LOOK["samples"], False, journal)
        for light in lights:
            show_slab(scene, light.slab, capture_px, journal)
            step = RenderPass(scene, "Rendering depth behind volumes", fraction, 0.0)
            planes = yield from ready.passes.planes(step, ready.path, {light.depth_plane}, "depth behind volumes",
                                                    *light.slab.facts)
            light.depth_m = light.depth_of(planes)
    read_again(scene)
