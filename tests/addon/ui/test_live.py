"""The live view, except for its drawing, which needs a window: `make ui-test` compares that with the engine."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from layouts import Layout
from lenses import fine_grid_lens
from lensfield.addon.scene.focus import focus_now
from lensfield.addon.ui.common.lens_at_rest import facts_at_rest
from lensfield.addon.ui.common.session import session
from lensfield.addon.ui.live import lens_view, live
from lensfield.addon.ui.live.lens_view import PATTERN, SAMPLERS, SOURCES, VALUES, VARIANCES, View
from lensfield.engine.lens.iris import Iris
from lensfield.engine.look.lens_tables import BOKEH_NODES, NODES, RAYS
from lensfield.engine.rays.rings import Rings
from waiting import LAST_RESORT_S


@pytest.fixture
def live_scene(scene):
    scene.camera.data.lensfield.lens, scene.camera.data.lensfield.view = "tessar-50mm", "CAMERA"
    scene.render.resolution_x, scene.render.resolution_y = 800, 500
    bpy.context.view_layer.update()
    yield scene
    live.end()


def frame_of(scene):
    return live.read_frame(*live.frame_question(scene, facts_at_rest(scene, LAST_RESORT_S)))


def evaluated_dof(scene):
    return scene.camera.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.dof


def test_the_button_switches_the_view_on_and_off(live_scene):
    assert bpy.ops.lensfield.live() == {"FINISHED"} and session.live
    live.draw_live(layout := Layout())
    assert layout.shown == ["lensfield.live"]
    assert bpy.ops.lensfield.live() == {"FINISHED"} and session.live is None
    assert not {live.hide_blenders_blur, live.on_load} & {
        handler for name in ("depsgraph_update_post", "frame_change_post", "load_pre")
        for handler in getattr(bpy.app.handlers, name)}


def test_a_scene_without_camera_is_refused(live_scene):
    live_scene.camera = None
    with pytest.raises(RuntimeError, match="camera: missing|camera is missing"):
        bpy.ops.lensfield.live()
    assert session.live is None


def test_another_file_switches_the_view_off(live_scene):
    bpy.ops.lensfield.live()
    bpy.ops.wm.read_homefile(use_empty=True)
    assert session.live is None


def test_viewports_do_not_blur_twice_and_the_file_is_unchanged(live_scene):
    dof = live_scene.camera.data.dof
    dof.use_dof, dof.aperture_fstop = True, 5.6
    bpy.context.view_layer.update()
    assert evaluated_dof(live_scene).use_dof
    bpy.ops.lensfield.live()
    bpy.context.view_layer.update()
    assert not evaluated_dof(live_scene).use_dof and dof.use_dof
    dof.focus_distance = 3.0
    bpy.context.view_layer.update()
    assert not evaluated_dof(live_scene).use_dof, "after a change of the camera, too"
    live_scene.frame_set(7)
    assert not evaluated_dof(live_scene).use_dof and dof.use_dof
    bpy.ops.lensfield.live()
    bpy.context.view_layer.update()
    assert evaluated_dof(live_scene).use_dof


def test_the_frame_has_the_cameras_view_or_the_lenss(live_scene):
    camera = live_scene.camera.data
    camera.sensor_width, camera.lens = 36.0, 60.0
    across, up = 18 / 60, 18 / 60 * 500 / 800
    assert frame_of(live_scene).tangents == pytest.approx((-across, -up, across, up))
    camera.shift_x, camera.shift_y = 0.25, -0.5  # of the width
    assert frame_of(live_scene).tangents == pytest.approx((-across / 2, -up - across, 1.5 * across, up - across))
    camera.shift_x = camera.shift_y = 0
    live_scene.camera.data.lensfield.view = "LENS"
    *_, across, up = frame_of(live_scene).tangents
    assert across == pytest.approx(16.8 / 52, rel=0.2) and up / across == pytest.approx(500 / 800)


def test_the_frame_follows_focus_f_stop_blades_and_field(live_scene):
    at_rest, dof = frame_of(live_scene), live_scene.camera.data.dof
    dof.use_dof, dof.focus_distance, dof.aperture_fstop, dof.aperture_blades = True, 1.5, 11.0, 5
    name, _, rings, *_, iris, vignette = live.frame_question(live_scene, facts_at_rest(live_scene, LAST_RESORT_S))
    assert (name, rings, iris, vignette) == ("tessar-50mm", Rings(1500.0, 11.0), Iris(5), False)
    turned = frame_of(live_scene)
    corner = np.count_nonzero(at_rest.tables.light[0, 0] > 1e-3), np.count_nonzero(turned.tables.light[0, 0] > 1e-3)
    assert turned.tables.illumination[0, 0] > 1.05 * at_rest.tables.illumination[0, 0], "stopped down, less vignetting"
    assert corner[0] > 0 and corner[1] > 0
    live_scene.lensfield.out_of_field = "VIGNETTE"
    assert live.frame_question(live_scene, facts_at_rest(live_scene, LAST_RESORT_S))[-1] is True


def test_the_blur_is_that_of_the_lens_at_its_focus(live_scene):
    """A lens that focuses internally blurs less than a thin lens of its focal length."""
    dof = live_scene.camera.data.dof
    live_scene.camera.data.lensfield.lens, live_scene.camera.data.lensfield.view = "nikkor-z-135mm-plena", "LENS"
    dof.use_dof, dof.focus_distance, dof.aperture_fstop = True, 1.5, 1.8
    focus, first = frame_of(live_scene).focus, focus_now(live_scene, facts_at_rest(live_scene, LAST_RESORT_S))
    assert focus.focus_m == pytest.approx(1.5, rel=1e-3)
    assert 0.85 * first.blur_px_m < focus.blur_px_m < 0.97 * first.blur_px_m


def test_a_squeezed_frame_is_as_wide_as_its_pixels_show_it_and_its_focus_leans(live_scene, monkeypatch):
    lens = fine_grid_lens(squeeze=2.0, focus_slope=(1e-3, -2e-3), wavelengths_nm=(400.0, 550.0, 700.0))
    monkeypatch.setattr(live, "load_lens", lambda *_, **__: lens)
    live_scene.camera.data.lensfield.view = "LENS"
    frame, half_px = frame_of(live_scene), np.array([400, 250])
    focal_mm, pitch_mm = lens.capture_focal_length_mm, 4.8 / 800
    assert frame.tangents[2:] == pytest.approx(half_px * pitch_mm / focal_mm)
    assert frame.focus.lean_per_m == pytest.approx((0.5 * focal_mm, -2 * focal_mm))
    edge = frame.tables.angle_rad[NODES // 2, -1, 1]
    assert np.tan(edge) == pytest.approx((2 * 2.4 / focal_mm, 0), abs=1e-6), "its light comes from twice as far"


def test_the_view_maps_camera_space_to_pixels():
    scene, (width, height) = bpy.context.scene, (1310, 786)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.shift_x, camera.data.clip_start, camera.data.clip_end = 0.2, 0.3, 40.0
    matrix = camera.calc_matrix_camera(bpy.context.evaluated_depsgraph_get(), x=width, y=height)
    view = View.of(matrix, width, height)
    point = np.array([0.4, -0.7, -2.5, 1.0])
    clip = np.array(matrix) @ point
    expected_px = (clip[:2] / clip[3] + 1) / 2 * (width, height)
    tangents = point[:2] / -point[2]
    assert view.middle_px + np.array(view.px_per_tangent) * tangents == pytest.approx(expected_px)
    assert (clip[2] / clip[3] + view.depth_at_infinity) * view.nearness_per_depth == pytest.approx(1 / 2.5)
    assert scene


def test_each_shader_has_its_source():
    names = {path.name.removesuffix(".frag.glsl") for path in SOURCES.glob("*.frag.glsl")}
    assert names == SAMPLERS.keys() and VALUES.keys() <= names
    for name, samplers in SAMPLERS.items():
        source = (SOURCES / f"{name}.frag.glsl").read_text(encoding="utf-8")
        assert all(sampler in source for sampler in (*samplers, *VALUES.get(name, ()))), name


def test_the_copies_spread_light_by_their_variances():
    """Rows of light, in the steps of the shaders; the place that is looked up may be anywhere in a pixel."""
    def smooth(rows, reach):
        return sum(share * np.roll(rows, step, axis=1) for step, share in ((-reach, 0.25), (0, 0.5), (reach, 0.25)))

    def halved(rows):
        return rows.reshape(len(rows), -1, 2).mean(axis=2)

    light = np.eye(256)[64:192]
    copies = {1: light, 2: halved(light)}
    copies[4] = smooth(copies[2], 1)
    copies[8] = smooth(copies[4], 2)
    copies[16] = smooth(halved(copies[8]), 2)
    for width, rows in copies.items():
        side = 256 // rows.shape[1]
        apart = np.arange(256) - np.arange(64, 192)[:, None]
        spread = (apart**2 * rows.repeat(side, axis=1)).sum() / rows.sum() / side
        assert VARIANCES[width] == pytest.approx(spread + 2 / 12), width  # of a pixel's light, and of a place in it


@pytest.fixture
def no_textures(monkeypatch):
    """The textures' values in their place: there is no graphics processor."""
    monkeypatch.setattr(lens_view, "_texture", np.float32)


