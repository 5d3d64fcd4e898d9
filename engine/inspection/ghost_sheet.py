"""A sheet of a lens's ghosts for a small source: the lens, the ghosts on the sensor, and a table of the strongest."""

import os

import numpy as np

from ..lens import Lens
from ..pictures.preview import save_png
from ..prescription.system import system_of
from ..stray.ghost_table import GhostTable
from .axes import LINE_PT, Panel, labels_of
from .canvas import Box, first_free
from .colour_map import smooth
from .cross_section import draw_cross_section
from .page import LEFT, MARGIN, SIDE, new_sheet, write
from .style import INK, PALE_INK, SMALL, TEXT, TITLE

NAMED = 6  # in the picture
DECADES = 4  # of its scale
HEADINGS = "surfaces", "of the light", "x, mm", "y, mm", "radius, mm"
COLUMNS = 0.0, 1.9, 3.6, 5.0, 6.4  # of the table, inches
LINE = 0.26  # of the table, inches
LENS, PICTURE = Box(LEFT, 8.75, SIDE - 2 * LEFT, 2.55), Box(LEFT, 4.2, SIDE - 2 * LEFT, 3.8)
NUMBER_LINE, NUMBER_LINES = 0.16, 4  # distance and most of the lines of surface numbers
MOST_TICKS = 9


def ghost_lines(table: GhostTable) -> list[str]:
    """The table as text."""
    lines = ["  ".join(f"{heading:>12}" for heading in HEADINGS)]
    lines += ["  ".join(f"{cell:>12}" for cell in _cells(row)) for row in table.rows]
    return [*lines, f"all ghosts on the sensor: {table.total:.2e} of the light"]


def _cells(row):
    first, second = row.surfaces
    x_mm, y_mm = (f"{place + 0.0:.2f}".replace("-0.00", "0.00") for place in (row.x_mm, row.y_mm))
    return f"{first} and {second}", f"{row.share:.2e}", x_mm, y_mm, f"{row.radius_mm:.2f}"


def write_ghost_sheet(lens: Lens, table: GhostTable, path: str | os.PathLike) -> None:
    """Draw the sheet to a PNG."""
    page = new_sheet()
    title = f"{lens.name}: ghosts of a point {table.angle_deg:g}\u00b0 above the axis"
    write(page, MARGIN, SIDE - MARGIN, title, TITLE)
    _draw_lens(page, system_of(lens.prescription))
    _draw_picture(page, table, lens)
    for number, cells in enumerate((HEADINGS, *map(_cells, table.rows))):
        for column, cell in zip(COLUMNS, cells, strict=True):
            write(page, LEFT + column, 3.6 - LINE * number, cell, SMALL, INK if number else PALE_INK)
    save_png(page.pixels(), path)


def _draw_lens(page, system):
    """The cross section, and below it the numbers of its surfaces, in as many lines as they need."""
    panel = draw_cross_section(page, LENS, system)
    vertices_mm = np.cumsum([0.0, *(surface.thickness_mm for surface in system.prescription.surfaces)])[:-1]
    taken = []
    for number, (x, _) in enumerate(panel.places(vertices_mm, panel.y.low), 1):
        boxes = (page.text_box(x, LENS.bottom - NUMBER_LINE * line, str(number), SMALL, across=0.5)
                 for line in range(NUMBER_LINES))
        if free := first_free(boxes, taken):
            taken.append(page.write(free.left, free.top, str(number), SMALL, PALE_INK))


def _draw_picture(page, table, lens):
    """Irradiance on the sensor in decades below its maximum, with the strongest ghosts' surfaces at their middles."""
    half_mm, picture = np.array(lens.sensor_mm) / 2, table.irradiance
    decades = np.log10(np.maximum(picture / max(picture.max(), np.finfo(float).tiny), 10.0 ** -DECADES))
    panel = Panel.to_scale(page, PICTURE, -half_mm, half_mm)
    page.picture(smooth(1 + decades / DECADES), panel.box)
    page.frame(panel.box, INK, LINE_PT)
    x_ticks, y_ticks = panel.x.ticks(MOST_TICKS), panel.y.ticks(MOST_TICKS)
    panel.across(x_ticks, labels_of(x_ticks))
    panel.upwards(y_ticks, labels_of(y_ticks))
    panel.entitle(f"Irradiance on the sensor, mm; {DECADES} decades", SMALL)
    taken = []
    for row in table.rows[:NAMED]:
        name = "{}\u2013{}".format(*row.surfaces)
        (x, y), = panel.places(row.x_mm, row.y_mm)
        boxes = (page.text_box(x, y + NUMBER_LINE * line, name, TEXT, across=0.5, up=0.5)
                 for number in range(NAMED) for line in (-number, number))
        free = first_free(boxes, taken, panel.box)
        if free and panel.box.contains(x, y):
            taken.append(page.write(free.left, free.top, name, TEXT, "#FFFFFF", halo=INK))
