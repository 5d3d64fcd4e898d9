"""Fitting a lens to photographs in Blender, and the marks of lenses that were compared with photographs."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from flat_pictures import flat_light, mounted, write_flat
from layouts import Layout
from lensfield.addon.scene.lens_facts import lens_facts
from lensfield.addon.ui import sheets
from lensfield.addon.ui.common import lens_worker
from lensfield.addon.ui.common.properties import COMPARED, lens_title, offered_lenses
from lensfield.addon.ui.fit_lens import LENSFIELD_OT_fit_lens, fitted_name
from lensfield.addon.ui.operators import LENSFIELD_OT_show_sheet
from lensfield.addon.ui.panels import draw_settings
from lensfield.engine.fitting.even_light import EvenField
from lensfield.engine.fitting.rims import with_rims
from lensfield.engine.fitting.vignetting import COLUMNS, light_of
from lensfield.engine.library import described_lenses, prescription_of
from lensfield.engine.prescription.photographs import Vignetting
from lensfield.engine.prescription.readers import read_prescription
from waiting import LAST_RESORT_S

NAME, RIMS_MM, SENSOR_MM = "helios-44-2-58mm", {2: 13.9, 10: 11.4}, (36.0, 24.0)


@pytest.fixture(scope="module")
def truth():
    """The lens with known rims."""
    lens = prescription_of(NAME)
    fields = [EvenField(lens, focus_mm, np.array([0.0, 10.0, 21.6])) for focus_mm in (np.inf, 526.0)]
    return with_rims(lens, fields, RIMS_MM)


@pytest.fixture
def chosen(scene, tmp_path):
    """The settings of a camera with the lens, in a saved .blend in a folder of its own."""
    (tmp_path / "film").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "film" / "scene.blend"))
    settings = bpy.context.scene.camera.data.lensfield
    settings.lens = NAME
    return settings


def fit(folder, names, **options):
    return bpy.ops.lensfield.fit_lens(directory=str(folder), files=[{"name": name} for name in names], **options)


def write_table(path, lens):
    heights_mm = np.linspace(2, 20.5, 8)
    curves = [Vignetting(f_number, np.inf, heights_mm, np.ones(8)) for f_number in (2.0, 2.8, 4.0, 8.0)]
    rows = [f"{curve.f_number},inf,{height:.6g},{light:.6g}" for curve, lights in
            zip(curves, light_of(lens, curves), strict=True) for height, light in zip(heights_mm, lights, strict=True)]
    path.write_text("\n".join([",".join(COLUMNS), *rows]))


def rims_of(path):
    return {index: read_prescription(path).surfaces[index].semi_aperture_mm for index in RIMS_MM}


def test_raw_pictures_give_the_camera_a_fitted_lens(chosen, tmp_path, truth):
    """Pictures of a smaller sensor, without f-numbers, in the order of their names, at 0.7 m. Adjacent surfaces have
    nearly the same effect on their light, so noise decides which of them block it."""
    small_mm = 27.0, 18.0
    for name, f_number in (("c.dng", 2.0), ("a.dng", 8.0), ("b.dng", 2.8), ("d.dng", 4.0)):
        write_flat(tmp_path / name, flat_light(truth, f_number, small_mm, (0.06, 0.03), focus_mm=700.0))
    assert fit(tmp_path, ["c.dng", "a.dng", "d.dng", "b.dng"], f_numbers="8, 2.8, 2, 4", sensor_mm=small_mm,
               focus_m=0.7) == {"FINISHED"}
    assert (chosen.lens, chosen.lens_file) == ("FILE", f"//lenses/{NAME}-fitted.toml")
    stored = tmp_path / "film" / "lenses" / f"{NAME}-fitted.toml"
    photographs = read_prescription(stored).photographs
    lights = [np.concatenate(light_of(lens, photographs.light)) for lens in (read_prescription(stored), truth)]
    np.testing.assert_allclose(*lights, atol=0.03)
    assert photographs.source == "a.dng, b.dng, c.dng and 1 more" and photographs.illumination < 0.03
    assert [(curve.f_number, curve.focus_mm) for curve in photographs.light] == [
        (f_number, 700.0) for f_number in (8.0, 2.8, 2.0, 4.0)]
    assert photographs.light[0].heights_mm[-1] < np.hypot(*small_mm) / 2


def test_a_table_of_light_gives_a_new_file_each_time(chosen, tmp_path, truth):
    write_table(tmp_path / "light.csv", truth)
    assert fit(tmp_path, ["light.csv"]) == {"FINISHED"}
    first = tmp_path / "film" / "lenses" / f"{NAME}-fitted.toml"
    assert rims_of(first) == pytest.approx(RIMS_MM, rel=0.02)
    text = first.read_text()
    write_table(tmp_path / "other.csv", with_rims(truth, [EvenField(truth, np.inf, np.array([0.0, 10.0, 21.6]))],
                                                  {2: 13.2, 10: 11.0}))
    assert fit(tmp_path, ["other.csv"]) == {"FINISHED"}  # of the fitted lens
    assert chosen.lens_file == f"//lenses/{NAME}-fitted-2.toml" and first.read_text() == text


@pytest.mark.parametrize("lens, name", [
    ("canon-rf-85mm-f1.2", "canon-rf-85mm-f1.2-fitted"), ("/film/lenses/mine.v2.toml", "mine.v2-fitted"),
    ("/film/lenses/mine-fitted-3.toml", "mine-fitted")])
def test_the_file_of_a_fitted_lens_has_its_name(lens, name):
    assert fitted_name(lens) == name


def test_what_cannot_be_fitted_is_reported_and_the_camera_keeps_its_lens(chosen, tmp_path, truth):
    write_table(tmp_path / "light.csv", truth)
    (tmp_path / "no.dng").write_bytes(b"II*\0")
    write_flat(tmp_path / "dark.dng", flat_light(truth, 2.0, SENSOR_MM), mounted(58.6, 2.0), level=0.01)
    for names, message in (([], "photographs: files is none: choose raw pictures, or a table"),
                           (["no.dng"], "no.dng: raw picture is not readable"),
                           (["light.csv", "dark.dng"], "dark.dng: exposure is .*: expose longer")):
        with pytest.raises(RuntimeError, match=message):
            fit(tmp_path, names)
    chosen.lens = "edmund-54852"
    with pytest.raises(RuntimeError, match="edmund-54852: .*"):
        fit(tmp_path, ["light.csv"])
    assert (chosen.lens, chosen.lens_file) == ("edmund-54852", "") and not (tmp_path / "film" / "lenses").exists()


def test_lenses_without_rims_to_fit_open_no_file_browser(chosen):
    reports = []
    operator = SimpleNamespace(report=lambda kind, text: reports.append(text))
    for lens, message in (("nikkor-reflex-500mm", "surface 5 is a mirror"), ("atlas-42mm-1.5x", "not rotationally")):
        chosen.lens = lens
        assert LENSFIELD_OT_fit_lens.invoke(operator, bpy.context, None) == {"CANCELLED"} and message in reports[-1]
    chosen.lens, chosen.lens_file = "FILE", "//a.npz"
    assert not bpy.ops.lensfield.fit_lens.poll()


def test_each_picture_is_a_step(chosen, tmp_path, truth):
    for f_number in (2.0, 2.8):
        write_flat(tmp_path / f"{f_number}.dng", flat_light(truth, f_number, SENSOR_MM), mounted(58.6, f_number))
    reports, shown = [], []
    operator = SimpleNamespace(
        directory=str(tmp_path), files=[SimpleNamespace(name=name) for name in ("2.0.dng", "2.8.dng")], f_numbers="",
        focus_m=0.0, sensor_mm=(0.0, 0.0), report=lambda kind, text: reports.append(text))
    operator._paths = lambda: LENSFIELD_OT_fit_lens._paths(operator)
    operator._curves = lambda *read: LENSFIELD_OT_fit_lens._curves(operator, *read)
    for fraction in LENSFIELD_OT_fit_lens.steps(operator, bpy.context):
        shown.append((round(fraction, 2), chosen.lens))
    assert shown == [(0.33, NAME), (0.67, NAME)] and chosen.lens == "FILE"
    assert reports[0].startswith("2.0.dng: f/2, illumination tilted by ") and "; illumination ± 0.0" in reports[-1]


def drawn(scene):
    """The panel's layout once its lens and its sheet are ready."""
    lens_worker.lens_request(scene).baked.result(LAST_RESORT_S)
    draw_settings(Layout(), scene)  # requests the sheet
    sheets._sheets.newest.result(LAST_RESORT_S)
    layout = Layout()
    draw_settings(layout, scene)
    return layout


