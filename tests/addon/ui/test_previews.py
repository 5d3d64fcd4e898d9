"""Sheets of lenses in the panel, and at full size."""

import os
import shutil
from pathlib import Path

import bpy
import numpy as np
import pytest
from PIL import Image, PngImagePlugin

from forged import forge
from layouts import Layout
from lensfield import addon
from lensfield.addon.scene.errors import SceneError
from lensfield.addon.ui import sheets
from lensfield.addon.ui.common import lens_worker, previews
from lensfield.addon.ui.panels import draw_settings
from lensfield.engine.library import BUNDLED
from lensfield.engine.prescription.photographs import Agreement
from lensfield.engine.runtime import cache
from lensfield.engine.runtime.errors import InputError
from refusals import refused
from waiting import LAST_RESORT_S

RED, BLUE = (255, 0, 0), (0, 0, 255)


@pytest.fixture
def user_lens(scene, tmp_path):
    """A user's lens, selected in the scene, that has no sheet yet; its path."""
    path = tmp_path / "own.npz"
    shutil.copy(BUNDLED / "edmund-54852.npz", path)
    scene.camera.data.lensfield.lens = "FILE"
    scene.camera.data.lensfield.lens_file = str(path)
    yield path
    previews.forget_previews()


@pytest.fixture
def drawing(monkeypatch, tmp_path):
    """Draws blank sheets with an empty cache; returns the f-numbers of the drawn lenses."""
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "cache"))
    sheets.forget_sheets()
    drawn = []

    def write(lens, path, photographs):
        drawn.append(round(lens.f_number_effective))
        paint(path, BLUE)
    monkeypatch.setattr(sheets, "write_lens_plot", write)
    yield drawn
    sheets.forget_sheets()


def settle(scene):
    """Draw the panel until its lens and its sheet are ready."""
    drawn(scene)
    lens_worker.lens_request(scene).baked.result(LAST_RESORT_S)
    drawn(scene)
    sheets._sheets.newest.exception(LAST_RESORT_S)


