"""The sheet of ghosts: its picture, its names and its table."""

import numpy as np
import pytest
from PIL import Image

from lensfield.engine import load_lens
from lensfield.engine.inspection.axes import Panel
from lensfield.engine.inspection.ghost_sheet import write_ghost_sheet
from lensfield.engine.stray.ghost_table import GhostRow, GhostTable
from written import check_legible, written

WHITE = 255


@pytest.fixture(scope="module")
def lens():
    return load_lens("edmund-54852", quality="preview", wavelengths_nm=[550])


def table(*places_mm):
    """Ghosts at places, and one bright point on the sensor, a quarter of it from its left and upper edges."""
    irradiance = np.zeros((60, 80))
    irradiance[15, 20] = 1
    rows = [GhostRow((number, number + 3), 1e-5, x_mm, y_mm, 1.0) for number, (x_mm, y_mm) in enumerate(places_mm, 1)]
    return GhostTable(10.0, rows, 1e-4, irradiance)


def test_light_is_where_it_is_on_the_sensor(lens, tmp_path, monkeypatch):
    panels, across = [], Panel.across
    monkeypatch.setattr(Panel, "across", lambda panel, *drawn: panels.append(panel) or across(panel, *drawn))
    write_ghost_sheet(lens, table(), tmp_path / "ghosts.png")
    pixels, box = np.asarray(Image.open(tmp_path / "ghosts.png")).astype(int), panels[0].box
    left, right, top, bottom = (round(140 * side) for side in (box.left, box.right, 12 - box.top, 12 - box.bottom))
    light = pixels[top + 3:bottom - 3, left + 3:right - 3].sum(axis=-1)
    row, column = np.unravel_index(light.argmax(), light.shape)
    assert (row / len(light), column / len(light[0])) == pytest.approx((15.5 / 60, 20.5 / 80), abs=0.02)
    assert box.width / box.height == pytest.approx(4.8 / 3.6) and np.median(light) < 20


def test_texts_are_legible_if_ghosts_meet_and_one_is_beyond_the_sensor(lens, tmp_path):
    with written() as texts:
        write_ghost_sheet(lens, table((0, 0), (0, 0.02), (0, -0.01), (2.4, 1.8), (9.0, 0.0)), tmp_path / "ghosts.png")
    check_legible(texts)
    names = [text for _, text, _ in texts]
    assert {"1–4", "2–5", "3–6", "1 and 4", "9.00"} <= set(names) and "5–8" not in names


def test_surfaces_are_numbered(lens, tmp_path):
    with written() as texts:
        write_ghost_sheet(lens, table(), tmp_path / "ghosts.png")
    numbers = [text for _, text, box in texts if 8 < box.bottom < 9 and text.isdigit()]
    assert numbers == [str(number) for number in range(1, len(lens.prescription.surfaces) + 1)]
