"""The animation that a window starts, stepped manually; and its place in the panel."""

from pathlib import Path

import bpy
import pytest

from layouts import Layout
from lensfield.addon.scene.compositor import lens_image, remove_from_compositor
from lensfield.addon.scene.errors import SceneError
from lensfield.addon.ui import window_render
from lensfield.addon.ui.animation import draw_animation
from lensfield.addon.ui.common.session import session
from lensfield.engine.runtime.files import HALF
from small_scenes import keyframe_world, set_world
from snapshot import COMPOSITOR, differences, snapshot
from window_follow import follow


@pytest.fixture
def moving_scene(scene, tmp_path):
    """A saved scene with a world of growing strength, whose current state is not saved."""
    keyframe_world(scene, 1, 3)
    scene.lensfield.wavelength_mode, scene.lensfield.wavelength_list = "LIST", "550"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    scene.frame_start, scene.frame_end = 1, 3
    bpy.context.view_layer.update()
    yield scene
    window_render.end()


def start(*arguments):
    """The operator's action in a window."""
    window_render.start(bpy.context.scene, "--frames", "scene", *arguments)
    return session.render


def notice():
    return "\n".join(session.last_render.lines)


def frame_file(tmp_path, frame, end="lens_image.exr"):
    return tmp_path / "lensfield" / f"scene_Scene_{frame:04d}_{end}"


def heavy(scene, samples):
    scene.cycles.samples = samples
    scene.render.resolution_x = scene.render.resolution_y = 300


def test_the_window_renders_the_scenes_range_and_the_compositor_follows(moving_scene, tmp_path):
    heavy(moving_scene, 4)
    labels, laid = set(), []
    render = start()

    def look(render):
        if render:
            labels.add(render.label.partition(":")[0])
            laid[:] = render.laid
        return False

    before = snapshot()
    follow(look)
    assert all(frame_file(tmp_path, frame, "report.json").is_file() for frame in (1, 2, 3))
    assert {"Frame 1, 1 of 3", "Frame 3, 3 of 3"} <= labels
    assert notice().startswith("3 frames in ") and not render.remarks
    assert len(laid) >= 2 and Path(laid[-1]) in (frame_file(tmp_path, 2), frame_file(tmp_path, 3))
    assert Path(bpy.path.abspath(lens_image(moving_scene).filepath)) == frame_file(tmp_path, 3)
    assert not [line for line in differences(before, snapshot()) if not any(word in line for word in COMPOSITOR)]


@pytest.mark.one_blender
def test_a_cancelled_animation_keeps_its_frames_and_resumes_after_them(moving_scene, tmp_path):
    heavy(moving_scene, 64)
    start()
    follow(lambda render: render and len(render.child.lens_images) == 2)
    assert bpy.ops.lensfield.cancel() == {"FINISHED"}
    assert notice() == "Cancelled\n2 frames are finished; Render Animation renders the rest"
    left = {path.relative_to(tmp_path / "lensfield").parts[1] for path in tmp_path.rglob("*/.lensfield/**/*")}
    assert not frame_file(tmp_path, 3).exists() and left <= {"scene_Scene_0003_passes", "scene_Scene_0003_passes.lock",
                                                             "scene_Scene_0003_report.json.lock"}
    assert not list(tmp_path.rglob(f"{HALF}*"))
    stamps = [frame_file(tmp_path, frame, "report.json").stat().st_mtime_ns for frame in (1, 2)]
    assert lens_image(moving_scene)
    start()
    follow()
    assert notice().startswith("1 frame in ") and "; 2 already finished" in notice()
    assert [frame_file(tmp_path, frame, "report.json").stat().st_mtime_ns for frame in (1, 2)] == stamps
    start("--overwrite")
    follow()
    assert notice().startswith("3 frames in ")


def test_a_compositor_error_does_not_stop_the_animation(moving_scene, monkeypatch):
    def refuse(scene, path, *_, **__):
        raise SceneError("tree", "owner", "library.blend", "make it local")

    monkeypatch.setattr(window_render, "lay_into_compositor", refuse)
    start()
    follow()
    assert notice().startswith("3 frames in ")
    remark = "The lens image was not added to the compositor: tree: owner is library.blend: make it local"
    assert notice().count(remark) == 1


@pytest.mark.one_blender
def test_frames_from_before_an_edit_are_reported_and_not_composited(moving_scene, tmp_path):
    """For an edit that is not saved; saving alone changes nothing."""
    moving_scene.frame_end = 2
    start()
    follow()
    bpy.ops.wm.save_mainfile()
    render = start()
    follow()
    assert notice() == f"nothing to render; 2 already finished, in {tmp_path / 'lensfield'}" and len(render.laid) == 2
    set_world(moving_scene, (1, 0.5, 0.5))
    frame_file(tmp_path, 2).unlink()
    render = start()
    follow()
    assert notice().startswith("1 frame in ") and [Path(path) for path in render.laid] == [frame_file(tmp_path, 2)]
    assert "the scene has changed since 1 of the finished frames, from frame 1 on: Overwrite" in notice()


@pytest.mark.one_blender
def test_an_error_names_the_frame_and_the_frames_already_rendered(moving_scene):
    for frame, start_m in ((1, 0.1), (2, 5000.0)):
        moving_scene.camera.data.clip_start = start_m
        moving_scene.camera.data.keyframe_insert("clip_start", frame=frame)
    moving_scene.frame_set(1)
    start()
    follow()
    assert session.last_render.lines[0].startswith("frame 2: camera 'Camera': clipping is 5000 to 1000: ")
    assert session.last_render.lines[1] == "1 frame is finished; Render Animation renders the rest"
    assert session.last_render.icon == "ERROR"


def test_a_script_can_render_the_range(moving_scene, tmp_path):
    assert bpy.ops.lensfield.render_animation() == {"FINISHED"}
    assert Path(bpy.path.abspath(lens_image(moving_scene).filepath)) == frame_file(tmp_path, 3)
    remove_from_compositor(moving_scene)
    assert bpy.ops.lensfield.render_animation() == {"FINISHED"}  # existing frames
    assert Path(bpy.path.abspath(lens_image(moving_scene).filepath)) in [frame_file(tmp_path, n) for n in (1, 2, 3)]
    moving_scene.camera.data.clip_start = 5000
    with pytest.raises(RuntimeError, match="camera 'Camera': clipping is 5000 to 1000"):
        bpy.ops.lensfield.render_animation(overwrite=True)


def test_the_panel_has_an_animation_button(moving_scene):
    moving_scene.frame_step = 2
    layout = Layout()
    draw_animation(layout, moving_scene)
    assert {"lensfield.render_animation", "LENSFIELD_MT_animation"} <= set(layout.shown)