def test_the_panel_marks_lenses_that_were_compared_with_photographs(scene):
    settings = scene.camera.data.lensfield
    settings.lens = "tessar-50mm"
    layout = drawn(scene)
    assert "Not compared with photographs" in " ".join(layout.labels) and "lensfield.fit_lens" in layout.shown
    assert layout.shown.count("lensfield.show_sheet") == 1  # below the sheet
    settings.lens = NAME
    layout = drawn(scene)
    assert layout.shown.count("lensfield.show_sheet") == 2
    tooltip = LENSFIELD_OT_show_sheet.description(bpy.context, None)
    line = str(described_lenses()[NAME].photographs)
    assert tooltip.startswith(f"C{line[1:]}.\nShow the lens sheet") and line[1:20] in " ".join(layout.labels)


def test_the_list_marks_the_lenses_that_the_command_lists(scene):
    compared = {name: lens for name, lens in described_lenses().items() if lens.photographs}
    offered = {name: (title, text) for name, title, text, *_ in offered_lenses()}
    assert {name for name, (title, _) in offered.items() if COMPARED in title} == set(compared) and len(compared) > 9
    for name, lens in compared.items():
        title, text = offered[name]
        assert title == f"{COMPARED}{lens.title}" and lens_title(name) == lens.title
        assert text.endswith(f"\nC{str(lens.photographs)[1:]}")


def test_the_facts_of_a_fitted_lens_have_the_photograph_of_its_f_stop(chosen, tmp_path, truth):
    write_table(tmp_path / "light.csv", truth)
    fit(tmp_path, ["light.csv"])
    dof = bpy.context.scene.camera.data.dof
    dof.use_dof = True
    for f_number, expected in ((4.0, [4.0]), (5.6, [])):
        dof.aperture_fstop = f_number
        facts = lens_worker.facts_now(bpy.context.scene)
        assert [curve.f_number for curve in facts.photographs.light] == expected
    assert lens_facts(chosen.lens_name_or_path()).photographs.light[0].f_number == 2.0
