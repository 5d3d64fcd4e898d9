"""Cached passes: a stopped render continues where it stopped, to the same bytes; processes share frames."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import bpy
import kill
import pytest

from lensfield import addon
from lensfield.addon.capture import finished_passes
from lensfield.addon.job import source
from lensfield.addon.job.result import Result
from lensfield.addon.job.steps import RenderPass
from lensfield.addon.render.render import job_of_frame, render_steps, run
from lensfield.engine.runtime import files
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.runtime.locks import Busy
from refusals import refused
from small_scenes import light, material, set_world, wall

OPTIONS = {"wavelengths_nm": [450.0, 550.0, 600.0, 650.0], "lens_quality": "preview", "lens": "tessar-50mm"}


@pytest.fixture
def deep(scene, tmp_path):
    """A saved scene with two slabs of depth, and two lamps with different colours."""
    set_world(scene, (0.2, 0.4, 0.9), 0.5)
    light(scene, "POINT", 20.0, color=(1, 0.5, 0.2)).location.x = 0.5
    wall(scene, material("Far", "ShaderNodeBsdfDiffuse", (0.7, 0.3, 0.05))[0], 4.0)
    wall(scene, material("Near", "ShaderNodeBsdfDiffuse", (0.1, 0.3, 0.5))[0], 0.5, 0.1)
    scene.cycles.samples = 4
    scene.render.image_settings.file_format = "OPEN_EXR"  # a factory scene has no colour space until then
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    return scene


def job_in(scene, folder, **options):
    return job_of_frame(scene, 1, output_folder=folder, **OPTIONS | {"source": addon.source_digest(scene)} | options)


def render_to_end(scene, folder, **options):
    """Render without interruption; returns the number of renders by Cycles."""
    return stopped(scene, folder, None, **options)[1]


def stopped(scene, folder, steps, **options):
    """Render, and stop before the step with this number: (whether it finished, number of renders by Cycles)."""
    at_work, answer, count, renders = render_steps(scene, job_in(scene, folder, **options)), None, 0, 0
    try:
        while count != steps:
            step = at_work.send(answer)
            count, answer = count + 1, None
            if isinstance(step, RenderPass):
                bpy.ops.render.render(write_still=True, scene=step.scene.name)
                renders += 1
            else:
                answer = step.call(lambda fraction: None)
    except StopIteration:
        return True, renders
    at_work.close()
    return False, renders


def passes(folder):
    return sorted(folder.glob(".lensfield/*_passes/*/[!.]*.exr"))


def test_a_render_stopped_at_any_step_resumes_to_the_same_bytes(deep, tmp_path):
    """It renders only the missing passes."""
    renders, steps, ended = render_to_end(deep, tmp_path / "whole"), 0, False
    assert renders > 4  # the look at the depth, and slabs
    while not ended:
        folder, steps = tmp_path / str(steps), steps + 3
        ended, first = stopped(deep, folder, steps)
        if not ended:
            cached_count = len(passes(folder))
            assert cached_count >= first - 1 and render_to_end(deep, folder) == renders - cached_count
        assert not kill.differing(tmp_path / "whole", folder)
    assert steps > renders


def blur(scene):
    scene.render.use_motion_blur = True
    for frame in (1, 2):
        bpy.data.objects["Wall.001"].location.x = frame * 0.01
        bpy.data.objects["Wall.001"].keyframe_insert("location", frame=frame)


def scatter(scene):
    scene.world.node_tree.links.new(scene.world.node_tree.nodes.new("ShaderNodeVolumeScatter").outputs[0],
                                    scene.world.node_tree.nodes["World Output"].inputs["Volume"])


@pytest.mark.sample(2)
@pytest.mark.parametrize("change", [
    lambda scene: setattr(scene.lensfield, "denoise", "ON"), blur, scatter,
    lambda scene: setattr(scene.cycles, "use_adaptive_sampling", True),
    lambda scene: setattr(scene.render, "film_transparent", True),
    lambda scene: setattr(scene.lensfield, "depth", "TRACED")])
def test_a_render_resumes_to_the_same_bytes_with_any_cycles_feature(deep, tmp_path, change):
    change(deep)
    bpy.ops.wm.save_mainfile()
    renders = render_to_end(deep, tmp_path / "whole")
    stopped(deep, tmp_path / "one", 6)
    cached_count = len(passes(tmp_path / "one"))
    assert cached_count and render_to_end(deep, tmp_path / "one") == renders - cached_count
    assert not kill.differing(tmp_path / "whole", tmp_path / "one")


def test_a_render_waits_for_another_process_that_captures_the_same(deep, tmp_path):
    renders = render_to_end(deep, tmp_path / "whole")
    stopped(deep, tmp_path / "one", 6)
    with another(tmp_path / "one" / "scene_Scene_0001_passes"):
        steps = render_steps(deep, job_in(deep, tmp_path / "one"))
        assert [next(steps).label for _ in range(2)] == ["Waiting for another process to capture the frame"] * 2
        steps.close()
    assert render_to_end(deep, tmp_path / "one") == renders - 3


def touch(path):
    os.utime(path, ns=(1, 1))


@pytest.mark.parametrize("change", [
    lambda scene: setattr(scene.cycles, "samples", 5),
    lambda scene: setattr(scene.camera.data.lensfield, "view", "CAMERA"),
    lambda scene: setattr(scene.lensfield, "tier", "REFERENCE"),
    lambda scene: setattr(scene.camera.data, "clip_start", 0.01),
    lambda scene: bpy.data.objects["Wall"].vertex_groups.new(name="Some").add([0], 0.5, "REPLACE")])
def test_passes_of_a_changed_scene_are_not_reused(deep, tmp_path, change):
    _, first = stopped(deep, tmp_path / "one", 6)
    cached = set(passes(tmp_path / "one"))
    assert first == len(cached) == 3
    change(deep)
    bpy.ops.wm.save_mainfile()
    assert stopped(deep, tmp_path / "one", 6)[1] == 3
    assert len(passes(tmp_path / "one")) == 3 and not cached & set(passes(tmp_path / "one"))


@pytest.mark.every_blender
@pytest.mark.sample(1)
@pytest.mark.parametrize("damage", [lambda path: os.truncate(path, path.stat().st_size // 2),
                                    lambda path: path.write_bytes(b""), Path.unlink])
def test_a_damaged_pass_is_rendered_again(deep, tmp_path, damage):
    renders = render_to_end(deep, tmp_path / "whole")
    stopped(deep, tmp_path / "one", 6)
    damage(passes(tmp_path / "one")[1])
    assert render_to_end(deep, tmp_path / "one") == renders - 2
    assert not kill.differing(tmp_path / "whole", tmp_path / "one")


def test_passes_are_not_cached_without_a_source_digest_or_disk_space(deep, tmp_path, monkeypatch):
    stopped(deep, tmp_path / "one", 6, source="")
    assert not passes(tmp_path / "one")
    usage = finished_passes.shutil.disk_usage(tmp_path)
    monkeypatch.setattr(finished_passes.shutil, "disk_usage", lambda _: usage._replace(free=50000))
    stopped(deep, tmp_path / "one", 6)
    assert not passes(tmp_path / "one")


@pytest.mark.parametrize("link", [".lensfield", ".lensfield/scene_Scene_0001_passes"])
def test_links_in_a_foreign_folder_are_not_followed(deep, tmp_path, link):
    stopped(deep, tmp_path / "one", 6)
    digest, names = passes(tmp_path / "one")[0].parent.name, [path.name for path in passes(tmp_path / "one")]
    shutil.rmtree(tmp_path / "one" / ".lensfield")
    precious = tmp_path / "precious" / "scene_Scene_0001_passes" / digest / "file"
    for place in (precious, *(path.with_name("file") for path in (precious.parent, precious.parents[1]))):
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text("precious")
    target = precious.parents[2 if link == ".lensfield" else 1]
    (tmp_path / "one" / link).parent.mkdir(exist_ok=True)
    (tmp_path / "one" / link).symlink_to(target)
    if link == ".lensfield":
        with pytest.raises(InputError, match=".lensfield: folder is a link: remove it"):
            render_to_end(deep, tmp_path / "one")
    else:
        render_to_end(deep, tmp_path / "one")
        (tmp_path / "one" / link).parent.mkdir(exist_ok=True)
    assert precious.read_text() == "precious" and len(list(target.rglob("file"))) == (3 if link == ".lensfield" else 2)
    for name in names:  # and of single passes
        cached_pass = tmp_path / "two" / ".lensfield" / "scene_Scene_0001_passes" / digest / name
        cached_pass.parent.mkdir(parents=True, exist_ok=True)
        cached_pass.symlink_to(precious)
    stopped(deep, tmp_path / "two", 6)
    assert precious.read_text() == "precious" and len(passes(tmp_path / "two")) == 3


def test_cached_passes_are_reported(deep, tmp_path):
    stopped(deep, tmp_path / "one", 6)
    folder, = {path.parents[1] for path in passes(tmp_path / "one")}
    assert finished_passes.passes_left(deep, tmp_path / "one") == [
        f"3 finished parts of passes stored in {folder}: the next render continues from there unless the file changes"]
    result = run(render_steps(deep, job_in(deep, tmp_path / "one")))
    assert [line for line in result.messages if "parts of passes from an interrupted render" in line]
    assert not finished_passes.passes_left(deep, tmp_path / "one") and not (tmp_path / "one" / ".lensfield").exists()


def test_one_capture_of_a_focus_rack_is_cached_until_its_last_frame(deep, tmp_path, monkeypatch):
    dof = deep.camera.data.dof
    dof.use_dof, dof.aperture_fstop = True, 3.0
    for frame, focus_m in ((1, 0.6), (2, 1.0), (3, 4.0)):
        dof.focus_distance = focus_m
        dof.keyframe_insert("focus_distance", frame=frame)
    bpy.ops.wm.save_mainfile()
    options = OPTIONS | {"source": addon.source_digest(deep)}
    addon.render_animation(deep, [1, 2, 3], output_folder=tmp_path / "whole", **options)
    assert not (tmp_path / "whole" / ".lensfield").exists()
    animation = addon.Animation(deep, [1, 2, 3], output_folder=tmp_path / "one", **options)
    assert "one capture" in animation.plan
    animation.render(1)
    assert passes(tmp_path / "one")
    monkeypatch.setattr("lensfield.addon.render.render._render", lambda scene: 1 / 0)  # everything is cached
    addon.render_animation(deep, [1, 2, 3], output_folder=tmp_path / "one", **options)
    assert not kill.differing(tmp_path / "whole", tmp_path / "one")
    assert not (tmp_path / "one" / ".lensfield").exists()


def test_only_files_that_a_scene_depends_on_change_its_digest(deep, tmp_path):
    image = bpy.data.images.new("Painted", 4, 4)
    image.filepath_raw, image.file_format = str(tmp_path / "paint.0001.png"), "PNG"
    image.save()
    shutil.copy(tmp_path / "paint.0001.png", tmp_path / "paint.0002.png")  # of a sequence, or a tile
    paint = bpy.data.materials["Far"]
    paint.node_tree.nodes.new("ShaderNodeTexImage").image = bpy.data.images.load(str(tmp_path / "paint.0001.png"))
    lamp = paint.node_tree.nodes.new("ShaderNodeTexIES")
    lamp.mode, lamp.filepath = "EXTERNAL", "//lamp.ies"
    paint.lensfield.reflectance = "//paint.spd"
    deep.objects[-1].modifiers.new("Particles", "PARTICLE_SYSTEM").particle_system.name = "Snow"
    cache = deep.objects[-1].particle_systems["Snow"].point_cache
    cache.use_external, cache.filepath = True, "//snow"
    caches = "blendcache_scene/1.bphys", "snow/a_000001_00.bphys"
    for name in ("lamp.ies", "paint.spd", "other.png", *caches, "paint.txt", "snow/deep/a_000001_00.bphys"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("400 0.5\n700 0.5\n")
    bpy.ops.wm.save_mainfile()
    digests = {source.source_digest(deep)}
    for name in ("paint.0001.png", "paint.0002.png", "lamp.ies", "paint.spd", *caches):
        touch(tmp_path / name)
        digests.add(source.source_digest(deep))
    assert len(digests) == 7
    for name in ("other.png", "paint.txt", "scene.blend", "snow/deep/a_000001_00.bphys"):
        touch(tmp_path / name)
        assert source.source_digest(deep) in digests
    (tmp_path / "scene.blend").unlink()
    assert source.source_digest(deep) == ""


def test_a_scene_does_not_depend_on_files_of_its_renders(deep, tmp_path):
    before = source.source_digest(deep)
    result = addon.render_through_lens(deep, output_folder=tmp_path, to_compositor=True, **OPTIONS)
    bpy.ops.wm.save_mainfile()
    laid = source.source_digest(deep)
    touch(result.lens_image)
    assert source.source_digest(deep) == laid != before


def test_a_frame_being_rendered_by_another_process_is_left_to_it(deep, tmp_path):
    result = Result.of(deep, tmp_path, 1)
    with another(result.record):
        with refused(Busy, field="file", value="being written by another process",
                     where="scene_Scene_0001_report.json"):
            addon.render_through_lens(deep, output_folder=tmp_path, frame=1, **OPTIONS)
        animation = addon.render_animation(deep, [1, 2], output_folder=tmp_path, **OPTIONS)
        assert list(animation.results) == [2] and animation.elsewhere == [1]
        assert "left to other processes: 1 of the frames, from frame 1 on" in animation.summary
    assert list(addon.render_animation(deep, [1, 2], output_folder=tmp_path, **OPTIONS).results) == [1]


@pytest.mark.sample(1)
@pytest.mark.parametrize("overwrite", [False, True])
def test_a_frame_rendered_meanwhile_by_another_process_is_not_repeated(deep, tmp_path, overwrite):
    options = OPTIONS | {"output_folder": tmp_path}
    addon.render_animation(deep, [1, 2], **options)
    Result.of(deep, tmp_path, 1).record.write_text('{"software": "Made by Lensfield"}')
    animation = addon.Animation(deep, [1, 2], overwrite=overwrite, **options)
    addon.render_animation(deep, [1, 2], overwrite=True, **options)
    assert [animation.render(frame) for frame in animation.turns] == [None] * (1 + overwrite)
    assert list(animation.earlier) == [1, 2] or list(animation.earlier) == [2, 1]


@pytest.mark.sample(1)
@pytest.mark.parametrize("wait, turns", [(False, [1, 2, 1]), (True, [1, 2, 1, 1])])
def test_a_frame_abandoned_by_another_process_is_rendered_at_the_end(deep, tmp_path, wait, turns):
    animation, attempted = addon.Animation(deep, [1, 2], output_folder=tmp_path, wait=wait, **OPTIONS), []
    holder = another(Result.of(deep, tmp_path, 1).record)
    holder.__enter__()
    for frame in animation.turns:
        animation.render(frame)
        attempted.append(frame)
        if len(attempted) == len(turns) - 1:
            holder.__exit__(None, None, None)
    assert attempted == turns and list(animation.results) == [2, 1] and not animation.elsewhere


class another:
    """A process that writes a file, and is killed at the end."""

    def __init__(self, path):
        code = (f"from lensfield.engine.runtime.locks import only_writer\n"
                f"with only_writer({str(path)!r}):\n    print('held', flush=True)\n    input()")
        self._process = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                         text=True)

    def __enter__(self):
        assert self._process.stdout.readline() == "held\n"

    def __exit__(self, *_):
        self._process.kill()
        self._process.communicate()


def test_processes_share_the_frames_of_a_folder_and_a_killed_one_loses_none(tmp_path):
    """Each frame is rendered by exactly one process, to the bytes that a single process writes."""
    kill.save_scene(tmp_path / "scene.blend", samples=16)
    kill.undisturbed(tmp_path / "scene.blend", tmp_path / "whole")
    first, second = (kill.start(tmp_path / "scene.blend", tmp_path / "shared") for _ in range(2))
    assert kill.killed(first, True, 1.0) or True  # it may have finished
    _, errors = second.communicate()
    assert second.returncode == 0, errors
    assert not kill.killed(kill.start(tmp_path / "scene.blend", tmp_path / "shared"), False, 600)
    assert not kill.differing(tmp_path / "whole", tmp_path / "shared")
    assert not (tmp_path / "shared" / ".lensfield").exists()


@pytest.mark.skipif(os.name != "posix", reason="Windows does not report whether a process runs")
@pytest.mark.parametrize("frames", [[1], [1, 2]], ids=["nothing to render", "a frame to render"])
def test_a_file_left_half_written_by_another_process_is_removed_at_the_end(deep, tmp_path, frames):
    """The process may have been killed after this one's first write to the folder."""
    addon.render_animation(deep, [1], output_folder=tmp_path, **OPTIONS)
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    left = tmp_path / f"{files.HALF}{files._machine()}-{ended.pid}-scene_Scene_0001_radiance-abc.exr"
    left.write_text("half")
    assert list(addon.render_animation(deep, frames, output_folder=tmp_path, **OPTIONS).results) == frames[1:]
    assert not left.exists() and not list(tmp_path.glob(f"{files.HALF}*"))


def test_a_link_in_place_of_the_cache_folder_contains_no_passes(deep, tmp_path):
    """The report at the end of a render looks there, too."""
    (tmp_path / "precious").mkdir()
    (tmp_path / ".lensfield").symlink_to(tmp_path / "precious")
    assert finished_passes.passes_left(deep, tmp_path) == []
