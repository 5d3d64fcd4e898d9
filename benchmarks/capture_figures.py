"""What a capture in slabs of depth costs beside one without, at equal samples: processor seconds of Cycles' renders.

    python benchmarks/capture_figures.py [SCENE.blend] [--lens NAME] [--slabs N] [--even] [--size WIDTHxHEIGHT]
        [--samples N] [--f-number N] [--focus MM]

The plan may take so many slabs (8), and takes as many as the accuracy asks for; or there are so many in any case, even
in inverse depth.
"""

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from lensfield import addon
from lensfield.addon.job import slabs
from lensfield.addon.job.render import job_of_frame, render_steps
from lensfield.addon.job.steps import RenderPass
from lensfield.commands.arguments import resolution
from lensfield.commands.terminal import quiet
from lensfield.engine import Options
from lensfield.engine.spectral.wavelength_choice import SpectralOptions

SCENE = Path(__file__).resolve().parents[1] / "sample_scenes" / "evening_chess.blend"


def evenly_cut(plan, count):
    ends = 1 / plan.check.nearest_mm, 1 / plan.check.farthest_mm
    return replace(plan, needed=True, borders_mm=tuple(1 / np.linspace(*ends, count + 1)[1:-1]),
                   margins_px=(plan.margin_px,) * count)


def render_seconds(scene, lens, depth, folder, **rings):
    """(label, processor seconds) of each render; and the plan in words."""
    job = job_of_frame(scene, scene.frame_current, lens=lens, wavelengths_nm=np.linspace(400, 700, 12),
                       output_folder=folder, options=Options(), spectral=SpectralOptions("preview"), view="camera",
                       unfit="render", depth=depth, denoise=False, **rings)
    steps, seconds, answer = render_steps(scene, job), [], None
    try:
        while True:
            step = steps.send(answer)
            begin, answer = time.process_time(), None
            if isinstance(step, RenderPass):
                with quiet(1):
                    bpy.ops.render.render(write_still=True, scene=step.scene.name)
                seconds.append((step.label, time.process_time() - begin))
            else:
                answer = step.call(lambda done: None)
    except StopIteration as end:
        return seconds, end.value.report.scene.layers


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", default=str(SCENE))
    parser.add_argument("--lens", default="kodak-petzval-100mm")
    parser.add_argument("--slabs", type=int, default=8)
    parser.add_argument("--even", action="store_true")
    parser.add_argument("--size", default="480x360")
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--f-number", type=float)
    parser.add_argument("--focus", type=float)
    asked = parser.parse_args()
    addon.register()
    with quiet(1):
        bpy.ops.wm.open_mainfile(filepath=asked.scene)
    scene, render = bpy.context.scene, bpy.context.scene.render
    render.resolution_x, render.resolution_y = resolution(asked.size)
    render.resolution_percentage, scene.cycles.samples = 100, asked.samples
    scene.cycles.use_adaptive_sampling = False
    slabs.PREVIEW_SLABS, plan_slabs = asked.slabs, slabs.plan_slabs
    if asked.even:
        slabs.plan_slabs = lambda *args, **named: evenly_cut(plan_slabs(*args, **named), asked.slabs)
    rings = {"f_number": asked.f_number, "focus": asked.focus}
    with tempfile.TemporaryDirectory() as folder:
        render_seconds(scene, asked.lens, "off", folder, **rings)  # what is loaded once is loaded
        whole = sum(s for _, s in render_seconds(scene, asked.lens, "off", folder, **rings)[0])
        (look, *parts), text = render_seconds(scene, asked.lens, "auto", folder, **rings)
    print(text)
    for label, seconds in (look, *parts):
        print(f"  {label}: {seconds:.2f} processor s")
    print(f"one render {whole:.2f} processor s; {len(parts)} {sum(s for _, s in parts):.2f}: "
          f"{sum(s for _, s in parts) / whole:.2f} times as long; the look {look[1] / whole:.2f}")


if __name__ == "__main__":
    main()
