"""From a new scene to the picture: the panel's options, predictions and fixes."""

import json
import os
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view

from layouts import Layout
from lensfield import addon
from lensfield.addon.capture.remarks import ENOUGH_SAMPLES
from lensfield.addon.capture.room import pass_bytes
from lensfield.addon.job.job import folder_for, unsaved_folder
from lensfield.addon.scene.camera import capture_grid
from lensfield.addon.scene.errors import SceneError
from lensfield.addon.scene.requirements import check_scene
from lensfield.addon.ui import lint_panel, panels, plan_line
from lensfield.addon.ui.common import lens_worker
from lensfield.addon.ui.common.favourite_lenses import favourite_lenses
from lensfield.addon.ui.common.preferences import follow_gpu
from lensfield.addon.ui.common.properties import DEFAULT_LENS, forget_items, offered_lenses, searched_lens_items
from lensfield.addon.ui.common.session import LastRender, session
from lensfield.addon.ui.learned_time import learn_time
from lensfield.addon.ui.panels import draw_settings
from lensfield.engine import Options, load_lens
from lensfield.engine.image.sampling import Sampling
from lensfield.engine.kernels.library import VARIABLE, running
from lensfield.engine.library import bundled_names
from lensfield.engine.plan.choose import make_plan
from lensfield.engine.stray.options import StrayOptions
from places import SAMPLE_SCENE
from small_scenes import light, material, wall
from waiting import LAST_RESORT_S


@pytest.fixture
def lit_scene(scene):
    """A scene that renders, and has not been planned."""
    plan_line.plans.forget()
    light(scene, "POINT", 20.0)
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (0.7, 0.3, 0.05))[0])
    return scene


def drawn(scene):
    """The panel after its lens is baked."""
    lens_worker.lens_request(scene).baked.result(LAST_RESORT_S)
    layout = Layout()
    draw_settings(layout, scene)
    return layout


def panel_text(scene):
    return " ".join(drawn(scene).labels)


def test_the_default_lens_matches_a_new_camera_and_focuses_at_infinity(scene):
    lens = load_lens(scene.camera.data.lensfield.lens)
    assert scene.camera.data.lensfield.lens == DEFAULT_LENS
    new = bpy.data.cameras.new("New")
    assert lens.object_distance_mm == np.inf and lens.sensor_mm[0] == new.sensor_width
    assert lens.efl_mm == pytest.approx(new.lens, rel=0.01)


def test_lenses_are_listed_by_title():
    assert {name for name, *_ in offered_lenses()} == {*bundled_names(), "FILE"}
    assert "Zeiss Tessar 50 mm f/5.5 (1902)" in {title for _, title, *_ in offered_lenses()}


@pytest.fixture
def preferences(monkeypatch):
    """The add-on's preferences: Lensfield is not enabled as an add-on here."""
    stored = SimpleNamespace(preview_place="CAMERA")
    monkeypatch.setattr("lensfield.addon.ui.common.preferences.addon_preferences", lambda: stored)
    return stored


@pytest.fixture
def settings_folder(monkeypatch, tmp_path):
    """Blender's folder of settings, for this test."""
    def user_resource(kind, path="", create=False):
        (tmp_path / path).mkdir(parents=True, exist_ok=create or not path)
        return str(tmp_path / path)

    monkeypatch.setattr(bpy.utils, "user_resource", user_resource)
    yield tmp_path
    forget_items()


