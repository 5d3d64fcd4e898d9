"""A sheet of a lens's ghosts for a small source: the lens, the ghosts on the sensor, and a table of the strongest."""

import os

import numpy as np

from ..lens import Lens
from ..pictures.preview import save_png
from ..prescription.system import system_of
from ..stray.ghost_table import GhostTable
from .cross_section import draw_cross_section
from .page import DPI, LEFT, MARGIN, SIDE, add_panel, write
from .style import INK, PALE_INK, SMALL, TEXT, TITLE, require_matplotlib

NAMED = 6  # in the picture
DECADES = 4  # of its scale
HEADINGS = "surfaces", "of the light", "x, mm", "y, mm", "radius, mm"
COLUMNS = 0.0, 1.9, 3.6, 5.0, 6.4  # of the table, inches
LINE = 0.26  # of the table, inches


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
    """Draw the sheet to a PNG.

    Raises
    ------
    InputError
        matplotlib is not installed.
    """
    figure_class = require_matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = figure_class(figsize=(SIDE, SIDE), dpi=DPI, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    title = f"{lens.name}: ghosts of a point {table.angle_deg:g}\u00b0 above the axis"
    write(figure, MARGIN, SIDE - MARGIN, title, TITLE)
    _draw_lens(add_panel(figure, LEFT, 8.4, SIDE - 2 * LEFT, 2.9), system_of(lens.prescription))
    _draw_picture(add_panel(figure, LEFT, 4.2, SIDE - 2 * LEFT, 3.9), table, lens)
    for number, cells in enumerate((HEADINGS, *map(_cells, table.rows))):
        for column, cell in zip(COLUMNS, cells, strict=True):
            write(figure, LEFT + column, 3.6 - LINE * number, cell, SMALL, INK if number else PALE_INK)
    canvas.draw()
    save_png(np.array(canvas.buffer_rgba()), path)


def _draw_lens(panel, system):
    """The cross section with the numbers of its surfaces."""
    draw_cross_section(panel, system)
    vertices_mm = np.cumsum([0.0, *(surface.thickness_mm for surface in system.prescription.surfaces)])[:-1]
    low = panel.get_ylim()[0]
    for number, z_mm in enumerate(vertices_mm, 1):
        panel.text(z_mm, low, str(number), fontsize=SMALL, color=PALE_INK, ha="center",
                   va="bottom" if number % 2 else "top")  # they may be close to one another


def _draw_picture(panel, table, lens):
    """Irradiance on the sensor in decades below its maximum, with the strongest ghosts' surfaces at their middles."""
    half_mm, picture = np.array(lens.sensor_mm) / 2, table.irradiance
    decades = np.log10(np.maximum(picture / max(picture.max(), np.finfo(float).tiny), 10.0 ** -DECADES))
    panel.imshow(decades, cmap="magma", vmin=-DECADES, vmax=0, aspect="equal",
                 extent=(-half_mm[0], half_mm[0], -half_mm[1], half_mm[1]))
    for row in table.rows[:NAMED]:
        panel.text(row.x_mm, row.y_mm, "{}\u2013{}".format(*row.surfaces), fontsize=TEXT, color="white", ha="center",
                   va="center", clip_on=True)
    panel.set_title(f"Irradiance on the sensor, mm; {DECADES} decades", fontsize=SMALL, color=INK, loc="left")
