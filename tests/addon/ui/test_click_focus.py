"""Click to Focus: the distance of the surface under the mouse along the camera's axis, from any view."""

from math import radians
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Matrix, Vector

from lensfield.addon.scene.active_camera import camera_object_in
from lensfield.addon.scene.camera import frame_grid
from lensfield.addon.scene.clicked_focus import focus_on, lens_ray, surface_at, view_ray
from lensfield.addon.scene.errors import SceneError
from lensfield.addon.scene.lens_cache import SKETCHED, load_lens
from lensfield.addon.scene.lens_facts import lens_facts
from lensfield.addon.scene.rings import scene_rings
from lensfield.addon.ui.common.lens_worker import facts_now
from lensfield.addon.ui.common.session import session
from lensfield.addon.ui.preview.click_focus import LENSFIELD_OT_click_focus as Operator
from lensfield.addon.ui.preview.click_focus import clicked_ray, picture_tangents, view_at
from lensfield.engine.inspection.curves import field_angle_rad, reference_nm
from refusals import refused

PLACE = 0.63, -0.41  # in the view, off its centre
DISTANCE = 7.25
ROUNDING = 1e-5  # of single precision, in the scene's coordinates and Blender's ray


@pytest.fixture
def turned(scene):
    """The scene in centimetres, in a frame of 64 x 36 px with a shifted lens; the camera's parent is moved, turned and
    unevenly scaled."""
    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", 0.01
    scene.render.resolution_x, scene.render.resolution_y = 64, 36
    parent = bpy.data.objects.new("Parent", None)
    scene.collection.objects.link(parent)
    parent.location, parent.scale = (3.0, -2.0, 1.5), (0.4, 0.4, 2.5)
    parent.rotation_euler = [radians(degrees) for degrees in (20.0, -35.0, 110.0)]
    scene.camera.parent, scene.camera.location = parent, (0.5, 0.25, -1.0)
    scene.camera.data.shift_x, scene.camera.data.clip_end = 0.1, 1e5
    bpy.context.view_layer.update()
    return scene


def axes(scene):
    """The camera's place and axes in the world."""
    return scene.camera.matrix_world.normalized()