def test_a_viewport_shows_the_blur_that_fisheyes_have_in_it(live_scene, no_textures):
    """Close to 90 degrees from the axis, where no viewport shows anything, its blur on a plane grows without limit."""
    live_scene.camera.data.lensfield.lens, live_scene.camera.data.lensfield.view = "olympus-fisheye-8mm", "LENS"
    tables = frame_of(live_scene).tables
    shown = lens_view.Tables(tables)

    def widest(width, height):
        return shown.widest(View((width / 2, height / 2), (414.0, 414.0), 1.0, 1.0), width, height)

    assert 1 <= widest(400, 400) < widest(1310, 786) < 8 < widest(13100, 7860) and np.abs(tables.shifts).max() > 80


def test_patterns_are_the_means_and_covariances_of_rays(live_scene, no_textures):
    tables = frame_of(live_scene).tables
    patterns = lens_view.Tables(tables).texture[:BOKEH_NODES, 2 * BOKEH_NODES * RAYS:]
    patterns = patterns.reshape(BOKEH_NODES, BOKEH_NODES, PATTERN, 4)
    for row, column in ((8, 8), (2, 13), (16, 0)):
        light, bends = tables.light[row, column], np.c_[tables.shifts[row, column], tables.aberrations[row, column]]
        mean, *covariance = patterns[row, column]
        assert mean == pytest.approx(np.average(bends, axis=0, weights=light), abs=1e-5)
        expected = np.cov(bends.T, aweights=light, ddof=0)
        assert np.array(covariance) == pytest.approx(expected, rel=1e-3, abs=1e-6)


