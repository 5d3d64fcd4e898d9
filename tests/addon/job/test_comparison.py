"""Lenses side by side: one capture serves them all, and each picture is what `apply_lens` and a render give."""

from dataclasses import replace

import bpy
import numpy as np
import pytest
from PIL import Image

from lensfield import addon
from lensfield.addon.render import comparison as comparison_module
from lensfield.addon.scene.look import look_of, shown_pixels
from lensfield.cli import main
from lensfield.engine import InputError, Options, load_lens
from lensfield.engine.lens_files.package import write_package
from lensfield.engine.library import clamped_rings
from lensfield.engine.pictures.spectral_exr import read_exr, read_parts, read_with_layers
from lensfield.engine.plan.options import TIER_ACCURACY
from lensfield.engine.rays.rings import Rings
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from noise import assert_means
from refusals import refused
from small_scenes import WAVELENGTHS_NM, material, wall

SHARP, FAST, WIDE, ANAMORPHIC = "tessar-50mm", "angenieux-50mm", "muller-fisheye-25mm", "cooke-42mm-2x"
QUICK = {"wavelengths_nm": WAVELENGTHS_NM, "spectral": SpectralOptions("preview"),
         "options": Options(accuracy=TIER_ACCURACY["preview"])}


@pytest.fixture
def squares(scene):
    """A near and a far glowing square, off the axis, in front of a dim wall; the camera focuses on the near one."""
    for name, strength, distance_m, side_m, x_m in (("Dim", 0.2, 9, 30, 0), ("Far", 2, 6, 1.2, -0.7),
                                                    ("Near", 1, 1, 0.2, 0.15)):
        glow, shader = material(name, "ShaderNodeEmission", (0.8, 0.5, 0.2))
        shader.inputs["Strength"].default_value = strength
        wall(scene, glow, distance_m, side_m).location.x = x_m
    scene.camera.data.lens = 40
    scene.camera.data.dof.use_dof, scene.camera.data.dof.focus_distance = True, 1.0
    scene.camera.data.dof.aperture_fstop = 4
    scene.cycles.samples = 64
    return scene


def compared(source, lenses, f_numbers, folder, **given):
    comparison = addon.plan_comparison(source, lenses, f_numbers, output_folder=folder, **given)
    return comparison, addon.render_comparison(comparison)


def lens_image(folder):
    path, = folder.glob("*_lens_image.exr")
    return np.stack([read_parts(path)[0][1][channel] for channel in "RGB"], axis=-1)


def test_each_picture_equals_the_lens_applied_to_the_capture(squares, tmp_path):
    """Bit for bit, at the actual f-number; and on the sheet in the look of the scene."""
    comparison, sheet = compared(squares, [SHARP, FAST], [2, 8], tmp_path, **QUICK)
    assert [cell.folder for cell, _ in sheet.cells] == [
        f"{SHARP}_f5.5", f"{SHARP}_f8", f"{FAST}_f2", f"{FAST}_f8"]
    shown = Image.open(sheet.path)
    for (cell, box), f_number in zip(sheet.cells, [2, 8] * 2, strict=True):
        applied = addon.apply_lens(comparison.radiance, lens=cell.lens, view="camera", f_number=f_number, focus=1000.0,
                                   lens_quality="preview", options=QUICK["options"], output_folder=tmp_path / "applied")
        picture, = (tmp_path / cell.folder).glob("*_irradiance.exr")
        assert np.array_equal(read_exr(applied.irradiance).cube, read_exr(picture).cube)
        assert "border" not in "".join(applied.messages)
        pixels = shown_pixels(lens_image(tmp_path / cell.folder), look_of(squares))
        assert np.array_equal(np.asarray(shown.crop(box)), pixels)
    assert f"{comparison.sheet} in " in sheet.messages[0] and "1 Cycles render at" in sheet.messages[1]


@pytest.mark.sample(1)
@pytest.mark.parametrize("lens", [FAST, WIDE])
def test_a_picture_equals_a_render_through_its_lens(squares, tmp_path, lens):
    """In blocks of pixels: the capture has the overscan and the layers of the lens that needs most, whatever the
    order."""
    squares.cycles.samples = 256
    _, sheet = compared(squares, [SHARP, lens], [4], tmp_path, **QUICK)
    fresh = addon.render_through_lens(squares, lens=lens, view="camera", output_folder=tmp_path / "fresh", **QUICK)
    picture, = (tmp_path / sheet.cells[1][0].folder).glob("*_irradiance.exr")
    pixels, expected = (read_exr(path).cube.reshape(3, 3, 12, 4, 12).transpose(0, 1, 3, 2, 4)
                        for path in (picture, fresh.irradiance))
    assert_means(pixels, expected, rtol=0.01, noise=0.03)


