"""A render that a window starts: it runs in a separate process, and a timer follows it, here stepped manually."""

import os
import signal
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from layouts import Layout
from lensfield import addon
from lensfield.addon.job.source import source_digest
from lensfield.addon.scene.compositor import compositor_state, fingerprint_anew, lens_image
from lensfield.addon.ui import window_render
from lensfield.addon.ui.common.session import session
from lensfield.addon.ui.panels import draw_settings
from lensfield.cli import CANCELLED
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.runtime import child
from lensfield.engine.runtime.errors import InputError
from refusals import refused
from small_scenes import light, material, wall
from snapshot import COMPOSITOR, differences, snapshot
from window_follow import follow

USUAL_GRACE_S = child.GRACE_S  # before tests extend it


@pytest.fixture
def ready_scene(scene, tmp_path, monkeypatch):
    """Saved, and then edited, as a window would detect: in the background this depends on Blender's version."""
    monkeypatch.setattr(window_render, "window_digest", lambda scene: "")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    light(scene, "POINT", 20.0, color=(1, 0.5, 0.2))
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (0.7, 0.3, 0.05))[0])
    scene.lensfield.wavelength_mode, scene.lensfield.wavelength_list = "LIST", "480, 530, 640"
    bpy.context.view_layer.update()
    yield scene
    window_render.end()


@pytest.fixture
def endless_scene(ready_scene):
    ready_scene.cycles.samples = 1 << 20
    ready_scene.render.resolution_x = ready_scene.render.resolution_y = 1000
    return ready_scene


def start():
    """The operator's action in a window; in background mode Blender would execute it in its own process."""
    window_render.start(bpy.context.scene)
    return session.render


def in_a_pass(render):
    """During the samples of a pass, which it also reports."""
    return render.child.status.get("label", "").startswith(("Pass 1", "Layer 1")) and render.fraction > 0


def shown(scene):
    layout = Layout()
    draw_settings(layout, scene)
    return layout


def notice():
    return "\n".join(session.last_render.lines)


def test_a_window_render_matches_a_script_and_changes_only_the_compositor(ready_scene, tmp_path):
    before = snapshot()
    render = start()
    assert not [line for line in differences(before, snapshot()) if "compositor_key" not in line]
    follow()
    changed = differences(before, snapshot())
    assert changed and not [line for line in changed if not any(word in line for word in COMPOSITOR)]
    image = tmp_path / "lensfield" / "scene_Scene_0001_lens_image.exr"
    assert bpy.path.abspath(lens_image(ready_scene).filepath) == str(image)
    assert str(image) in notice() and "Cycles render" in notice()
    assert not Path(render.folder.name).exists()
    child_s = read_exr(tmp_path / "lensfield" / "scene_Scene_0001_irradiance.exr").cube
    ready_scene.lensfield.output_folder = "//script"
    assert bpy.ops.lensfield.render() == {"FINISHED"}
    assert np.array_equal(child_s, read_exr(tmp_path / "script" / "scene_Scene_0001_irradiance.exr").cube)


@pytest.mark.one_blender
def test_a_folder_renamed_during_a_render_is_reported_with_its_picture(ready_scene, tmp_path):
    (tmp_path / "project").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "project" / "shot.blend"))
    start()
    (tmp_path / "project").rename(tmp_path / "renamed")
    follow()
    image = tmp_path / "project" / "lensfield" / "shot_Scene_0001_lens_image.exr"
    assert image.is_file() and str(image) in notice()
    assert f"{tmp_path}/project/shot.blend is missing: open the .blend where it is now, or use Save As" in notice()


@pytest.mark.one_blender
def test_files_in_one_folder_have_pictures_of_their_own(ready_scene, tmp_path):
    """Also after Save As; a renamed scene keeps its render, and each file shows its own."""
    assert bpy.ops.lensfield.render() == {"FINISHED"}
    first = (tmp_path / "lensfield" / "scene_Scene_0001_lens_image.exr").read_bytes()
    ready_scene.name = "Renamed"
    assert bpy.ops.lensfield.apply_lens() == {"FINISHED"}
    assert (tmp_path / "lensfield" / "scene_Renamed_0001_lens_image.exr").read_bytes() == first
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "other.blend"))
    bpy.data.objects["Wall"].location.z -= 1
    fingerprint_anew(ready_scene)
    assert bpy.ops.lensfield.apply_lens() == {"FINISHED"}
    assert compositor_state(ready_scene)[0] == "plain render, the scene has changed since"
    assert bpy.ops.lensfield.render() == {"FINISHED"}
    assert compositor_state(ready_scene)[0] == "lens image"
    assert (tmp_path / "lensfield" / "other_Renamed_0001_lens_image.exr").read_bytes() != first
    for name in "Scene", "Renamed":
        assert (tmp_path / "lensfield" / f"scene_{name}_0001_lens_image.exr").read_bytes() == first


