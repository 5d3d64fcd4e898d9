"""Opening a lens file: used as it is, or converted with the answers of the dialog."""

import json
from math import radians
from pathlib import Path

import bpy
import numpy as np
import pytest

from layouts import Layout
from lens_texts import DOT_LENS, LENTIL, PBRT, TOML, ZEMAX, changed
from lensfield.addon.scene.lens_facts import lens_facts
from lensfield.addon.ui.common.previews import drawing_preview
from lensfield.addon.ui.open_lens import DROPPED_ON, LENSFIELD_FH_lens, ask, draw_opened
from lensfield.addon.ui.panels import draw_settings
from lensfield.engine import ReadingOptions, read_prescription
from lensfield.engine.prescription.readers import SUFFIXES
from lensfield.engine.prescription.readers.toml import read_lensfield
from places import SHARED_DATA

pytestmark = pytest.mark.one_blender


def write(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    return str(tmp_path / name)


def open_lens(path, **answers):
    assert bpy.ops.lensfield.open_lens(filepath=path, **answers) == {"FINISHED"}
    settings = bpy.context.scene.camera.data.lensfield
    assert settings.lens == "FILE"
    return settings.lens_file


@pytest.mark.parametrize("name, text", [("lens.toml", TOML), ("LENS.ZMX", ZEMAX)])
def test_a_complete_file_is_used_as_it_is(saved, tmp_path, name, text):
    path = write(tmp_path, name, text)
    assert open_lens(path) == path
    near = write(tmp_path / "film", name, text)
    assert open_lens(near) == f"//{name}"
    assert sorted(file.name for file in (tmp_path / "film").iterdir()) == sorted([name, "scene.blend"])


def test_an_incomplete_file_is_refused_and_the_scene_keeps_its_lens(saved, tmp_path):
    before = saved.camera.data.lensfield.lens
    for path, message in ((write(tmp_path, "lens.lens", DOT_LENS), "lens.lens: field is missing"),
                          (write(tmp_path, "lens.dat", "1 2"), "lens.dat: field is missing"),
                          (str(tmp_path / "no.zmx"), "no.zmx: prescription is missing"), ("", "lens is ")):
        with pytest.raises(RuntimeError, match=message):
            bpy.ops.lensfield.open_lens(filepath=path)
    assert (saved.camera.data.lensfield.lens, saved.camera.data.lensfield.lens_file) == (before, "")


def test_a_file_without_a_lens_opens_no_dialog(saved, tmp_path):
    before = saved.camera.data.lensfield.lens
    one_surface = ZEMAX[:ZEMAX.index("SURF 1")]
    for path, message in ((write(tmp_path, "one.zmx", one_surface), "this file contains no lens"),
                          (write(tmp_path, "text.toml", "not a lens"), "text.toml")):
        with pytest.raises(RuntimeError, match=message):
            bpy.ops.lensfield.open_lens("INVOKE_DEFAULT", filepath=path)
    assert saved.camera.data.lensfield.lens == before


def test_answers_are_stored_with_the_lens_next_to_the_blend(saved, tmp_path):
    path = write(tmp_path, "lens.lens", DOT_LENS)
    assert open_lens(path, field_kind="ANGLE", field_angle=radians(14)) == "//lenses/lens.toml"
    stored = read_lensfield(tmp_path / "film" / "lenses" / "lens.toml")
    assert stored == read_prescription(path, ReadingOptions(("angle_deg", 14.0)))
    higher = {"field_kind": "HEIGHT", "field_height": 12.5, "image_plane": "PARAXIAL"}
    assert open_lens(path, **higher) == open_lens(path, **higher) == "//lenses/lens-2.toml"
    stored = read_lensfield(tmp_path / "film" / "lenses" / "lens-2.toml")
    assert (stored.field, stored.focus) == (("image_height_mm", 12.5), "paraxial")
    assert open_lens(path, field_kind="ANGLE", field_angle=radians(14)) == "//lenses/lens.toml"


def test_files_of_the_user_are_not_overwritten(saved, tmp_path):
    folder = tmp_path / "film" / "lenses"
    folder.mkdir()
    (folder / "lens.toml").write_text("mine")
    (folder / "lens-2.toml").symlink_to("nowhere")
    assert open_lens(write(tmp_path, "lens.lens", DOT_LENS), field_kind="ANGLE") == "//lenses/lens-3.toml"
    assert (folder / "lens.toml").read_text() == "mine" and not (folder / "nowhere").exists()


def test_the_lens_of_an_unsaved_file_is_stored_in_the_users_configuration(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(bpy.utils, "user_resource", lambda kind: str(tmp_path / kind))
    stored = open_lens(write(tmp_path, "lens.lens", DOT_LENS), field_kind="ANGLE")
    assert Path(stored) == tmp_path / "CONFIG" / "lensfield" / "lenses" / "lens.toml" and Path(stored).is_file()


def test_glasses_and_numbers_are_answers(saved, tmp_path):
    path = write(tmp_path, "lens.dat", PBRT)
    with pytest.raises(RuntimeError, match="lens.dat: surface 2, glass is 1.5168: an index without dispersion"):
        bpy.ops.lensfield.open_lens(filepath=path, field_kind="ANGLE")
    open_lens(path, field_kind="ANGLE", glasses=[{"name": "1.5168", "glass": "1.5168/64.2"}])
    assert "1.5168/64.2" in {surface.glass for surface in
                             read_lensfield(tmp_path / "film" / "lenses" / "lens.toml").surfaces}


@pytest.fixture
def dialog(saved, tmp_path):
    """The answers of a new dialog for a file."""
    def answers_for(name, text):
        answers = bpy.context.window_manager.operator_properties_last("lensfield.open_lens")
        for each in answers.bl_rna.properties.keys():
            answers.property_unset(each)
        answers.filepath = write(tmp_path, name, text)
        ask(answers)
        return answers

    return answers_for


def drawn(answers):
    layout = Layout()
    draw_opened(layout, answers)
    return layout


def test_the_dialog_draws_the_lens_and_asks_only_for_what_the_file_lacks(dialog):
    layout = drawn(dialog("lens.toml", TOML))
    assert layout.shown == ["picture", "image_plane"]
    answers = dialog("lens.lens", DOT_LENS)
    layout = drawn(answers)
    assert layout.shown == ["picture", "field_kind", "field_angle", "image_plane"]
    assert "Field \u00b120\u00b0" in layout.labels and "49.04 mm \u00b7 f/10" in layout.labels
    assert "Image circle 35 mm" in layout.labels  # 2 * 49.04 mm * tan(20 deg), less 2 % of distortion
    assert "Focused at infinity" in layout.labels
    assert "Apertures are read as diameters" in " ".join(layout.labels)


def test_the_drawing_follows_the_answers(dialog, monkeypatch):
    answers, drawings = dialog("lens.lens", DOT_LENS), []
    monkeypatch.setattr("lensfield.addon.ui.open_lens.drawing_preview", lambda subject, draw: drawings.append(
        draw()) or drawing_preview(subject, draw))
    drawn(answers)
    answers.field_kind, answers.field_height = "HEIGHT", 5.0
    assert drawn(answers).shown == ["picture", "field_kind", "field_height", "image_plane"]
    assert "Field \u00b15.82\u00b0" in drawn(answers).labels  # atan(5 / 49.04)
    assert not np.array_equal(drawings[0], drawings[1]) and np.array_equal(drawings[1], drawings[2])


def test_the_dialog_asks_for_unknown_glasses_and_reports_what_is_wrong(dialog):
    answers = dialog("lens.zmx", changed(ZEMAX, ("N-BK7", "LAK10C")))
    layout = drawn(answers)
    assert layout.shown == ["glass", "image_plane"] and [glass.name for glass in answers.glasses] == ["LAK10C"]
    assert "LAK10C: in no glass catalogue: perhaps SCHOTT N-LAK10" in " ".join(layout.labels)
    answers.glasses[0].glass = "N-LAK10"
    assert drawn(answers).shown == ["picture", "glass", "image_plane"]
    answers = dialog("lens.lens", changed(DOT_LENS, ("focal_length: 49.00", "focal_length: 60.0")))
    assert drawn(answers).shown == ["field_kind", "field_angle", "image_plane", "allow_mismatch"]
    answers.allow_mismatch = True
    assert "picture" in drawn(answers).shown


def test_the_dialog_asks_for_a_stop_and_an_image_plane(dialog):
    answers = dialog("lens.zmx", changed(ZEMAX, ("  STOP\n", "")))
    assert answers.stop == 1 and drawn(answers).shown == ["picture", "stop", "image_plane"]
    answers.stop = 9
    assert "--stop is 9: expected the number of a surface, 1 to 3" in " ".join(drawn(answers).labels)
    answers = dialog("lens.toml", changed(TOML, ("thickness_mm = 47.5", "thickness_mm = 0.0")))
    assert answers.image_plane == "BEST" and drawn(answers).shown == ["picture", "image_plane"]


def test_the_dialog_asks_which_lens_of_a_file(dialog):
    answers = dialog("lenses.json", json.dumps(LENTIL | {"0002": LENTIL["0001"]}))
    assert drawn(answers).shown == ["which", "image_plane"]
    answers.which = "0001"
    ask(answers)
    assert drawn(answers).shown == ["picture", "which", "field_kind", "field_angle", "image_plane"]


def test_a_field_that_the_lens_cannot_image_is_one_line_under_its_drawing(dialog):
    answers = dialog("lens.lens", DOT_LENS)
    answers.field_angle = radians(89)
    layout = drawn(answers)
    assert layout.shown[0] == "picture" and "reduce the field" in " ".join(layout.labels)


@pytest.mark.skipif(not SHARED_DATA.is_dir(), reason="the lens files of ../shared/data are not there")
@pytest.mark.parametrize("name, answers, efl_mm", [
    ("prescriptions/Cooke_40_degree_field.zmx", {}, 50.0),
    ("prescriptions/rayoptics_ag_dblgauss.seq", {}, 100.0),
    ("prescriptions/muller_US4525038_f25.25.optiland.json", {}, 25.25),
    ("patent_lenses/lens/AI_Nikkor_35mm_F1.4S.lens", {"field_kind": "HEIGHT"}, 35.0)])
def test_real_files_are_opened(saved, name, answers, efl_mm):
    open_lens(str(SHARED_DATA / name), **answers)
    assert lens_facts(saved.camera.data.lensfield.lens_name_or_path()).efl_mm == pytest.approx(efl_mm, rel=0.01)


def test_dropped_files_of_all_kinds_are_opened():
    assert LENSFIELD_FH_lens.bl_file_extensions.split(";") == [*SUFFIXES, ".npz"]
    assert not LENSFIELD_FH_lens.poll_drop(bpy.context) and "VIEW_3D" in DROPPED_ON


def test_the_panel_offers_the_dialog_for_the_file(saved, tmp_path):
    layout = Layout()
    saved.camera.data.lensfield.lens = "FILE"
    draw_settings(layout, saved)
    assert "lensfield.open_lens" not in layout.shown
    open_lens(write(tmp_path, "lens.toml", TOML))
    draw_settings(layout, saved)
    assert "lensfield.open_lens" in layout.shown
