"""Repeated operations do not increase the memory over time, and leave nothing behind.

    python tests/reliability/long_runs.py [--previews 200] [--renders 50] [--registers 50]

Each line shows the memory of a process after a fifth of its runs and at the end (medians over a fifth of the runs), and
any growth of other counts: threads, open files, child processes, Blender's data, handlers, classes and temporary files.
The exit status is 1 if memory is not constant within 5 %, or anything has leaked.
"""

import argparse
import os
import shutil
import statistics
import sys
import tempfile
import time
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS / "support"), str(TESTS / "addon")]

TEMPORARY = Path(tempfile.mkdtemp(prefix="lensfield-long-runs-"))
os.environ["TMPDIR"] = tempfile.tempdir = str(TEMPORARY)  # no other program writes there

import bpy  # noqa: E402

from lensfield import addon  # noqa: E402
from lensfield.addon.ui.common.session import session  # noqa: E402
from lensfield.addon.ui.preview import preview  # noqa: E402
from lensfield.commands.terminal import quiet  # noqa: E402
from small_scenes import background, light, material, wall  # noqa: E402

FLAT = 0.05
POLL_S = 0.01


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    for what, count in {"previews": 200, "renders": 50, "registers": 50}.items():
        parser.add_argument(f"--{what}", type=int, default=count)
    options = parser.parse_args()
    addon.register()
    make_scene()
    sound = [renders(options.renders), previews(options.previews), registers(options.registers)]
    sys.stdout.flush()
    shutil.rmtree(TEMPORARY, ignore_errors=True)
    os._exit(not all(sound))  # some wheels crash while the interpreter exits


def make_scene():
    """A wall and a lamp in front of a camera."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = 1, False
    scene.render.resolution_x, scene.render.resolution_y = 64, 48
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    scene.world = bpy.data.worlds.new("World")
    scene.world.use_nodes = True
    light(scene, "POINT", 20.0)
    wall(scene, material("Wall", "ShaderNodeBsdfDiffuse")[0])
    scene.camera.data.lensfield.view = "CAMERA"


def renders(count):
    with tempfile.TemporaryDirectory() as folder:
        def render(number):
            background(bpy.context.scene).inputs["Strength"].default_value = number % 7
            addon.render_through_lens(bpy.context.scene, lens="edmund-54852", wavelengths_nm=[450, 550, 650],
                                      output_folder=folder)
            return os.getpid()

        return is_stable("renders", count, render)


def previews(count):
    """A preview after each change of the scene; the memory is that of the rendering process."""
    preview.STILL_S, preview.SAMPLES = 0.0, 16
    preview.start(bpy.context.scene)
    scene = bpy.context.scene

    def show(number):
        background(scene).inputs["Strength"].default_value = number % 7
        bpy.context.view_layer.update()
        session.preview.changed_s = session.preview.other_s = 0.0
        while preview.tick() is not None and (session.preview.at_work or not session.preview.fresh):
            time.sleep(POLL_S)
        if session.preview is None or session.preview.error:
            raise SystemExit(f"preview {number}: {session}")
        return session.preview.child._process.pid

    sound = is_stable("previews", count, show, ("the process that renders", "Blender"))
    preview.end()
    return sound


def registers(count):
    def register(number):
        addon.unregister()
        addon.register()
        return os.getpid()

    return is_stable("register, unregister", count, register)


def is_stable(what, count, run, names=("Blender",)):
    """Run it `count` times, and print memory and leaks; returns whether memory is constant and nothing has leaked."""
    megabytes = {name: [] for name in names}
    with quiet(1):  # suppresses Blender's messages about saved copies
        for number in range(count):
            process = run(number)
            if number == count // 5:
                before = remains(process)
            for name, held in megabytes.items():
                held.append(resident_mb(os.getpid() if name == "Blender" else process))
    left = {name: after - before[name] for name, after in remains(process).items() if after > before[name]}
    sound = not left
    for name, held in megabytes.items():
        fifth = max(1, count // 5)
        early, late = statistics.median(held[fifth:2 * fifth]), statistics.median(held[-fifth:])
        sound &= late <= (1 + FLAT) * early
        print(f"{what:<22}{count:4} runs  {name:<26}{early:8.1f} MB, at the end {late:8.1f} MB  "
              f"({late / early - 1:+.1%})  left: {left or 'nothing'}", flush=True)
    return sound


def resident_mb(process):
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def remains(process):
    """Counts of everything that this process and the rendering process may leak."""
    processes = {os.getpid(), process}
    handlers = (getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers) if not name.startswith("_"))
    return {"threads": sum(len(os.listdir(f"/proc/{each}/task")) for each in processes),
            "open files": sum(len(os.listdir(f"/proc/{each}/fd")) for each in processes),
            "processes": len(Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()),
            "data blocks": sum(len(data) for data in vars_of_data()),
            "handlers": sum(len(each) for each in handlers if isinstance(each, list)),
            "classes": len(bpy.types.Panel.__subclasses__()) + len(bpy.types.Operator.__subclasses__()),
            "temporary files": sum(1 for _ in TEMPORARY.rglob("*"))}


def vars_of_data():
    return (getattr(bpy.data, name) for name in dir(bpy.data) if hasattr(getattr(bpy.data, name), "new"))


if __name__ == "__main__":
    main()
