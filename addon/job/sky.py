"""The sky: the hemisphere of the world in front of the camera, without the scene's objects, for worlds that nodes
compute, such as those with an HDRI."""

import numpy as np

from ...engine import SpectralImage
from ...engine.image.pixel_grid import PixelGrid
from ...engine.image.projection import FISHEYE
from ..scene.render_state import guard_render_state, rendered_layer, show_slab
from ..scene.undo import Journal
from ..scene.units import metres_per_unit
from .light import GatheredLight
from .slabs import BEYOND_ALL_UNITS, LOOK, Slab
from .steps import RenderPass

SIDE_PX, SAMPLES = 512, 16  # 0.35 degrees per pixel, less than the sun


def sky_steps(ready):
    """Steps that render the sky for a scene that is ready for its passes; returns a SpectralImage, an equidistant
    fisheye of the hemisphere.

    Parameters
    ----------
    ready : Ready
    """
    scene, job, plan = ready.scene, ready.job, ready.plan
    focal_mm, unit_m = job.lens.capture_focal_length_mm, metres_per_unit(scene)
    grid = PixelGrid((SIDE_PX, SIDE_PX), np.pi * focal_mm * 1e3 / SIDE_PX, projection=FISHEYE)
    slab = Slab(*(units * unit_m for units in BEYOND_ALL_UNITS), (slice(0, SIDE_PX), slice(0, SIDE_PX)), False, False)
    light = GatheredLight(plan, rendered_layer(scene).name, ready.group_names, slab, None, unit_m)
    path = ready.path.with_name("sky.exr")
    with Journal() as journal:
        guard_render_state(scene, job, grid, path, journal)
        for name, value in (LOOK | {"samples": SAMPLES}).items():
            journal.set(scene.cycles, name, value)
        journal.set(rendered_layer(scene), "samples", 0)  # no override of the scene's samples
        show_slab(scene, slab, grid, journal)
        for index, band in enumerate(plan.bands):
            ready.substitution.set_wavelengths(band, plan.dispersive)
            step = RenderPass(scene, f"Sky {index + 1} of {len(plan.bands)}", 0.0, 0.0)
            planes = yield from ready.passes.planes(step, path, light.planes, "sky", index)
            light.add(index, light.light_of(planes))
    return SpectralImage(light.radiance(), job.wavelengths_nm, grid, focal_mm=focal_mm)