def pane(scene, distance=DISTANCE, name="Pane", half=50.0):
    """A square at this distance in front of the camera, parallel to its sensor."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)], [], [(0, 1, 2, 3)])
    square = bpy.data.objects.new(name, mesh)
    square.matrix_world = axes(scene) @ Matrix.Translation((0, 0, -distance))
    scene.collection.objects.link(square)
    return square


def through_camera(scene):
    """The perspective matrix of a view through the camera."""
    camera, render = scene.camera, scene.render
    to_view = camera.calc_matrix_camera(bpy.context.evaluated_depsgraph_get(), x=render.resolution_x,
                                        y=render.resolution_y)
    return to_view @ camera.matrix_world.normalized().inverted()


def hit_at(scene, place=PLACE, perspective=None):
    bpy.context.view_layer.update()
    ray = view_ray(perspective or through_camera(scene), place)
    return surface_at(scene, bpy.context.evaluated_depsgraph_get(), ray)


def test_a_click_off_centre_sets_the_distance_along_the_axis(turned):
    pane(turned)
    hit, dof = hit_at(turned), turned.camera.data.dof
    across, up, depth = world_to_camera_view(turned, turned.camera, hit.place)
    assert (2 * across - 1, 2 * up - 1, depth) == pytest.approx((*PLACE, DISTANCE), rel=ROUNDING)
    assert (hit.place - turned.camera.matrix_world.translation).length > 1.04 * DISTANCE
    dof.focus_object = turned.camera.parent
    focus_on(turned.camera, hit)
    assert dof.use_dof and dof.focus_object is None
    assert dof.focus_distance == pytest.approx(DISTANCE, rel=ROUNDING)
    assert scene_rings(turned).focus_mm == pytest.approx(10 * DISTANCE, rel=ROUNDING), "a unit is a centimetre"


@pytest.mark.parametrize("orthographic", [False, True])
def test_another_view_sets_the_same_distance(turned, orthographic):
    pane(turned)
    lens = Matrix.Diagonal((0.05, 0.05, -1e-3, 1.0)) if orthographic else through_camera(turned) @ axes(turned)
    view = axes(turned) @ Matrix.Translation((2.0, -1.0, 1.5)) @ Matrix.Rotation(radians(25.0), 4, "Y")
    hit = hit_at(turned, perspective=lens @ view.inverted())
    assert world_to_camera_view(turned, turned.camera, hit.place)[0] * 2 - 1 != pytest.approx(PLACE[0], abs=0.1)
    focus_on(turned.camera, hit)
    assert turned.camera.data.dof.focus_distance == pytest.approx(DISTANCE, rel=ROUNDING)


def test_the_distance_is_exact_with_a_large_clipping_range(turned):
    turned.camera.data.clip_start, turned.camera.data.clip_end = 1e-3, 1e6
    pane(turned)
    focus_on(turned.camera, hit_at(turned))
    assert turned.camera.data.dof.focus_distance == pytest.approx(DISTANCE, rel=ROUNDING)


@pytest.mark.parametrize("hide", [
    lambda each: each.hide_set(True), lambda each: setattr(each, "hide_viewport", True),
    lambda each: setattr(each, "hide_render", True), lambda each: setattr(each, "visible_camera", False)])
def test_hidden_surfaces_are_passed_through(turned, hide):
    pane(turned)
    front = pane(turned, 3.0, "Front")
    assert hit_at(turned).obj.name == "Front"
    hide(front)
    assert hit_at(turned).obj.name == "Pane"


def test_surfaces_before_the_near_clipping_are_passed_through(turned):
    pane(turned)
    pane(turned, 0.5, "Housing")
    turned.camera.data.clip_start = 1.0
    assert hit_at(turned).obj.name == "Pane"


def test_an_instance_sets_the_distance_and_is_not_followed(turned):
    square = pane(turned)
    group, empty = bpy.data.collections.new("Group"), bpy.data.objects.new("Instancer", None)
    turned.collection.objects.unlink(square)
    group.objects.link(square)
    empty.instance_type, empty.instance_collection = "COLLECTION", group
    empty.location = axes(turned).to_3x3() @ Vector((0, 0, -2.0))
    turned.collection.objects.link(empty)
    hit, dof = hit_at(turned), turned.camera.data.dof
    with pytest.raises(SceneError, match="object 'Pane': focus object is an instance: click without Ctrl"):
        focus_on(turned.camera, hit, follow=True)
    assert not dof.use_dof and dof.focus_object is None
    focus_on(turned.camera, hit)
    assert dof.focus_distance == pytest.approx(DISTANCE + 2.0, rel=ROUNDING)


def test_with_ctrl_the_focus_follows_the_object(turned):
    square, dof = pane(turned), turned.camera.data.dof
    before = dof.focus_distance
    focus_on(turned.camera, hit_at(turned), follow=True)
    assert dof.use_dof and dof.focus_object == square and dof.focus_distance == before
    assert scene_rings(turned).focus_mm == pytest.approx(10 * DISTANCE, rel=ROUNDING)


def test_a_click_past_all_objects_hits_nothing(turned):
    pane(turned, half=0.1)
    assert hit_at(turned) is None and hit_at(turned, (0.0, 0.0)) is None  # the view's centre is shifted


def test_a_surface_behind_the_camera_is_refused(turned):
    behind, dof = pane(turned, -4.0), turned.camera.data.dof
    place = axes(turned) @ Vector((0.1, 0.2, 4.0))
    hit = SimpleNamespace(place=place, obj=behind, to_world=behind.matrix_world)
    with pytest.raises(SceneError, match="focus is behind the camera: click on something in front of it"):
        focus_on(turned.camera, hit)
    assert not dof.use_dof


def test_a_linked_camera_is_refused(turned, tmp_path):
    pane(turned)
    hit, path = hit_at(turned), str(tmp_path / "library.blend")
    bpy.data.libraries.write(path, {turned.camera})
    with bpy.data.libraries.load(path, link=True) as (_, loaded):
        loaded.objects = ["Camera"]
    with refused(SceneError, field="data-block", where="camera 'Camera'"):
        focus_on(loaded.objects[0], hit)


@pytest.mark.one_blender
def test_the_camera_in_the_editor_is_focused(turned):
    """In a camera's properties, that camera, even if another one is active."""
    other = bpy.data.objects.new("Other", bpy.data.cameras.new("Other"))
    turned.collection.objects.link(other)
    context = SimpleNamespace(scene=turned, object=None)
    assert camera_object_in(context) == turned.camera
    assert camera_object_in(SimpleNamespace(scene=turned, object=None, camera=other.data)) == other
    other.data = turned.camera.data
    assert camera_object_in(SimpleNamespace(scene=turned, object=other, camera=other.data)) == turned.camera
    assert Operator.poll(bpy.context)
    turned.camera.data.type = "ORTHO"
    assert not Operator.poll(bpy.context)
    turned.camera = None
    assert not Operator.poll(bpy.context)


