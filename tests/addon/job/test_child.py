"""A render in a child process, on a copy of the file."""

import os
import subprocess
import sys
import tempfile
from contextlib import nullcontext
from pathlib import Path

import bpy
import numpy as np
import pytest
from PIL import Image

from lensfield.addon.job.job import set_blend_folder, unsaved_folder
from lensfield.addon.render import child
from lensfield.addon.scene.errors import SceneError
from lensfield.engine.runtime.child import Child
from small_scenes import light, material, wall
from snapshot import differences, snapshot
from waiting import wait_until


def paint(path, colour=(200, 30, 30)):
    Image.new("RGB", (4, 4), colour).save(path)
    return path


def test_a_copy_includes_unsaved_changes_and_leaves_the_session_unchanged(scene, tmp_path):
    project = tmp_path / "own"
    project.mkdir()
    image = bpy.data.images.load(str(paint(project / "texture.png")))
    image.use_fake_user = True
    bpy.ops.wm.save_as_mainfile(filepath=str(project / "scene.blend"))
    image.filepath = "//texture.png"
    saved = (project / "scene.blend").read_bytes()
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse")[0]).name = "Edited"
    bpy.context.view_layer.update()  # as saving does
    before, dirty = snapshot(), bpy.data.is_dirty
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    copy = child.save_copy(folder)
    assert not differences(before, snapshot()) and bpy.data.is_dirty == dirty
    assert bpy.data.filepath == str(project / "scene.blend") and (project / "scene.blend").read_bytes() == saved
    assert copy == folder / "scene.blend"
    bpy.ops.wm.open_mainfile(filepath=str(copy))
    assert "Edited" in bpy.data.objects
    path = bpy.data.images["texture.png"].filepath
    assert path.startswith("//..") and bpy.path.abspath(path) == str(folder / ".." / "own" / "texture.png")


@pytest.mark.parametrize("fails", [False, True])
@pytest.mark.parametrize("changed", [False, True])
def test_a_copy_has_no_thumbnail_and_leaves_the_preferences_unchanged(scene, tmp_path, fails, changed):
    preferences, during = bpy.context.preferences, []
    preferences.filepaths.file_preview_type, preferences.is_dirty = "CAMERA", changed

    def note(*_):
        during.append(preferences.filepaths.file_preview_type)

    bpy.app.handlers.save_pre.append(note)
    try:
        with pytest.raises(SceneError, match="copy of the file is not saved: (?!Error)") if fails else nullcontext():
            child.save_copy(tmp_path / "missing" if fails else tmp_path)
        assert (preferences.filepaths.file_preview_type, preferences.is_dirty) == ("CAMERA", changed)
    finally:
        bpy.app.handlers.save_pre.remove(note)
        preferences.filepaths.file_preview_type = "AUTO"
    assert during == ["NONE"]


def test_simulations_cached_on_disk_are_available_to_the_copy(scene, tmp_path):
    caches = tmp_path / "own" / "blendcache_scene"
    caches.mkdir(parents=True)
    (caches / "0001.bphys").write_text("cloth")
    modifier = wall(scene, material("Paint", "ShaderNodeBsdfDiffuse")[0]).modifiers.new("Nodes", "NODES")
    modifier.bake_directory = "//bakes"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "own" / "scene.blend"))
    with tempfile.TemporaryDirectory(dir=tmp_path) as elsewhere:
        copy = child.save_copy(elsewhere)
        assert (copy.parent / "blendcache_scene" / "0001.bphys").read_text() == "cloth"
        bpy.ops.wm.open_mainfile(filepath=str(copy))
        set_blend_folder(tmp_path / "own")
        assert bpy.data.objects["Wall"].modifiers["Nodes"].bake_directory == str(tmp_path / "own" / "bakes")
    assert (caches / "0001.bphys").read_text() == "cloth"


def test_an_unsaved_file_can_be_copied(scene, tmp_path):
    assert child.save_copy(tmp_path).is_file()
    command = child.render_command(bpy.context.scene, "copy.blend", picture="picture.png")
    assert not bpy.data.filepath and command[command.index("--blend-folder") + 1] == str(unsaved_folder())


def test_blender_itself_is_started_with_this_add_on(scene, monkeypatch):
    class App:
        binary_path, autoexec_fail = "/opt/blender", False

    monkeypatch.setattr(child.bpy, "app", App)
    command = child.render_command(bpy.context.scene, "copy.blend", picture="picture.png")
    assert command[:command.index("render")] == ["/opt/blender", "--background", "--addons", "lensfield",
                                                 "--enable-autoexec", "--command", "lensfield"]
    App.autoexec_fail = True
    assert "--disable-autoexec" in child.render_command(bpy.context.scene, "copy.blend", picture="picture.png")