@pytest.fixture
def metered_light(live_scene, no_textures):
    """A function that returns the exposed light of the live view in front of an even world, and its ShownExposure, in
    a viewport with these settings."""
    bpy.ops.lensfield.live()
    frame, view = frame_of(live_scene), View((500.0, 300.0), (1400.0, 1400.0), 1.0, 1.0)
    shading = {"type": "RENDERED", "use_scene_lights_render": True, "use_scene_world_render": True}

    def metered(light=0.4, **changed):
        space = SimpleNamespace(shading=SimpleNamespace(**shading | changed))
        exposure_of = live._metering(session.live, live_scene, space, frame)
        if exposure_of is None:
            return None
        seen = lens_view.Tables(frame.tables).metered(np.full((600, 1000, 4), light, np.float32), view)
        return exposure_of(seen) * seen, session.live.exposure

    return metered


def test_the_light_has_the_brightness_of_the_cameras_exposure(live_scene, metered_light):
    settings, render = live_scene.camera.data.lensfield, live_scene.render
    render.engine, live_scene.cycles.film_exposure = "CYCLES", 2.0
    assert metered_light() is None, "no body"
    settings.body = "sony-a7-iv"
    bright, auto = metered_light()
    assert bright.mean() == pytest.approx(10 / 78, rel=0.01) and auto.iso == 100
    assert bright.max() > 1.3 * bright.min(), "the lens's corners are darker"
    assert metered_light(0.8)[1].shutter_s == pytest.approx(auto.shutter_s / 2, rel=0.01)
    live_scene.cycles.film_exposure = 1.0
    assert metered_light(0.2)[1].shutter_s == pytest.approx(auto.shutter_s, rel=0.01)
    live_scene.cycles.film_exposure = 2.0
    assert session.live.shows_exposure_of(live_scene)
    settings.shutter_s, settings.iso = auto.shutter_s / 4, 100
    assert not session.live.shows_exposure_of(live_scene)
    darker, fixed = metered_light()
    assert darker == pytest.approx(bright / 4, rel=0.01) and fixed.shutter_s == pytest.approx(auto.shutter_s / 4)
    live_scene.lensfield.develop = False
    assert not metered_light()[0].any() and session.live.exposure, "the light as it is"


@pytest.mark.parametrize("shading", [
    {"type": "SOLID"}, {"use_scene_lights_render": False}, {"use_scene_world_render": False},
    {"type": "MATERIAL", "use_scene_lights": False, "use_scene_world": True}])
def test_only_the_scenes_own_light_is_exposed(live_scene, metered_light, shading):
    live_scene.camera.data.lensfield.body = "sony-a7-iv"
    assert metered_light(**shading) is None
    assert metered_light(type="MATERIAL", use_scene_lights=True, use_scene_world=True)


def test_a_failure_is_reported_and_switches_the_view_off(live_scene):
    bpy.ops.lensfield.live()
    live.end("the shader does not compile")
    live.draw_live_status(layout := Layout())
    assert "Live switched off: the shader does not compile" in " ".join(layout.labels)
