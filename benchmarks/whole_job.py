"""Measure the whole job: a scene's lens picture by tiers, relative to a plain render by Cycles.

    .venv/bin/python benchmarks/whole_job.py [FILE.blend] [--size WIDTHxHEIGHT] [--samples N] [--lens NAME]

prints, for a plain render and each tier, processor seconds by stage and their sum relative to the plain render, which
has the same size and samples. Each job is a process with an empty cache, so its lens is baked anew.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import bpy

from lensfield import addon
from lensfield.addon.job.steps import RenderPass
from lensfield.addon.render.render import job_of_frame, render_steps
from lensfield.commands.terminal import quiet
from lensfield.engine.spectral.wavelength_choice import SpectralOptions

SCENE = Path(__file__).resolve().parents[1] / "sample_scenes" / "evening_chess.blend"
PLAIN = "plain render"
JOBS = {PLAIN: {}, "preview": {"tier": "preview", "depth": "off"}, "standard": {"tier": "standard", "depth": "off"},
        "standard, depth": {"tier": "standard", "depth": "auto"}, "reference": {"tier": "reference", "depth": "off"}}
STAGES = "lens", "Cycles", "filter", "rest"


def stages_of(options, name):
    """Processor seconds of a job's stages, by name, and its report's line about samples."""
    bpy.ops.wm.open_mainfile(filepath=str(options.blend))
    scene, (columns, rows) = bpy.context.scene, map(int, options.size.split("x"))
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = columns, rows, 100
    scene.cycles.samples, scene.view_layers[0].samples = options.samples, 0
    seconds = dict.fromkeys(STAGES, 0.0)
    with tempfile.TemporaryDirectory() as folder:
        if name == PLAIN:
            scene.render.filepath = f"{folder}/plain.png"
            return {"Cycles": _render_s(scene)}, ""
        begin_s = time.process_time()
        job = job_of_frame(scene, scene.frame_current, lens=options.lens, depth=JOBS[name]["depth"],
                           output_folder=folder, spectral=SpectralOptions(JOBS[name]["tier"]))
        seconds["lens"] = time.process_time() - begin_s
        steps, answer = render_steps(scene, job), None
        try:
            while True:
                begin_s = time.process_time()
                step = steps.send(answer)
                seconds["rest"] += time.process_time() - begin_s
                if isinstance(step, RenderPass):
                    seconds["Cycles"] += _render_s(step.scene)
                    answer = None
                else:
                    begin_s = time.process_time()
                    answer = step.call(lambda fraction: None)
                    seconds["filter" if step.label.startswith("Through") else "rest"] += time.process_time() - begin_s
        except StopIteration as end:
            return seconds, end.value.report.scene.samples


def _render_s(scene):
    begin_s = time.process_time()
    with quiet(1):
        bpy.ops.render.render(write_still=True, scene=scene.name)
    return time.process_time() - begin_s


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("blend", nargs="?", type=Path, default=SCENE)
    parser.add_argument("--size", default="384x288")
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--lens", default="edmund-54852")
    parser.add_argument("--job", choices=list(JOBS), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.job:
        addon.register()
        stages, samples = stages_of(options, options.job)
        print(json.dumps({"stages": stages, "samples": samples}))
        return
    print(f"the whole job: {options.blend.name}, {options.size} px, {options.samples} samples, {options.lens}: "
          "processor seconds", flush=True)
    print(f"{'':<17}" + "".join(f"{stage:>9}" for stage in (*STAGES, "sum", "multiple")))
    plain_s = None
    for name in JOBS:
        with tempfile.TemporaryDirectory() as cache:
            printed = subprocess.run([sys.executable, "-W", "ignore", __file__, *sys.argv[1:], "--job", name],
                                     check=True, env=os.environ | {"LENSFIELD_CACHE": cache},
                                     stdout=subprocess.PIPE).stdout
        facts = json.loads(printed.splitlines()[-1])
        total = sum(facts["stages"].values())
        plain_s = plain_s or total
        cells = [f"{facts['stages'].get(stage, 0):9.1f}" for stage in STAGES]
        print(f"{name:<17}{''.join(cells)}{total:9.1f}{total / plain_s:9.2f}  {facts['samples']}".rstrip(), flush=True)


if __name__ == "__main__":
    main()
