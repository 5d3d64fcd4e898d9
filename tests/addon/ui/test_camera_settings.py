"""The lens is the camera's: copies, libraries, overrides, undo, presets, and the panels that show it."""

import os

import bpy
import pytest

from layouts import Layout
from lensfield.addon.scene.active_camera import camera_settings
from lensfield.addon.scene.errors import SceneError
from lensfield.addon.scene.rings import scene_rings
from lensfield.addon.ui.panels import draw_camera_settings, draw_settings
from lensfield.engine.rays.rings import Rings


@pytest.fixture
def second(scene):
    """A second camera of the scene, with a lens of its own."""
    camera = bpy.data.objects.new("Second", bpy.data.cameras.new("Second"))
    scene.collection.objects.link(camera)
    camera.data.lensfield.lens, camera.data.lensfield.tilt_deg = "kodak-petzval-100mm", (0.1, 0.0)
    return camera


def test_each_camera_has_its_lens(scene, second):
    assert scene.lensfield.to_request().lens == camera_settings(scene).lens == "tessar-50mm"
    scene.camera = second
    request = scene.lensfield.to_request()
    assert request.lens == "kodak-petzval-100mm" and request.tilt_deg[0] == pytest.approx(5.72958)
    assert scene.lensfield.without_camera().tilt_deg == (0.0, 0.0)


def test_a_scene_without_a_camera_has_no_lens(scene):
    scene.camera = None
    with pytest.raises(SceneError, match="^scene 'Scene': camera is missing: add a camera to render from$"):
        scene.lensfield.to_request()


def test_copies_of_a_camera_have_its_lens(scene, second, tmp_path):
    copy = second.copy()
    copy.data = second.data.copy()
    second.data.lensfield.lens = "nikkor-28mm"
    assert copy.data.lensfield.lens == "kodak-petzval-100mm"
    bpy.data.libraries.write(str(tmp_path / "cameras.blend"), {copy})
    with bpy.data.libraries.load(str(tmp_path / "cameras.blend")) as (_, loaded):
        loaded.objects = [copy.name]
    appended, = loaded.objects
    assert appended.data != copy.data and appended.data.lensfield.lens == "kodak-petzval-100mm"
    assert tuple(appended.data.lensfield.tilt_deg) == pytest.approx((0.1, 0.0))


def linked_camera(scene, camera, folder):
    """The same camera linked from a file, and the scene's active one."""
    folder.mkdir(exist_ok=True)
    bpy.data.libraries.write(str(folder / "cameras.blend"), {camera})
    with bpy.data.libraries.load(str(folder / "cameras.blend"), link=True) as (_, loaded):
        loaded.objects = [camera.name]
    bpy.data.objects.remove(camera)
    scene.camera, = loaded.objects
    scene.collection.objects.link(scene.camera)
    return scene.camera


def test_a_linked_camera_has_its_lens_and_keeps_it(scene, second, tmp_path):
    second.data.lensfield.lens, second.data.lensfield.lens_file = "FILE", "//own.toml"
    camera = linked_camera(scene, second, tmp_path / "library")
    assert camera.data.lensfield.lens_name_or_path() == str(tmp_path / "library" / "own.toml")
    with pytest.raises(RuntimeError, match="data-block is linked from .*: change it in that file, or make a library"):
        bpy.ops.lensfield.search_lens(lens="nikkor-28mm")
    assert camera.data.lensfield.lens == "FILE"


def test_an_override_of_a_camera_has_a_lens_of_its_own(scene, second, tmp_path):
    second.data.lensfield.lens_file = "//own.toml"
    linked_camera(scene, second, tmp_path / "library").override_create(remap_local_usages=True)
    scene.camera.data.override_create(remap_local_usages=True)
    settings = scene.camera.data.lensfield
    assert settings.lens == "kodak-petzval-100mm"
    assert bpy.ops.lensfield.search_lens(lens="nikkor-28mm") == {"FINISHED"}
    settings.copy = 3
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "film.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "film.blend"))
    settings = bpy.context.scene.camera.data.lensfield
    assert settings.id_data.override_library and (settings.lens, settings.copy) == ("nikkor-28mm", 3)
    assert tuple(settings.tilt_deg) == pytest.approx((0.1, 0.0)), "of the library"
    settings.lens = "FILE"
    assert settings.lens_name_or_path() == str(tmp_path / "library" / "own.toml"), "as the library has it"
    settings.lens_file = "//mine.toml"
    assert settings.lens_name_or_path() == str(tmp_path / "mine.toml")