@pytest.mark.parametrize("by", ["scene", "command"])
def test_pictures_have_the_requested_stray_light(squares, tmp_path, capfd, by):
    """From the scene's settings, or from the command line; also with a radiance file in place of the scene."""
    squares.cycles.samples = 1
    if by == "scene":
        squares.lensfield.stray_light, squares.lensfield.stray_parts = "PARTS", {"VEIL"}
    squares.lensfield.glare_index = 2.0
    blend, capture = tmp_path / "scene.blend", tmp_path / "one" / "capture" / "scene_Scene_0001_radiance.exr"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    given = [] if by == "scene" else ["--stray", "veil", "--glare-index", "2"]
    for source, name, options in ((blend, "one", given), (capture, "two", ["--stray", "veil", "--glare-index", "2"]),
                                  (capture, "dark", ["--stray", "off"])):
        focus = ["--focus", "1m"] if source == capture else []
        assert main(["compare", str(source), "--lens", SHARP, "--output", str(tmp_path / name), *focus,
                     *(["--wavelengths", "450,550,650", "--samples", "1"] if source == blend else []), *options]) == 0
    veils = [read_parts(next((tmp_path / name).glob("*_f*/*_stray_light.exr")))[0][1]["G"]
             for name in ("one", "two", "dark")]
    assert veils[0].min() > 0 and np.array_equal(veils[0], veils[1]) and not veils[2].any()


@pytest.mark.parametrize("aspect", [1.0, 2.0])
def test_an_anamorphic_lens_shows_the_same_view_on_the_sheet(squares, tmp_path, aspect):
    """With the squeeze undone, also in a scene whose pixels have it; and the scene stays as it was."""
    render = squares.render
    render.resolution_x, render.pixel_aspect_x = round(96 / aspect), aspect
    render.resolution_y, squares.cycles.samples = 72, 64
    comparison, sheet = compared(squares, [FAST, ANAMORPHIC], [8], tmp_path, **QUICK | {"look": "standard"})
    assert (render.resolution_x, render.resolution_y, render.pixel_aspect_x) == (round(96 / aspect), 72, aspect)
    squeezes = [read_exr(each.radiance).squeeze for each in comparison.captures]
    assert squeezes[0] == 1 and squeezes[1] == pytest.approx(1.98, abs=0.01)
    assert [(right - left, bottom - top) for _, (left, top, right, bottom) in sheet.cells] == [(96, 72)] * 2
    shown, places = Image.open(sheet.path).convert("L"), []
    for _, box in sheet.cells:
        pixels = np.asarray(shown.crop(box), float)
        bright = np.argwhere(pixels > (pixels.min() + pixels.max()) / 2)
        places.append((*bright.mean(axis=0), *bright.std(axis=0)))
    np.testing.assert_allclose(*places, atol=1.0)


def test_layers_are_captured_if_any_lens_needs_them(squares, tmp_path):
    squares.cycles.samples = 1
    alone, _ = compared(squares, [SHARP], [22], tmp_path / "alone", **QUICK)
    both, _ = compared(squares, [SHARP, FAST], [1.1], tmp_path / "both", **QUICK)
    counts = [len(layers.layers) if (layers := read_with_layers(each.radiance)[2]) else 0 for each in (alone, both)]
    assert counts[0] < counts[1] and counts[1] > 1


def test_remarks_on_the_capture_hold_for_all_lenses(squares, tmp_path):
    """Those on one lens name it."""
    squares.cycles.samples, squares.render.resolution_x, squares.render.resolution_y = 1, 192, 144
    wall(squares, material("Glass", "ShaderNodeBsdfGlass")[0], 2, 0.8).name = "Pane"
    write_package(replace(load_lens("edmund-54852"), name="Edmund"), tmp_path / "plain.npz")
    _, sheet = compared(squares, [str(tmp_path / "plain.npz"), SHARP, FAST], (), tmp_path / "sheet", **QUICK)
    assert not any(line.startswith(("Lens ", "In focus: ")) for line in sheet.messages)
    assert any(line.startswith("plain.npz: Edmund") and "a package without rays" in line for line in sheet.messages)
    pane, = (line for line in sheet.messages if line.startswith("Glass 'Pane'"))
    assert ": up to " in pane and "Traced Lens" not in pane


