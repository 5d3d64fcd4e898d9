"""Scenes that no lens can render are rejected immediately, with the same text in window, panel and command."""

import bpy
import pytest

from layouts import Layout
from lensfield import addon, cli
from lensfield.addon.job import job
from lensfield.addon.scene.errors import SceneError
from lensfield.addon.scene.requirements import check_scene
from lensfield.addon.ui import window_render
from lensfield.addon.ui.common.plain_words import plain
from lensfield.addon.ui.common.session import session
from lensfield.addon.ui.panels import draw_settings
from lensfield.addon.ui.preview import preview
from refusals import refused
from small_scenes import set_world

RENDERS = bpy.ops.lensfield.render, bpy.ops.lensfield.render_animation


def setting(path, value):
    *owners, name = path.split(".")

    def change(scene):
        owner = scene
        for each in owners:
            owner = getattr(owner, each)
        setattr(owner, name, value)

    return change


UNFIT = {
    "camera 'Camera': type is ORTHO: expected a perspective camera": setting("camera.data.type", "ORTHO"),
    "camera 'Camera': panorama type is": setting("camera.data.type", "PANO"),
    "camera 'Camera': shift is 0, nan: ": setting("camera.data.shift_y", float("nan")),
    "camera 'Camera': scale is 1, 0, 1: ": setting("camera.scale", (1.0, 0.0, 1.0)),
    "camera 'Camera': position is 0, nan, 0: ": setting("camera.location", (0.0, float("nan"), 0.0)),
    "camera 'Camera': clipping is 5000 to 1000: ": setting("camera.data.clip_start", 5000.0),
    "scene 'Scene': pixel aspect is 2:1: expected square pixels": setting("render.pixel_aspect_x", 2.0),
    "scene 'Scene': resolution is 3 x 4 px: expected at least 4 px": setting("render.resolution_percentage", 8)}


@pytest.fixture
def no_work(scene, monkeypatch):
    """The scene; the test fails if a process starts, the file is copied or the lens is read."""
    def work(*_, **__):
        pytest.fail("work was started")

    for module, name in ((window_render, "Child"), (window_render, "save_copy"), (preview, "Child"),
                         (job, "scene_lens"), (job, "scene_iris")):
        monkeypatch.setattr(module, name, work)
    set_world(scene)
    scene.render.resolution_x, scene.render.resolution_y = 48, 56
    return scene


@pytest.mark.parametrize("expected", UNFIT)
def test_every_entry_point_rejects_an_unfit_scene_with_the_same_message(no_work, tmp_path, capsys, expected):
    UNFIT[expected](no_work)
    bpy.context.view_layer.update()
    with pytest.raises(SceneError) as first:
        check_scene(no_work)
    text = str(first.value)
    assert text.startswith(expected)
    for start in (window_render.start, lambda scene: window_render.start(scene, "--frames", "scene"), preview.start,
                  lambda scene: addon.render_through_lens(scene, output_folder=tmp_path / "out"), addon.Animation):
        with pytest.raises(SceneError) as refused:
            start(no_work)
        assert str(refused.value) == text
    for render in RENDERS:
        with pytest.raises(RuntimeError) as refused:
            render()
        assert text in str(refused.value)
    blend = str(tmp_path / "scene.blend")
    bpy.ops.wm.save_as_mainfile(filepath=blend)
    assert cli.main(["render", blend, "--output", str(tmp_path / "out")]) == 1
    assert text in capsys.readouterr().err
    assert not (tmp_path / "out").exists() and session.render is None


@pytest.mark.parametrize("expected", UNFIT)
def test_the_panel_and_the_check_report_an_unfit_scene(scene, tmp_path, expected):
    scene.render.resolution_x, scene.render.resolution_y = 48, 56
    UNFIT[expected](scene)
    bpy.context.view_layer.update()
    layout = Layout()
    draw_settings(layout, scene)
    refusal, = (each for each in addon.preflight(scene, output_folder=tmp_path).refusals
                if str(each).startswith(expected))
    assert " ".join(layout.labels).count(plain(refusal)) == 1


def test_a_camera_bound_to_a_later_marker_is_rejected_before_the_first_frame(no_work, tmp_path):
    late = bpy.data.objects.new("Late", bpy.data.cameras.new("Late"))
    late.data.type = "ORTHO"
    no_work.collection.objects.link(late)
    no_work.frame_end = 9
    for frame, camera in ((1, no_work.camera), (8, late)):
        no_work.timeline_markers.new(camera.name, frame=frame).camera = camera
    check_scene(no_work)
    check_scene(no_work, frames=range(1, 8))
    for start in (lambda: window_render.start(no_work, "--frames", "scene"),
                  lambda: addon.Animation(no_work, output_folder=tmp_path)):
        with refused(SceneError, field="type", value="ORTHO", where="camera 'Late'"):
            start()


@pytest.mark.parametrize("name", ["lens", "sensor_width"])
def test_the_camera_view_requires_finite_numbers(scene, name):
    setattr(scene.camera.data, name, float("nan"))
    check_scene(scene)
    with pytest.raises(SceneError, match="camera 'Camera': .* is nan mm: expected a positive number"):
        check_scene(scene, view="camera")


def test_a_fisheye_camera_is_valid_only_for_the_lens_view(scene):
    scene.camera.data.type, scene.camera.data.panorama_type = "PANO", "FISHEYE_LENS_POLYNOMIAL"
    check_scene(scene)
    with refused(SceneError, field="type", value="PANO", where="camera 'Camera'"):
        check_scene(scene, view="camera")


@pytest.mark.parametrize("lens, accepted", [("tessar-50mm", False), ("", False), ("jacobsen-41mm-2x", True)])
def test_pixels_may_be_wide_for_an_anamorphic_lens(scene, lens, accepted):
    scene.render.pixel_aspect_x = 2.0
    if accepted:
        check_scene(scene, lens=lens)
    else:
        with refused(SceneError, field="pixel aspect", where="scene 'Scene'",
                     match="expected square pixels, as the lens is not anamorphic"):
            check_scene(scene, lens=lens)
