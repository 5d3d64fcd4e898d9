"""The focus overlay: blur of more than a pixel of the render is tinted, in front of and behind the focus."""

import bpy
import numpy as np
import pytest

from lensfield.addon.scene.focus import Focus
from lensfield.addon.ui.common.session import session
from lensfield.addon.ui.preview import focus_overlay, preview
from small_scenes import light, material, wall
from snapshot import differences, snapshot
from waiting import wait_until

LENS = "sonnar-50mm-f1.5"


def test_near_far_and_sharp_have_different_tints():
    depth_m = np.array([[1.0, 1.9, 2.0, 2.1, 8.0, np.inf]], np.float32)
    tints = focus_overlay.tints(depth_m, Focus(2.0, 10.0))[0]
    assert tints.shape == (6, 4) and tints.dtype == np.float32
    assert np.all(tints[1:4, 3] == 0), "within a pixel"
    assert np.allclose(tints[0, :3], focus_overlay.NEARER) and np.allclose(tints[4:, :3], focus_overlay.FARTHER)
    assert focus_overlay.FAINTEST < tints[4, 3] < tints[5, 3] < focus_overlay.STRONGEST
    assert not focus_overlay.tints(np.full((1, 1), np.nan), Focus(2.0, 10.0))[..., 3].any()


def test_tints_of_a_leaning_plane_of_focus():
    """At 2 m on the axis, nearer above it and on its left; the axis is off the middle of an upright picture."""
    edges = -0.2, -0.1, 0.1, 0.3
    rows, columns = np.indices((40, 30)) + 0.5
    right, up = -0.2 + 0.3 * columns / 30, 0.3 - 0.4 * rows / 40
    plane_m = 1 / (0.5 + 0.8 * up - 0.5 * right)
    focus = Focus(2.0, 100.0, (-0.5, 0.8))
    assert not focus_overlay.tints(plane_m, focus, edges)[..., 3].any()
    for factor, colour in ((0.9, focus_overlay.NEARER), (1.1, focus_overlay.FARTHER)):
        tints = focus_overlay.tints(factor * plane_m, focus, edges)
        assert np.all(tints[..., 3] > 0) and np.allclose(tints[..., :3], colour)


def test_near_and_far_colours_differ_in_lightness():
    """They are distinguishable with any type of colour blindness, and by luminance alone."""
    luminance = [np.dot([0.2126, 0.7152, 0.0722], np.power(colour, 2.2))
                 for colour in (focus_overlay.NEARER, focus_overlay.FARTHER)]
    assert luminance[0] > 2 * luminance[1]


@pytest.fixture
def on(scene, monkeypatch):
    """A scene with an active preview: a wall at 2 m, in focus, on the left, and one at 6 m on the right."""
    light(scene, "POINT", 20.0)
    paint = material("Paint", "ShaderNodeBsdfDiffuse")[0]
    wall(scene, paint, 2.0).location.x = -5
    wall(scene, paint, 6.0, 40.0)
    scene.render.resolution_x, scene.render.resolution_y = 960, 640
    scene.camera.data.lensfield.lens = LENS
    dof = scene.camera.data.dof
    dof.use_dof, dof.focus_distance, dof.aperture_fstop = True, 2.0, 1.5
    bpy.context.view_layer.update()
    monkeypatch.setattr(preview, "LONG_SIDE_PX", 96)
    monkeypatch.setattr(preview, "VIEWPORT_SIDES_PX", (96, 96))
    monkeypatch.setattr(preview, "SAMPLES", 4)
    preview.start(scene)
    follow()
    assert not session.preview.error
    yield scene
    preview.end()


def follow():
    wait_until(lambda: preview.tick() is None or (
        session.preview.fresh and not session.preview.at_work))


def tinted(scene):
    """The tints on the left and on the right: two times red, green and blue, 0 without a tint."""
    tints = focus_overlay.focus_tints(scene, session.preview.depth)
    row = tints[tints.shape[0] // 2]
    return [tuple(round(float(part), 3) for part in one[:3] * (one[3] > 0))
            for one in (row[len(row) // 4], row[3 * len(row) // 4])]


def test_the_overlay_follows_the_rings_immediately_using_the_saved_depth(on):
    scene, nothing = on, (0.0, 0.0, 0.0)
    before = snapshot()
    assert bpy.ops.lensfield.focus_overlay() == {"FINISHED"}
    assert not differences(before, snapshot()), "the file knows nothing of it"
    assert tinted(scene) == [nothing, focus_overlay.FARTHER]
    same = focus_overlay.focus_tints(scene, session.preview.depth)
    assert focus_overlay.focus_tints(scene, session.preview.depth) is same
    scene.camera.data.dof.focus_distance = 6.0
    bpy.context.view_layer.update()
    assert session.preview.same_scene and not session.preview.fresh
    assert tinted(scene) == [focus_overlay.NEARER, nothing]
    scene.camera.data.dof.focus_distance = 2.0
    for degrees, colour in ((4.0, focus_overlay.NEARER), (-4.0, focus_overlay.FARTHER)):
        scene.camera.data.lensfield.tilt_deg = 0.0, np.radians(degrees)
        assert tinted(scene)[0] == colour, "the plane of focus leans, towards the camera on one side"
    scene.camera.data.lensfield.tilt_deg = 0.0, 0.0
    scene.camera.data.dof.focus_distance = 6.0
    scene.camera.data.dof.aperture_fstop = 64.0  # limited to about f/22
    scene.render.resolution_percentage = 5
    assert tinted(scene) == [nothing, nothing]
    bpy.data.objects["Wall"].location.z -= 1
    bpy.context.view_layer.update()
    assert not session.preview.same_scene, "the saved picture shows the scene before the edit"


@pytest.mark.one_blender
def test_the_overlay_ends_with_the_preview(on):
    assert bpy.ops.lensfield.focus_overlay.poll() and bpy.ops.lensfield.focus_overlay() == {"FINISHED"}
    preview.end()
    assert not session.focus_overlay and not bpy.ops.lensfield.focus_overlay.poll()


def test_the_overlay_waits_for_its_lens_only_when_it_is_enabled(scene, monkeypatch):
    waits = []
    monkeypatch.setattr(focus_overlay, "facts_at_rest",
                        lambda scene, longest_s: waits.append(session.focus_overlay and longest_s > 0))
    for _ in range(4):
        focus_overlay.switch(scene)
    assert waits == [True, True]


@pytest.mark.one_blender
def test_no_overlay_is_drawn_without_a_lens_or_camera(on):
    focus_overlay.switch(on)
    path = session.preview.depth
    assert focus_overlay.focus_tints(on, path) is not None and focus_overlay.focus_tints(on, None) is None
    on.camera.data.lensfield.lens, on.camera.data.lensfield.lens_file = "FILE", "/nowhere.toml"
    focus_overlay.switch(on)
    assert focus_overlay.focus_tints(on, path) is None
