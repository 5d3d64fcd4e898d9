"""From a new scene to the picture: the panel's options, predictions and fixes."""

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view

from layouts import Layout
from lensfield.addon.job.job import folder_for, unsaved_folder
from lensfield.addon.job.radiance import pass_bytes
from lensfield.addon.job.remarks import ENOUGH_SAMPLES
from lensfield.addon.scene.camera import capture_grid
from lensfield.addon.ui import lens_worker, lint_panel, plan_line
from lensfield.addon.ui.panels import draw_settings
from lensfield.addon.ui.properties import DEFAULT_LENS, matching_lens_items, offered_lenses, searched_lens_items
from lensfield.addon.ui.session import LastRender, session
from lensfield.engine import Options, load_lens
from lensfield.engine.image.sampling import Sampling
from lensfield.engine.library import bundled_names
from lensfield.engine.plan.choose import make_plan
from places import SAMPLE_SCENE
from small_scenes import light, material, wall
from varied_lenses import VARIED
from waiting import LAST_RESORT_S


@pytest.fixture
def plain(scene):
    """A scene that renders."""
    light(scene, "POINT", 20.0)
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (0.7, 0.3, 0.05))[0])
    return scene


def drawn(scene):
    """The panel after its lens is baked."""
    lens_worker.lens_request(scene).future.result(timeout=LAST_RESORT_S)
    layout = Layout()
    draw_settings(layout, scene)
    return layout


def told(scene):
    return " ".join(drawn(scene).labels)


def test_the_default_lens_sees_a_new_files_view_from_afar(scene):
    lens = load_lens(scene.lensfield.lens)
    assert scene.lensfield.lens == DEFAULT_LENS
    new = bpy.data.cameras.new("New")
    assert lens.object_distance_mm == np.inf and lens.sensor_mm[0] == new.sensor_width
    assert lens.efl_mm == pytest.approx(new.lens, rel=0.01)


def test_lenses_go_by_their_titles():
    assert {name for name, *_ in offered_lenses()} == {*bundled_names(), "FILE"}
    assert "Zeiss Tessar 50 mm f/5.5 (1902)" in {title for _, title, *_ in offered_lenses()}


@pytest.mark.parametrize("words, found", [("zeiss 1902", {"tessar-50mm"}), ("SWIRL petzval", {"kodak-petzval-100mm"}),
                                          ("no such lens", set())])
def test_words_find_lenses_to_choose_from(scene, words, found):
    scene.lensfield.lens, scene.lensfield.lens_words = "nikkor-28mm", words
    assert {name for name, *_ in matching_lens_items(scene.lensfield, None)} == found | {"nikkor-28mm"}
    for name in found:
        scene.lensfield.matching_lens = name
        assert scene.lensfield.lens == scene.lensfield.matching_lens == name


def test_without_words_all_lenses_are_to_choose_from(scene):
    assert matching_lens_items(scene.lensfield, None) == offered_lenses()
    scene.lensfield.matching_lens = "FILE"
    assert scene.lensfield.lens == "FILE"


def test_a_search_knows_lenses_by_all_that_is_told_of_them():
    names = dict((name, shown) for name, shown, *_ in searched_lens_items(None, None))
    assert names.keys() == {name for name, *_ in offered_lenses()}
    for word in ("Zeiss", "1902", "50mm", "crisp"):
        assert word in names["tessar-50mm"]


def test_each_bundled_lens_has_its_picture():
    from PIL import Image

    from lensfield.engine.library import PICTURES
    for name in VARIED:
        with Image.open(PICTURES / f"{name}.jpg") as picture:
            assert picture.size == (256, 192)


@pytest.mark.sample(1)
@pytest.mark.parametrize("lens", [DEFAULT_LENS, "edmund-54852", "kodak-petzval-100mm"])
def test_a_scene_without_a_camera_gets_one_that_sees_all(scene, lens):
    scene.lensfield.lens = lens
    for place in ((0, 0, 0), (5, 1, 0), (-2, 8, 3)):
        bpy.ops.mesh.primitive_cube_add(location=place)
    bpy.data.objects.remove(scene.camera)
    assert "lensfield.add_camera" in drawn(scene).shown
    assert bpy.ops.lensfield.add_camera() == {"FINISHED"}
    bpy.context.view_layer.update()
    assert "lensfield.add_camera" not in drawn(scene).shown and "different field of view" not in told(scene)
    for obj in (obj for obj in scene.objects if obj.type == "MESH"):
        for vertex in obj.data.vertices:
            x, y, z = world_to_camera_view(scene, scene.camera, obj.matrix_world @ vertex.co)
            assert 0 < x < 1 and 0 < y < 1 and z > 0


def test_an_empty_scene_gets_a_camera_too(scene):
    bpy.data.objects.remove(scene.camera)
    assert bpy.ops.lensfield.add_camera() == {"FINISHED"}
    assert np.all(np.isfinite(scene.camera.location)) and scene.camera.location.length > 0


def test_a_camera_that_frames_another_view_is_told_of(scene):
    scene.camera.data.type, scene.camera.data.lens = "PERSP", 90
    assert "different field of view" in told(scene)
    assert bpy.ops.lensfield.match_camera() == {"FINISHED"}
    assert "different field of view" not in told(scene)


def test_many_samples_are_told_of_and_mended(plain):
    plain.cycles.samples, plain.cycles.use_denoising = 4096, False
    assert "4096 samples" in told(plain) and "lensfield.sensible_samples" in drawn(plain).shown
    assert bpy.ops.lensfield.sensible_samples() == {"FINISHED"}
    assert plain.cycles.samples == ENOUGH_SAMPLES and plain.cycles.use_denoising
    assert "lensfield.sensible_samples" not in drawn(plain).shown


