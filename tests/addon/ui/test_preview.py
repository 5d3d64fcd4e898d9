"""The preview: on, displayed, updated after a change, through another lens, and off; stepped as by its timer."""

import os
import shutil
import signal
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from layouts import Layout
from lensfield import addon
from lensfield.addon.scene import rings
from lensfield.addon.scene.compositor import compositing_tree
from lensfield.addon.ui.common.preferences import IN_PANEL
from lensfield.addon.ui.common.properties import lens_title
from lensfield.addon.ui.common.session import session
from lensfield.addon.ui.preview import preview, preview_panel, state
from lensfield.addon.ui.preview.preview_overlay import frame_corners
from lensfield.engine.library import PRESCRIPTIONS
from small_scenes import light, material, wall
from snapshot import differences, snapshot
from waiting import wait_until


@pytest.fixture
def ready_scene(scene, monkeypatch):
    light(scene, "POINT", 20.0)
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (0.7, 0.3, 0.05))[0])
    scene.camera.data.lensfield.lens = "tessar-50mm"
    scene.render.resolution_x, scene.render.resolution_y = 800, 600
    bpy.context.view_layer.update()
    monkeypatch.setattr(preview, "LONG_SIDE_PX", 96)
    monkeypatch.setattr(preview, "VIEWPORT_SIDES_PX", (96, 96))
    monkeypatch.setattr(preview, "SAMPLES", 4)
    yield scene
    preview.end()


def on():
    return session.preview


def copied_ns():
    """Time of the last copy of the file."""
    return next(Path(on().folder.name).glob("*.blend")).stat().st_mtime_ns


def follow():
    """Tick until everything is finished and displayed."""
    wait_until(lambda: preview.tick() is None or (on().fresh and not on().at_work))


def shown():
    layout = Layout()
    preview_panel.draw_preview(layout)
    preview_panel.draw_preview_status(layout)
    return " ".join(layout.labels)


def picture():
    """The values of the displayed picture."""
    pixels = np.empty(4 * np.prod(bpy.data.images[preview.NAME].size), np.float32)
    bpy.data.images[preview.NAME].pixels.foreach_get(pixels)
    return pixels


def red(scene):
    """The mean red value of the displayed picture."""
    return picture()[::4].mean()


def test_the_preview_shows_the_scene_without_changing_it(ready_scene):
    before = snapshot()
    assert bpy.ops.lensfield.preview() == {"FINISHED"}
    follow()
    assert not [line for line in differences(before, snapshot()) if preview.NAME not in line]
    assert tuple(bpy.data.images[preview.NAME].size) == (96, 72) and red(ready_scene) > 0
    assert on().picture.is_file() and not on().error
    assert "96 \u00d7 72 px, 4 samples" in shown() and "Zeiss Tessar" in shown()
    child, folder = on().child, Path(on().folder.name)
    assert bpy.ops.lensfield.preview() == {"FINISHED"}
    assert child.ended and not folder.exists() and not bpy.app.timers.is_registered(preview.tick)
    assert not any(handler in getattr(bpy.app.handlers, name) for name, handler in preview._HANDLERS.items())
    assert not differences(before, snapshot())


@pytest.fixture
def viewport():
    """A 3D viewport that looks elsewhere, without overlays."""
    area = next(area for area in bpy.context.window.screen.areas if area.type == "VIEW_3D")
    area.spaces.active.region_3d.view_perspective, area.spaces.active.overlay.show_overlays = "PERSP", False
    return area


@pytest.mark.one_blender
def test_one_click_turns_a_viewport_to_the_camera(ready_scene, viewport):
    assert not preview.shows_camera(viewport)
    assert bpy.ops.lensfield.preview() == {"FINISHED"}
    assert preview.shows_camera(viewport)
    assert on().waiting_for == "Lensfield Preview: starting" and "Not visible" not in shown()
    follow()
    assert on().waiting_for == ""
    viewport.spaces.active.region_3d.view_perspective = "PERSP"
    assert "Not visible: view the scene through its camera" in shown()