@pytest.fixture
def coloured_scene(scene, tmp_path):
    """A scene that takes a few seconds in two passes, with its own folder."""
    light(scene, "POINT", 20.0, color=(1, 0.5, 0.2))
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (0.7, 0.3, 0.05))[0])
    scene.cycles.samples = 64
    scene.render.resolution_x, scene.render.resolution_y = 200, 150
    scene.camera.data.lensfield.lens = "edmund-54852"  # others are baked first, at the tier's quality
    scene.lensfield.tier, scene.lensfield.wavelength_count = "REFERENCE", 6
    scene.lensfield.output_folder = str(tmp_path / "out")
    return scene


def test_folders_of_a_killed_process_are_deleted(tmp_path, monkeypatch):
    monkeypatch.setattr(child, "_temporary_parent", lambda: tmp_path)
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    with child.work_folder() as current:
        left = tmp_path / Path(current).name.replace(f"-{os.getpid()}-", f"-{dead.pid}-")
        for name in ("lensfield-renders-2", f"other-{dead.pid}-abc", left.name):
            (tmp_path / name).mkdir()
        (left / "copy.blend").write_bytes(b"BLENDER")
        (tmp_path / "lensfield-kept.log").write_text("its last words")
        expected = {path.name for path in tmp_path.iterdir()} - {left.name}
        child.sweep()
        assert {path.name for path in tmp_path.iterdir()} == expected and Path(current).is_dir()


def started(tmp_path):
    command = child.render_command(bpy.context.scene, child.save_copy(tmp_path), picture=tmp_path / "picture.png")
    return Child(command, tmp_path)


def test_a_child_reports_progress_and_updates_its_picture(coloured_scene, tmp_path):
    render, progress, pictures = started(tmp_path), [], set()

    def look():
        progress.append((render.status.get("fraction", 0.0), render.status.get("label")))
        if (tmp_path / "picture.png").is_file():
            pictures.add((tmp_path / "picture.png").read_bytes())
        return render.ended

    wait_until(look, 0.01)
    render.end()
    assert [fraction for fraction, _ in progress] == sorted(fraction for fraction, _ in progress)
    labels = list(dict.fromkeys(label for _, label in progress if label))
    passes = (label.partition(":")[0].partition(",")[0] for label in labels if label.startswith("Pass"))
    assert list(dict.fromkeys(passes)) == ["Pass 1 of 2", "Pass 2 of 2"]
    assert render.status["lens_image"] == str(tmp_path / "out" / "unsaved_Scene_0001_lens_image.exr")
    assert len(pictures) == 2
    with Image.open(tmp_path / "picture.png") as picture:
        assert picture.size == (200, 150) and np.ptp(np.array(picture)) > 50


def test_a_child_renders_the_scene_that_it_is_started_for(coloured_scene, tmp_path):
    """In the background, Blender opens the first scene of a file, whichever the window showed."""
    bpy.ops.scene.new(type="FULL_COPY")
    second = bpy.context.scene
    second.name, second.lensfield.tier = "It's the second", "PREVIEW"
    render = Child(child.render_command(second, child.save_copy(tmp_path)), tmp_path)
    wait_until(lambda: render.ended)
    render.end()
    assert render.status.get("lens_image") == str(tmp_path / "out" / "unsaved_It_s_the_second_0001_lens_image.exr")


def test_bad_input_is_reported_in_one_line(coloured_scene, tmp_path):
    coloured_scene.camera.data.type = "ORTHO"
    render = started(tmp_path)
    wait_until(lambda: render.ended)
    render.end()
    assert render.status["error"].startswith("camera 'Camera': type is ORTHO: ")


LEAVE_IT = """
import os, sys, time
import bpy
from lensfield.addon.scene.errors import SceneError
from lensfield.engine.runtime.child import Child
child = Child([sys.executable, *sys.argv[2:]], sys.argv[1])
while "fraction" not in child.status: time.sleep(0.01)
print(child._process.pid, flush=True)
os.kill(os.getpid(), 9)
"""


def test_a_child_ends_when_its_parent_is_killed(coloured_scene, tmp_path):
    coloured_scene.cycles.samples = 1 << 20
    command = child.render_command(bpy.context.scene, child.save_copy(tmp_path), picture=tmp_path / "picture.png")[1:]
    parent = subprocess.run([sys.executable, "-c", LEAVE_IT, tmp_path, *command], capture_output=True, text=True)
    pid = int(parent.stdout.splitlines()[-1])
    wait_until(lambda: not runs(pid), 60)
    assert not [path for path in (tmp_path / "out").glob("*")]


def runs(pid):
    """Whether a process exists and is not a zombie, which the test cannot reap."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")")[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_subprocesses_of_a_dead_child_are_ended(tmp_path):
    """One of its workers would wait for ever, with the child's output open."""
    code = "import subprocess, os; subprocess.Popen(['sleep', '1000']); os._exit(3)"
    render = Child([sys.executable, "-c", code], tmp_path)
    wait_until(lambda: render.ended)
    render.end()
    why, log = render.death()
    assert why == "exit status 3: no output"
    Path(log).unlink()
