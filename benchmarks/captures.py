"""Captures of scenes: their cost, their colours, and the noise and bias of few samples."""

import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import bpy
import numpy as np
import scipy
from cases import ROOT, SCENE, pixels
from mathutils import Vector
from timing import marked

from lensfield import addon
from lensfield.addon.capture import radiance
from lensfield.addon.job.result import Result
from lensfield.addon.job.steps import RenderPass
from lensfield.addon.render.render import job_of_frame, render_steps
from lensfield.commands.terminal import quiet
from lensfield.engine import Options, simulate
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.spectral.colour_difference import ciede2000, lab_from_xyz
from lensfield.engine.spectral.spectra import colour_matching
from lensfield.engine.spectral.wavelength_choice import SpectralOptions, sensor_error

CYCLES, OWN = "Cycles", ""  # in place of the labels of steps, for renders and for the generator's own work
CORNELL, SCENES = "cornell", (str(SCENE), "cornell")
LENS, GRID_SIDE = "edmund-54852", 708  # squares: a million triangles
STANDARD, DEFAULTS = SpectralOptions(), Options()
SAME_PATHS = Options(detail="off")  # in parts of pixels, light takes other paths, so that noise would be compared
MEANS_PX = 4  # averages over blocks keep noise out of the colours

BLOCK_PX = 16
DARK = 0.01  # of a band's mean light: darker blocks are compared with this much
MOST_NOISE, MOST_COST, MOST_BIAS = 1.3, 1.6, 0.003
ROUNDING = 1e-5  # of a block's light: least standard error of a difference
CHANCE = 0.05  # that noise alone exceeds the limit of the largest deviation
COLUMNS, WIDTH = ("cost", "whole", "noise", "of all", "ratio", "sensor", "bias", "±", "sigmas", "limit"), 8
NOISE_LEGEND = f"""\
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

FINER, TRUE_SAMPLES = 4, 48  # parts of a pixel across and down; samples in each
DETAIL_LEGEND = """\
error      misplaced light (L1), relative to the light: noise, blur, and the truth's noise
noise      the part that differs between seeds
dE 50, 90  median and 90 % of the pixels' CIEDE2000
seconds    of the processor: Cycles and estimates, and the lens"""


def timed(steps, clock=time.process_time):
    """The return value of a job's steps, and (label, seconds) of each and of the generator's own work between them."""
    spent, answer = [], None

    def measured(label, work, *arguments):
        begin_s = clock()
        result = work(*arguments)
        spent.append((label, clock() - begin_s))
        return result

    try:
        while True:
            step = measured(OWN, steps.send, answer)
            if isinstance(step, RenderPass):
                answer = measured(CYCLES, rendered, step.scene)
            else:
                answer = measured(step.label, step.call, lambda fraction: None)
    except StopIteration as end:
        return end.value, spent


def steps_s(spent):
    """Seconds of a job's steps, without the generator's own work."""
    return sum(seconds for label, seconds in spent if label != OWN)


def rendered(scene):
    """Render a scene by Cycles."""
    with quiet(1):  # Blender prints where it saves each pass
        bpy.ops.render.render(write_still=True, scene=scene.name)


def scene(*, quick=False) -> Iterator[str]:
    """The cost and accuracy of the Blender side: passes, seconds and colours.

    * The overhead of a wavelength band in a scene of a million triangles.
    * The sample scene by tiers: passes, seconds, and errors of colours compared with a render of every wavelength.
    * The time that Lensfield adds to Cycles in a 1080p frame of 12 wavelengths at 64 samples (25 minutes; with --quick,
      at an eighth of the samples).
    """
    addon.register()
    yield band_overhead()
    yield from tiers()
    yield full_frame(8 if quick else 64)


def frame_timed(scene, wavelengths_nm, spectral=STANDARD, options=DEFAULTS):
    """Render a scene; returns the seconds of each Cycles pass and of the rest, the report, and the radiance."""
    with tempfile.TemporaryDirectory() as folder:
        job = job_of_frame(scene, scene.frame_current, lens=LENS, wavelengths_nm=wavelengths_nm, output_folder=folder,
                           options=options, spectral=spectral, view="lens", unfit="refuse", denoise="off",
                           to_compositor=False)
        result, spent = timed(render_steps(scene, job), time.perf_counter)
        passes = [seconds for label, seconds in spent if label == CYCLES]
        return passes, sum(seconds for _, seconds in spent) - sum(passes), result.report, read_exr(result.radiance)


def million_triangles():
    """A wavy grid of a million triangles with a coloured material, under a sun and a world."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples, scene.cycles.device = "CYCLES", 1, "CPU"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 64, 48, 100
    x, y = np.meshgrid(np.linspace(-5, 5, GRID_SIDE + 1), np.linspace(-5, 5, GRID_SIDE + 1))
    corners = np.stack([x, y, 0.3 * np.sin(3 * x) * np.cos(4 * y)], axis=-1).reshape(-1, 3)
    row, column = np.divmod(np.arange(GRID_SIDE**2), GRID_SIDE)
    first = row * (GRID_SIDE + 1) + column
    faces = np.stack([first, first + 1, first + GRID_SIDE + 2, first + GRID_SIDE + 1], axis=1)
    mesh = bpy.data.meshes.new("Grid")
    mesh.from_pydata(corners, [], faces)
    painted = bpy.data.materials.new("Paint")
    painted.use_nodes = True
    painted.lensfield.reflectance = "chart-15-red"
    mesh.materials.append(painted)
    for name, data, height in (("Grid", mesh, 0), ("Camera", bpy.data.cameras.new("Camera"), 12),
                               ("Sun", bpy.data.lights.new("Sun", "SUN"), 5)):
        thing = bpy.data.objects.new(name, data)
        thing.location.z = height
        scene.collection.objects.link(thing)
    scene.camera = bpy.data.objects["Camera"]
    scene.world = bpy.data.worlds.new("World")
    return scene