@pytest.mark.one_blender
def test_the_preview_can_appear_in_the_panel_instead(ready_scene, viewport, monkeypatch):
    monkeypatch.setattr(preview_panel, "preview_place", lambda: IN_PANEL)
    assert bpy.ops.lensfield.preview() == {"FINISHED"}
    follow()
    assert not preview.shows_camera(viewport)
    preview_panel.draw_preview_status(layout := Layout())
    assert "picture" in layout.shown and not any("Not visible" in label for label in layout.labels)


def test_an_edit_refreshes_the_preview_and_a_selection_does_not(ready_scene):
    tree = compositing_tree(ready_scene)  # the first one makes Blender 4.5 report all objects as changed
    bpy.context.view_layer.update()
    preview.start(ready_scene)
    follow()
    first, copied = red(ready_scene), copied_ns()
    bpy.data.objects["Wall"].select_set(True)
    bpy.context.view_layer.update()
    assert on().fresh
    bpy.data.lights["Light"].energy *= 2
    bpy.context.view_layer.update()
    assert not on().fresh
    follow()
    assert copied_ns() == copied
    assert red(ready_scene) == pytest.approx(2 * first, rel=0.01)
    tree.nodes.new("CompositorNodeBlur")  # Blender 4.5 then reports meshes as changed, so a later edit needs a copy
    bpy.context.view_layer.update()
    assert on().fresh


@pytest.mark.one_blender
def test_the_scenes_first_compositor_does_not_begin_the_preview_anew(ready_scene):
    preview.start(ready_scene)
    follow()
    with preview.unaffected():
        compositing_tree(ready_scene)
        ready_scene.update_tag()
        for obj in ready_scene.objects:
            obj.update_tag()
    assert on().fresh and on().up_to_date
    ready_scene.objects["Wall"].location.x += 0.1
    with preview.unaffected():
        ready_scene.update_tag()
    assert not on().fresh


@pytest.mark.one_blender
def test_changed_values_give_the_picture_of_a_new_copy(ready_scene):
    """A slope in the left half of the picture, with depth of field; and a mesh that is edited afterwards."""
    dof, obj = ready_scene.camera.data.dof, bpy.data.objects["Wall"]
    dof.use_dof, dof.focus_distance, dof.aperture_fstop = True, 2.0, 2.8
    bpy.context.view_layer.update()
    preview.start(ready_scene)
    follow()
    before, copied = picture(), copied_ns()
    obj.location.x, obj.rotation_euler.y = -5.1, 0.3
    bpy.data.lights["Light"].energy *= 1.5
    bpy.context.view_layer.update()
    follow()
    changed = picture()
    assert copied_ns() == copied and not np.allclose(changed, before, rtol=0.1)
    on().by_hand = True
    follow()
    assert copied_ns() > copied and np.allclose(picture(), changed, rtol=1e-5, atol=1e-6)  # sums in another order
    copied = copied_ns()
    obj.data.vertices[0].co.z += 0.1
    obj.data.update()
    bpy.context.view_layer.update()
    follow()
    assert copied_ns() > copied and not on().error


@pytest.mark.one_blender
def test_an_object_that_moves_again_needs_no_preparation(ready_scene, monkeypatch):
    """Off the centre; the picture is that of a new copy, also after another change next to the move."""
    requests, ask = [], preview._ask
    monkeypatch.setattr(preview, "_ask", lambda *request: requests.append(request[-1]) or ask(*request))
    obj, lamp = bpy.data.objects["Wall"], bpy.data.objects["Light"]
    preview.start(ready_scene)
    follow()
    for place, moved, expected in (((-5.1, 0.2), obj, "--changes"), ((-5.2, 0.3), obj, "--moves"),
                                   ((1.0, 0.5), lamp, "--changes"), ((-5.3, 0.1), obj, "--moves")):
        before = picture()
        moved.location.xy = place
        bpy.context.view_layer.update()
        follow()
        assert expected in requests[-1] and not np.allclose(picture(), before, rtol=0.01)
    with_moves = picture()
    obj.location.x -= 0.1
    obj.pass_index = 3  # more than a move
    bpy.context.view_layer.update()
    follow()
    assert "--changes" in requests[-1]
    obj.location.x += 0.1
    on().by_hand = True
    follow()
    assert np.allclose(picture(), with_moves, rtol=1e-5, atol=1e-6) and not on().error


