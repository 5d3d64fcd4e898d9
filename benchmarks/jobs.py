"""Complete jobs: their processor seconds by stage, by the capture's projection, and in the preview."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np
from captures import CYCLES, rendered, timed
from cases import SCENE, pixels

from lensfield import addon
from lensfield.addon.render.render import job_of_frame, render_steps
from lensfield.addon.ui.common.session import session
from lensfield.addon.ui.preview import preview as running_preview
from lensfield.engine.field import overscan
from lensfield.engine.image.projection import fitted_projection
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.spectral.wavelength_choice import SpectralOptions

PLAIN = "plain render"
JOBS = {PLAIN: {}, "preview": {"tier": "preview", "depth": "off"}, "standard": {"tier": "standard", "depth": "off"},
        "standard, depth": {"tier": "standard", "depth": "auto"}, "reference": {"tier": "reference", "depth": "off"}}
STAGES = "lens", "Cycles", "filter", "rest"
ROUNDS = 3
RENDER_PX, PREVIEW_PX = (1920, 1080), (480, 270)
PAUSE_S = 0.01
PROCESSOR_FIELDS = slice(11, 15)  # of /proc/PID/stat: seconds of the process, and of those that it has waited for


def job(blend: str = str(SCENE), *, size: str = "384x288", samples: int = 64, lens: str = "edmund-54852",
        one: str = "") -> Iterator[str]:
    """The whole job: a scene's lens picture by tiers, relative to a plain render by Cycles.

    For a plain render and each tier, processor seconds by stage and their sum relative to the plain render, which has
    the same size and samples. Each job is a process with an empty cache, so its lens is baked anew; `one` is the name
    of the only job of a process, whose figures are a line of JSON.
    """
    if one:
        addon.register()
        stages, words = stages_of(blend, size, samples, lens, one)
        yield json.dumps({"stages": stages, "samples": words})
        return
    yield f"the whole job: {Path(blend).name}, {size} px, {samples} samples, {lens}: processor seconds"
    yield f"{'':<17}" + "".join(f"{stage:>9}" for stage in (*STAGES, "sum", "multiple"))
    plain_s = None
    for name in JOBS:
        with tempfile.TemporaryDirectory() as cache:
            printed = subprocess.run([sys.executable, "-W", "ignore", *sys.argv, "--one", name], check=True,
                                     env=os.environ | {"LENSFIELD_CACHE": cache}, stdout=subprocess.PIPE).stdout
        facts = json.loads(printed.splitlines()[-1])
        total = sum(facts["stages"].values())
        plain_s = plain_s or total
        cells = [f"{facts['stages'].get(stage, 0):9.1f}" for stage in STAGES]
        yield f"{name:<17}{''.join(cells)}{total:9.1f}{total / plain_s:9.2f}  {facts['samples']}".rstrip()


def opened(blend, size, samples):
    """The scene of a file, in this size and with these samples."""
    bpy.ops.wm.open_mainfile(filepath=blend)
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = pixels(size)
    scene.render.resolution_percentage, scene.cycles.samples = 100, samples
    return scene


def stages_of(blend, size, samples, lens, name):
    """Processor seconds of a job's stages, by name, and its report's line about samples."""
    scene = opened(blend, size, samples)
    scene.view_layers[0].samples = 0
    with tempfile.TemporaryDirectory() as folder:
        begin_s = time.process_time()
        if name == PLAIN:
            scene.render.filepath = f"{folder}/plain.png"
            rendered(scene)
            return {CYCLES: time.process_time() - begin_s}, ""
        job = job_of_frame(scene, scene.frame_current, lens=lens, depth=JOBS[name]["depth"], output_folder=folder,
                           spectral=SpectralOptions(JOBS[name]["tier"]))
        seconds = Counter(lens=time.process_time() - begin_s)
        result, spent = timed(render_steps(scene, job))
    for label, step_s in spent:
        seconds[label if label == CYCLES else "filter" if label.startswith("Through") else "rest"] += step_s
    return seconds, result.report.scene.samples


def projection(lenses=("edmund-54852",), *, size: str = "192x144", samples: int = 64) -> Iterator[str]:
    """Pixels and processor seconds of captures on a plane, and in a panorama with the lens's distortion.

    Each row is a capture of the sample scene for a lens: its pixels, relative to the frame; and Cycles' processor
    seconds, in all passes and per million samples. The second row has the view of the first, by the camera of the
    third: only the cost of a sample differs.
    """
    addon.register()
    scene = opened(str(SCENE), size, samples)
    scene.cycles.use_adaptive_sampling = False
    for lens in lenses:
        for name, (overscan.MOST_PLANE, overscan.lens_projection) in CAPTURES.items():
            with tempfile.TemporaryDirectory() as folder:
                rounds = [passes_of(scene, lens, Path(folder) / str(number)) for number in range(ROUNDS)]
            grid, passes_s = rounds[0][0], np.array([seconds for _, seconds in rounds])
            number, least_s = np.prod(grid.shape_px), passes_s.min(axis=0).sum()
            yield (f"{lens:24} {name:28} {number / np.prod(grid.frame_px):6.3f} x the frame's pixels  "
                   f"{least_s:7.2f} s  "
                   f"{least_s / (number * samples * passes_s.shape[1]) * 1e6:6.2f} s per million samples")
    addon.unregister()


def plane_in_panorama(lens, grid):
    """The panorama closest to a plane over a grid."""
    radius = np.linspace(0, grid.farthest_px * grid.pitch_um * 1e-3 / lens.capture_focal_length_mm, 257)
    return fitted_projection(radius, radius, radius[-1])


CAPTURES = {"plane": (np.inf, overscan.lens_projection), "plane, by a panoramic camera": (0.0, plane_in_panorama),
            "panorama": (0.0, overscan.lens_projection)}
"""MOST_PLANE, and the panorama."""


def passes_of(scene, lens, folder):
    """The capture's PixelGrid, and the processor seconds of its Cycles passes."""
    job = job_of_frame(scene, scene.frame_current, lens=lens, output_folder=folder, view="lens", depth="off",
                       denoise="off", to_compositor=False, lens_quality="preview")
    result, spent = timed(render_steps(scene, job))
    return read_exr(result.radiance).grid, [seconds for label, seconds in spent if label == CYCLES]