def settled(scene):
    """The plan's line after the thread has computed it."""
    plan_text(scene)
    plan_line._worker.submit(int).result(timeout=LAST_RESORT_S)  # after pending work
    return plan_text(scene)


def plan_text(scene):
    return plan_line.plan_text(scene, load_lens(scene.lensfield.lens))


def test_the_plan_line_follows_the_settings(plain):
    plain.lensfield.wavelength_mode, plain.lensfield.wavelength_list = "LIST", "450, 500, 550, 600, 650"
    assert "Up to 2 Cycles passes \u00b7 " in settled(plain) and "5 wavelengths" in settled(plain)
    plain.lensfield.tier = "PREVIEW"
    assert settled(plain).startswith("1 Cycles pass \u00b7 ")
    plain.lensfield.tier = "REFERENCE"
    assert settled(plain).startswith("2 or more Cycles passes")


def test_the_plan_line_knows_what_a_check_has_found_until_the_settings_change(plain):
    plain.lensfield.tier = "REFERENCE"
    assert bpy.ops.lensfield.lint() == {"FINISHED"}
    count = len(session.check.result.plan.bands)
    assert plan_text(plain).startswith(f"{count} Cycles pass")
    assert "changed since this check" not in told(plain)
    plain.lensfield.wavelength_count = 7
    assert plan_text(plain).startswith("3 or more") and "changed since this check" in told(plain)


def stopped_down(scene):
    scene.camera.data.dof.use_dof, scene.camera.data.dof.aperture_fstop = True, 8.0


def more_accurate(scene):
    scene.lensfield.accuracy = 0.001


@pytest.mark.parametrize("change", [stopped_down, more_accurate])
def test_a_check_is_an_old_one_where_the_number_of_slabs_may_be_another(plain, change):
    def told():
        lint_panel.draw_check(layout := Layout(), plain)
        return " ".join(layout.labels)

    plain.lensfield.tier = "RESULT"
    assert bpy.ops.lensfield.lint() == {"FINISHED"}
    assert "changed since this check" not in told()
    change(plain)
    assert "changed since this check" in told()


@pytest.mark.parametrize("denoise", ["OFF", "ON"])
def test_the_plan_line_tells_the_seconds_of_the_engine_and_the_memory_of_what_takes_most(plain, denoise):
    plain.lensfield.denoise = denoise
    text = settled(plain)
    settings = plain.lensfield
    lens = load_lens(settings.lens)
    grid = capture_grid(plain, lens, settings.wavelengths_nm())
    cube = np.zeros((len(settings.wavelengths_nm()), *grid.shape_px), np.float32)
    plan = list(plan_line._plans.values())[-1][1].result()
    assert plan == make_plan(Options(accuracy=0.01), lens, Sampling(grid, tuple(settings.wavelengths_nm())))
    pass_mb = 1e-6 * pass_bytes(cube[0].size, 1, denoise == "ON")
    memory_mb = 1e-6 * cube.nbytes + max(pass_mb, plan.memory_mb + 1e-6 * cube.nbytes)
    assert f"; Lens: {max(plan.seconds, 0.1):.1f} s, {memory_mb:.0f} MB" in text


def test_what_cannot_be_planned_is_told_in_its_place(plain):
    plain.lensfield.wavelength_mode, plain.lensfield.wavelength_list = "LIST", "red"
    assert "red" in told(plain)


def test_a_file_that_is_not_saved_renders_to_a_temporary_folder(plain):
    assert not bpy.data.filepath and str(unsaved_folder()) in told(plain).replace(" ", "")
    plain.lensfield.tier, plain.cycles.samples = "PREVIEW", 1
    assert bpy.ops.lensfield.render() == {"FINISHED"}
    assert folder_for(plain) == unsaved_folder() / "lensfield"
    assert (folder_for(plain) / "Scene_0001_lens_image.exr").is_file()


def test_the_picture_of_the_last_render_is_shown_and_told_of_by_name(plain, monkeypatch, tmp_path):
    plain.lensfield.tier, plain.cycles.samples, plain.lensfield.output_folder = "PREVIEW", 1, str(tmp_path)
    assert bpy.ops.lensfield.render() == {"FINISHED"}
    path = tmp_path / "Scene_0001_lens_image.exr"
    assert not bpy.ops.lensfield.show_picture.poll()
    monkeypatch.setattr(session, "last_render", LastRender("INFO", (f"{path} in 2.0 s",), path))
    assert "lensfield.show_picture" in drawn(plain).shown and str(tmp_path) not in told(plain).replace(" ", "")
    for _ in range(2):
        assert bpy.ops.lensfield.show_picture() == {"FINISHED"}
    assert [image.filepath for image in bpy.data.images if image.name == path.name] == [str(path)]
    path.unlink()
    assert not bpy.ops.lensfield.show_picture.poll()


def test_another_file_has_nothing_of_the_last_ones_render(plain, monkeypatch):
    monkeypatch.setattr(session, "last_render", LastRender("INFO", ("Scene_0001_lens_image.exr in 2.0 s",)))
    assert "in 2.0 s" in told(plain)
    bpy.ops.wm.open_mainfile(filepath=str(SAMPLE_SCENE))
    assert "in 2.0 s" not in told(bpy.context.scene)


def test_a_lens_of_another_size_is_told_of_in_few_words(plain):
    plain.camera.data.type, plain.camera.data.lens, plain.lensfield.view = "PERSP", 25, "CAMERA"
    assert "Lens and blur scaled 0.5\u00d7" in told(plain)


def test_once_saved_pictures_go_beside_the_file(plain, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    assert folder_for(plain) == tmp_path / "lensfield" and str(unsaved_folder()) not in told(plain)