@pytest.mark.one_blender
def test_a_modifier_that_is_turned_off_for_renders_refreshes_the_preview(ready_scene):
    """Blender does not announce this."""
    modifier = bpy.data.objects["Wall"].modifiers.new("Build", "BUILD")
    modifier.frame_start, modifier.frame_duration = 1000, 1  # removes all faces until then
    modifier.show_viewport = False
    bpy.context.view_layer.update()
    preview.start(ready_scene)
    follow()
    assert red(ready_scene) < 1e-6
    modifier.show_render = False
    wait_until(lambda: preview.tick() and not on().fresh)
    follow()
    assert red(ready_scene) > 1e-3 and not on().error


@pytest.mark.one_blender
def test_changes_do_not_pile_up(ready_scene):
    preview.start(ready_scene)
    preview.tick()
    for _ in range(20):
        bpy.data.lights["Light"].energy *= 1.01
        bpy.context.view_layer.update()
        preview.tick()
    first_job_s = on().started_s
    assert on().at_work and on().task is state.Task.RENDER and not on().fresh
    follow()
    assert on().started_s > first_job_s and on().fresh


@pytest.mark.one_blender
def test_another_lens_shows_immediately_and_then_with_its_field_of_view(ready_scene):
    preview.start(ready_scene)
    follow()
    narrow, shown_first, copied = on().loaded.tangents, red(ready_scene), copied_ns()
    ready_scene.camera.data.lensfield.lens = "nikkor-28mm"
    bpy.context.view_layer.update()
    preview.tick()
    assert on().at_work and on().task is state.Task.LENS
    while on().at_work and on().task is state.Task.LENS:
        preview.tick()
    assert red(ready_scene) != shown_first and "Nikkor 28 mm" in shown()
    assert on().at_work and on().task is state.Task.CHANGE
    follow()
    assert copied_ns() == copied and on().loaded.tangents[2] > 1.5 * narrow[2]


@pytest.mark.one_blender
def test_another_lens_in_the_camera_view_needs_no_render(ready_scene):
    ready_scene.camera.data.lensfield.view = "CAMERA"
    preview.start(ready_scene)
    follow()
    rendered_ns = copied_ns()
    for lens in ("edmund-54852", "cooke-triplet-50mm"):  # the first uses much more than the render's lens
        ready_scene.camera.data.lensfield.lens = lens
        bpy.context.view_layer.update()
        follow()
        assert copied_ns() == rendered_ns and not on().error and lens_title(lens) in shown()


@pytest.mark.one_blender
@pytest.mark.parametrize("shading, same_scene", [(False, True), (True, False)])
def test_announcements_of_lens_and_view_differ(endless, ready_scene, shading, same_scene):
    """Blender announces Lensfield's settings of a camera as changes of its geometry, and its own also as shading."""
    ready_scene.camera.data.lensfield.coating = "NONE"
    announced = SimpleNamespace(id=ready_scene.camera.data, is_updated_transform=True, is_updated_geometry=True,
                                is_updated_shading=shading)
    preview.on_update(ready_scene, SimpleNamespace(updates=[announced]))
    assert on().same_scene == same_scene


@pytest.mark.one_blender
def test_turning_a_ring_needs_no_render(ready_scene):
    ready_scene.camera.data.lensfield.view = "CAMERA"
    dof = ready_scene.camera.data.dof
    dof.use_dof, dof.focus_distance, dof.aperture_fstop = True, 3.0, 8.0
    bpy.context.view_layer.update()
    preview.start(ready_scene)
    follow()
    rendered_ns = copied_ns()
    for name, value in (("aperture_fstop", 11.0), ("focus_distance", 2.0)):
        setattr(dof, name, value)
        bpy.context.view_layer.update()
        follow()
        assert copied_ns() == rendered_ns and not on().error
    assert (on().lens[3].f_number, on().lens[3].focus_mm) == (11.0, 2000.0)


