"""Measure the cost and accuracy of the Blender side: passes, seconds and colours.

    python benchmarks/scene_figures.py [--quick]

* The overhead of a wavelength band in a scene of a million triangles.
* The sample scene by tiers: passes, seconds, and errors of colours compared with a render of every wavelength.
* The time that Lensfield adds to Cycles in a 1080p frame of 12 wavelengths at 64 samples (25 minutes; with --quick, at
  an eighth of the samples).
"""

import sys
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np

from lensfield import addon
from lensfield.addon.job.steps import RenderPass
from lensfield.addon.render.render import job_of_frame, render_steps
from lensfield.commands.terminal import quiet
from lensfield.engine import Options
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.spectral.colour_difference import ciede2000, lab_from_xyz
from lensfield.engine.spectral.spectra import colour_matching
from lensfield.engine.spectral.wavelength_choice import SpectralOptions, sensor_error

SCENE = Path(__file__).resolve().parents[1] / "sample_scenes" / "evening_chess.blend"
LENS = "edmund-54852"
GRID_SIDE = 708  # squares: a million triangles
STANDARD = SpectralOptions()
BLOCK_PX = 4  # averages over blocks keep noise out of the colours


def timed(scene, wavelengths_nm, spectral=STANDARD):
    """Render a scene; returns the seconds of each Cycles pass and of the rest, the report, and the radiance."""
    with tempfile.TemporaryDirectory() as folder:
        job = job_of_frame(scene, scene.frame_current, lens=LENS, wavelengths_nm=wavelengths_nm, output_folder=folder,
                           options=Options(), spectral=spectral, view="lens", unfit="refuse", denoise="off",
                           to_compositor=False)
        steps, passes, answer = render_steps(scene, job), [], None
        begin = time.perf_counter()
        try:
            while True:
                step = steps.send(answer)
                started = time.perf_counter()
                if isinstance(step, RenderPass):
                    with quiet(1):  # Blender prints where it saves each pass
                        bpy.ops.render.render(write_still=True, scene=step.scene.name)
                    answer = None
                    passes.append(time.perf_counter() - started)
                else:
                    answer = step.call(lambda fraction: None)
        except StopIteration as end:
            result = end.value
        rest = time.perf_counter() - begin - sum(passes)
        return passes, rest, result.report, read_exr(result.radiance)


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
    passes, _, _, _ = timed(million_triangles(), np.linspace(400, 700, 31), SpectralOptions("reference"))
    alone = bpy.context.scene
    alone.render.use_persistent_data = True
    seconds = []
    with tempfile.TemporaryDirectory() as folder:
        alone.render.filepath = f"{folder}/alone.png"
        for _ in range(4):
            begin = time.perf_counter()
            with quiet(1):
                bpy.ops.render.render(write_still=True)
            seconds.append(time.perf_counter() - begin)
    print(f"a million triangles, {len(passes)} passes of 3 wavelengths, 64 x 48 px, 1 sample: the first "
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
    print("the sample scene, 192 x 144 px, 64 samples, 31 wavelengths; colours and three sensor bands of means "
          f"over {BLOCK_PX} x {BLOCK_PX} px, compared with a render of every wavelength")
    truth = None
    for name, spectral in (("reference", SpectralOptions("reference")), ("preview", SpectralOptions("preview")),
                           ("standard", SpectralOptions()), ("colour error 2", SpectralOptions(colour_error=2)),
                           ("colour error 0.1", SpectralOptions(colour_error=0.1)),
                           ("sensor error 0.002", SpectralOptions(sensor_error=0.002))):
        passes, _, report, radiance = timed(sample_scene(192, 144, 64), wavelengths_nm, spectral)
        blocks = block_means(radiance)
        truth = blocks if truth is None else truth
        colour, sensor = colour_errors(truth, blocks, wavelengths_nm), sensor_error(truth, blocks, wavelengths_nm)
        facts = report.scene
        print(f"  {name:<20}{facts.passes:3d} passes {sum(passes):7.1f} s; CIEDE2000 median {np.median(colour):.2f}, "
              f"95 % {np.percentile(colour, 95):.2f}, predicted {facts.predicted_colour_error:.2f}; sensor "
              f"{sensor:.2%}, predicted {facts.predicted_sensor_error:.2%}; worst wavelength "
              f"{spectral_error(truth, blocks):.1%}, predicted {facts.predicted_spectral_error:.1%}")


def block_means(radiance):
    """Mean spectra of blocks: array (block, wavelength)."""
    cube = radiance.frame().cube.astype(float)
    rows, columns = (n // BLOCK_PX for n in cube.shape[1:])
    cube = cube[:, :rows * BLOCK_PX, :columns * BLOCK_PX].reshape(-1, rows, BLOCK_PX, columns, BLOCK_PX)
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
    passes, rest, report, _ = timed(sample_scene(1920, 1080, samples), np.linspace(400, 700, 12))
    print(f"the sample scene, 1920 x 1080 px, {samples} samples, 12 wavelengths: Cycles {sum(passes):.0f} s in "
          f"{len(passes)} passes, the rest {rest:.1f} s: {rest / sum(passes):.1%} (target: at most 10 % at 64 "
          "samples); "
          + ", ".join(f"{stage} {seconds:.1f} s" for stage, seconds in report.stages.items()
                      if stage != "multispectral render"))


def main(arguments):
    addon.register()
    band_overhead()
    tiers()
    full_frame(8 if "--quick" in arguments else 64)


if __name__ == "__main__":
    main(sys.argv[1:])