def test_a_preference_leaves_casting_to_the_processor(preferences, monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    for choice, value in (("OFF", running()), ("AUTO", None)):
        preferences.lens_on_gpu = choice
        follow_gpu()
        assert os.environ.get(VARIABLE) == value


def test_favourites_are_listed_first(scene, settings_folder):
    usual = [name for name, *_ in offered_lenses()]
    for lens in ("tessar-50mm", "nikkor-28mm"):
        scene.camera.data.lensfield.lens = lens
        assert bpy.ops.lensfield.favourite() == {"FINISHED"}
    favourites = sorted(["tessar-50mm", "nikkor-28mm"], key=usual.index)
    listed = offered_lenses()
    assert [name for name, *_ in listed] == favourites + [name for name in usual if name not in favourites]
    assert [title for _, title, *_ in listed if title.startswith("\u2605")] == [title for _, title, *_ in listed[:2]]
    assert scene.camera.data.lensfield.lens == "nikkor-28mm"
    assert bpy.ops.lensfield.favourite() == {"FINISHED"}
    assert favourite_lenses() == {"tessar-50mm"}


def test_favourites_that_cannot_be_stored_are_reported_in_one_line(scene, settings_folder):
    (settings_folder / "lensfield" / "favourite_lenses.txt").mkdir(parents=True)
    assert favourite_lenses() == set()
    with pytest.raises(RuntimeError, match="favourite_lenses.txt: file is a folder"):
        bpy.ops.lensfield.favourite()


def test_a_search_matches_all_listed_facts_of_a_lens():
    names = dict((name, shown) for name, shown, *_ in searched_lens_items(None, None))
    assert names.keys() == {name for name, *_ in offered_lenses()}
    for word in ("Zeiss", "1902", "50mm", "crisp"):
        assert word in names["tessar-50mm"]


@pytest.mark.one_blender
def test_each_bundled_lens_has_a_picture_that_differs_from_all_others():
    from PIL import Image

    from lensfield.engine.library import PICTURES
    pictures = []
    for name in bundled_names():
        path = PICTURES / f"{name}.jpg"
        assert path.stat().st_size <= 30 * 1024
        with Image.open(path) as picture:
            assert picture.size == (256, 192)
            pictures.append(np.asarray(picture.convert("L").reduce(4), np.float32))
        scene, points = np.split(pictures[-1], [38])
        assert scene.std() > 15 and points.max() > 30
    for number, picture in enumerate(pictures):
        assert all(np.abs(picture - other).mean() > 0.5 for other in pictures[:number])


def sees_otherwise(scene):
    """Whether the panel offers to match the camera, because its field of view differs from the lens's."""
    return "lensfield.match_camera" in drawn(scene).shown


def test_a_scene_without_a_camera_gets_one_that_frames_everything(scene):
    for place in ((0, 0, 0), (5, 1, 0), (-2, 8, 3)):
        bpy.ops.mesh.primitive_cube_add(location=place)
    bpy.data.objects.remove(scene.camera)
    draw_settings(layout := Layout(), scene)
    assert "lensfield.add_camera" in layout.shown and "lens" not in layout.shown
    assert bpy.ops.lensfield.add_camera() == {"FINISHED"}
    bpy.context.view_layer.update()
    assert "lensfield.add_camera" not in drawn(scene).shown and not sees_otherwise(scene)
    for obj in (obj for obj in scene.objects if obj.type == "MESH"):
        for vertex in obj.data.vertices:
            x, y, z = world_to_camera_view(scene, scene.camera, obj.matrix_world @ vertex.co)
            assert 0 < x < 1 and 0 < y < 1 and z > 0


def test_an_empty_scene_also_gets_a_camera(scene):
    bpy.data.objects.remove(scene.camera)
    assert bpy.ops.lensfield.add_camera() == {"FINISHED"}
    assert np.all(np.isfinite(scene.camera.location)) and scene.camera.location.length > 0


def test_a_camera_with_another_view_is_reported(scene):
    scene.camera.data.type, scene.camera.data.lens = "PERSP", 90
    assert sees_otherwise(scene)
    assert bpy.ops.lensfield.match_camera() == {"FINISHED"}
    assert not sees_otherwise(scene)


def test_a_fisheye_camera_sees_alike_after_it_is_matched(scene):
    """Off the axis, and for a frame that is not square."""
    camera = scene.camera.data
    camera.lensfield.lens, camera.shift_x = "olympus-fisheye-8mm", 0.1
    assert sees_otherwise(scene)
    assert bpy.ops.lensfield.match_camera() == {"FINISHED"}
    assert camera.type == "PANO" and not sees_otherwise(scene)
    camera.fisheye_polynomial_k1 *= 1.1
    assert sees_otherwise(scene)


@pytest.mark.parametrize("spoil, label", [
    (lambda scene: setattr(scene.camera.data, "type", "ORTHO"), "Orthographic cameras have no lens"),
    (lambda scene: setattr(scene.render, "pixel_aspect_x", 2), "pixel aspect is 2:1"),
    (lambda scene: draw_region(scene.render, 0.5, 0.5), "render region is empty")])
def test_a_refusal_has_a_button_that_removes_the_obstacle(lit_scene, spoil, label):
    assert "lensfield.fix" not in drawn(lit_scene).shown
    spoil(lit_scene)
    with pytest.raises(SceneError) as refusal:
        check_scene(lit_scene)
    assert label in panel_text(lit_scene) and "lensfield.fix" in drawn(lit_scene).shown
    assert bpy.ops.lensfield.fix(obstacle=refusal.value.field) == {"FINISHED"}
    check_scene(lit_scene)


def draw_region(render, left, right):
    render.use_border, render.border_min_x, render.border_max_x = True, left, right


def test_the_panel_keeps_its_order_in_every_state(lit_scene):
    """The lens, focus and f-stop, and the buttons come first, before anything that appears or disappears."""
    fixed = ["lens", "lensfield.search_lens", "lensfield.favourite", "lensfield.compare", "use_dof",
             "lensfield.click_focus", "focus_object", "focus_distance", "aperture_fstop", "lensfield.preview",
             "lensfield.live", "lensfield.render", "lensfield.render_animation"]
    assert drawn(lit_scene).shown[:len(fixed)] == fixed
    lit_scene.camera.data.dof.use_dof = True
    lit_scene.camera.data.type, lit_scene.cycles.samples = "ORTHO", 4096
    assert drawn(lit_scene).shown[:len(fixed)] == fixed


def test_figures_are_written_as_photographers_write_them(lit_scene):
    lit_scene.camera.data.lensfield.lens = "cooke-triplet-50mm"
    text = panel_text(lit_scene)
    facts = lens_worker.lens_request(lit_scene).facts
    assert f"50 mm \u00b7 f/5 \u00b7 {facts.sensor_mm[0]:.3g} \u00d7 {facts.sensor_mm[1]:.3g} mm" in text
    assert "Focused at infinity" in text and "f/5 to f/" in text and ", closest focus " in text


def test_a_sensor_shows_its_crop_and_field_of_view(lit_scene):
    lit_scene.render.resolution_x, lit_scene.render.resolution_y = 1600, 1200
    lit_scene.camera.data.lensfield.lens, lit_scene.camera.data.lensfield.view = "zeiss-planar-50mm-f1.4", "MFT"
    text = panel_text(lit_scene)
    # atan(8.65 / 50) and atan(6.4875 / 50), doubled; the lens distorts by 0.5 % there
    assert "\u00b7 17.3 \u00d7 13 mm" in text and "19.7\u00b0 \u00d7 14.8\u00b0, crop factor 2" in text
    assert "pixel pitch 10.81 \u00b5m" in text
    assert "The lens covers" not in text and "Your camera has a different field of view" in text
    bpy.ops.lensfield.match_camera()
    camera = lit_scene.camera.data
    assert camera.lens / camera.sensor_width == pytest.approx(50 / 17.3, rel=0.01)
    assert "Your camera has" not in panel_text(lit_scene)
    lit_scene.camera.data.lensfield.view = "FILM66"  # 56 x 42 mm of it, for a field of 43.3 mm
    assert "The lens covers 62%" in panel_text(lit_scene)


def test_too_many_samples_are_reported_and_can_be_fixed(lit_scene):
    lit_scene.cycles.samples, lit_scene.cycles.use_denoising = 4096, False
    assert "4096 samples" in panel_text(lit_scene) and "lensfield.sensible_samples" in drawn(lit_scene).shown
    assert bpy.ops.lensfield.sensible_samples() == {"FINISHED"}
    assert lit_scene.cycles.samples == ENOUGH_SAMPLES and lit_scene.cycles.use_denoising
    assert "lensfield.sensible_samples" not in drawn(lit_scene).shown


def settled(scene):
    """The plan's line after the thread has computed it."""
    plan_text(scene)
    plan_line.plans.newest.exception(LAST_RESORT_S)
    return plan_text(scene)


def plan_text(scene):
    return plan_line.plan_text(scene, load_lens(scene.camera.data.lensfield.lens))


def test_the_plan_line_follows_the_settings(lit_scene):
    lit_scene.lensfield.wavelength_mode, lit_scene.lensfield.wavelength_list = "LIST", "450, 500, 550, 600, 650"
    assert settled(lit_scene).startswith("Up to 2 renders, then ")
    lit_scene.lensfield.tier = "PREVIEW"
    assert settled(lit_scene).startswith("1 render, then ")
    lit_scene.lensfield.tier = "REFERENCE"
    assert settled(lit_scene).startswith("2 or more renders")


def test_the_plan_line_uses_a_check_until_the_settings_change(lit_scene):
    lit_scene.camera.data.lensfield.lens = "edmund-54852"  # without a bake, which takes seconds for Reference
    lit_scene.lensfield.tier, lit_scene.lensfield.wavelength_count = "REFERENCE", 31
    assert bpy.ops.lensfield.lint() == {"FINISHED"}
    count = len(session.check.result.plan.bands)
    assert plan_text(lit_scene).startswith(f"{count} render")
    assert "changed since this check" not in panel_text(lit_scene)
    lit_scene.lensfield.wavelength_count = 7
    assert plan_text(lit_scene).startswith("3 or more") and "changed since this check" in panel_text(lit_scene)


def stopped_down(scene):
    scene.camera.data.dof.use_dof, scene.camera.data.dof.aperture_fstop = True, 8.0


def more_accurate(scene):
    scene.lensfield.accuracy = 0.001


@pytest.mark.parametrize("change", [stopped_down, more_accurate])
def test_a_check_is_outdated_when_the_number_of_slabs_may_change(lit_scene, change):
    def check_text():
        lint_panel.draw_check(layout := Layout(), lit_scene)
        return " ".join(layout.labels)

    lit_scene.lensfield.tier = "RESULT"
    assert bpy.ops.lensfield.lint() == {"FINISHED"}
    assert "changed since this check" not in check_text()
    change(lit_scene)
    assert "changed since this check" in check_text()


@pytest.mark.parametrize("denoise", ["OFF", "ON"])
def test_the_plan_line_states_engine_time_and_peak_memory(lit_scene, denoise):
    lit_scene.lensfield.denoise = denoise
    text = settled(lit_scene)
    settings = lit_scene.lensfield
    lens = load_lens(lit_scene.camera.data.lensfield.lens)
    grid = capture_grid(lit_scene, lens, settings.wavelengths_nm())
    cube = np.zeros((len(settings.wavelengths_nm()), *grid.shape_px), np.float32)
    plan = plan_line.plans.newest.result()[1]
    assert plan == make_plan(Options(accuracy=0.01), lens, Sampling(grid, tuple(settings.wavelengths_nm())))
    pass_mb = 1e-6 * pass_bytes(cube[0].size, 1, denoise == "ON")
    memory_mb = 1e-6 * cube.nbytes + max(pass_mb, plan.memory_mb + 1e-6 * cube.nbytes)
    lens_s = max(plan.seconds, 0.1)
    assert text.endswith(f", then about {lens_s:.1f} s for the lens \u00b7 {memory_mb:.0f} MB of memory")


@pytest.mark.one_blender
def test_the_plan_line_learns_from_the_last_render(lit_scene, tmp_path, monkeypatch):
    monkeypatch.setattr(session, "times", {})
    settings = lit_scene.lensfield
    lit_scene.render.resolution_x, lit_scene.render.resolution_y, lit_scene.cycles.samples = 24, 16, 2
    settings.tier, settings.depth, settings.wavelength_count = "PREVIEW", "OFF", 7
    result = addon.render_through_lens(lit_scene, output_folder=tmp_path, lens_quality="preview")
    facts = json.loads(result.record.read_text())
    facts["stages_s"] = {"multispectral render": 100.0, "filtering": 6.0, "write pictures": 4.0}
    facts["plan"]["seconds"] = 2 * settled_plan(lit_scene).seconds
    result.record.write_text(json.dumps(facts))
    learn_time(lit_scene.session_uid, result.lens_image)
    assert settled(lit_scene).startswith("About 2 min: 1 render, then about 5.0 s for the lens"), settled(lit_scene)
    lit_scene.cycles.samples = 60
    assert settled(lit_scene).startswith("About 50 min: ")
    facts["job"]["settings"]["samples"], facts["stages_s"]["multispectral render"] = 60, 1260.0
    result.record.write_text(json.dumps(facts))
    learn_time(lit_scene.session_uid, result.lens_image)
    lit_scene.cycles.samples = 118
    assert settled(lit_scene).startswith("About 40 min: "), "60 s, and 20 s for a sample"
    lit_scene.cycles.samples = 60
    settings.tier = "STANDARD"
    assert settled(lit_scene).startswith("Up to "), "other renders, of unknown time"
    settings.tier = "PREVIEW"
    learn_time(lit_scene.session_uid, tmp_path / "missing_0001_lens_image.exr")
    assert settled(lit_scene).startswith("About 21 min: ")


def settled_plan(scene):
    settled(scene)
    return plan_line.plans.newest.result()[1]


def test_the_plan_line_counts_detail(lit_scene):
    settings, lens = lit_scene.lensfield, load_lens(lit_scene.camera.data.lensfield.lens)
    lit_scene.cycles.samples, settings.denoise = 64, "OFF"
    text, plan = settled(lit_scene), plan_line.plans.newest.result()[1]
    assert plan.supersampling == plan.known == 2 and " with detail \u00b7 " in text
    pixels = np.prod(capture_grid(lit_scene, lens, settings.wavelengths_nm()).shape_px)
    radiance = len(settings.wavelengths_nm()) * 4 * pixels
    shares, split = 3 * 4 * 2 * pixels, 2 * 4 * 4 * pixels
    needed = radiance + shares + max(pass_bytes(4 * pixels, 1, False), 1e6 * plan.memory_mb + split + radiance)
    assert text.endswith(f"{1e-6 * needed:.0f} MB of memory")
    for name, value in (("tier", "PREVIEW"), ("detail", "OFF")):
        setattr(settings, name, value)
        settled(lit_scene)
        assert plan_line.plans.newest.result()[1].supersampling == 1
        settings.tier = "STANDARD"


def test_a_planning_error_replaces_the_plan(lit_scene):
    lit_scene.lensfield.wavelength_mode, lit_scene.lensfield.wavelength_list = "LIST", "red"
    assert "red" in panel_text(lit_scene)


def test_an_unsaved_file_renders_to_a_temporary_folder(lit_scene):
    assert not bpy.data.filepath and str(unsaved_folder()) in panel_text(lit_scene).replace(" ", "")
    lit_scene.lensfield.tier, lit_scene.cycles.samples = "PREVIEW", 1
    assert bpy.ops.lensfield.render() == {"FINISHED"}
    assert folder_for(lit_scene) == unsaved_folder() / "lensfield"
    assert (folder_for(lit_scene) / "unsaved_Scene_0001_lens_image.exr").is_file()


def test_the_panel_shows_the_last_picture_by_name(lit_scene, monkeypatch, tmp_path):
    lit_scene.lensfield.tier, lit_scene.cycles.samples, lit_scene.lensfield.output_folder = "PREVIEW", 1, str(tmp_path)
    assert bpy.ops.lensfield.render() == {"FINISHED"}
    path = tmp_path / "unsaved_Scene_0001_lens_image.exr"
    assert not bpy.ops.lensfield.show_picture.poll()
    monkeypatch.setattr(session, "last_render", LastRender("INFO", (f"{path} in 2.0 s",), path))
    assert "lensfield.show_picture" in drawn(lit_scene).shown
    assert str(tmp_path) not in panel_text(lit_scene).replace(" ", "")
    for _ in range(2):
        assert bpy.ops.lensfield.show_picture() == {"FINISHED"}
    assert [image.filepath for image in bpy.data.images if image.name == path.name] == [str(path)]
    path.unlink()
    assert not bpy.ops.lensfield.show_picture.poll()


def test_opening_another_file_clears_the_last_render(lit_scene, monkeypatch):
    monkeypatch.setattr(session, "last_render", LastRender("INFO", ("Scene_0001_lens_image.exr in 2.0 s",)))
    assert "in 2.0 s" in panel_text(lit_scene)
    bpy.ops.wm.open_mainfile(filepath=str(SAMPLE_SCENE))
    assert "in 2.0 s" not in panel_text(bpy.context.scene)


def test_a_scaled_lens_is_reported_briefly(lit_scene):
    lit_scene.camera.data.type, lit_scene.camera.data.lens, lit_scene.camera.data.lensfield.view = "PERSP", 25, "CAMERA"
    assert "Lens and blur scaled 0.5\u00d7" in panel_text(lit_scene)


def test_a_saved_file_renders_to_a_folder_next_to_it(lit_scene, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    assert folder_for(lit_scene) == tmp_path / "lensfield" and str(unsaved_folder()) not in panel_text(lit_scene)


def test_every_tooltip_is_one_line_without_a_full_stop():
    tooltips = [getattr(bpy.ops.lensfield, name).get_rna_type().description for name in dir(bpy.ops.lensfield)]
    tooltips += [each.description for each in bpy.types.Scene.bl_rna.properties["lensfield"].fixed_type.properties
                 if not each.is_hidden and each.identifier not in ("rna_type", "name")]
    assert len(tooltips) > 30
    assert [text for text in tooltips if not text or "\n" in text or "  " in text or text.endswith(".")] == []


def test_parts_of_the_stray_light_are_shown_if_chosen(lit_scene):
    """In the subpanel after the view and before the camera."""
    names = [name for name, _, _ in panels._PARTS]
    assert names[names.index("stray") - 1:][:3] == ["view", "stray", "body"]
    settings = lit_scene.lensfield
    settings.property_unset("stray_light")
    assert settings.to_request().stray == StrayOptions()
    assert "stray_parts" not in drawn(lit_scene).shown
    settings.stray_light, settings.stray_parts, settings.glare_index = "PARTS", {"VEIL", "GHOSTS"}, 2.5
    assert "stray_parts" in drawn(lit_scene).shown
    assert settings.to_request().stray == StrayOptions("ghosts,veil", glare_index=2.5)
    settings.stray_parts = set()
    assert settings.to_request().stray.parts(accuracy=0.001) == ()
    settings.stray_light = "OFF"
    assert {"cleanliness", "glare_index"} <= set(drawn(lit_scene).greyed)