@pytest.fixture
def endless(ready_scene, monkeypatch):
    """A preview with rings that is refined until something stops it."""
    monkeypatch.setattr(preview, "SAMPLES", 1 << 20)
    ready_scene.camera.data.lensfield.view = "CAMERA"
    dof = ready_scene.camera.data.dof
    dof.use_dof, dof.focus_distance, dof.aperture_fstop = True, 3.0, 8.0
    bpy.context.view_layer.update()
    preview.start(ready_scene)
    wait_until(lambda: preview.tick() and on().number > 2)
    assert on().at_work and "Refining" in shown()
    return dof


@pytest.mark.one_blender
def test_a_change_of_the_scene_stops_the_refinement(endless):
    first, count = red(endless), on().number
    bpy.data.lights["Light"].energy *= 2
    bpy.context.view_layer.update()
    assert not on().same_scene  # so the picture is hidden
    wait_until(lambda: preview.tick() and not on().at_work)
    assert on().number == count  # no picture of the scene before the change
    wait_until(lambda: preview.tick() and on().same_scene and on().number)
    assert red(endless) == pytest.approx(2 * first, rel=0.2)


@pytest.mark.one_blender
def test_the_picture_stays_while_a_ring_turns_and_is_refined_afterwards(endless):
    copied, before = copied_ns(), on().depth
    for f_stop in (11.0, 16.0):
        endless.aperture_fstop = f_stop
        bpy.context.view_layer.update()
        assert on().same_scene and not on().fresh
        wait_until(lambda: preview.tick() and on().fresh and on().number)
        assert on().lens[3].f_number == f_stop
    number = on().number
    wait_until(lambda: preview.tick() and on().number > number)
    assert on().child.status["size_px"] == [96, 72] and on().at_work and on().depth.name == before.name
    assert copied_ns() == copied and not on().error


@pytest.mark.one_blender
def test_a_setting_of_the_scene_that_is_not_the_lens_makes_the_picture_outdated(endless, ready_scene):
    ready_scene.cycles.film_exposure = 3.0
    ready_scene.update_tag()
    bpy.context.view_layer.update()
    assert not on().same_scene


@pytest.mark.one_blender
def test_another_scene_in_the_window_stops_the_refinement(endless, ready_scene):
    other = bpy.data.scenes.new("Other")
    other.render.engine, other.camera = "CYCLES", ready_scene.camera
    bpy.context.window.scene = other
    wait_until(lambda: preview.tick() and on().scene_uid == other.session_uid)
    assert not on().picture.is_file() and not on().number
    wait_until(lambda: preview.tick() and on().number)
    assert on().picture.is_file() and not on().error


@pytest.mark.one_blender
def test_the_refinement_pauses_during_a_render(endless, monkeypatch):
    monkeypatch.setattr(session, "render", object())
    wait_until(lambda: preview.tick() and not on().at_work)
    assert on().fresh
    monkeypatch.setattr(session, "render", None)
    count, samples = on().number, int(on().shown.facts[0].split(" px, ")[1].split()[0])
    wait_until(lambda: preview.tick() and on().number > count)
    assert on().at_work and not on().error and int(on().shown.facts[0].split(" px, ")[1].split()[0]) > samples


@pytest.mark.one_blender
def test_a_moving_focus_object_refocuses_and_renders_again(ready_scene):
    """It refocuses the lens and changes the scene at the same time."""
    ready_scene.camera.data.lensfield.view = "CAMERA"
    dof, obj = ready_scene.camera.data.dof, bpy.data.objects["Wall"]
    dof.use_dof, dof.focus_object = True, obj
    bpy.context.view_layer.update()
    preview.start(ready_scene)
    follow()
    before, focus_mm = picture(), on().lens[3].focus_mm
    obj.location.z -= 0.5
    bpy.context.view_layer.update()
    assert not on().same_scene
    follow()
    assert not np.allclose(picture(), before, rtol=0.01)
    assert on().lens[3].focus_mm == pytest.approx(focus_mm + 500)


