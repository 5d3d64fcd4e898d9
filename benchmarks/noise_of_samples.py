"""Measure what few samples cost and leave: noise and bias of captures with a control variate, and their seconds.

    .venv/bin/python benchmarks/noise_of_samples.py [FILE.blend or cornell ...] [--seeds 3] [--size WIDTHxHEIGHT]
        [--samples N]

prints a line for each scene, by default the sample scene and the Cornell box. Each seed is rendered plainly by Cycles,
captured in *Standard*, and captured again with all samples in each pass, always with the camera's view. See LEGEND for
the columns. Scenes without a camera or without light get one. Costs need a larger picture than noise (320x240), because
small renders mostly synchronise the scene; the bias needs 48 seeds.
"""

import argparse
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from unittest.mock import patch

import bpy
import numpy as np
import scipy
from mathutils import Vector
from scene_figures import SCENE, colour_errors

from lensfield import addon
from lensfield.addon.capture import radiance
from lensfield.addon.job.result import Result
from lensfield.addon.job.steps import RenderPass
from lensfield.addon.render.render import job_of_frame
from lensfield.commands.terminal import quiet
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.spectral.wavelength_choice import sensor_error

VALIDATION = Path(__file__).resolve().parents[1] / "validation"
CORNELL = "cornell"
BLOCK_PX = 16
DARK = 0.01  # of a band's mean light: darker blocks are compared with this much
MOST_NOISE, MOST_COST, MOST_BIAS = 1.3, 1.6, 0.003
ROUNDING = 1e-5  # of a block's light: least standard error of a difference
CHANCE = 0.05  # that noise alone exceeds the limit of the largest deviation
COLUMNS, WIDTH = ("cost", "whole", "noise", "of all", "ratio", "sensor", "bias", "±", "sigmas", "limit"), 8
LEGEND = f"""\
cost, whole    processor seconds of Cycles and of the estimates, relative to a plain render of the same size and
               samples: of the capture, at most {MOST_COST}; and with all samples in each pass
noise, of all  median CIEDE2000 of the pixels, relative to a capture of many samples in each pass; with all samples
ratio          of the two: at most {MOST_NOISE}
sensor         ratio of the relative RMS errors in the worst of three sensor bands
bias, ±        the mean difference between the two captures of a seed, in blocks of {BLOCK_PX} x {BLOCK_PX} px at each
               wavelength, relative to the light: RMS in excess of the standard errors, at most {MOST_BIAS:.1%}; and
               the median of these errors
sigmas, limit  the largest of these differences, in standard errors; at most the limit that noise alone exceeds with a
               probability of {CHANCE:.0%}
!              missed"""


def open_scene(name, size, options):
    """The scene of a file or the Cornell box, with the options' size and samples: bpy.types.Scene."""
    columns, rows = size
    if name == CORNELL:
        sys.path.insert(0, str(VALIDATION))
        import cornell_blender  # noqa: PLC0415 - needs the folder on the path
        scene = cornell_blender.build(rows, options.samples)
        columns = rows
    else:
        with quiet(1):
            bpy.ops.wm.open_mainfile(filepath=str(name), use_scripts=False)
        scene = bpy.context.scene
    scene.render.engine, scene.cycles.device = "CYCLES", "CPU"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = columns, rows, 100
    scene.cycles.use_adaptive_sampling, scene.cycles.time_limit = options.adaptive, 0
    scene.cycles.use_denoising, scene.cycles.use_animated_seed = False, False
    for layer in scene.view_layers:
        layer.samples = 0
    if scene.camera is None:
        _add(scene, bpy.data.cameras.new("Camera"))
        scene.camera = scene.objects["Camera"]
    if not any(each.type == "LIGHT" for each in scene.objects) and not scene.world:
        _add(scene, bpy.data.lights.new("Sun", "SUN")).data.energy = 3
    return scene


def _add(scene, data):
    """Add an object that looks at the scene's meshes from the upper right, at about their size's distance."""
    corners = np.array([each.matrix_world @ Vector(corner) for each in scene.objects if each.type == "MESH"
                        for corner in each.bound_box])
    low, high = corners.min(axis=0), corners.max(axis=0)
    towards = Vector((0.6, -0.7, 0.45)).normalized()
    thing = bpy.data.objects.new(data.name, data)
    thing.location = Vector((low + high) / 2) + towards * float(np.linalg.norm(high - low))
    thing.rotation_euler = towards.to_track_quat("Z", "Y").to_euler()
    scene.collection.objects.link(thing)
    return thing


def captured(scene, options, seed, samples, whole=False):
    """The radiance of a capture's frame, its wavelengths, its report's line on samples, and the processor seconds of
    its renders and estimates."""
    scene.cycles.seed, scene.cycles.samples = seed, samples
    with tempfile.TemporaryDirectory() as folder, quiet(1), ExitStack() as changes:
        if whole:
            changes.enter_context(patch.object(radiance, "shares_noise", lambda *_: False))
        job = job_of_frame(scene, scene.frame_current, lens=options.lens, output_folder=Path(folder), view="camera",
                           depth="off", unfit="render", denoise="on" if options.denoise else "off")
        result = Result.of(scene, Path(folder), job.frame)
        capture, seconds = drained(radiance.capture(scene, job, result, 1.0))
    picture = capture.radiance.frame()
    return picture.cube.astype(float), picture.wavelengths_nm, result.report.scene.samples, seconds


