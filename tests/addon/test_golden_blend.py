"""The settings in .blend files and presets of released versions arrive in today's add-on."""

import json

import bpy
import pytest

from golden import FACTS, FOLDERS
from golden_blend import facts_of_scene

BLENDS = [folder for folder in FOLDERS if (folder / "scene.blend").is_file()]


def recorded(folder):
    return json.loads((folder / FACTS).read_text(encoding="utf-8"))["scene.blend"]


def assert_same(scene, facts):
    read = facts_of_scene(scene)
    assert facts and {name: read.get(name) for name in facts} == facts


@pytest.mark.parametrize("folder", BLENDS, ids=lambda folder: folder.name)
def test_the_settings_in_an_old_blend_arrive(folder):
    bpy.ops.wm.open_mainfile(filepath=str(folder / "scene.blend"))
    scene = bpy.context.scene
    assert_same(scene, recorded(folder))
    scene.lensfield.tier = "PREVIEW"
    with pytest.raises(AssertionError):
        assert_same(scene, recorded(folder))


@pytest.mark.parametrize("folder", BLENDS, ids=lambda folder: folder.name)
def test_an_old_preset_sets_lens_and_body(scene, folder):
    bpy.ops.script.execute_preset(filepath=str(folder / "preset.py"), menu_idname="LENSFIELD_PT_camera_presets")
    given, facts = scene.camera.data.lensfield, recorded(folder)
    assert (given.lens, given.body, given.coating, given.view, given.copy) == tuple(
        facts[f"Camera.{name}"] for name in ("lens", "body", "coating", "view", "copy"))
    assert tuple(given.sensor_mm) == tuple(facts["Camera.sensor_mm"])
