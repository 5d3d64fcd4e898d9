"""Progress of a render from what Blender says about it."""

import bpy
import pytest

from lensfield.addon.scene.watch import LOADING, samples_watched


@pytest.mark.parametrize("on_gpu", [True, False])
def test_samples_and_kernels_are_progress(on_gpu):
    noted, before = [], list(bpy.app.handlers.render_stats)
    with samples_watched(lambda *given: noted.append(given), on_gpu):
        on_stats = bpy.app.handlers.render_stats[-1]
        for text in ("Mem: 0M | Updating Shaders",
                     "Mem: 0M | Loading render kernels (may take a few minutes the first time)",
                     "Mem: 1M | Remaining: 00:00.01 | Sample 3/4"):
            on_stats(text)
    assert noted == [(0.0, LOADING)] * on_gpu + [(0.75,)]
    assert list(bpy.app.handlers.render_stats) == before