def paint(path, *colours, size=(90, 60), changed_ns=0):
    """A picture of horizontal bands, the first at the top."""
    picture = Image.new("RGB", size)
    for index, colour in enumerate(colours):
        picture.paste(colour, (0, size[1] * index // len(colours), *size))
    picture.save(path)
    os.utime(path, ns=(changed_ns, changed_ns))
    return path


def preview_pixels(preview):
    columns, rows = preview.image_size
    return np.array(preview.image_pixels_float).reshape(rows, columns, 4)


def drawn(scene, **layout):
    layout = Layout(**layout)
    draw_settings(layout, scene)
    return layout


def test_lens_packages_have_their_sheets_next_to_them(tmp_path):
    sheet = paint(tmp_path / "a lens.v2.png", RED)
    assert sheets.stored_sheet(str(tmp_path / "a lens.v2.npz")) == sheet
    assert sheets.stored_sheet(str(tmp_path / "a lens.v2.toml")) is None  # its rings are turned
    for nonsense in ("", ".", "/", "a\0"):
        assert sheets.stored_sheet(nonsense) is None


def test_a_preview_is_upright_and_keeps_its_aspect_ratio(tmp_path):
    pixels = preview_pixels(previews.sheet_preview(paint(tmp_path / "flag.png", RED, BLUE)))
    assert pixels.shape == (60, 90, 4)
    assert pixels[0, 0].tolist() == [0, 0, 1, 1] and pixels[-1, 0].tolist() == [1, 0, 0, 1]  # row 0 is the lowest


def test_a_changed_sheet_is_reloaded(tmp_path):
    path = paint(tmp_path / "sheet.png", RED)
    preview = previews.sheet_preview(path)
    before = preview_pixels(preview)
    assert previews.sheet_preview(path) == preview
    paint(path, BLUE, size=(40, 20), changed_ns=10**9)
    after = preview_pixels(previews.sheet_preview(path))
    assert before[0, 0].tolist() == [1, 0, 0, 1] and after[0, 0].tolist() == [0, 0, 1, 1]
    assert after.shape == (20, 40, 4)


def test_an_unchanged_sheet_is_read_once(tmp_path, monkeypatch):
    path = paint(tmp_path / "sheet.png", RED)
    previews.sheet_preview(path)
    monkeypatch.setattr(previews, "_read", None)
    assert tuple(previews.sheet_preview(path).image_size) == (90, 60)


@pytest.mark.parametrize("damage", [b"", b"no picture", slice(0, 300)])
def test_a_damaged_sheet_is_named(tmp_path, damage):
    path = paint(tmp_path / "sheet.png", *[RED, BLUE] * 20, size=(500, 400))
    path.write_bytes(path.read_bytes()[damage] if isinstance(damage, slice) else damage)
    with refused(SceneError, field="picture", value="not readable", where="sheet.png"):
        previews.sheet_preview(path)


def test_pictures_in_other_formats_are_not_opened(tmp_path, monkeypatch):
    """EPS by its first bytes, which Pillow would pass to Ghostscript."""
    path = tmp_path / "sheet.png"
    path.write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 90 60\n%%EndComments\n%%EOF\n")
    from PIL import EpsImagePlugin

    read = []
    monkeypatch.setattr(EpsImagePlugin, "Ghostscript", lambda *_, **__: read.append(path) or Image.new("RGB", (9, 6)))
    with pytest.raises(SceneError, match="sheet.png: picture is not readable: expected a PNG"):
        previews.sheet_preview(path)
    assert not read


@pytest.mark.parametrize("show", [previews.sheet_preview, previews.load_sheet], ids=["in the panel", "at full size"])
def test_a_huge_picture_is_not_decoded(tmp_path, monkeypatch, scene, show):
    path = tmp_path / "sheet.png"
    Image.new("1", (13300, 13300)).save(path)
    assert path.stat().st_size < 100_000
    monkeypatch.setattr(PngImagePlugin.PngImageFile, "load", None)
    with pytest.raises(SceneError, match="sheet.png: size is 13300 x 13300 px: expected at most 40 million pixels"):
        show(path)
    assert not bpy.data.images


def test_an_unreadable_sheet_is_read_again_after_it_changes(tmp_path, monkeypatch):
    path, read = tmp_path / "sheet.png", []
    path.write_bytes(b"no picture")
    os.utime(path, ns=(0, 0))
    read_it = previews._read
    monkeypatch.setattr(previews, "_read", lambda path: read.append(path) or read_it(path))
    for _ in range(3):
        with refused(SceneError, field="picture", value="not readable", where="sheet.png"):
            previews.sheet_preview(path)
    assert len(read) == 1
    paint(path, BLUE)  # with the same modification time
    assert preview_pixels(previews.sheet_preview(path))[0, 0].tolist() == [0, 0, 1, 1] and len(read) == 2


def test_a_collapsed_sheet_is_not_drawn(scene):
    layout = drawn(scene, folded=True)
    assert not {"picture", "lensfield.show_sheet"} & set(layout.shown) and "Lens Sheet" in layout.labels


def test_the_panel_draws_a_missing_sheet(scene, user_lens, drawing):
    layout = drawn(scene)
    assert not {"picture", "lensfield.show_sheet"} & set(layout.shown)
    assert "appears once the lens is baked" in " ".join(layout.labels)
    settle(scene)
    assert {"picture", "lensfield.show_sheet"} <= set(drawn(scene).shown) and len(drawing) == 1
    assert not user_lens.with_suffix(".png").exists()


@pytest.mark.one_blender
def test_a_sheet_is_drawn_once_per_ring_setting(scene, drawing):
    scene.camera.data.dof.use_dof = True
    for f_number in (8, 11, 8):
        scene.camera.data.dof.aperture_fstop = f_number
        settle(scene)
        assert "picture" in drawn(scene).shown
    assert drawing == [8, 11]


def test_a_sheet_is_cached(scene, user_lens, drawing):
    settle(scene)
    sheets.forget_sheets()
    settle(scene)
    assert "picture" in drawn(scene).shown and len(drawing) == 1


def test_a_sheet_is_drawn_again_with_other_photographs(scene, drawing):
    lens = lens_worker.lens_now(scene)
    first, second = (sheets.draw_sheet(lens, agreement) for agreement in (None, Agreement("mine", illumination=0.01)))
    assert first != second and len(drawing) == 2
    assert sheets.draw_sheet(lens, None) == first and len(drawing) == 2


def test_a_forged_sheet_is_drawn_again(scene, user_lens, drawing, tmp_path):
    settle(scene)
    forge(tmp_path / "cache", "sheets", b"\x89PNG\r\n\x1a\n" + bytes(40))
    sheets.forget_sheets()
    settle(scene)
    assert "picture" in drawn(scene).shown and len(drawing) == 2


def test_a_deleted_sheet_is_drawn_again(scene, user_lens, drawing):
    settle(scene)
    for path in Path(sheets._folder().name).glob("Lens Sheet *.png"):
        path.unlink()
    settle(scene)
    assert "picture" in drawn(scene).shown


def test_the_panel_says_why_a_sheet_is_missing(scene, user_lens, drawing, monkeypatch):
    def refuse(lens, path, photographs):
        raise InputError("lens sheet", "frequencies", "6 of them", "expected 1 to 5")
    monkeypatch.setattr(sheets, "write_lens_plot", refuse)
    settle(scene)
    for _ in range(2):
        assert "expected 1 to 5" in " ".join(drawn(scene).labels)


def test_the_panel_names_a_damaged_sheet(scene, user_lens):
    user_lens.with_suffix(".png").write_text("no picture")
    assert "own.png: picture is not readable" in " ".join(drawn(scene).labels)


def test_the_operator_reloads_a_changed_sheet(scene, user_lens):
    path = paint(user_lens.with_suffix(".png"), RED)
    bpy.ops.lensfield.show_sheet()
    assert bpy.data.images["own.png"].pixels[:3] == (1, 0, 0)
    paint(path, BLUE, size=(8, 8))
    bpy.ops.lensfield.show_sheet()
    assert bpy.data.images["own.png"].pixels[:3] == (0, 0, 1) and tuple(bpy.data.images["own.png"].size) == (8, 8)


def test_the_operator_draws_a_missing_sheet(scene, user_lens, drawing):
    assert bpy.ops.lensfield.show_sheet() == {"FINISHED"} and len(drawing) == 1
    assert [image.packed_file is not None for image in bpy.data.images] == [True]
    scene.camera.data.lensfield.lens_file = ""
    assert not bpy.ops.lensfield.show_sheet.poll()


def test_the_operator_leaves_no_image_of_a_damaged_sheet(scene, user_lens):
    user_lens.with_suffix(".png").write_text("no picture")
    with pytest.raises(RuntimeError, match="own.png: picture is not readable"):
        bpy.ops.lensfield.show_sheet()
    assert not bpy.data.images


def test_previews_are_freed_with_the_addon(scene, user_lens, monkeypatch):
    paint(user_lens.with_suffix(".png"), RED)
    drawn(scene)
    removed = []
    remove = bpy.utils.previews.remove
    monkeypatch.setattr(bpy.utils.previews, "remove", lambda pcoll: (removed.append(len(pcoll)), remove(pcoll)))
    addon.unregister()
    try:
        assert len(removed) == 1 and removed[0] > 0 and not previews._loaded
    finally:
        addon.register()
    assert "picture" in drawn(scene).shown
