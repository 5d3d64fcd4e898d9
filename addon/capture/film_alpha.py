"""Alpha of a transparent film behind a traced lens.

Cycles weights each ray by its throughput, and a film's alpha is 1 minus the sum of the weights of the rays that meet
nothing. The lens lets only a part of the light through, so the same rays are rendered again without the scene: the
share of their weights that is missing is the share of the pixel's light that the scene covers. The noise of both is the
same, and pixels that show nothing have an alpha of exactly 0.
"""

from dataclasses import replace

import numpy as np

from ..job.steps import RenderPass
from ..scene.render_state import show_slab
from ..scene.units import metres_per_unit
from .slabs import BEYOND_ALL_UNITS

WITHOUT_SCENE = {"max_bounces": 0, "use_adaptive_sampling": False, "use_denoising": False}


def alpha_steps(ready, light, fraction, journal):
    """Steps that render the lens of the last pass without the scene; returns the alpha of the pass's light.

    Parameters
    ----------
    ready : Ready
        Of a traced lens.
    light : GatheredLight
        Of all its passes.
    fraction : float
        Of the job so far.
    journal : Journal

    Returns
    -------
    array (row, column)
        1 also where no ray passes the lens.
    """
    near_m, far_m = (units * metres_per_unit(ready.scene) for units in BEYOND_ALL_UNITS)
    show_slab(ready.scene, replace(light.slab, near_m=near_m, far_m=far_m), ready.capture_px, journal)
    for name, value in WITHOUT_SCENE.items():
        journal.set(ready.scene.cycles, name, value)
    name = light.planes[0]
    planes = yield from ready.passes.planes(RenderPass(ready.scene, "Rendering the lens alone", fraction, 0.0),
                                            ready.path, {name}, "lens alone")
    return covered_share(light.alpha, planes[name])


def covered_share(alpha, of_lens):
    """Share of each pixel's light that the scene covers, from a film's alpha with and without the scene: array."""
    total = 1 - of_lens
    free = np.divide(1 - alpha, total, out=np.zeros_like(total), where=total > 0)
    return np.clip(1 - free, 0, 1)