def test_rings_of_a_camera_are_animated(scene, second):
    scene.camera = second
    for frame, degrees in ((1, 0.0), (11, 0.1)):
        second.data.lensfield.tilt_deg = degrees, 0.0
        second.data.lensfield.keyframe_insert("tilt_deg", index=0, frame=frame)
    tilts = []
    for frame in (1, 6, 11):
        scene.frame_set(frame)
        tilts.append(scene_rings(scene).tilt_deg[0])
    assert tilts == pytest.approx([0, 2.86479, 5.72958])


def test_undo_restores_the_lens_of_each_camera(scene, second):
    bpy.ops.ed.undo_push(message="Before")
    bpy.data.cameras["Second"].lensfield.lens = "nikkor-28mm"
    bpy.data.cameras["Camera"].lensfield.coating = "NONE"
    bpy.ops.ed.undo_push(message="After")
    bpy.ops.ed.undo()
    assert bpy.data.cameras["Second"].lensfield.lens == "kodak-petzval-100mm"
    assert bpy.data.cameras["Camera"].lensfield.coating == "LENS"
    bpy.ops.ed.redo()
    assert bpy.data.cameras["Second"].lensfield.lens == "nikkor-28mm"


def shown(scene, camera):
    draw_camera_settings(layout := Layout(), scene, camera)
    return layout


def test_the_camera_panel_shows_the_lens_of_its_camera_alone(scene, second):
    layout = shown(scene, second.data)
    assert {"lens", "tilt_deg", "view", "copy", "coating", "body"} <= set(layout.shown)
    assert not {"tier", "stray_light", "output_folder", "depth", "lensfield.render"} & set(layout.shown)
    assert "Not the scene's active camera" in layout.labels
    assert "Not the scene's active camera" not in shown(scene, scene.camera.data).labels


def test_a_scene_without_a_camera_shows_no_lens(scene):
    scene.camera = None
    draw_settings(layout := Layout(), scene)
    assert not {"lens", "view", "body", "lensfield.compare"} & set(layout.shown)
    assert {"lensfield.add_camera", "tier", "stray_light"} <= set(layout.shown)


def test_operators_change_the_camera_that_the_editor_shows(scene, second):
    with bpy.context.temp_override(camera=second.data):
        assert bpy.ops.lensfield.search_lens(lens="nikkor-28mm") == {"FINISHED"}
    assert second.data.lensfield.lens == "nikkor-28mm" and scene.camera.data.lensfield.lens == "tessar-50mm"


def test_a_preset_keeps_lens_and_body(scene, second, tmp_path, monkeypatch):
    monkeypatch.setenv("BLENDER_USER_SCRIPTS", str(tmp_path / "scripts"))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    scene.camera = second
    settings = second.data.lensfield
    settings.body, settings.sensor_mm, settings.coating, settings.lens_file = "nikon-d700", (18, 12), "NONE", "//l.toml"
    second.data.dof.aperture_blades = 7
    assert bpy.ops.lensfield.add_camera_preset(name="Portrait kit") == {"FINISHED"}
    path = tmp_path / "scripts" / "presets" / "lensfield" / "camera" / "Portrait_kit.py"
    scene.camera = bpy.data.objects["Camera"]
    apply = {"filepath": str(path), "menu_idname": "LENSFIELD_PT_camera_presets"}
    assert bpy.ops.script.execute_preset(**apply) == {"FINISHED"}
    given = scene.camera.data.lensfield
    assert (given.lens, given.body, given.coating) == ("kodak-petzval-100mm", "nikon-d700", "NONE")
    assert tuple(given.sensor_mm) == (18, 12) and scene.camera.data.dof.aperture_blades == 7
    assert given.lens_file == os.path.join(tmp_path, "l.toml"), "complete, because a preset is for all files"
    assert tuple(given.tilt_deg) == (0, 0), "of a picture, not of the lens"
    assert bpy.ops.lensfield.add_camera_preset(name="Portrait_kit", remove_name=True) == {"FINISHED"}
    assert not path.exists()


def test_given_rings_need_no_depth_of_field(scene, second):
    scene.camera = second
    assert scene_rings(scene, focus=700.0, tilt_deg=(0.0, 0.0)) == Rings(700.0)
