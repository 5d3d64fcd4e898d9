"""The contact sheet: where its pictures and labels are."""

import numpy as np
import pytest
from PIL import Image

from lensfield.engine.inspection import contact_sheet
from lensfield.engine.inspection.contact_sheet import PAPER, write_contact_sheet

SHAPE_PX = 30, 44


@pytest.fixture
def rows():
    """Two rows of three different pictures, none of them symmetric."""
    return np.random.default_rng(0).integers(0, 256, (2, 3, *SHAPE_PX, 3), np.uint8)


def cut(path, box):
    return np.asarray(Image.open(path).crop(box))


def test_each_picture_is_in_its_box_and_its_label_below(rows, tmp_path):
    """Unchanged, and not mirrored. Without a label the area below a picture is empty."""
    path = tmp_path / "sheet.png"
    boxes = write_contact_sheet(rows, [["f/2", "", "Angénieux at f/1.1"]] * 2, path)
    lines = np.ptp(np.asarray(boxes)[..., :2].reshape(2, 3, 2), axis=0), np.ptp(np.asarray(boxes)[..., 1], axis=1)
    assert not lines[0][:, 0].any() and not lines[1].any()  # columns and rows are straight
    for in_row, in_boxes in zip(rows, boxes, strict=True):
        for pixels, box in zip(in_row, in_boxes, strict=True):
            assert np.array_equal(cut(path, box), pixels)
        below = [cut(path, (left, bottom, right, bottom + 20)) for left, _, right, bottom in in_boxes]
        assert [bool((part != PAPER).any()) for part in below] == [True, False, True]


def test_a_label_as_long_as_any_lens_name_fits_and_a_longer_one_is_cut(rows, tmp_path):
    longest, endless = "Zeiss Sonnar Superachromat 250 mm f/5.6 at f/22", "own lens " * 30
    for text in (longest, endless):
        font = contact_sheet._font([text], contact_sheet.LEAST_WIDTH_PX)
        shown = contact_sheet._fitted(text, font, contact_sheet.LEAST_WIDTH_PX)
        assert font.getlength(shown) <= contact_sheet.LEAST_WIDTH_PX
        assert (shown == text) == (text == longest)
    write_contact_sheet(rows, [[endless] * 3] * 2, tmp_path / "sheet.png")


def test_large_pictures_are_scaled_down_evenly(rows, tmp_path, monkeypatch):
    monkeypatch.setattr(contact_sheet, "MOST_PIXELS", rows[..., 0].size / 4)
    even = np.full_like(rows, 77)
    path = tmp_path / "sheet.png"
    (box, *_), _ = write_contact_sheet(even, [[""] * 3] * 2, path)
    assert (box[2] - box[0], box[3] - box[1]) == (SHAPE_PX[1] // 2, SHAPE_PX[0] // 2)
    assert (cut(path, box) == 77).all()