def band_overhead():
    passes, _, _, _ = frame_timed(million_triangles(), np.linspace(400, 700, 31), SpectralOptions("reference"))
    alone = bpy.context.scene
    alone.render.use_persistent_data = True
    seconds = []
    with tempfile.TemporaryDirectory() as folder:
        alone.render.filepath = f"{folder}/alone.png"
        for _ in range(4):
            begin = time.perf_counter()
            rendered(alone)
            seconds.append(time.perf_counter() - begin)
    return (f"a million triangles, {len(passes)} passes of 3 wavelengths, 64 x 48 px, 1 sample: the first "
            f"{passes[0]:.2f} s, each other {np.median(passes[1:]):.3f} s (target: at most 0.05 s); a plain render of "
            f"the unchanged scene: {np.median(seconds[1:]):.3f} s")


def sample_scene(width, height, samples):
    with quiet(1):
        bpy.ops.wm.open_mainfile(filepath=str(SCENE))
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y, scene.cycles.samples = width, height, samples
    scene.cycles.sample_clamp_direct = scene.cycles.sample_clamp_indirect = 0  # Reference does not clamp
    return scene


def tiers():
    wavelengths_nm = np.linspace(400, 700, 31)
    yield ("the sample scene, 192 x 144 px, 64 samples, 31 wavelengths; colours and three sensor bands of means "
           f"over {MEANS_PX} x {MEANS_PX} px, compared with a render of every wavelength")
    truth = None
    for name, spectral in (("reference", SpectralOptions("reference")), ("preview", SpectralOptions("preview")),
                           ("standard", SpectralOptions()), ("colour error 2", SpectralOptions(colour_error=2)),
                           ("colour error 0.1", SpectralOptions(colour_error=0.1)),
                           ("sensor error 0.002", SpectralOptions(sensor_error=0.002))):
        passes, _, report, light = frame_timed(sample_scene(192, 144, 64), wavelengths_nm, spectral, SAME_PATHS)
        blocks = block_means(light)
        truth = blocks if truth is None else truth
        colour, sensor = colour_errors(truth, blocks, wavelengths_nm), sensor_error(truth, blocks, wavelengths_nm)
        facts = report.scene
        yield (f"  {name:<20}{facts.passes:3d} passes {sum(passes):7.1f} s; CIEDE2000 median {np.median(colour):.2f}, "
               f"95 % {np.percentile(colour, 95):.2f}, predicted {facts.predicted_colour_error:.2f}; sensor "
               f"{sensor:.2%}, predicted {facts.predicted_sensor_error:.2%}; worst wavelength "
               f"{spectral_error(truth, blocks):.1%}, predicted {facts.predicted_spectral_error:.1%}")