@pytest.fixture
def window(turned):
    """A context with a 3D view of 640 x 360 px at (100, 50) in its window, through the camera, and a sidebar on it; and
    an operator at work in it."""
    bpy.context.view_layer.update()
    view = SimpleNamespace(perspective_matrix=through_camera(turned), view_perspective="CAMERA")
    main = SimpleNamespace(type="WINDOW", x=100, y=50, width=640, height=360, data=view)
    sidebar = SimpleNamespace(type="UI", x=640, y=50, width=100, height=360)
    area = SimpleNamespace(type="VIEW_3D", regions=[main, sidebar], spaces=SimpleNamespace(active=None))
    changes, lines = [], []
    context = SimpleNamespace(
        scene=turned, object=None, screen=SimpleNamespace(areas=[area]), lines=lines, changes=changes,
        evaluated_depsgraph_get=bpy.context.evaluated_depsgraph_get,
        window=SimpleNamespace(cursor_modal_set=changes.append,
                               cursor_modal_restore=lambda: changes.append("restored")),
        workspace=SimpleNamespace(status_text_set=changes.append),
        window_manager=SimpleNamespace(modal_handler_add=lambda operator: None))
    operator = SimpleNamespace(report=lambda kinds, line: lines.append(line))
    operator.cancel, operator._focus = (lambda *given: Operator.cancel(operator, *given),
                                        lambda *given: Operator._focus(operator, *given))
    assert Operator.invoke(operator, context, None) == {"RUNNING_MODAL"} and changes[0] == "EYEDROPPER"
    return context, operator


def event(type, place=PLACE, **given):
    x_px, y_px = (100 + 320 * (1 + place[0]), 50 + 180 * (1 + place[1]))
    return SimpleNamespace(**{"type": type, "value": "PRESS", "mouse_x": x_px, "mouse_y": y_px, "ctrl": False,
                              "alt": False} | given)


def test_a_click_in_a_view_focuses_and_ends(turned, window):
    context, operator = window
    square = pane(turned)
    bpy.context.view_layer.update()
    for waits in (event("MOUSEMOVE"), event("X"), event("ESC", value="RELEASE"),
                  event("LEFTMOUSE", value="RELEASE")):
        assert Operator.modal(operator, context, waits) == {"RUNNING_MODAL"}
    for passes in (event("WHEELUPMOUSE"), event("TIMER"), event("NUMPAD_0"), event("LEFTMOUSE", alt=True)):
        assert Operator.modal(operator, context, passes) == {"PASS_THROUGH"}
    dof = turned.camera.data.dof
    assert not dof.use_dof and "restored" not in context.changes
    assert Operator.modal(operator, context, event("LEFTMOUSE")) == {"FINISHED"}
    assert dof.focus_distance == pytest.approx(DISTANCE, rel=ROUNDING)
    assert context.changes[-2:] == ["restored", None] and not context.lines
    assert Operator.modal(operator, context, event("LEFTMOUSE", ctrl=True)) == {"FINISHED"}
    assert dof.focus_object == square


@pytest.mark.parametrize("given, line", [
    (event("LEFTMOUSE"), "Nothing there to focus on"),
    (event("LEFTMOUSE", (0.9, 0.0)), "Click in a 3D view to focus"),  # on the sidebar
    (event("LEFTMOUSE", (-1.5, 0.0)), "Click in a 3D view to focus"),
    (event("ESC"), None), (event("RIGHTMOUSE"), None)])
