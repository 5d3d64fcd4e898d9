"""A sheet of a lens's ghosts for a small source: the lens, the ghosts on the sensor, and a table of the strongest."""

import os
from dataclasses import dataclass, replace

import numpy as np

from ..depth.iris import Iris, opening
from ..image.pixel_grid import PixelGrid
from ..lens import Lens
from ..lens.entrance_pupil import entrance_pupil_size_mm
from ..prescription.coatings import IDEAL
from ..prescription.system import system_of
from ..runtime.errors import LensError
from ..runtime.files import atomic_path
from ..stray.ghosts import ghosts
from ..stray.sources import Sources
from ..stray.stray_light import no_ghosts
from .cross_section import draw_cross_section
from .page import DPI, LEFT, MARGIN, SIDE, add_panel, write
from .style import INK, PALE_INK, SMALL, TEXT, TITLE, require_matplotlib

WIDTH_PX = 360
ROWS = 12  # of the table
NAMED = 6  # in the picture
DECADES = 4  # of its scale
HEADINGS = "surfaces", "of the light", "x, mm", "y, mm", "radius, mm"
COLUMNS = 0.0, 1.9, 3.6, 5.0, 6.4  # of the table, inches
LINE = 0.26  # of the table, inches


@dataclass(frozen=True)
class GhostRow:
    """The ghost of a pair of surfaces, on the sensor's frame.

    Attributes
    ----------
    surfaces : (int, int)
        Numbers of the surfaces that reflect, from 1, the front one first.
    share : float
        Its light, as a share of the light of the source that the lens transmits to its image on the axis.
    x_mm, y_mm : float
        Centroid from the middle of the sensor, to the right and up.
    radius_mm : float
        Radius of the disc with its second moment.
    """

    surfaces: tuple[int, int]
    share: float
    x_mm: float
    y_mm: float
    radius_mm: float


def ghost_table(lens: Lens, angle_deg: float, iris: Iris | None = None, rows: int = ROWS
                ) -> tuple[list[GhostRow], float, np.ndarray]:
    """The strongest ghosts of a point at infinity above the axis, in white light of equal energy.

    Parameters
    ----------
    lens : Lens
        With a prescription.
    angle_deg : float
        Between the source and the axis.
    iris : Iris, optional
    rows : int
        Number of ghosts.

    Returns
    -------
    list of GhostRow
        Strongest first.
    float
        Light of all ghosts, as a share like `GhostRow.share`.
    array (row, column)
        Irradiance on the sensor, relative to the irradiance of the source at the entrance pupil.

    Raises
    ------
    LensError
        The lens has no ghosts.
    """
    nm = lens.wavelengths_nm
    if word := no_ghosts(lens, nm):
        raise LensError(lens.name, "ghosts", "none", word)
    grid, source = _grid(lens), _source(angle_deg, nm)
    found = _ghosts_of(lens, lens.prescription, source, grid, iris)
    light = np.nansum(found.light, axis=(0, 2)) / _image_light_w(lens, nm)
    strongest = [index for index in np.argsort(-light, kind="stable")[:rows] if light[index]]
    table = [_row(lens, found.pairs[index], float(light[index]), source, grid, iris) for index in strongest]
    return table, float(light.sum()), found.irradiance.mean(axis=0)


def _ghosts_of(lens, prescription, source, grid, iris):
    return ghosts(prescription, source, grid, opening(iris, lens))


def _image_light_w(lens, wavelengths_nm):
    """Light through the entrance pupil to the image of a source of unit irradiance on the axis, of all wavelengths."""
    pupil_m2 = np.pi / 4 * np.prod(entrance_pupil_size_mm(lens)) * 1e-6
    return pupil_m2 * sum(lens.at_wavelength(nm).transmittance for nm in wavelengths_nm)


def _grid(lens):
    width_mm, height_mm = lens.sensor_mm
    return PixelGrid((round(WIDTH_PX * height_mm / width_mm), WIDTH_PX), width_mm / WIDTH_PX * 1e3)


def _source(angle_deg, wavelengths_nm):
    angle = np.radians(angle_deg)
    return Sources(np.array([[0.0, np.sin(angle), np.cos(angle)]]), np.array([np.inf]),
                   np.ones((1, len(wavelengths_nm))), wavelengths_nm, np.zeros(1), (f"{angle_deg:g} degrees",))


