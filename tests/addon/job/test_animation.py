"""Several frames: finished ones are skipped, damaged or outdated ones are rendered again, and errors name the frame."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

from lensfield import addon
from lensfield.addon.job.result import FRAME_FILES, LENS_FILES
from lensfield.addon.render import animation as animation_module
from lensfield.addon.render import pictures
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.runtime.errors import InputError
from refusals import refused
from small_scenes import keyframe_world, light, material, set_world, wall
from snapshot import differences, snapshot
from waiting import LAST_RESORT_S, wait_until

NAMES = tuple(FRAME_FILES.values())


@pytest.fixture
def moving_scene(scene, tmp_path):
    """A saved scene with a world whose strength is the number of the frame."""
    keyframe_world(scene, 1, 9)
    for curve in curves(scene.world.node_tree):
        curve.keyframe_points[0].interpolation = "LINEAR"
    scene.lensfield.wavelength_mode, scene.lensfield.wavelength_list = "LIST", "550"
    scene.lensfield.depth = "OFF"  # most of a small frame's time, and test_slabs.py has an animation with depth
    scene.render.image_settings.file_format = "OPEN_EXR"  # a factory scene has no colour space until then
    scene.frame_start, scene.frame_end, scene.frame_step = 2, 6, 2
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    return scene


def curves(block):
    action = block.animation_data.action
    return action.fcurves if hasattr(action, "fcurves") else action.layers[0].strips[0].channelbags[0].fcurves


def level(folder, frame):
    cube = read_exr(folder / f"scene_Scene_{frame:04d}_radiance.exr").cube
    return cube[cube > 0].mean()


def rendered_frames(animation):
    return list(animation.results)


def files(folder):
    """Names of the files of frames."""
    return {path.name for path in folder.iterdir()} - {f"scene_Scene_{end}" for end in LENS_FILES.values()}


def test_frames_of_an_animation_equal_single_renders(moving_scene, tmp_path):
    before, progress = snapshot(), []
    animation = addon.render_animation(moving_scene, progress=lambda *facts: progress.append(facts))
    assert not differences(before, snapshot())
    assert rendered_frames(animation) == [2, 4, 6] and not animation.earlier
    folder = tmp_path / "lensfield"
    assert files(folder) == {f"scene_Scene_{frame:04d}_{name}" for frame in (2, 4, 6) for name in NAMES}
    levels = [level(folder, frame) for frame in (2, 4, 6)]
    np.testing.assert_allclose(np.array(levels) / levels[0], (1, 2, 3), rtol=1e-5)
    single = addon.render_through_lens(moving_scene, output_folder=tmp_path / "one", frame=4)
    assert np.array_equal(read_exr(single.irradiance).cube, read_exr(folder / single.irradiance.name).cube)
    fractions = [fraction for fraction, _ in progress]
    assert fractions == sorted(fractions) and fractions[-1] == 1
    assert {label.split(":")[0] for _, label in progress} == {f"Frame {2 * n}, {n} of 3" for n in (1, 2, 3)}


def test_existing_frames_are_not_rendered_again(moving_scene, tmp_path):
    folder = tmp_path / "lensfield"
    addon.render_animation(moving_scene, [2, 4])
    stamps = {path: path.stat().st_mtime_ns for path in folder.glob("scene_Scene_000[24]*")}
    animation = addon.render_animation(moving_scene, range(2, 7, 2))
    assert rendered_frames(animation) == [6] and list(animation.earlier) == [2, 4]
    assert {path: path.stat().st_mtime_ns for path in stamps} == stamps
    assert animation.summary[0].endswith(f"; 2 already finished, in {folder}") and len(animation.summary) == 1
    report = animation.report.as_dict()
    assert [(frame["frame"], frame.get("earlier", False)) for frame in report["frames"]] == [
        (2, True), (4, True), (6, False)]
    assert all({"stages_s", "energy", "plan", "passes"} <= frame.keys() for frame in report["frames"])
    assert report["total_s"] == pytest.approx(report["frames"][2]["total_s"]) and report["lens"] == "tessar-50mm"
    assert rendered_frames(addon.render_animation(moving_scene, [2, 4], overwrite=True)) == [2, 4]
    assert not rendered_frames(nothing := addon.render_animation(moving_scene))
    assert nothing.summary == [f"nothing to render; 3 already finished, in {folder}"]


def test_frames_of_another_build_are_rendered_again_or_accepted(moving_scene, tmp_path):
    addon.render_animation(moving_scene, [2, 4])
    record = tmp_path / "lensfield" / "scene_Scene_0002_report.json"
    facts = json.loads(record.read_text())
    record.write_text(json.dumps(facts | {"build": "0123456789abcdef"}))
    accepted = addon.render_animation(moving_scene, [2, 4], any_build=True)
    line = "1 of 2 frames come from another build of Lensfield: "
    assert not rendered_frames(accepted) and list(accepted.earlier) == [2, 4]
    assert all(line + "accepted by --any-build" in lines for lines in (accepted.summary, accepted.beforehand))
    again = addon.render_animation(moving_scene, [2, 4])
    assert rendered_frames(again) == [2] and any(each.startswith(line + "rendered again") for each in again.beforehand)
    assert json.loads(record.read_text())["build"] == facts["build"]
    assert not any("another build" in each for each in addon.render_animation(moving_scene, [2, 4]).summary)


def shorten(path):
    os.truncate(path, path.stat().st_size - 2)


def fill_with_zeros(path):
    """As a disk does after a power failure."""
    path.write_bytes(bytes(path.stat().st_size))


DAMAGES = [
    *(lambda folder, name=name: (folder / f"scene_Scene_0002_{name}").unlink() for name in NAMES),
    *(lambda folder, name=name: shorten(folder / f"scene_Scene_0002_{name}") for name in NAMES),
    *(lambda folder, name=name: fill_with_zeros(folder / f"scene_Scene_0002_{name}") for name in NAMES),
    *(lambda folder, text=text: (folder / "scene_Scene_0002_report.json").write_text(text)
      for text in ("[]", "{}", "null", '{"job": 1, "sizes": {}}', "\x00")),
    lambda folder: (folder / "scene_Scene_0002_report.json").write_bytes(b"\xff\xfe")]


def test_damaged_frames_are_rendered_again(moving_scene, tmp_path):
    addon.render_animation(moving_scene, [2, 4])
    folder, intact = tmp_path / "lensfield", tmp_path / "whole"
    shutil.copytree(folder, intact)
    for number, damage in enumerate(DAMAGES):
        damage(folder)
        assert addon.Animation(moving_scene, [2, 4]).pending == [2], number
        shutil.copytree(intact, folder, dirs_exist_ok=True)
    assert not addon.Animation(moving_scene, [2, 4]).pending


def test_files_of_the_lens_are_written_once_for_all_frames(moving_scene, tmp_path):
    paths = [tmp_path / "lensfield" / f"scene_Scene_{name}.exr" for name in LENS_FILES]

    def written(frame):
        addon.render_animation(moving_scene, [frame], lens_quality="preview")
        return [path.stat().st_mtime_ns for path in paths]

    first = written(2)
    assert written(4) == first
    paths[0].unlink()
    paths[1].write_bytes(b"another. Made by Lensfield")
    again = written(6)
    assert again[0] > first[0] and again[1] > first[1] and again[2] == first[2]
    assert all(path.stat().st_size > 1000 for path in paths)
    moving_scene.camera.data.lensfield.lens = "nikkor-28mm"
    assert all(now > before for now, before in zip(written(2), again, strict=True))


def darken(scene):
    scene.cycles.max_bounces += 1


@pytest.mark.parametrize("change", [
    lambda scene: setattr(scene.cycles, "samples", 17), darken,
    lambda scene: setattr(scene.render, "resolution_x", 50),
    lambda scene: setattr(scene.lensfield, "wavelength_list", "550, 600"),
    lambda scene: setattr(scene.camera.data.lensfield, "lens", "nikkor-28mm"),
    lambda scene: setattr(scene.camera.data.lensfield, "view", "CAMERA"),
    lambda scene: setattr(scene.lensfield, "tier", "REFERENCE"),
    lambda scene: setattr(scene.lensfield, "tier", "RESULT"),
    lambda scene: setattr(scene.lensfield, "denoise", "ON"),
    lambda scene: setattr(scene.lensfield, "stray_light", "AUTO"),
    lambda scene: setattr(scene.lensfield, "cleanliness", "HAZY")])
def test_frames_are_rendered_again_after_a_change_of_settings(moving_scene, change):
    addon.render_animation(moving_scene, [2], lens_quality="preview")
    change(moving_scene)
    assert addon.Animation(moving_scene, [2], lens_quality="preview").pending == [2]


def test_settings_without_effect_on_the_picture_leave_frames_up_to_date(moving_scene):
    addon.render_animation(moving_scene, [2])
    moving_scene.cycles.preview_samples, moving_scene.render.filepath = 3, "//elsewhere"
    moving_scene.cycles.device, moving_scene.frame_end = "GPU", 100
    moving_scene.lensfield.to_compositor = not moving_scene.lensfield.to_compositor
    assert not addon.Animation(moving_scene, [2]).pending


def outdated_lines(animation):
    return [line for line in animation.summary if "the scene has changed since" in line]


def test_frames_older_than_a_change_of_the_scene_are_reported(moving_scene):
    addon.render_animation(moving_scene, [2, 4])
    moving_scene.frame_set(5)
    bpy.ops.wm.save_mainfile()
    assert not outdated_lines(addon.Animation(moving_scene))
    bpy.ops.wm.revert_mainfile()
    scene = bpy.context.scene
    assert not outdated_lines(addon.Animation(scene))
    set_world(scene, (1, 0.5, 0.5))
    animation = addon.render_animation(scene)
    assert rendered_frames(animation) == [6] and animation.outdated == [2, 4] and not animation.current
    assert outdated_lines(animation) == ["the scene has changed since 2 of the finished frames, from frame 2 on: "
                                         "Overwrite (--overwrite) renders them again"]
    addon.render_animation(scene, overwrite=True)
    assert not outdated_lines(addon.Animation(scene)) and len(addon.Animation(scene).current) == 3


def test_an_animation_recognises_frames_of_single_renders(moving_scene):
    addon.render_through_lens(moving_scene, frame=4)
    assert addon.Animation(moving_scene, [2, 4]).pending == [2]
    addon.render_through_lens(moving_scene, frame=4, wavelengths_nm=[450.0])
    assert addon.Animation(moving_scene, [2, 4]).pending == [2, 4]


def test_each_frame_uses_its_marker_camera_and_keyframed_settings(moving_scene, tmp_path):
    other = bpy.data.objects.new("Other", bpy.data.cameras.new("Other"))
    moving_scene.collection.objects.link(other)
    for name, frame, camera in (("A", 1, moving_scene.camera), ("B", 4, other)):
        moving_scene.timeline_markers.new(name, frame=frame).camera = camera
    other.data.lens = 2 * moving_scene.camera.data.lens
    for camera in (moving_scene.camera, other):
        camera.data.lensfield.view = "CAMERA"
    moving_scene.lensfield.tier = "RESULT"
    for frame, accuracy in ((2, 0.02), (4, 0.05)):
        moving_scene.lensfield.accuracy = accuracy
        moving_scene.cycles.samples = 4 * frame
        for path in ("lensfield.accuracy", "cycles.samples"):
            moving_scene.keyframe_insert(path, frame=frame)
    results = addon.render_animation(moving_scene, [2, 4]).results.values()
    first, second = (result.report.scene.lens_warning for result in results)
    factor = [float(text.split("(scaled by ")[1].split(")")[0]) for text in (first, second)]
    assert factor[1] == pytest.approx(2 * factor[0], rel=1e-2)
    records = [json.loads(result.record.read_text()) for result in results]
    assert [record["job"]["options"]["accuracy"] for record in records] == [0.02, 0.05]
    assert [record["job"]["settings"]["samples"] for record in records] == [8, 16]
    for frame in (2, 4):  # whatever the scene's current frame
        moving_scene.frame_set(frame)
        animation = addon.Animation(moving_scene, [2, 4])
        assert not animation.pending and not animation.outdated
    moving_scene.timeline_markers["B"].camera = moving_scene.timeline_markers["A"].camera
    moving_scene.camera = moving_scene.timeline_markers["A"].camera
    assert addon.Animation(moving_scene, [2]).outdated == [2]


def test_cameras_of_markers_have_lenses_of_their_own(moving_scene, tmp_path):
    """Each frame equals a render with the lens of its camera."""
    other = moving_scene.camera.copy()
    other.data = moving_scene.camera.data.copy()
    moving_scene.collection.objects.link(other)
    wall(moving_scene, material("Paint", "ShaderNodeBsdfDiffuse")[0], distance_m=2.0)
    light(moving_scene, "POINT", 20.0).location.x = 0.4
    for frame, camera, lens in ((1, moving_scene.camera, "tessar-50mm"), (4, other, "kodak-petzval-100mm")):
        moving_scene.timeline_markers.new(lens, frame=frame).camera = camera
        camera.data.lensfield.lens, camera.data.lensfield.view = lens, "CAMERA"
    given = {"wavelengths_nm": [550], "lens_quality": "preview"}
    film = addon.render_animation(moving_scene, [2, 4], output_folder=tmp_path / "film", **given)
    both = {}
    for frame, lens in ((2, "tessar-50mm"), (4, "kodak-petzval-100mm")):
        assert film.results[frame].report.lens_image.lens.startswith(lens)
        single = addon.render_through_lens(moving_scene, frame=frame, lens=lens, output_folder=tmp_path / lens, **given)
        both[frame] = read_exr(film.results[frame].irradiance).cube
        assert np.array_equal(both[frame], read_exr(single.irradiance).cube)
    assert not np.allclose(both[2] / both[2].mean(), both[4] / both[4].mean(), rtol=0.01)
    assert not addon.Animation(moving_scene, [2, 4], output_folder=tmp_path / "film", **given).pending
    moving_scene.camera.data.lensfield.lens = "nikkor-28mm"
    assert len(addon.Animation(moving_scene, [2, 4], output_folder=tmp_path / "film", **given).pending) == 1


@pytest.mark.parametrize("animated", [False, True])
def test_noise_is_the_same_in_each_frame_unless_the_scene_animates_its_seed(scene, tmp_path, animated):
    light(scene, "AREA", 20.0).location.x = 2.0
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse")[0])
    scene.cycles.use_animated_seed, scene.lensfield.wavelength_count = animated, 2
    results = addon.render_animation(scene, [1, 2], output_folder=tmp_path).results.values()
    first, second = (read_exr(result.radiance).cube for result in results)
    assert np.array_equal(first, second) != animated


def test_an_error_names_its_frame_and_leaves_earlier_frames(moving_scene, tmp_path):
    camera = moving_scene.camera.data
    for frame, start_m in ((5, 5000.0), (4, 0.1)):
        camera.clip_start = start_m
        camera.keyframe_insert("clip_start", frame=frame)
    before = snapshot()
    with refused(InputError, field="clipping", value="5000 to 1000", where="frame 6: camera 'Camera'"):
        addon.render_animation(moving_scene)
    assert not differences(before, snapshot())
    assert files(tmp_path / "lensfield") == {f"scene_Scene_{frame:04d}_{name}" for frame in (2, 4) for name in NAMES}
    assert addon.Animation(moving_scene).pending == [6]


def test_a_full_disk_is_reported_with_its_frame_and_leaves_no_partial_files(moving_scene, tmp_path, monkeypatch):
    written = []

    def write_or_fail(*arguments):
        written.append(arguments)
        if len(written) == 4:  # the second picture of the second frame
            raise OSError(28, "No space left on device")
        return write(*arguments)

    write = pictures.write_shown
    monkeypatch.setattr(pictures, "write_shown", write_or_fail)
    with pytest.raises(InputError, match="^frame 4: render is stopped: No space left on device$"):
        addon.render_animation(moving_scene)
    assert "scene_Scene_0004_report.json" not in files(tmp_path / "lensfield")
    assert addon.Animation(moving_scene).pending == [4, 6]
    assert not [name for name in files(tmp_path / "lensfield") if name.startswith(".")]


def test_a_frame_being_rendered_again_counts_as_missing(moving_scene, monkeypatch):
    """If it is stopped while writing files, the old files no longer have a record."""
    addon.render_animation(moving_scene, [2])

    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(pictures, "write_shown", stop)
    with pytest.raises(KeyboardInterrupt):
        addon.render_animation(moving_scene, [2], overwrite=True)
    assert addon.Animation(moving_scene, [2]).pending == [2]


def test_missing_frames_are_detected_without_evaluating_them(moving_scene, monkeypatch):
    monkeypatch.setattr(animation_module, "job_of_frame", None)
    assert addon.Animation(moving_scene, range(100)).pending == list(range(100))


COMMAND = [sys.executable, "-c", "from lensfield.cli import console; console()", "render"]


def lensfield(*arguments):
    return subprocess.run([*COMMAND, *map(str, arguments)], capture_output=True, text=True, timeout=LAST_RESORT_S)


def test_the_command_resumes_after_it_was_stopped(moving_scene, tmp_path):
    light(moving_scene, "POINT", 20.0)
    wall(moving_scene, material("Paint", "ShaderNodeBsdfDiffuse")[0])
    moving_scene.cycles.samples, moving_scene.render.resolution_x, moving_scene.render.resolution_y = 32, 120, 90
    moving_scene.lensfield.depth = "AUTO"
    bpy.ops.wm.save_mainfile()
    folder, blend = tmp_path / "lensfield", bpy.data.filepath
    process = subprocess.Popen([*COMMAND, blend, "--frames", "2-200"], stderr=subprocess.PIPE, text=True)
    wait_until(lambda: (folder / "scene_Scene_0003_report.json").is_file() or process.poll() is not None)
    assert process.poll() is None
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=LAST_RESORT_S)
    assert process.returncode == 130
    caches = {path.parents[1] for path in folder.glob(".lensfield/*/*/[!.]*.exr")}
    stored = "".join(f"; finished passes are stored in {path}" for path in caches)
    assert stderr.endswith(f"lensfield: cancelled{stored}\n")
    finished = {name[:16] for name in files(folder) if name.endswith("report.json")}
    assert {"scene_Scene_0002", "scene_Scene_0003"} <= finished
    assert {name for name in files(folder) if name.startswith(".")} <= {".lensfield"}  # passes of the next frame
    assert not list(folder.glob(".lensfield/*.lock"))
    stamps = {path: path.stat().st_mtime_ns for path in folder.glob("scene_Scene_000[23]_*")}
    last = len(finished) + 2  # which does not exist yet
    result = lensfield(blend, "--frames", f"2-{last}", "--report", tmp_path / "report.json")
    assert result.returncode == 0, result.stderr
    assert {path: path.stat().st_mtime_ns for path in stamps} == stamps
    assert "1 frame in " in result.stdout and f"; {len(finished)} already finished" in result.stdout
    assert [Path(line).name for line in result.stdout.splitlines() if line.startswith(str(folder))] == [
        f"scene_Scene_{last:04d}_{name}" for name in NAMES] + [f"scene_Scene_{end}" for end in LENS_FILES.values()]
    frames = json.loads((tmp_path / "report.json").read_text())["frames"]
    assert [frame["frame"] for frame in frames] == list(range(2, last + 1))
    result = lensfield(blend, "--frames", "scene")
    assert f"{sum(frame > last for frame in (2, 4, 6))} frame" in result.stdout or "nothing to render" in result.stdout
    assert result.returncode == 0 and (folder / "scene_Scene_0006_report.json").is_file()