def block_means(light):
    """Mean spectra of blocks: array (block, wavelength)."""
    cube = light.frame().cube.astype(float)
    rows, columns = (n // MEANS_PX for n in cube.shape[1:])
    cube = cube[:, :rows * MEANS_PX, :columns * MEANS_PX].reshape(-1, rows, MEANS_PX, columns, MEANS_PX)
    return cube.mean(axis=(2, 4)).reshape(len(cube), -1).T


def colour_errors(truth, blocks, wavelengths_nm):
    """CIEDE2000 of every block, relative to a white with D65's chromaticity and the 99th percentile of luminance."""
    matching = colour_matching(wavelengths_nm)
    white = np.array([0.9505, 1, 1.089]) * np.percentile(truth @ matching[:, 1], 99)
    return ciede2000(lab_from_xyz(truth @ matching, white), lab_from_xyz(np.maximum(blocks, 0) @ matching, white))


def spectral_error(truth, blocks):
    """Relative RMS error at the worst wavelength."""
    return np.sqrt(((blocks - truth)**2).mean(axis=0) / (truth**2).mean(axis=0)).max()


def full_frame(samples):
    passes, rest, report, _ = frame_timed(sample_scene(1920, 1080, samples), np.linspace(400, 700, 12))
    return (f"the sample scene, 1920 x 1080 px, {samples} samples, 12 wavelengths: Cycles {sum(passes):.0f} s in "
            f"{len(passes)} passes, the rest {rest:.1f} s: {rest / sum(passes):.1%} (target: at most 10 % at 64 "
            "samples); "
            + ", ".join(f"{stage} {seconds:.1f} s" for stage, seconds in report.stages.items()
                        if stage != "multispectral render"))


def noise(scenes=SCENES, *, seeds: int = 3, size: str = "96x72", samples: int = 64, reference: int = 16,
          lens: str = LENS, adaptive=False, denoise=False) -> Iterator[str]:
    """What few samples cost and leave: noise and bias of captures with a control variate, and their seconds.

    A line for each scene, FILE.blend or cornell. Each seed is rendered plainly by Cycles, captured in *Standard*, and
    captured again with all samples in each pass, always with the camera's view and without detail. The reference has
    `reference` times as many samples. Scenes without a camera or without light get one. Costs need a larger picture
    than noise (320x240), because small renders mostly synchronise the scene; the bias needs 48 seeds.
    """
    addon.register()
    yield f"{size} px, {samples} samples, {seeds} seeds, {lens}\n{NOISE_LEGEND}\n"
    yield f"{'scene':<24}" + "".join(f"{name:>{WIDTH}}" for name in COLUMNS)
    for name in scenes:
        try:
            opened, captures = open_scene(name, size, samples, adaptive), Captures(lens, samples, denoise)
            cells, words = captures.cells(opened, range(1, seeds + 1), reference)
        except InputError as error:
            cells, words = [], str(error)
        yield f"{Path(name).stem[:23]:<24}" + "".join(f"{cell:>{WIDTH}}" for cell in cells) + f"  {words}"


@dataclass(frozen=True)
class Captures:
    """Captures of scenes in *Standard*, for `noise`."""

    lens: str
    samples: int
    denoise: bool

    def captured(self, scene, seed, times=1, whole=False):
        """The radiance of a capture's frame, its wavelengths, its report's line on samples, and the processor seconds
        of its renders and estimates."""
        scene.cycles.seed, scene.cycles.samples = seed, times * self.samples
        with tempfile.TemporaryDirectory() as folder, quiet(1), ExitStack() as changes:
            if whole:
                changes.enter_context(patch.object(radiance, "shares_noise", lambda *_: False))
            job = job_of_frame(scene, scene.frame_current, lens=self.lens, output_folder=Path(folder), view="camera",
                               depth="off", unfit="render", denoise="on" if self.denoise else "off",
                               options=SAME_PATHS)
            result = Result.of(scene, Path(folder), job.frame)
            capture, spent = timed(radiance.capture(scene, job, result, 1.0))
        picture = capture.radiance.frame()
        return picture.cube.astype(float), picture.wavelengths_nm, result.report.scene.samples, steps_s(spent)

    def plain_s(self, scene, seed):
        """Processor seconds of a render by Cycles alone."""
        with tempfile.TemporaryDirectory() as folder:
            scene.cycles.seed, scene.cycles.samples = seed, self.samples
            scene.render.filepath = f"{folder}/plain.png"
            begin_s = time.process_time()
            rendered(scene)
            return time.process_time() - begin_s

    def cells(self, scene, seeds, reference):
        """The cells of a scene's row, and its report's line on samples."""
        truth, nm, *_ = self.captured(scene, 0, reference, whole=True)
        plain, few, every = [], [], []
        for seed in seeds:
            plain.append(self.plain_s(scene, seed))
            few.append(self.captured(scene, seed))
            every.append(self.captured(scene, seed, whole=True))
        costs = [sum(seconds for *_, seconds in captures) / sum(plain) for captures in (few, every)]
        true, *spectra = (np.array(cubes).reshape(-1, len(nm), truth[0].size).swapaxes(1, 2)
                          for cubes in (truth, *([cube for cube, *_ in captures] for captures in (few, every))))
        noise, of_all = (np.mean([np.median(colour_errors(true[0], each, nm)) for each in cubes]) for cubes in spectra)
        sensor, sensor_of_all = (np.mean([sensor_error(true[0], each, nm) for each in cubes]) for cubes in spectra)
        bias, error, sigmas, limit = bias_of(
            np.array([one[0] - other[0] for one, other in zip(few, every, strict=True)]), truth)
        return [judged(costs[0], MOST_COST, ".2f"), f"{costs[1]:.2f} ", f"{noise:.3f} ", f"{of_all:.3f} ",
                judged(noise / of_all, MOST_NOISE, ".2f"), f"{sensor / sensor_of_all:.2f} ",
                judged(bias, MOST_BIAS, ".2%"), f"{error:.2%} ", judged(sigmas, limit, ".1f"), f"{limit:.1f} "
                ], few[-1][2]


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
    return marked(f"{value:{form}}", value > most)


def open_scene(name, size, samples, adaptive=False):
    """The scene of a file or the Cornell box, with this size and these samples: bpy.types.Scene."""
    columns, rows = pixels(size)
    if name == CORNELL:
        sys.path.insert(0, str(ROOT / "validation"))
        import cornell_blender  # noqa: PLC0415 - needs the folder on the path
        scene = cornell_blender.build(rows, samples)
        columns = rows
    else:
        with quiet(1):
            bpy.ops.wm.open_mainfile(filepath=name, use_scripts=False)
        scene = bpy.context.scene
    scene.render.engine, scene.cycles.device = "CYCLES", "CPU"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = columns, rows, 100
    scene.cycles.use_adaptive_sampling, scene.cycles.time_limit = adaptive, 0
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


def detail(scenes=SCENES, *, samples=(64, 256), size: str = "128x96", seeds: int = 3,
           lens: str = "nikkor-z-50mm-f1.8", f_number: float = 4.0) -> Iterator[str]:
    """Errors of lens images without and with detail, at the same samples: noise and blur together.

    Each scene, FILE.blend or cornell, is captured in *Standard* with the camera's view, and imaged by a lens. The truth
    is an image of 4 x 4 times as many pixels with many samples.
    """
    addon.register()
    yield DETAIL_LEGEND
    yield f"{'':24}{'samples':>8} {'':<4}{'error':>9}{'noise':>9}{'dE 50':>8}{'dE 90':>8}{'Cycles':>9}{'lens':>8}"
    for name in scenes:
        opened = open_scene(name, size, 64)
        for row in detail_rows(opened, samples, seeds, lens, f_number):
            yield f"{Path(name).stem:<24}{row}"


def lens_image(scene, lens, f_number, seed, samples, detail, finer=1):
    """Irradiance (wavelength, row, column) in the frame's pixels, wavelengths, and processor seconds of both parts."""
    scene.render.resolution_percentage = 100 * finer
    scene.cycles.seed, scene.cycles.samples, scene.lensfield.tier = seed, samples, "STANDARD"
    with tempfile.TemporaryDirectory() as folder, quiet(1):
        job = job_of_frame(scene, scene.frame_current, lens=lens, f_number=f_number, view="camera",
                           output_folder=Path(folder), depth="off", unfit="render", denoise="off",
                           options=Options(detail=detail), lens_quality="preview")
        captured, spent = timed(radiance.capture(scene, job, Result.of(scene, Path(folder), job.frame), 1.0))
        light = captured.radiance
        if finer > 1:
            light = light.cropped([n % finer for n in light.overscan_px]).coarser(finer)
        begin_s = time.process_time()
        irradiance = simulate(light, job.lens, job.options).cube.astype(float)
    return irradiance, light.wavelengths_nm, (steps_s(spent), time.process_time() - begin_s)


def detail_rows(scene, numbers, seeds, lens, f_number):
    """A line for each number of samples, without and with detail."""
    truth, nm, _ = lens_image(scene, lens, f_number, 99, TRUE_SAMPLES, "off", FINER)
    pixels = truth.reshape(len(nm), -1).T
    for samples in numbers:
        for detail in ("off", "on"):
            images, _, seconds = zip(*(lens_image(scene, lens, f_number, seed, samples, detail)
                                       for seed in range(1, seeds + 1)), strict=True)
            images = np.array(images)
            error = np.abs(images - truth).sum() / truth.sum() / len(images)
            noise = (np.abs(images - images.mean(axis=0)).sum() / truth.sum()
                     / np.sqrt(len(images) * (len(images) - 1)))
            colours = [colour_errors(pixels, image.reshape(len(nm), -1).T, nm) for image in images]
            middle, most = (np.mean([np.percentile(each, share) for each in colours]) for share in (50, 90))
            cycles_s, lens_s = np.mean(seconds, axis=0)
            yield (f"{samples:8} {detail:<4}{error:9.4f}{noise:9.4f}{middle:8.3f}{most:8.3f}{cycles_s:9.2f}"
                   f"{lens_s:8.2f}")