def drained(steps):
    """The return value of a job's steps, and the processor seconds of each step's own work."""
    seconds, answer = 0.0, None
    try:
        while True:
            step = steps.send(answer)
            begin_s = time.process_time()
            answer = render(step.scene) if isinstance(step, RenderPass) else step.call(lambda fraction: None)
            seconds += time.process_time() - begin_s
    except StopIteration as end:
        return end.value, seconds


def render(scene):
    bpy.ops.render.render(write_still=True, scene=scene.name)


def plain_s(scene, seed, samples, folder):
    """Processor seconds of a render by Cycles alone."""
    scene.cycles.seed, scene.cycles.samples, scene.render.filepath = seed, samples, f"{folder}/plain.png"
    begin_s = time.process_time()
    with quiet(1):
        render(scene)
    return time.process_time() - begin_s


def figures(scene, options):
    """The cells of a scene's row, and its report's line on samples."""
    seeds = range(1, options.seeds + 1)
    truth, nm, *_ = captured(scene, options, 0, options.reference * options.samples, whole=True)
    plain, few, every = [], [], []
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            plain.append(plain_s(scene, seed, options.samples, folder))
        few.append(captured(scene, options, seed, options.samples))
        every.append(captured(scene, options, seed, options.samples, whole=True))
    costs = [sum(seconds for *_, seconds in captures) / sum(plain) for captures in (few, every)]
    pixels, *spectra = (np.array(cubes).reshape(-1, len(nm), truth[0].size).swapaxes(1, 2)
                        for cubes in (truth, *([cube for cube, *_ in captures] for captures in (few, every))))
    noise, of_all = (np.mean([np.median(colour_errors(pixels[0], each, nm)) for each in cubes]) for cubes in spectra)
    sensor, sensor_of_all = (np.mean([sensor_error(pixels[0], each, nm) for each in cubes]) for cubes in spectra)
    bias, error, sigmas, limit = bias_of(
        np.array([one[0] - other[0] for one, other in zip(few, every, strict=True)]), truth)
    return [judged(costs[0], MOST_COST, ".2f"), f"{costs[1]:.2f} ", f"{noise:.3f} ", f"{of_all:.3f} ",
            judged(noise / of_all, MOST_NOISE, ".2f"), f"{sensor / sensor_of_all:.2f} ",
            judged(bias, MOST_BIAS, ".2%"), f"{error:.2%} ", judged(sigmas, limit, ".1f"), f"{limit:.1f} "], few[-1][2]


def bias_of(differences, truth):
    """The four figures of bias, from differences (seed, wavelength, row, column)."""
    light = blocks(truth)
    light = np.maximum(light, DARK * light.mean(axis=(1, 2), keepdims=True))
    shares = np.array([blocks(each) for each in differences]) / np.where(light > 0, light, 1)
    mean = shares.mean(axis=0)
    error = np.maximum(shares.std(axis=0, ddof=1) / np.sqrt(len(shares)), ROUNDING)
    limit = scipy.special.stdtrit(len(shares) - 1, 1 - CHANCE / 2 / mean.size)
    return np.sqrt(max(np.mean(mean**2 - error**2), 0)), np.median(error), np.max(np.abs(mean) / error), limit


def blocks(cube):
    """Means over blocks: array (wavelength, row of blocks, column of blocks)."""
    rows, columns = (n // BLOCK_PX for n in cube.shape[1:])
    cube = cube[:, :rows * BLOCK_PX, :columns * BLOCK_PX].reshape(-1, rows, BLOCK_PX, columns, BLOCK_PX)
    return cube.mean(axis=(2, 4))


def judged(value, most, form):
    return f"{value:{form}}{'!' if value > most else ' '}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=[SCENE, CORNELL], metavar="FILE.blend or cornell")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--size", default="96x72")
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--reference", type=int, default=16, help="samples of the reference, in multiples")
    parser.add_argument("--lens", default="edmund-54852")
    parser.add_argument("--adaptive", action="store_true", help="with Cycles' adaptive sampling")
    parser.add_argument("--denoise", action="store_true")
    options = parser.parse_args()
    addon.register()
    print(f"{options.size} px, {options.samples} samples, {options.seeds} seeds, {options.lens}\n{LEGEND}\n")
    print(f"{'scene':<24}" + "".join(f"{name:>{WIDTH}}" for name in COLUMNS))
    for name in options.scenes:
        try:
            cells, samples = figures(open_scene(name, [*map(int, options.size.split("x"))], options), options)
        except InputError as error:
            cells, samples = [], str(error)
        row = "".join(f"{cell:>{WIDTH}}" for cell in cells)
        print(f"{Path(name).stem[:23]:<24}{row}  {samples}", flush=True)


if __name__ == "__main__":
    main()
