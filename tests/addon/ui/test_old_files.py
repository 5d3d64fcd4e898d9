"""Files in which the lens was the scene's: opening them gives it to the cameras, once, and says so in a line."""

from zlib import crc32

import bpy
import pytest

from lensfield.addon.ui.common.properties import LensfieldCameraSettings, lens_items
from lensfield.addon.ui.old_files import NEW_NAMES, give_lenses_to_cameras

PETZVAL = next(number for name, *_, number in lens_items(None, None) if name == "kodak-petzval-100mm")


def number_of(name, identifier):
    items = LensfieldCameraSettings.bl_rna.properties[name].enum_items
    return [item.identifier for item in items].index(identifier)


def add_camera(scene, name):
    camera = bpy.data.objects.new(name, bpy.data.cameras.new(name))
    scene.collection.objects.link(camera)
    return camera


def store(scene, **values):
    """Store values as an older Lensfield did: by the names and numbers of the scene's properties."""
    for name, value in values.items():
        scene.lensfield[name] = value


def reopened(path):
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.context.scene


@pytest.fixture
def old(scene):
    """A scene with all old settings."""
    store(scene, lens=PETZVAL, lens_file="//own.toml", view=number_of("view", "CAMERA"), tilt_deg=(0.1, -0.2), copy=7,
          copy_grade=number_of("copy_grade", "DROPPED"), coating=number_of("coating", "SINGLE"), focused_wide_open=True,
          iris_roundness=0.25, iso=800.0, shutter_s=0.01, sensor_mm=(18.0, 12.0), camera_file="own.toml", accuracy=0.02)
    return scene


def test_all_cameras_of_a_scene_get_its_settings(old, tmp_path, capsys):
    add_camera(old, "Second")
    scene = reopened(tmp_path / "old.blend")
    for camera in (scene.camera.data, bpy.data.cameras["Second"]):
        settings = camera.lensfield
        assert (settings.lens, settings.lens_file, settings.view) == ("kodak-petzval-100mm", "//own.toml", "CAMERA")
        assert tuple(settings.tilt_deg) == pytest.approx((0.1, -0.2)) and tuple(settings.sensor_mm) == (18, 12)
        assert (settings.copy, settings.copy_grade, settings.coating) == (7, "DROPPED", "SINGLE")
        assert (settings.focused_wide_open, settings.iris_roundness, settings.iso) == (True, 0.25, 800)
        assert settings.shutter_s == pytest.approx(0.01) and settings.body_file == "own.toml"
    assert scene.lensfield.accuracy == pytest.approx(0.02) and not {*scene.lensfield.keys()} & {*NEW_NAMES}
    assert capsys.readouterr().err == (
        "lensfield: scene 'Scene': lenses now belong to cameras: this one was given to 'Camera', 'Second'\n")
    again = reopened(tmp_path / "new.blend")
    give_lenses_to_cameras()
    assert again.camera.data.lensfield.copy == 7 and not capsys.readouterr().err


def test_numbers_from_before_the_pickers_numbers_are_known(scene, tmp_path):
    store(scene, lens=crc32(b"kodak-petzval-100mm") >> 1)
    assert reopened(tmp_path / "old.blend").camera.data.lensfield.lens == "kodak-petzval-100mm"


def test_a_camera_with_a_lens_keeps_it(old, tmp_path, capsys):
    add_camera(old, "Own").data.lensfield.lens = "tessar-50mm"
    reopened(tmp_path / "old.blend")
    assert bpy.data.cameras["Own"].lensfield.lens == "tessar-50mm"
    assert bpy.data.cameras["Own"].lensfield.copy == 0
    assert "given to 'Camera'; 'Own' has a lens already\n" in capsys.readouterr().err


def test_two_scenes_with_a_camera_in_common_are_reported(old, tmp_path, capsys):
    bpy.ops.scene.new(type="LINK_COPY")
    other = bpy.context.scene
    store(other, lens=lens_items(None, None)[0][-1])
    reopened(tmp_path / "old.blend")
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2 and sum("'Camera' has the lens of scene" in line for line in lines) == 1


def test_keyframes_and_drivers_go_with_their_settings(old, tmp_path):
    old.lensfield.accuracy = 0.1
    old.lensfield.keyframe_insert("accuracy", frame=1)
    for frame, value in ((1, 0.25), (11, 0.75)):  # of a registered setting, whose curve is then named like the old
        old.lensfield.colour_error = value
        old.lensfield.keyframe_insert("colour_error", frame=frame)
    curve = next(each for each in curves(old) if each.data_path == "lensfield.colour_error")
    curve.data_path, curve.keyframe_points[0].interpolation = "lensfield.iris_roundness", "LINEAR"
    driver = old.driver_add("lensfield.glare_index")
    driver.driver.expression, driver.data_path = "frame * 0.5", "lensfield.copy"
    scene = reopened(tmp_path / "old.blend")
    settings = scene.camera.data.lensfield
    for frame in (1, 6, 11):
        scene.frame_set(frame)
        assert settings.iris_roundness == pytest.approx(0.25 + (frame - 1) / 20) and settings.copy == frame // 2
    assert [each.data_path for each in curves(scene)] == ["lensfield.accuracy"]
    assert not scene.animation_data.drivers


def curves(block):
    action = block.animation_data.action
    return list(action.fcurves if hasattr(action, "fcurves") else action.layers[0].strips[0].channelbags[0].fcurves)


def test_what_cannot_be_converted_is_reported(old, tmp_path, capsys):
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {old})
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, loaded):
        loaded.scenes = ["Scene"]
    assert "scene 'Scene' is linked, with a lens of an older Lensfield: open " in capsys.readouterr().err
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bare = bpy.context.scene
    store(bare, lens=PETZVAL)
    give_lenses_to_cameras()
    assert "lacks a camera to take its lens: add one, or make a library override" in capsys.readouterr().err
    bare.camera = add_camera(bare, "Late")
    give_lenses_to_cameras()
    assert bare.camera.data.lensfield.lens == "kodak-petzval-100mm"


def test_an_appended_scene_is_converted(old, tmp_path, capsys):
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {old})
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=False) as (_, loaded):
        loaded.scenes = ["Scene"]
    appended, = loaded.scenes
    assert appended.camera.data.lensfield.lens == "kodak-petzval-100mm"
    assert "given to 'Camera'" in capsys.readouterr().err
