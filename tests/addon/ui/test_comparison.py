"""Comparing lenses in a window: the dialog, the render in the background, and the choice on the contact sheet."""

from types import SimpleNamespace

import bpy
import pytest

from layouts import Layout
from lensfield.addon.job.child import COMPARISON
from lensfield.addon.ui import comparison, window_render
from lensfield.addon.ui.panels import draw_settings
from lensfield.addon.ui.session import ComparedLens, LastRender, LastSheet, session
from lensfield.engine.library import bundled_names
from small_scenes import light, material, wall
from snapshot import differences, snapshot

SHARP, FAST = "tessar-50mm", "angenieux-50mm"
BOXES = (12, 12, 60, 48), (72, 12, 120, 48)


@pytest.fixture
def lit_scene(scene, tmp_path):
    light(scene, "POINT", 20.0)
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (0.7, 0.3, 0.05))[0])
    scene.lensfield.wavelength_mode, scene.lensfield.wavelength_list = "LIST", "480, 530, 640"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    yield scene
    window_render.end()
    session.last_sheet, session.last_render = None, LastRender()


@pytest.fixture
def sheet(lit_scene, tmp_path):
    """A sheet with the two lenses, at f-numbers that were chosen."""
    session.last_sheet = LastSheet(tmp_path / "sheet.png", lit_scene.session_uid, True, tuple(
        ComparedLens(lens, f_number, lens, box) for lens, f_number, box in zip(
            (SHARP, FAST), (8.0, 2.0), BOXES, strict=True)))
    return lit_scene


def ticks(*lenses):
    return [{"name": lens, "ticked": True} for lens in lenses]


@pytest.mark.one_blender
def test_ticked_lenses_are_compared_in_the_background_and_one_is_chosen(lit_scene, tmp_path):
    before, size = snapshot(), {"side_px": 60, "samples": 1}
    assert bpy.ops.lensfield.compare(lenses=ticks(FAST, SHARP), f_stops={"2", "8"}, **size) == {"FINISHED"}
    assert not differences(before, snapshot())
    assert session.last_render.icon == "INFO", session.last_render.lines
    path = tmp_path / "lensfield" / COMPARISON / "scene_Scene_0001_contact_sheet.png"
    assert session.last_render.sheet == session.last_sheet.path == path and path.is_file()
    assert [(each.lens, each.f_number) for each in session.last_sheet.lenses] == [
        (FAST, 2.0), (FAST, 8.0), (SHARP, 5.5), (SHARP, 8.0)]
    left, top, right, bottom = session.last_sheet.lenses[1].box
    assert (right - left, bottom - top) == (60, 45)
    panel = Layout()
    draw_settings(panel, lit_scene)
    assert {"picture", "lensfield.show_picture", "lensfield.compare"} <= set(panel.shown)
    assert comparison.CHOOSE in " ".join(panel.labels)
    assert bpy.ops.lensfield.choose_compared(number=1) == {"FINISHED"}
    dof = lit_scene.camera.data.dof
    assert (lit_scene.camera.data.lensfield.lens, dof.use_dof, dof.aperture_fstop) == (FAST, True, 8.0)


def test_a_click_finds_the_picture_under_it(sheet):
    lenses = session.last_sheet.lenses
    assert [comparison.picture_at(lenses, *place) for place in (
        (12, 12), (59.9, 47.9), (60, 20), (72, 12), (100, 48), (100, 47), (5, 5))] == [0, 0, -1, 1, -1, 1, -1]


def test_the_f_stop_is_chosen_only_if_it_was_compared_or_the_camera_sets_it(sheet):
    dof = sheet.camera.data.dof
    dof.use_dof, dof.aperture_fstop = False, 4.0
    session.last_sheet = LastSheet(session.last_sheet.path, sheet.session_uid, False, session.last_sheet.lenses)
    bpy.ops.lensfield.choose_compared(number=1)
    assert (sheet.camera.data.lensfield.lens, dof.use_dof, dof.aperture_fstop) == (FAST, False, 4.0)
    dof.use_dof = True
    bpy.ops.lensfield.choose_compared(number=0)
    assert (sheet.camera.data.lensfield.lens, dof.aperture_fstop) == (SHARP, 8.0)
    with pytest.raises(RuntimeError, match="picture is 2: expected 0 to 1"):
        bpy.ops.lensfield.choose_compared(number=2)


def test_only_the_editor_of_the_sheet_is_clickable_while_its_scene_exists(sheet):
    def clickable(path):
        image = path and SimpleNamespace(filepath=str(path))
        return comparison.LENSFIELD_GGT_pictures.poll(SimpleNamespace(space_data=SimpleNamespace(image=image)))

    assert clickable(session.last_sheet.path)
    assert not clickable(None) and not clickable(session.last_sheet.path.with_name("other.png"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert not clickable(session.last_sheet.path) and not bpy.ops.lensfield.choose_compared.poll()


def test_the_dialog_lists_lenses_and_stops_and_refuses_none(sheet):
    layout, settings = Layout(), comparison.LENSFIELD_OT_compare
    dialog = SimpleNamespace(layout=layout, lenses=[], search="", bl_rna=bpy.ops.lensfield.compare.get_rna_type())
    settings.draw(dialog, bpy.context)
    assert {"f_stops", "side_px", "samples"} <= set(layout.shown)
    with pytest.raises(RuntimeError, match="comparison: lenses is none: tick at least one"):
        bpy.ops.lensfield.compare(lenses=[])


def test_a_picture_has_the_sides_of_the_scene(sheet):
    sheet.render.resolution_x, sheet.render.resolution_y = 1080, 1920
    assert comparison._size_px(sheet, 640) == (360, 640)
    sheet.render.resolution_y = 7
    assert comparison._size_px(sheet, 640) == (640, 4)


@pytest.mark.one_blender
@pytest.mark.parametrize("number, columns, more", [(3, 3, 0), (90, 3, 0), (91, 4, 0), (120, 4, 0), (130, 4, 10)])
def test_the_dialog_grows_with_the_library_and_states_how_many_lenses_it_lacks(monkeypatch, number, columns, more):
    lenses = [SimpleNamespace(name=str(n), ticked=n == 2) for n in range(number)]
    monkeypatch.setattr(comparison, "matching_lenses", lambda search: {lens.name for lens in lenses})
    shown, lacking = comparison._offered(lenses, "")
    assert comparison._columns(lenses) == columns and (len(shown) + lacking, lacking) == (number, more)


@pytest.mark.one_blender
def test_a_search_limits_the_offered_lenses_but_never_hides_ticked_ones(monkeypatch):
    monkeypatch.setattr(comparison, "MOST_OFFERED", 4)
    lenses = [SimpleNamespace(name=name, ticked=name == SHARP) for name in bundled_names()]
    shown, more = comparison._offered(lenses, "")
    assert len(shown) == 4 and more == len(lenses) - 4 and SHARP in [lens.name for lens in shown]
    shown, more = comparison._offered(lenses, "PETZVAL Kodak")
    assert [lens.name for lens in shown] == ["kodak-petzval-100mm", SHARP] and more == 0
