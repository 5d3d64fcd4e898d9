"""Five ordinary scenes through every command: render, animation, apply, compare, preview and Traced Lens must agree.

    python validation/scene_commands.py [NAME ...] [--output FOLDER] [--columns 72] [--samples 64]

Each scene is rendered twice through a real lens, with different seeds, whose difference is the noise. The pictures of
the other commands are compared with these (`scene_measure.py`). Frames of an animation, and a render that is
applied again, must be equal to the render of that frame. The exit status is 1 if anything differs.
"""

import argparse
import os
import sys
from pathlib import Path

import bpy
import numpy as np

from lensfield import cli
from lensfield.commands.terminal import quiet
from lensfield.engine.runtime.errors import InputError
from ordinary_scenes import FOLDER, OF_LAYERS, SEED, saved
from scene_measure import Limits, Marks, compare
from scene_pictures import hide_marks, marks_px, open_scene, read_picture, registered
from scenes import ORDINARY

NAMES = "hdri", "camera_shift", "moving_object", "transparent_film", "collection_instances"
LENS, F_NUMBER, FOCUS_M = "zeiss-distagon-35mm-f1.4", 2.8, 1.25  # its field is wider than a shifted frame
WAVELENGTHS = 400, 700, 7
FRAMES = 3
FINER = 3  # pixels of a preview in one of its first picture
EQUAL = 2e-3  # of the brightest: the half-float precision of stored light
OTHERS = Limits(**OF_LAYERS)
TRACED = Limits(misplaced=0.05, detail=0.5)  # rays see hidden surfaces, and blocked ones make noise in alpha
EQUALS = "frame 2 of an animation", "apply"
"""The pictures with the same noise as the render."""


def faults_of(name, folder, columns, samples):
    """Put a scene through every command; returns how many of them differ from two renders with different seeds."""
    path, second, unmarked = saved_thrice(name, folder, columns, samples)
    frame = open_scene(path).frame_current
    *rendered, without = [_render(each, folder / f"render_{number}", frame)
                          for number, each in enumerate((path, second, unmarked))]
    marks = Marks(marks_px(path), without, samples)
    commands = {"frame 2 of an animation": lambda: _animation(path, folder / "animation", frame),
                "apply": lambda: _apply(folder / "render_0", folder / "apply", frame),
                "compare": lambda: _compare(path, folder / "compare", frame),
                "preview": lambda: _preview(path, folder / "preview", (columns, 2 * columns // 3)),
                "traced lens": lambda: _render(path, folder / "traced", frame, "--depth", "traced")}
    return sum(_differs(command, picture(), rendered, marks) for command, picture in commands.items())


def _differs(command, picture, rendered, marks):
    """Compare the picture of a command with two renders, and print the result; whether anything differs."""
    found = compare(picture, rendered, marks, TRACED if command == "traced lens" else OTHERS)
    faults = list(found.faults)
    if command in EQUALS and not np.abs(picture - rendered[0]).max() <= EQUAL * rendered[0][:3].max():
        faults.append(f"differs from the render by {np.abs(picture - rendered[0]).max():.2g}")
    off_px = max(found.off_px.values(), default=0)
    print(f"    {command:<24} {' '.join(f'{ratio:.4f}' for ratio in found.means)}  block {found.worst_colour:.2f}  "
          f"detail {found.detail:.1%}  marks {off_px:.2f} px  {'; '.join(faults) or 'agrees'}", flush=True)
    return bool(faults)


def saved_thrice(name, folder, columns, samples):
    """A scene with Lensfield's settings, as two files with different seeds, and a third whose camera sees no marks."""
    path = saved(ORDINARY[name], folder, columns, samples)
    paths = []
    for number in (0, 1, 2):
        scene = open_scene(path)
        settings, of_camera = scene.lensfield, scene.camera.data.lensfield
        of_camera.lens, of_camera.view, settings.stray_light = LENS, "CAMERA", "OFF"
        settings.wavelength_first_nm, settings.wavelength_last_nm, settings.wavelength_count = WAVELENGTHS
        dof = scene.camera.data.dof
        dof.use_dof, dof.aperture_fstop, dof.focus_distance = True, F_NUMBER, FOCUS_M
        scene.cycles.seed = 1000 * SEED + number % 2
        if number == 2:
            hide_marks(scene)
        paths.append(folder / f"{name}_{number}.blend")
        with quiet(1):
            bpy.ops.wm.save_as_mainfile(filepath=str(paths[-1]))
    return paths


def _run(*words):
    """Run a command of lensfield.

    Raises
    ------
    InputError
        It failed.
    """
    with quiet(1):
        status = cli.main(list(map(str, words)))
    if status:
        raise InputError("lensfield", words[0], f"status {status}", "see the line above")


def _picture(folder, frame):
    return read_picture(next(folder.glob(f"*_{frame:04d}_lens_image.exr")))


def _render(path, folder, frame, *words):
    _run("render", path, "--output", folder, *words)
    return _picture(folder, frame)


def _animation(path, folder, frame):
    """The picture of the current frame, the second of three."""
    _run("render", path, "--frames", f"{frame - 1}-{frame + 1}", "--output", folder)
    if len(list(folder.glob("*_lens_image.exr"))) != FRAMES:
        raise InputError(folder, "frames", "missing", f"expected {FRAMES}")
    return _picture(folder, frame)


def _apply(rendered, folder, frame):
    radiance = next(rendered.glob(f"*_{frame:04d}_radiance.exr"))
    _run("apply", radiance, "--lens", LENS, "--view", "camera", "--f-number", F_NUMBER, "--focus", f"{FOCUS_M}m",
         "--lens-quality", "preview", "--stray", "off", "--output", folder)
    return _picture(folder, frame)


def _compare(path, folder, frame):
    _run("compare", path, "--lens", LENS, "--f-number", F_NUMBER, "--tier", "standard", "--lens-quality", "preview",
         "--output", folder)
    return _picture(next(each for each in folder.iterdir() if each.name.startswith(LENS)), frame)


def _preview(path, folder, size):
    """The last picture of a preview, in all samples."""
    columns, rows = (side // FINER for side in size)
    _run("preview", path, "--resolution", f"{columns}x{rows}", "--output", folder)
    return read_picture(max(folder.glob("picture-*/*_lens_image.exr"), key=lambda each: each.stat().st_mtime_ns))


def main(arguments):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", default=NAMES)
    parser.add_argument("--output", type=Path, default=FOLDER / "commands")
    parser.add_argument("--columns", type=int, default=72, help="a multiple of 18, for whole pixels of previews")
    parser.add_argument("--samples", type=int, default=64)
    given, failed = parser.parse_args(arguments), 0
    with registered():
        for name in given.names or NAMES:
            print(f"{name}: R G B over the render, the worst block's CIEDE2000, the farthest mark", flush=True)
            failed += faults_of(name, given.output.resolve() / name, given.columns, given.samples) > 0
    print(f"{len(given.names) - failed} scenes passed, {failed} failed by command; SEED={SEED}", flush=True)
    os._exit(failed > 0)  # some wheels crash while the interpreter exits


if __name__ == "__main__":
    main(sys.argv[1:])
