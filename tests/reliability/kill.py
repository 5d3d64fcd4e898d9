"""Kill `lensfield render` at random moments, restart it, and compare the final results.

    python tests/reliability/kill.py 50 [SEED]

The scene has two frames of three passes of two slabs each. A kill happens at a random moment between the beginning of
the first frame and the end of an undisturbed render, or, for one kill in eight, before the first frame.
"""

import random
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS / "support"), str(TESTS / "addon")]

from waiting import LAST_RESORT_S  # noqa: E402

FRAMES = "1-2"
COMMAND = [sys.executable, "-c", "from lensfield.cli import console; console()", "render"]
EARLY = 1 / 8
SAMPLES = 256


def save_scene(path, samples):
    """Save the scene to render."""
    import bpy

    from small_scenes import keyframe_world, light, material, wall

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = samples, False
    scene.render.resolution_x, scene.render.resolution_y = 128, 96
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    scene.world = bpy.data.worlds.new("World")
    scene.world.use_nodes = True
    keyframe_world(scene, 1, 2)
    light(scene, "POINT", 20.0, color=(1, 0.5, 0.2)).location.x = 0.5
    wall(scene, material("Far", "ShaderNodeBsdfDiffuse", (0.7, 0.3, 0.05))[0], 4.0)
    wall(scene, material("Near", "ShaderNodeBsdfDiffuse", (0.1, 0.3, 0.5))[0], 0.5, 0.1)
    settings = scene.lensfield
    settings.tier, settings.wavelength_mode, settings.wavelength_count = "REFERENCE", "RANGE", 9
    bpy.ops.wm.save_as_mainfile(filepath=str(path))


def start(blend, folder, frames=FRAMES):
    """A process that renders the scene."""
    return subprocess.Popen([*COMMAND, str(blend), "--frames", frames, "--output", str(folder), "--progress", "lines",
                             "--lens-quality", "preview"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def undisturbed(blend, folder, frames=FRAMES):
    """Render the scene; returns the seconds until the first frame begins, and from then to the end."""
    begin, process = time.monotonic(), start(blend, folder, frames)
    _begun(process)
    opened = time.monotonic()
    _, errors = process.communicate()
    if process.returncode:
        raise RuntimeError(errors)
    return opened - begin, time.monotonic() - opened


def killed(process, begun, seconds):
    """Kill a process this long after its start or, with `begun`, its first frame; returns whether it was running."""
    if begun:
        _begun(process)
    try:
        _, errors = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return True
    if process.returncode:
        raise RuntimeError(errors)
    return False


def _begun(process):
    while "Frame " not in (process.stdout.readline() or "Frame "):
        pass


def differing(folder, other):
    """Names of files that differ between both folders or exist in only one, except for the seconds in reports."""
    names = {path.name for each in (folder, other) for path in each.iterdir() if not path.name.endswith("report.json")}
    return sorted(name for name in names if _bytes(folder / name) != _bytes(other / name))


def _bytes(path):
    return path.read_bytes() if path.is_file() else None


def main(kills=50, seed=1):
    """Kill renders `kills` times; returns the exit status."""
    from lensfield import addon

    addon.register()
    chance, work = random.Random(seed), Path(tempfile.mkdtemp(prefix="lensfield-kills-"))
    blend, reference, folder = work / "scene.blend", work / "whole", work / "killed"
    save_scene(blend, SAMPLES)
    undisturbed(blend, folder)  # bakes the lens
    shutil.rmtree(folder)
    opening_s, rendering_s = undisturbed(blend, reference)
    print(f"undisturbed: {opening_s:.1f} s until the first frame begins, {rendering_s:.1f} s to render it", flush=True)
    count = ended = 0
    while count < kills or not ended:
        begun = chance.random() >= EARLY
        seconds = chance.random() * (rendering_s if begun else opening_s) if count < kills else LAST_RESORT_S
        if killed(start(blend, folder), begun, seconds):
            count += 1
            pass_count = len(list(folder.glob(".lensfield/*_passes/*/[!.]*.exr")))
            print(f"{count}: after {seconds:.1f} s{' of rendering' * begun}, {pass_count} passes kept", flush=True)
            continue
        ended += 1
        if names := differing(reference, folder):
            print(f"other than undisturbed, with seed {seed}: {', '.join(names)}; see {work}")
            return 1
        shutil.rmtree(folder)
    shutil.rmtree(work)
    print(f"{count} kills, {ended} renders that came to their end: each byte as undisturbed, and nothing else left")
    return 0


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
