"""A .blend whose folder is moved or renamed during the session: no file is written that would create it anew."""

from pathlib import Path

import bpy
import pytest

import lensfield
from lensfield import addon
from lensfield.addon.render.preflight import preflight
from lensfield.addon.scene.lens_file import lens_file_for_scene
from lensfield.engine import InputError
from lensfield.engine.prescription.readers import ReadingOptions
from refusals import refused
from small_scenes import set_world

GONE = r"project/shot\.blend: folder is missing: open the \.blend where it is now, or use Save As$"


@pytest.fixture
def moved_scene(scene, tmp_path):
    """A scene whose .blend has been in tmp_path/project."""
    set_world(scene)
    (tmp_path / "project").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "project" / "shot.blend"))
    (tmp_path / "project").rename(tmp_path / "renamed")
    return scene


def test_no_render_creates_the_former_folder(moved_scene, tmp_path):
    for operator in bpy.ops.lensfield.render, bpy.ops.lensfield.render_animation:
        with pytest.raises(RuntimeError, match=GONE.removesuffix("$")):
            operator()
    with pytest.raises(InputError, match=GONE):
        addon.render_through_lens(moved_scene)
    assert [str(refusal).rpartition("/")[2] for refusal in preflight(moved_scene).refusals] == [
        "shot.blend: folder is missing: open the .blend where it is now, or use Save As"]
    assert not (tmp_path / "project").exists()


def test_no_lens_file_creates_the_former_folder(moved_scene, tmp_path):
    prescription = Path(lensfield.__file__).parent / "engine/library/prescriptions/tessar-50mm.toml"
    with refused(InputError, field="folder", value="missing", where="shot.blend"):
        lens_file_for_scene(prescription, ReadingOptions(sensor_mm=(18, 12)))
    assert not (tmp_path / "project").exists()


@pytest.mark.parametrize("output_folder", ["elsewhere", "renamed"])
def test_a_render_into_an_existing_folder_goes_on(moved_scene, tmp_path, output_folder):
    moved_scene.lensfield.output_folder = str(tmp_path / output_folder)
    if output_folder == "renamed":
        moved_scene.lensfield.output_folder = "//lensfield"
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "renamed" / "shot.blend"))
    assert addon.render_through_lens(moved_scene, wavelengths_nm=[550]).lens_image.is_relative_to(
        tmp_path / output_folder)
    assert not (tmp_path / "project").exists()