def test_other_clicks_change_nothing_and_say_so(turned, window, given, line):
    context, operator = window
    assert Operator.modal(operator, context, given) == {"CANCELLED"}
    assert context.lines == ([line] if line else []) and context.changes[-2:] == ["restored", None]
    assert not turned.camera.data.dof.use_dof


@pytest.mark.one_blender
def test_a_place_in_a_window_is_one_in_its_view(window):
    context, _ = window
    _, view, place = view_at(context.screen, 100 + 480, 50 + 90)
    assert place == (0.5, -0.5) and view.view_perspective == "CAMERA"


@pytest.fixture(params=["olympus-fisheye-8mm", "kodak-petzval-100mm"])
def distorting(request, turned):
    """The scene with a lens, its facts, and the height of light from some angles on its axis by the baked lens data."""
    turned.camera.data.lensfield.lens = request.param
    lens, facts = load_lens(request.param, quality=SKETCHED), lens_facts(request.param)
    heights_mm = lens.real_height_at(reference_nm(lens))
    return turned, facts, lambda angle: np.interp(angle, field_angle_rad(lens, lens.heights_mm), heights_mm)


@pytest.mark.parametrize("share", [0.2, 0.6])
def test_a_click_on_the_lens_picture_goes_through_the_lens(distorting, share):
    """Light that the baked lens images at a place of the frame is what a click there finds."""
    scene, facts, height_mm = distorting
    tangents = -0.7, -0.4, 0.5, 0.3  # of the picture in the view: any rectangle
    edges_mm = frame_grid(scene, facts).edges_mm
    angle, azimuth = share * facts.angle_rad(min(edges_mm[2:])), 0.7
    place_mm = height_mm(angle) * np.array([np.cos(azimuth), np.sin(azimuth)])
    shares = (place_mm - edges_mm[:2]) / np.subtract(edges_mm[2:], edges_mm[:2])
    in_view = Vector((-0.7 + 1.2 * shares[0], -0.4 + 0.7 * shares[1], -1.0))
    turn = axes(scene).to_3x3()
    start, direction = lens_ray(scene, facts, tangents, (axes(scene).translation, turn @ in_view))
    expected = np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), -np.cos(angle)
    assert tuple(turn.transposed() @ direction) == pytest.approx(expected, abs=2e-3)
    assert (start - axes(scene).translation).length == pytest.approx(scene.camera.data.clip_start, rel=1e-3)
    outside = axes(scene).translation, turn @ Vector((0.6, 0.0, -1.0))
    assert lens_ray(scene, facts, tangents, outside) is outside


def test_a_click_uses_the_lens_only_where_its_picture_is_shown(turned, window, monkeypatch):
    context, _ = window
    area, = context.screen.areas
    space, view = SimpleNamespace(camera=turned.camera), area.regions[0].data
    turned.camera.data.lensfield.lens = "olympus-fisheye-8mm"
    facts_now(turned)
    in_view = clicked_ray(turned, space, view, PLACE)
    frame = SimpleNamespace(tangents=(-0.7, -0.4, 0.7, 0.4))
    monkeypatch.setattr(session, "live", SimpleNamespace(shown=(frame, None)))
    through_lens = clicked_ray(turned, space, view, PLACE)
    assert in_view[1].angle(through_lens[1]) > radians(5)
    view.view_perspective = "PERSP"
    assert clicked_ray(turned, space, view, PLACE) == in_view


@pytest.mark.one_blender
@pytest.mark.parametrize("up_to_date", [True, False])
def test_a_click_on_the_preview_uses_its_frame(turned, window, monkeypatch, tmp_path, up_to_date):
    context, _ = window
    tangents = -0.5, -0.4, 0.7, 0.4
    picture = tmp_path / "preview.png"
    picture.touch()
    monkeypatch.setattr(session, "preview", SimpleNamespace(
        scene_uid=turned.session_uid, loaded=SimpleNamespace(tangents=tangents), up_to_date=up_to_date,
        picture=picture))
    space = SimpleNamespace(camera=turned.camera, overlay=SimpleNamespace(show_overlays=True))
    edges = picture_tangents(turned, space, context.screen.areas[0].regions[0].data)
    assert edges == (pytest.approx(tangents, rel=ROUNDING) if up_to_date else None)