def test_an_undo_can_change_lens_and_scene_together(ready_scene):
    preview.start(ready_scene)
    follow()
    first = red(ready_scene)
    ready_scene.camera.data.lensfield.lens = "cooke-triplet-50mm"
    bpy.data.lights["Light"].energy *= 3
    bpy.context.view_layer.update()
    preview.on_frame(ready_scene)
    follow()
    assert red(ready_scene) > 2 * first and "Cooke Triplet" in shown()


@pytest.mark.one_blender
def test_a_failed_preview_shows_its_error_and_is_retried_after_a_change(ready_scene):
    preview.start(ready_scene)
    ready_scene.camera.data.clip_start = 5000
    follow()
    assert "clipping is 5000 to 1000" in shown()
    ready_scene.camera.data.clip_start = 0.1
    ready_scene.render.resolution_x = 801
    ready_scene.update_tag()
    bpy.context.view_layer.update()
    on().changed_s = 0.0
    follow()
    assert not on().error and on().picture.is_file()
    preview.end()
    ready_scene.camera.data.type = "ORTHO"
    with pytest.raises(RuntimeError, match="Orthographic cameras have no lens"):
        bpy.ops.lensfield.preview()
    assert on() is None


@pytest.mark.one_blender
def test_an_unusable_lens_is_reported_until_it_is_restored(ready_scene, tmp_path, monkeypatch):
    """With blades, which need its widest f-number, read once for each version of a file."""
    calls, iris_is_visible = [], rings.iris_is_visible
    monkeypatch.setattr(rings, "iris_is_visible", lambda *lens: calls.append(lens) or iris_is_visible(*lens))
    path, dof = tmp_path / "own.toml", ready_scene.camera.data.dof
    shutil.copy(PRESCRIPTIONS / "tessar-50mm.toml", path)
    ready_scene.camera.data.lensfield.lens, ready_scene.camera.data.lensfield.lens_file = "FILE", str(path)
    dof.use_dof, dof.focus_distance, dof.aperture_fstop, dof.aperture_blades = True, 2.0, 8.0, 6
    bpy.context.view_layer.update()
    preview.start(ready_scene)
    follow()
    assert len(calls) == 1 and on().lens[4].blades == 6 and not on().error
    for spoil in (path.unlink, lambda: path.write_text("title = ")):
        spoil()
        assert preview.tick() == preview.TICK_S == preview.tick()
        assert "own.toml" in on().error and on().error in shown()
    shutil.copy(PRESCRIPTIONS / "tessar-50mm.toml", path)
    follow()
    assert not on().error and on().lens[4].blades == 6


@pytest.mark.one_blender
def test_a_file_that_is_slow_to_copy_is_refreshed_manually(ready_scene, monkeypatch):
    monkeypatch.setattr(state, "LONGEST_COPY_S", 0.0)
    preview.start(ready_scene)
    for _ in range(2):  # once may be coincidence
        on().by_hand = True
        follow()
    copied, mesh = copied_ns(), bpy.data.objects["Wall"].data
    bpy.data.lights["Light"].energy *= 2
    bpy.context.view_layer.update()
    follow()
    assert copied_ns() == copied and "click Refresh Preview" not in shown()
    mesh.vertices[0].co.z += 0.1
    mesh.update()
    bpy.context.view_layer.update()
    on().changed_s = 0.0
    preview.tick()
    assert not on().at_work and "click Refresh Preview" in shown()
    assert bpy.ops.lensfield.refresh_preview() == {"FINISHED"}
    follow()
    assert copied_ns() > copied


def test_the_preview_waits_for_a_lens_render(ready_scene, monkeypatch):
    preview.start(ready_scene)
    monkeypatch.setattr(session, "render", object())
    preview.tick()
    assert not on().at_work
    monkeypatch.setattr(session, "render", None)
    preview.tick()
    assert on().at_work


