"""Comparing lenses in a window: the dialog, the render in the background, and the choice on the contact sheet."""

from types import SimpleNamespace

import bpy
import pytest

from layouts import Layout
from lensfield.addon.render.child import COMPARISON
from lensfield.addon.ui import comparison, window_render
from lensfield.addon.ui.common.properties import offered_lenses
from lensfield.addon.ui.common.session import ComparedLens, LastRender, LastSheet, session
from lensfield.addon.ui.panels import draw_settings
from lensfield.engine.library import described_lenses
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


def test_the_dialog_lists_lenses_and_stops_and_refuses_none(sheet, monkeypatch):
    monkeypatch.setattr(comparison, "_grid", lambda window: (4, 3))
    layout, settings = Layout(), comparison.LENSFIELD_OT_compare
    lens = SimpleNamespace(name=SHARP, ticked=True, bl_rna=comparison.LensfieldTick.bl_rna)
    dialog = SimpleNamespace(layout=layout, lenses=[lens], search="", page=1,
                             bl_rna=bpy.ops.lensfield.compare.get_rna_type())
    settings.draw(dialog, bpy.context)
    assert {"f_stops", "side_px", "samples", "picture", "ticked"} <= set(layout.shown)
    assert "To compare: Zeiss Tessar 50 mm f/5.5 (1902)" in layout.labels
    with pytest.raises(RuntimeError, match="Tick at least one lens"):
        bpy.ops.lensfield.compare(lenses=[])


def test_a_picture_has_the_sides_of_the_scene(sheet):
    sheet.render.resolution_x, sheet.render.resolution_y = 1080, 1920
    assert comparison._size_px(sheet, 640) == (360, 640)
    sheet.render.resolution_y = 7
    assert comparison._size_px(sheet, 640) == (640, 4)


@pytest.mark.parametrize("scale", [1.0, 2.0])
@pytest.mark.parametrize("size_px", [(1280, 720), (1600, 900), (3840, 2160), (300, 200)])
def test_the_dialog_fits_its_window(size_px, scale, monkeypatch):
    system = SimpleNamespace(preferences=SimpleNamespace(system=SimpleNamespace(ui_scale=scale)))
    monkeypatch.setattr(comparison, "bpy", SimpleNamespace(context=system))
    columns, rows = comparison._grid(SimpleNamespace(width=scale * size_px[0], height=scale * size_px[1]))
    assert columns >= 1 and rows >= 1
    if size_px[0] > 300:
        assert columns * comparison.COLUMN_PX < size_px[0]
        assert rows * comparison.ROW_WIDGETS + comparison.FRAME_WIDGETS <= size_px[1] / comparison.WIDGET_PX


def test_pages_together_offer_every_lens_that_matches():
    lenses = [SimpleNamespace(name=name, ticked=name == SHARP) for name, *_ in offered_lenses()]
    for search, expected in (("", {lens.name for lens in lenses}), ("PETZVAL Kodak", {"kodak-petzval-100mm"})):
        _, pages = comparison._page(lenses, search, 1, 20)
        listed = [lens.name for page in range(pages) for lens in comparison._page(lenses, search, page + 1, 20)[0]]
        assert {*listed} == expected and len(listed) == len(expected) and pages == -(-len(expected) // 20)
        assert comparison._page(lenses, search, 99, 20) == comparison._page(lenses, search, pages, 20)


def test_lenses_are_sorted_by_title_without_accents_or_case():
    titles = [described_lenses()[name].title for name, *_ in offered_lenses() if name != "FILE"]
    assert titles[0].startswith("Ang\u00e9nieux") and titles.index("Zeiss Tessar 50 mm f/5.5 (1902)") > len(titles) / 2
    letters = [title.replace("\u00e9", "e").replace("\u00fc", "u").casefold() for title in titles]
    assert letters == sorted(letters)