def _row(lens, pair, share, source, grid, iris):
    """A ghost's row. Its place is that of the only ghost of the lens if all other surfaces reflect nothing."""
    coated = zip(lens.prescription.surfaces, lens.prescription.surface_coatings, strict=True)
    surfaces = tuple(replace(surface, coating=coating if number in pair else IDEAL)
                     for number, (surface, coating) in enumerate(coated, 1))
    only = _ghosts_of(lens, replace(lens.prescription, surfaces=surfaces), source, grid, iris)
    plane = only.irradiance.sum(axis=0, dtype=np.float64)
    x_mm, y_mm = grid.position_mm(*np.indices(plane.shape))
    total = max(plane.sum(), np.finfo(float).tiny)
    middle = [float((plane * place).sum() / total) for place in (x_mm, y_mm)]
    square = (plane * ((x_mm - middle[0]) ** 2 + (y_mm - middle[1]) ** 2)).sum() / total
    return GhostRow(tuple(pair.tolist()), share, *middle, float(np.sqrt(2 * square)))


def ghost_lines(table: list[GhostRow], total: float) -> list[str]:
    """The table as text."""
    lines = ["  ".join(f"{heading:>12}" for heading in HEADINGS)]
    lines += ["  ".join(f"{cell:>12}" for cell in _cells(row)) for row in table]
    return [*lines, f"all ghosts on the sensor: {total:.2e} of the light"]


def _cells(row):
    first, second = row.surfaces
    x_mm, y_mm = (f"{place + 0.0:.2f}".replace("-0.00", "0.00") for place in (row.x_mm, row.y_mm))
    return f"{first} and {second}", f"{row.share:.2e}", x_mm, y_mm, f"{row.radius_mm:.2f}"


def write_ghost_sheet(lens: Lens, path: str | os.PathLike, angle_deg: float, iris: Iris | None = None) -> list[str]:
    """Draw the sheet to a PNG; returns the table as lines.

    Raises
    ------
    InputError
        matplotlib is not installed, or the lens has no ghosts.
    """
    figure_class = require_matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    table, total, picture = ghost_table(lens, angle_deg, iris)
    figure = figure_class(figsize=(SIDE, SIDE), dpi=DPI, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    write(figure, MARGIN, SIDE - MARGIN, f"{lens.name}: ghosts of a point {angle_deg:g}\u00b0 above the axis", TITLE)
    _draw_lens(add_panel(figure, LEFT, 8.4, SIDE - 2 * LEFT, 2.9), system_of(lens.prescription))
    _draw_picture(add_panel(figure, LEFT, 4.2, SIDE - 2 * LEFT, 3.9), picture, lens, table)
    for number, cells in enumerate((HEADINGS, *map(_cells, table))):
        for column, cell in zip(COLUMNS, cells, strict=True):
            write(figure, LEFT + column, 3.6 - LINE * number, cell, SMALL, INK if number else PALE_INK)
    canvas.draw()
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png")
    return ghost_lines(table, total)


def _draw_lens(panel, system):
    """The cross section with the numbers of its surfaces."""
    draw_cross_section(panel, system)
    vertices_mm = np.cumsum([0.0, *(surface.thickness_mm for surface in system.prescription.surfaces)])[:-1]
    low = panel.get_ylim()[0]
    for number, z_mm in enumerate(vertices_mm, 1):
        panel.text(z_mm, low, str(number), fontsize=SMALL, color=PALE_INK, ha="center",
                   va="bottom" if number % 2 else "top")  # they may be close to one another


def _draw_picture(panel, picture, lens, table):
    """Irradiance on the sensor in decades below its maximum, with the strongest ghosts' surfaces at their middles."""
    half_mm = np.array(lens.sensor_mm) / 2
    decades = np.log10(np.maximum(picture / max(picture.max(), np.finfo(float).tiny), 10.0 ** -DECADES))
    panel.imshow(decades, cmap="magma", vmin=-DECADES, vmax=0, aspect="equal",
                 extent=(-half_mm[0], half_mm[0], -half_mm[1], half_mm[1]))
    for row in table[:NAMED]:
        panel.text(row.x_mm, row.y_mm, "{}\u2013{}".format(*row.surfaces), fontsize=TEXT, color="white", ha="center",
                   va="center", clip_on=True)
    panel.set_title(f"Irradiance on the sensor, mm; {DECADES} decades", fontsize=SMALL, color=INK, loc="left")