def test_the_preview_ends_with_its_file_scene_child_or_the_add_on(ready_scene):
    preview.start(ready_scene)
    child = on().child
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert on() is None and child.ended
    bpy.context.scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    preview.start(bpy.context.scene)
    os.kill(on().child._process.pid, signal.SIGKILL)
    follow()
    assert on() is None and "its process ended unexpectedly (signal 9" in shown()
    Path(session.preview_failure.rsplit("log: ")[1]).unlink()
    other = bpy.data.scenes.new("Other")
    other.camera = bpy.context.scene.camera
    preview.start(other)
    bpy.data.scenes.remove(other)
    follow()
    assert on() is None and "its scene no longer exists" in shown()
    preview.start(bpy.context.scene)
    child = on().child
    addon.unregister()
    try:
        assert child.ended
    finally:
        addon.register()


def test_the_overlay_covers_the_view_of_the_lens(ready_scene):
    ready_scene.camera.location = 1, 2, 3
    bpy.context.view_layer.update()
    corners = frame_corners(ready_scene, (-0.4, -0.3, 0.4, 0.3))
    assert np.allclose(corners, [(0.6, 1.7, 2), (1.4, 2.3, 2)])


def test_the_overlay_covers_the_frame_that_a_viewport_shows_of_a_panorama(ready_scene):
    camera = ready_scene.camera
    camera.location, camera.data.type, camera.data.sensor_fit = (1, 2, 3), "PANO", "HORIZONTAL"
    camera.data.sensor_width, camera.data.lens, camera.data.shift_x = 36, 24, 0.1
    bpy.context.view_layer.update()
    corners = np.array(frame_corners(ready_scene, (-0.4, -0.3, 0.4, 0.3))) - (1, 2, 3)
    assert np.allclose(corners[:, :2] / -corners[:, 2:], [(-0.6, -0.5625), (0.9, 0.5625)])


def test_the_first_picture_waits_until_the_turned_viewport_is_drawn(ready_scene, viewport, monkeypatch):
    monkeypatch.setattr(session.overlay, "turned", False)
    monkeypatch.setattr(preview.preview_overlay, "start", lambda: setattr(session.overlay, "handle", object()))
    monkeypatch.setattr(preview.preview_overlay, "end", lambda: setattr(session.overlay, "handle", None))
    assert bpy.ops.lensfield.preview() == {"FINISHED"}
    for _ in range(3):
        preview.tick()
        assert not on().at_work
    session.overlay.turned = False  # as a drawing does
    preview.tick()
    assert on().at_work


def test_a_frame_that_grows_is_rendered_finer_and_never_coarser_meanwhile(ready_scene, monkeypatch):
    sides, shown_px, show = [96], [], preview._show
    monkeypatch.setattr(preview, "VIEWPORT_SIDES_PX", (24, 960))
    monkeypatch.setattr(preview.preview_overlay, "frame_sides_px", lambda *_: sides)
    monkeypatch.setattr(preview, "_show", lambda *given: (shown_px.append(given[-1]["size_px"][0]), show(*given)))
    preview.start(ready_scene)
    follow()
    copied = copied_ns()
    assert shown_px[0] == 32 and shown_px[-1] == 96
    shown_px.clear()
    sides[:] = [192]
    preview.tick()
    assert not on().fresh and on().up_to_date  # the picture stays
    follow()
    assert {*shown_px} == {192} and tuple(bpy.data.images[preview.NAME].size) == (192, 144) and copied_ns() == copied
    sides[:] = [48]
    preview.tick()
    assert on().fresh


def test_the_picture_is_hidden_while_a_lens_cannot_replace_the_camera(ready_scene):
    preview.start(ready_scene)
    follow()
    for camera_type in ("ORTHO", "PANO"):
        ready_scene.camera.data.type = camera_type
        bpy.context.view_layer.update()
        assert not on().up_to_date
        follow()
        assert not on().up_to_date and on().error
        ready_scene.camera.data.type = "PERSP"
        bpy.context.view_layer.update()
        follow()
        assert on().up_to_date and not on().error