@pytest.mark.one_blender
def test_light_of_another_file_is_neither_applied_nor_replaced(ready_scene, tmp_path):
    folder = str(tmp_path / "pictures")
    ready_scene.lensfield.output_folder = folder
    assert bpy.ops.lensfield.render() == {"FINISHED"}
    (tmp_path / "elsewhere").mkdir()
    bpy.data.objects["Wall"].location.z -= 1
    ready_scene.lensfield.compositor_key = ""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "elsewhere" / "scene.blend"))
    refused = r"scene_Scene_0001_radiance.exr: {} is rendered from scene 'Scene' of ../scene.blend: {}"
    with pytest.raises(RuntimeError, match=refused.format("radiance file", "render through the lens first")):
        bpy.ops.lensfield.apply_lens()
    with pytest.raises(RuntimeError, match=refused.format("file", "choose another output folder")):
        bpy.ops.lensfield.render()
    with pytest.raises(RuntimeError, match=refused.format("file", "choose another output folder")):
        bpy.ops.lensfield.render_animation()
    addon.render_through_lens(ready_scene, overwrite=True)


@pytest.mark.one_blender
def test_another_lens_can_be_applied_in_the_background(ready_scene, tmp_path):
    ready_scene.camera.data.lensfield.lens = "tessar-50mm"
    with pytest.raises(RuntimeError, match="Render this frame through the lens first"):
        bpy.ops.lensfield.apply_lens()
    assert bpy.ops.lensfield.render() == {"FINISHED"}
    radiance = tmp_path / "lensfield" / "scene_Scene_0001_radiance.exr"
    rendered_ns = radiance.stat().st_mtime_ns
    ready_scene.camera.data.lensfield.lens, ready_scene.camera.data.lensfield.view = "cooke-triplet-50mm", "CAMERA"
    before = snapshot()
    window_render.start_again(ready_scene)
    assert not [line for line in differences(before, snapshot()) if "('images'" not in line]  # images load on access
    follow()
    assert "from the light in" in notice() and "Cooke Triplet 50 mm" in notice()
    assert radiance.stat().st_mtime_ns == rendered_ns
    pixels = read_exr(radiance.with_name("scene_Scene_0001_irradiance.exr"))
    assert pixels.lens_name.startswith("cooke-triplet-50mm")
    assert bpy.ops.lensfield.apply_lens() == {"FINISHED"}
    assert np.array_equal(pixels.cube, read_exr(radiance.with_name("scene_Scene_0001_irradiance.exr")).cube)
    ready_scene.name = "Renamed"
    assert bpy.ops.lensfield.apply_lens() == {"FINISHED"}
    ready_scene.render.resolution_x = 60
    with pytest.raises(InputError, match="size is 48 x 36 px: the scene's resolution is now 60 x 36 px: render again"):
        window_render.start_again(ready_scene)


@pytest.mark.one_blender
def test_the_panel_shows_the_render_and_its_outcome(endless_scene):
    assert "lensfield.cancel" not in shown(endless_scene).shown
    start()
    follow(in_a_pass)
    panel = shown(endless_scene)
    assert {"lensfield.cancel", "lens"} <= set(panel.shown)
    assert "Layer 1 of 2" in " ".join(panel.labels)
    assert bpy.ops.lensfield.cancel() == {"FINISHED"}
    assert "Cancelled" in shown(endless_scene).labels


def test_cancelling_lets_the_child_exit_and_leaves_no_files(endless_scene, tmp_path):
    render = start()
    follow(in_a_pass)
    assert bpy.ops.lensfield.cancel() == {"FINISHED"}
    assert render.child.ended and window_render.tick() is None
    assert render.child._process.returncode == CANCELLED
    assert not Path(render.folder.name).exists()
    assert not list((tmp_path / "lensfield").iterdir())


@pytest.mark.one_blender
def test_cancelling_a_saved_file_keeps_its_passes_and_reports_them(endless_scene, tmp_path, monkeypatch):
    """A window knows whether the file is saved; in the background Blender does not."""
    endless_scene.cycles.samples, endless_scene.lensfield.wavelength_list = 1 << 14, "400, 450, 500, 550, 600, 650"
    endless_scene.render.resolution_x = endless_scene.render.resolution_y = 40
    bpy.ops.wm.save_mainfile()
    monkeypatch.setattr(window_render, "window_digest", source_digest)
    start()
    follow(lambda render: list(tmp_path.glob("lensfield/.lensfield/*/*/[!.]*.exr")))
    assert bpy.ops.lensfield.cancel() == {"FINISHED"}
    passes = tmp_path / "lensfield" / ".lensfield" / "scene_Scene_0001_passes"
    assert notice().startswith("Cancelled\n")
    assert f"stored in {passes}: the next render continues from there unless the file changes" in notice()
    assert not list(passes.parent.glob("*.lock"))