def test_a_radiance_file_replaces_the_scene(squares, tmp_path):
    """Also with other lenses, except one that it cannot serve: this is refused before any picture."""
    squares.cycles.samples = 1
    first, _ = compared(squares, [SHARP], [8], tmp_path, **QUICK)
    comparison, sheet = compared(first.radiance, ["cooke-triplet-50mm"], (), tmp_path / "more", lens_quality="preview")
    assert [cell.label for cell, _ in sheet.cells] == ["Cooke Triplet 50 mm f/5"]
    assert sheet.messages[1] == f"from the light in {first.radiance}" and sheet.path.parent == tmp_path / "more"
    with refused(InputError, field="overscan", match="edmund-54852, scaled by "):
        addon.plan_comparison(first.radiance, [SHARP, "edmund-54852"], output_folder=tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_what_a_lens_does_not_have_is_announced_and_shown(squares, tmp_path):
    comparison = addon.plan_comparison(squares, [SHARP, FAST], [2, 2.8], output_folder=tmp_path, **QUICK)
    assert comparison.words == tuple(f"Zeiss Tessar 50 mm f/5.5: {words}" for f_number in (2.0, 2.8)
                                     for words in clamped_rings("tessar-50mm", Rings(f_number=f_number)))
    assert [[cell.label for cell in row] for row in comparison.rows] == [
        ["Zeiss Tessar 50 mm f/5.5"] * 2, ["Angénieux 50 mm f/1.1 at f/2", "Angénieux 50 mm f/1.1 at f/2.8"]]
    assert len(comparison.pictures) == 3  # the Tessar's picture is shared
    squares.camera.data.dof.use_dof = False
    (cell,), = addon.plan_comparison(squares, [FAST], output_folder=tmp_path, **QUICK).rows
    assert cell.label == "Angénieux 50 mm f/1.1" and cell.rings.focus_mm is None  # wide open, at infinity


def test_requests_that_cannot_be_met_are_refused_before_the_render(squares, tmp_path):
    def refuses(lenses, field, value, match=None, **given):
        with refused(InputError, field=field, value=value, match=match):
            addon.plan_comparison(squares, lenses, output_folder=tmp_path / "none", **QUICK | given)
        assert not (tmp_path / "none").exists()

    refuses([SHARP, SHARP], "lens", SHARP, "named like another lens")
    refuses([SHARP, "no-such-lens"], "lens", "missing", "no-such-lens")
    refuses([SHARP], "depth", "traced", "expected auto or off: a traced lens stores no light", depth="traced")
    refuses([SHARP], "wavelength", "390 nm", wavelengths_nm=(390.0, 550.0))
    own = tmp_path / f"{SHARP}_f8" / "unsaved_Scene_0001_after.png"
    own.parent.mkdir()
    own.write_text("mine")
    with refused(InputError, field="file", value="an existing file that Lensfield did not write",
                 where="unsaved_Scene_0001_after.png"):
        addon.plan_comparison(squares, [SHARP], [8], output_folder=tmp_path, **QUICK)


def test_the_command_compares_at_the_current_frame(squares, tmp_path, capfd):
    squares.frame_set(7)
    blend = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    assert main(["compare", str(blend), "--lens", SHARP, "--lens", f"{FAST},{WIDE}", "--f-number", "8", "--output",
                 str(tmp_path / "out"), "--wavelengths", "450,550,650", "--samples", "1",
                 "--report", str(tmp_path / "report.json")]) == 0
    printed = capfd.readouterr().out
    sheet = tmp_path / "out" / "scene_Scene_0007_contact_sheet.png"
    assert f"{sheet} in " in printed and sheet.is_file() and (tmp_path / "report.json").is_file()
    assert {path.name for path in sheet.parent.iterdir()} == {
        sheet.name, comparison_module.CAPTURE, f"{SHARP}_f8", f"{FAST}_f8", f"{WIDE}_f8"}
