"""The spectral files that a render writes, and what later commands do without them."""

import json

import bpy
import pytest

from lensfield import addon, cli
from lensfield.addon.render.refilter import saved_radiance
from lensfield.engine import InputError
from refusals import refused
from small_scenes import set_world

SPECTRAL = {"radiance", "irradiance"}
QUICK = {"lens": "tessar-50mm", "lens_quality": "preview", "depth": "off", "wavelengths_nm": [550.0]}


@pytest.fixture
def lit_scene(scene, tmp_path):
    set_world(scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    return scene


def render(scene, folder, **given):
    return addon.render_through_lens(scene, output_folder=folder, **QUICK | given)


def written(result):
    """The spectral files that exist; the pictures all do."""
    assert all(path.is_file() for path in (result.lens_image, result.stray, result.depth, result.before, result.after))
    return {name for name in SPECTRAL if getattr(result, name).is_file()}


@pytest.mark.parametrize("files, expected", [
    ("all", SPECTRAL), ("radiance,irradiance,pictures", SPECTRAL), ("radiance", {"radiance"}),
    ("irradiance,pictures", {"irradiance"}), ("pictures", set())])
def test_requested_spectral_files_are_written_and_earlier_ones_removed(lit_scene, tmp_path, files, expected):
    assert written(render(lit_scene, tmp_path / "out")) == SPECTRAL
    result = render(lit_scene, tmp_path / "out", files=files)
    assert written(result) == expected
    record = json.loads(result.record.read_text())
    for facts in record, result.report.as_dict():
        assert SPECTRAL & facts["files"].keys() == expected == SPECTRAL - set(facts.get("left_out", []))
    assert {result.lens_image.name, result.after.name} < record["sizes"].keys()


def test_a_traced_lens_writes_pictures_alone_if_requested(lit_scene, tmp_path):
    lit_scene.cycles.samples = 1
    traced = addon.render_through_lens(lit_scene, output_folder=tmp_path / "out", files="pictures",
                                       **QUICK | {"depth": "traced"})
    assert traced.lens_image.is_file() and not traced.irradiance.exists() and not traced.radiance.exists()


@pytest.mark.parametrize("files", ["", "all,pictures", "raw", "radiance irradiance"])
def test_unknown_files_are_refused(lit_scene, tmp_path, files):
    with refused(InputError, field="files", value=files or "empty", where="options",
                 match="expected all, or some of radiance, irradiance, pictures"):
        render(lit_scene, tmp_path, files=files)


def test_frames_with_more_files_than_requested_are_finished(lit_scene, tmp_path):
    def rendered(files):
        animation = addon.render_animation(lit_scene, [1, 2], output_folder=tmp_path / "out", files=files, **QUICK)
        return list(animation.results)

    assert rendered("radiance") == [1, 2]
    assert not rendered("radiance") and not rendered("pictures"), "they have the pictures"
    assert rendered("irradiance") == [1, 2], "they lack it"
    assert rendered("all") == [1, 2]
    assert not any(map(rendered, ("irradiance", "radiance", "pictures")))


def test_commands_name_the_option_for_a_file_that_was_left_out(lit_scene, tmp_path, capsys):
    result = render(lit_scene, tmp_path / "out", files="pictures")
    develop = ["develop", result.irradiance, "--camera", "nikon-d700", "-o", tmp_path / "raw.dng"]
    apply = ["apply", result.radiance, "--lens", "tessar-50mm"]
    for kind, command in {"radiance": apply, "irradiance": develop}.items():
        assert cli.main([str(word) for word in command]) == 1
        line = capsys.readouterr().err.splitlines()[-1]
        assert f"_{kind}.exr: {kind} file is left out of the frame's files: write the frame again with --files" in line
    lit_scene.lensfield.output_folder = str(tmp_path / "out")
    with pytest.raises(InputError, match="--files radiance"):
        saved_radiance(lit_scene)
    result.record.unlink()
    with refused(InputError, field="file", where=result.radiance.name):
        addon.apply_lens(result.radiance, lens="tessar-50mm")


def test_applying_a_lens_keeps_the_radiance_and_leaves_out_the_irradiance(lit_scene, tmp_path):
    result = render(lit_scene, tmp_path / "out")
    before = result.radiance.read_bytes()
    applied = addon.apply_lens(result.radiance, lens="tessar-50mm", lens_quality="preview", files="pictures")
    assert written(applied) == {"radiance"} and applied.radiance.read_bytes() == before
    assert json.loads(applied.record.read_text())["left_out"] == ["irradiance"]


@pytest.mark.parametrize("files", ["all", "irradiance", "pictures"])
def test_pictures_of_another_scene_are_not_replaced(lit_scene, tmp_path, files):
    result = render(lit_scene, tmp_path / "out", files=files)
    (tmp_path / "other").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "other" / "scene.blend"))
    set_world(lit_scene, strength=2.0)
    with refused(InputError, field="file", match="rendered from scene 'Scene' of ../scene.blend"):
        render(lit_scene, tmp_path / "out")
    assert written(result) == {"all": SPECTRAL, "pictures": set()}.get(files, {files})


def test_the_panel_chooses_the_files(lit_scene, tmp_path):
    lit_scene.lensfield.files = "PICTURES"
    assert written(render(lit_scene, tmp_path / "out")) == set()
    assert written(render(lit_scene, tmp_path / "out", files="all")) == SPECTRAL
