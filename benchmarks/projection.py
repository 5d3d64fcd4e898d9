"""Pixels and processor seconds of captures on a plane, and in a panorama with the lens's distortion.

    python benchmarks/projection.py [LENS ...] [--size 192x144] [--samples 64]

Each row is a capture of the sample scene for a lens: its pixels over the frame's; and Cycles' processor seconds, in all
passes and per million samples. The second row has the view of the first, by the camera of the third: only the cost of a
sample differs.
"""

import argparse
import resource
import tempfile
from pathlib import Path

import bpy
import numpy as np

from lensfield import addon
from lensfield.addon.job.steps import RenderPass
from lensfield.addon.render.render import job_of_frame, render_steps
from lensfield.commands.terminal import quiet
from lensfield.engine.field import overscan
from lensfield.engine.image.projection import fitted_projection
from lensfield.engine.pictures.spectral_exr import read_exr

SCENE = Path(__file__).resolve().parents[1] / "sample_scenes" / "evening_chess.blend"
ROUNDS = 3


def plane_in_panorama(lens, grid):
    """The panorama closest to a plane over a grid."""
    radius = np.linspace(0, grid.farthest_px * grid.pitch_um * 1e-3 / lens.capture_focal_length_mm, 257)
    return fitted_projection(radius, radius, radius[-1])


CAPTURES = {"plane": (np.inf, overscan.lens_projection), "plane, by a panoramic camera": (0.0, plane_in_panorama),
            "panorama": (0.0, overscan.lens_projection)}
"""MOST_PLANE, and the panorama."""


def processor_s():
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def cycles(scene, lens, folder):
    """The capture's PixelGrid, and the processor seconds of its Cycles passes."""
    steps = render_steps(scene, job_of_frame(scene, scene.frame_current, lens=lens, output_folder=folder, view="lens",
                                             depth="off", denoise="off", to_compositor=False, lens_quality="preview"))
    passes_s, answer = [], None
    try:
        while True:
            step, answer = steps.send(answer), None
            if isinstance(step, RenderPass):
                begin_s = processor_s()
                with quiet(1):  # Blender prints where it saves each pass
                    bpy.ops.render.render(write_still=True, scene=step.scene.name)
                passes_s.append(processor_s() - begin_s)
            else:
                answer = step.call(lambda fraction: None)
    except StopIteration as end:
        return read_exr(end.value.radiance).grid, passes_s


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("lenses", nargs="*", metavar="LENS", default=["edmund-54852"])
    parser.add_argument("--size", default="192x144")
    parser.add_argument("--samples", type=int, default=64)
    options = parser.parse_args()
    addon.register()
    bpy.ops.wm.open_mainfile(filepath=str(SCENE))
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = map(int, options.size.split("x"))
    scene.render.resolution_percentage, scene.cycles.samples = 100, options.samples
    scene.cycles.use_adaptive_sampling = False
    for lens in options.lenses:
        for name, (overscan.MOST_PLANE, overscan.lens_projection) in CAPTURES.items():
            with tempfile.TemporaryDirectory() as folder:
                rounds = [cycles(scene, lens, Path(folder) / str(number)) for number in range(ROUNDS)]
            grid, passes_s = rounds[0][0], np.array([seconds for _, seconds in rounds])
            pixels = np.prod(grid.shape_px)
            least_s = passes_s.min(axis=0).sum()
            print(f"{lens:24} {name:28} {pixels / np.prod(grid.frame_px):6.3f} x the frame's pixels  {least_s:7.2f} s  "
                  f"{least_s / (pixels * options.samples * passes_s.shape[1]) * 1e6:6.2f} s per million samples",
                  flush=True)
    addon.unregister()


if __name__ == "__main__":
    main()