def preview() -> Iterator[str]:
    """The preview: processor seconds of its child from a change to each of its pictures.

    For the sample scene and Blender's default scene, at 480 x 270 px: the first picture, and each that refines it; and
    the first picture after the lens's f-stop or focus has been turned, with another lens, and with an object moved. The
    picture before is then still being refined, which counts until it has stopped. Each change is made twice; the second
    figures exclude work that is done once, such as loading modules, or preparing the scene for an object that moves.
    The preview is driven as by its timer.
    """
    addon.register()
    bpy.ops.wm.open_mainfile(filepath=str(SCENE))
    yield "the sample scene, 480 x 270 px"
    yield from changes(bpy.context.scene, bpy.data.objects["Vase"])
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    bpy.context.scene.render.engine = "CYCLES"
    yield "Blender's default scene, 480 x 270 px"
    yield from changes(bpy.context.scene, bpy.data.objects["Cube"])
    sys.stdout.flush()
    os._exit(0)  # some of Blender's wheels crash while the interpreter exits


def child_s():
    """Processor seconds of the preview's child."""
    stat = Path(f"/proc/{session.preview.child._process.pid}/stat").read_text()
    ticks = map(int, stat.rpartition(")")[2].split()[PROCESSOR_FIELDS])
    return sum(ticks) / os.sysconf("SC_CLK_TCK")


def pictures(name, complete=False):
    """Wait for the first picture after a change, or for all; yields the child's processor seconds for each."""
    bpy.context.view_layer.update()
    changed_s, begin_s, number = time.monotonic(), child_s(), 0
    running = session.preview
    while not number or (complete and running.at_work):
        running_preview.tick()
        assert not running.error, running.error
        if running.started_s > changed_s and running.fresh and running.number > number:
            number = running.number
            yield f"    {name:<24}{child_s() - begin_s:6.2f} s   {running.shown.facts[0].rpartition(',')[0]}"
        time.sleep(PAUSE_S)


def changes(scene, moved):
    """The lines of a scene; the object `moved` is raised."""
    running_preview.size_px = lambda scene: PREVIEW_PX
    scene.render.resolution_x, scene.render.resolution_y = RENDER_PX
    scene.render.resolution_percentage = 100
    scene.camera.data.lensfield.view = "CAMERA"
    dof = scene.camera.data.dof
    dof.use_dof, dof.aperture_fstop = True, 2.8
    bpy.context.view_layer.update()
    running_preview.start(scene)
    yield from pictures("first, and refined", complete=True)
    for f_stop in (4.0, 4.5):
        dof.aperture_fstop = f_stop
        yield from pictures("f-stop")
    for _ in range(2):
        dof.focus_distance *= 1.02
        yield from pictures("focus")
    for lens in ("cooke-triplet-50mm", "nikkor-28mm"):
        scene.camera.data.lensfield.lens = lens
        yield from pictures("another lens")
    for _ in range(2):
        moved.location.z += 0.01
        yield from pictures("moved object")
    running_preview.end()
