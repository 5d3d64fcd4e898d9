"""Measure the preview: processor seconds of its child from a change to each of its pictures.

    python benchmarks/preview_figures.py

For the sample scene and Blender's default scene, at 480 x 270 px: the first picture, and each that refines it; and the
first picture after the lens's f-stop or focus has been turned, with another lens, and with an object moved. The picture
before is then still being refined, which counts until it has stopped. Each change is made twice; the second figures
exclude work that is done once, such as loading modules, or preparing the scene for an object that moves. The preview is
driven as by its timer.
"""

import os
import sys
import time
from pathlib import Path

import bpy

from lensfield import addon
from lensfield.addon.ui.common.session import session
from lensfield.addon.ui.preview import preview

SAMPLE = Path(__file__).resolve().parents[1] / "sample_scenes" / "evening_chess.blend"
RENDER_PX, PREVIEW_PX = (1920, 1080), (480, 270)
PAUSE_S = 0.01
PROCESSOR_FIELDS = slice(11, 15)  # of /proc/PID/stat: seconds of the process, and of those that it has waited for


def child_s():
    """Processor seconds of the preview's child."""
    stat = Path(f"/proc/{session.preview.child._process.pid}/stat").read_text()
    ticks = map(int, stat.rpartition(")")[2].split()[PROCESSOR_FIELDS])
    return sum(ticks) / os.sysconf("SC_CLK_TCK")


def report(name, complete=False):
    """Wait for the first picture after a change, or for all, and print the child's processor seconds for each."""
    bpy.context.view_layer.update()
    changed_s, begin_s, number = time.monotonic(), child_s(), 0
    running = session.preview
    while not number or (complete and running.job):
        preview.tick()
        assert not running.error, running.error
        if running.started_s > changed_s and running.fresh and running.shown > number:
            number = running.shown
            print(f"    {name:<24}{child_s() - begin_s:6.2f} s   {running.facts[0].rpartition(',')[0]}", flush=True)
        time.sleep(PAUSE_S)


def measure(scene, moved):
    """Print the figures of a scene; the object `moved` is raised."""
    preview.size_px = lambda scene: PREVIEW_PX
    scene.render.resolution_x, scene.render.resolution_y = RENDER_PX
    scene.render.resolution_percentage = 100
    scene.camera.data.lensfield.view = "CAMERA"
    dof = scene.camera.data.dof
    dof.use_dof, dof.aperture_fstop = True, 2.8
    bpy.context.view_layer.update()
    preview.start(scene)
    report("first, and refined", complete=True)
    for f_stop in (4.0, 4.5):
        dof.aperture_fstop = f_stop
        report("f-stop")
    for _ in range(2):
        dof.focus_distance *= 1.02
        report("focus")
    for lens in ("cooke-triplet-50mm", "nikkor-28mm"):
        scene.camera.data.lensfield.lens = lens
        report("another lens")
    for _ in range(2):
        moved.location.z += 0.01
        report("moved object")

    preview.end()


def main():
    addon.register()
    bpy.ops.wm.open_mainfile(filepath=str(SAMPLE))
    print("the sample scene, 480 x 270 px")
    measure(bpy.context.scene, bpy.data.objects["Vase"])
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    bpy.context.scene.render.engine = "CYCLES"
    print("Blender's default scene, 480 x 270 px")
    measure(bpy.context.scene, bpy.data.objects["Cube"])
    sys.stdout.flush()
    os._exit(0)  # some of Blender's wheels crash while the interpreter exits


if __name__ == "__main__":
    main()