def test_cancelling_kills_a_child_that_exceeds_its_grace_period(endless_scene, monkeypatch):
    """Less than a second: before the child has loaded Blender, and can end by itself."""
    assert 0 < USUAL_GRACE_S < 1
    monkeypatch.setattr(child, "GRACE_S", 1e-3)
    render = start()
    assert bpy.ops.lensfield.cancel() == {"FINISHED"}
    assert render.child.ended and render.child._process.returncode == -signal.SIGKILL


def test_only_one_render_runs_at_a_time(endless_scene):
    start()
    with pytest.raises(RuntimeError, match="A lens render is in progress: wait for it, or cancel it"):
        bpy.ops.lensfield.render()
    window_render.end()
    assert bpy.ops.lensfield.render.poll() and not bpy.ops.lensfield.cancel.poll()


@pytest.mark.one_blender
def test_a_crashed_child_leaves_a_message_and_its_log(endless_scene):
    render = start()
    follow(in_a_pass)
    os.kill(render.child._process.pid, signal.SIGABRT)
    follow()
    assert notice().startswith("The render process ended unexpectedly (signal 6: ")
    log = Path(notice().rsplit("log: ")[1])
    assert log.read_text() and not Path(render.folder.name).exists()
    log.unlink()
    assert bpy.ops.lensfield.render.poll()


@pytest.mark.one_blender
def test_bad_input_is_reported_before_or_by_the_child(ready_scene):
    ready_scene.lensfield.wavelength_list = "300"
    with refused(InputError, field="wavelength", value="300 nm"):
        start()
    assert session.render is None
    ready_scene.lensfield.wavelength_list = "550"
    ready_scene.camera.data.type = "ORTHO"
    with refused(InputError, field="type", value="ORTHO", where="camera 'Camera'"):
        start()
    assert session.render is None
    ready_scene.camera.data.type = "PERSP"
    nodes = bpy.data.materials["Paint"].node_tree.nodes
    film = nodes.new("ShaderNodeBsdfPrincipled")
    film.inputs["Thin Film Thickness"].default_value = 400
    surface = next(node for node in nodes if node.bl_idname == "ShaderNodeOutputMaterial").inputs["Surface"]
    bpy.data.materials["Paint"].node_tree.links.new(film.outputs[0], surface)
    start()
    follow()
    assert "Thin Film Thickness" in notice()
    assert session.last_render.icon == "ERROR"


def test_another_file_can_be_opened_during_a_render(ready_scene, tmp_path):
    start()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert bpy.context.scene.name == "Scene"  # a different scene with the same name
    before = snapshot()
    follow()
    assert not differences(before, snapshot())
    assert "Scene 'Scene' is no longer open" in notice()
    assert (tmp_path / "lensfield" / "scene_Scene_0001_lens_image.exr").is_file()


@pytest.mark.one_blender
def test_the_scene_can_be_renamed_edited_and_saved_elsewhere(ready_scene, tmp_path):
    start()
    ready_scene.name = "Renamed"
    bpy.data.objects.remove(bpy.data.objects["Wall"])
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "elsewhere.blend"))
    follow()
    path = bpy.path.abspath(lens_image(ready_scene).filepath)
    assert path == str(tmp_path / "lensfield" / "scene_Scene_0001_lens_image.exr")


@pytest.mark.one_blender
def test_the_compositor_is_unchanged_when_to_compositor_is_off(ready_scene):
    ready_scene.lensfield.to_compositor = False
    before = snapshot()
    start()
    follow()
    assert not [line for line in differences(before, snapshot()) if "compositor_key" not in line] and notice()


def test_unsaved_pixels_of_tiles_are_reported(ready_scene):
    image = bpy.data.images.new("Painted", 4, 4, tiled=True)
    image.use_fake_user = True
    image.pixels[0] = 0.5
    assert window_render.start(ready_scene) == list(session.render.remarks)
    follow()
    assert "Image 'Painted' has unsaved pixels" in notice()


def test_disabling_the_add_on_ends_its_render(endless_scene):
    render = start()
    addon.unregister()
    try:
        assert render.child.ended and not Path(render.folder.name).exists()
        assert not bpy.app.timers.is_registered(window_render.tick)
    finally:
        addon.register()


def test_the_label_shows_the_remaining_time_and_another_file(scene, monkeypatch):
    child = SimpleNamespace(status={"fraction": 0.25, "label": "Pass 1 of 3"}, status_s=30.0)
    render = window_render.WindowRender(child, None, "hall.blend", "Scene", scene.session_uid, True, [], started_s=10.0)
    monkeypatch.setattr(window_render.time, "monotonic", lambda: 40.0)
    assert render.label == "Pass 1 of 3, 30 s, about 50 s left"
    child.status = {}
    assert render.label == "Starting Blender in the background, 30 s"
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert render.label == "Scene of hall.blend: Starting Blender in the background, 30 s"
