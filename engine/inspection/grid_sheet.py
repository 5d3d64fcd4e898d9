"""The panels of the sheet of a lens without rotational symmetry: PSFs as in the picture, and curves along x and y."""

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..field.field_map import field_map
from ..lens import GridLens
from .curves import WHITE_NM, reference_nm, white_contrast
from .grid_curves import (
    Path,
    angle_rad,
    displacement_um,
    distortion_lines,
    distortion_percent,
    mirror_image,
    paths,
    psfs_at,
    reference_field,
    relative_illumination,
)
from .page import (
    DISTORTION,
    ILLUMINATION,
    LATERAL_COLOUR,
    LEFT,
    LEFT_WIDTH,
    MAP_HEIGHT,
    MAP_TOP,
    MTF,
    add_panel,
    focal_length_text,
    write,
)
from .panels import (
    DASHES,
    MOST_ILLUMINATIONS,
    Line,
    distortion_title,
    draw_distortion,
    draw_illumination,
    draw_lateral_colour,
    draw_legend,
    draw_mtf,
    label_mtf,
    label_wavelengths,
    lateral_colour_title,
)
from .psf_map import (
    add_map,
    draw_colour_bar,
    draw_note,
    draw_single,
    draw_white,
    even_indices,
    hidden_share,
    shown_wavelengths,
)
from .style import INK, PALE_INK, SMALL, TEXT, TITLE, degree_labels
from .white_light import in_white_light

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TILES = 3, 5  # along the short and the long side of the sensor
MAP_GAP = 0.27  # between the two maps, in inches, as all lengths here
PANEL_GAP = 0.3
LABEL_ROOM = 0.3  # for the labels at the right ends of curves
TICKS = {2: 5, 3: 3, 4: 2}  # on each of as many panels side by side
OUTLINE_POINTS = 301


def grid_facts(lens: GridLens) -> tuple[str, str]:
    """The focal lengths and the field of a lens, as text."""
    width, height = lens.sensor_mm
    across, up = np.degrees(angle_rad(lens, np.array([width / 2, 0.0]), np.array([0.0, height / 2])))
    squeeze = "" if lens.squeeze == 1 else f", squeeze {lens.squeeze:.3g}×"
    return focal_length_text(lens.efl_mm) + squeeze, f"±{across:.3g}° × ±{up:.3g}°"


def draw_grid_panels(figure: "Figure", lens: GridLens, frequencies_per_mm: Sequence[float]) -> None:
    """Draw the PSFs of a lens over its picture, and its curves along x, y and diagonals."""
    lines = paths(lens)
    reach = field_map(lens).covered_diagonal(lens.sensor_mm)
    _draw_psfs(figure, lens, reach)
    _draw_distortion(add_panel(figure, *DISTORTION), lens, reach)
    _draw_mtf(figure, lens, lines, frequencies_per_mm)
    _draw_illumination(figure, lens, lines)
    _draw_lateral_colour(figure, lens, lines[:2])


def _draw_psfs(figure, lens, reach):
    """Draw the maps of PSFs at the reference wavelength and in white light, and their colour bar."""
    width, height = lens.sensor_mm
    rows, columns = TILES if width >= height else TILES[::-1]
    x_mm, y_mm = (reach * side / 2 * np.linspace(-1, 1, count) for side, count in ((width, columns), (-height, rows)))
    places_mm = [each.ravel() for each in np.meshgrid(x_mm, y_mm)]
    psfs = psfs_at(lens, *places_mm)
    white = in_white_light(lens, psfs, _along_psf(displacement_um(lens, WHITE_NM, *places_mm)))
    wave = int(np.abs(lens.wavelengths_nm - reference_nm(lens)).argmin())
    single = upright(psfs[wave]).reshape(rows, columns, *psfs.shape[2:][::-1])
    white = upright(white).reshape(rows, columns, *white.shape[2:0:-1], 3)

    side_px = int(figure.dpi * min(LEFT_WIDTH / columns, (MAP_HEIGHT - MAP_GAP) / (2 * rows)))
    side = side_px / figure.dpi  # makes samples of the tiles coincide with pixels of the figure
    right, lower = LEFT + columns * side, MAP_TOP - rows * side - MAP_GAP
    upper_map, lower_map = (add_map(figure, LEFT, top, columns * side, rows * side) for top in (MAP_TOP, lower))
    shown = draw_single(upper_map, single, lens.psf_pitch_um, side_px)
    draw_white(lower_map, white, lens.psf_pitch_um, side_px)
    write(figure, LEFT, MAP_TOP + 0.76, "Point spread functions, as in the picture", TITLE)
    write(figure, right, MAP_TOP + 0.74, f"at {lens.wavelengths_nm[wave]:.4g} nm", TEXT, ha="right")
    write(figure, right, lower + 0.2, "in white light", TEXT, ha="right")
    _label_tiles(lens, (upper_map, lower_map), x_mm, y_mm)
    draw_colour_bar(figure, shown, right, MAP_TOP)
    draw_note(figure, lower - rows * side, hidden_share(single, lens.psf_pitch_um))


def upright(psfs: np.ndarray) -> np.ndarray:
    """PSFs (place, v, u, ...) with axes that `tile` draws to the right and downwards."""
    return mirror_image(psfs, 1).swapaxes(1, 2)


def _along_psf(displacement_um):
    """Displacements along v and u."""
    return displacement_um[..., ::-1]


def _label_tiles(lens, maps, x_mm, y_mm):
    """Label columns with x and rows with y, and with their field angles."""
    upper, _ = maps
    across, up = (np.degrees(angle_rad(lens, *place)) for place in
                  ((x_mm, np.zeros_like(x_mm)), (np.zeros_like(y_mm), y_mm)))
    upper.xaxis.tick_top()
    upper.set_xticks(np.arange(x_mm.size) + 0.5, _place_labels(x_mm, across))
    for each in maps:
        each.set_yticks(np.arange(y_mm.size) + 0.5, _place_labels(y_mm, up))
        each.tick_params(length=0)


def _place_labels(places_mm, degrees):
    return [f"{mm + 0.0:.3g} mm\n{angle}".replace("-", "−") for mm, angle in
            zip(places_mm, degree_labels(degrees), strict=True)]


def _draw_distortion(panel, lens, reach):
    half_mm = np.array(lens.sensor_mm) / 2
    signs = np.array([(1, 1), (-1, 1), (1, -1), (-1, -1)]).T
    if lens.mirrored[1]:
        signs = signs[:, ::2]
    if lens.mirrored[0]:
        signs = signs[:, :signs.shape[1] // 2]
    corners_mm = signs * reach * half_mm[:, None]
    title = distortion_title(distortion_percent(lens, *corners_mm), reach == 1)
    draw_distortion(panel, lens, distortion_lines(lens), corners_mm, title,
                    None if reach == 1 else partial(_draw_end, lens))


def _draw_end(lens, panel, _):
    """Draw the end of the lens data."""
    x_mm, y_mm = (np.linspace(-side, side, OUTLINE_POINTS) / 2 for side in lens.sensor_mm)
    known = np.asarray(reference_field(lens).within(x_mm, y_mm[:, None]), float)
    panel.contour(x_mm, y_mm, known, [0.5], colors=PALE_INK, linestyles=[DASHES], linewidths=1, zorder=3)


def _draw_mtf(figure, lens, lines, frequencies_per_mm):
    panels = _side_by_side(figure, MTF, len(lines))
    for panel, line in zip(panels, lines, strict=True):
        places_mm = line.places_mm(line.along_mm)
        moved_um = _along_psf(displacement_um(lens, WHITE_NM, *places_mm))
        horizontal, vertical = white_contrast(lens, psfs_at(lens, *places_mm), moved_um, frequencies_per_mm)
        draw_mtf(panel, _line(lens, line, len(lines)), frequencies_per_mm, vertical, horizontal,
                 "MTF in white light" if line is lines[0] else "")
    label_mtf(panels[-1], frequencies_per_mm, vertical, "lines: solid vertical, dashed horizontal")


def _draw_illumination(figure, lens, lines):
    left, bottom, width, height = ILLUMINATION
    panels = _side_by_side(figure, (left, bottom, width - LABEL_ROOM, height), len(lines))
    nm = lens.wavelengths_nm[even_indices(lens.wavelengths_nm.size, MOST_ILLUMINATIONS)]
    curves = [relative_illumination(lens, nm, *line.places_mm(line.along_mm)) for line in lines]
    for panel, line, each in zip(panels, lines, curves, strict=True):
        cosine = np.cos(angle_rad(lens, *line.places_mm(line.along_mm)))**4
        draw_illumination(panel, _line(lens, line, len(lines)), nm, each, cosine, max(map(np.max, curves)),
                          "Relative illumination" if line is lines[0] else "")
    panels[-1].set_title("dotted: cos⁴ of the field angle", fontsize=SMALL, loc="right", color=INK)
    label_wavelengths(panels[-1], nm, curves[-1][:, -1])


def _draw_lateral_colour(figure, lens, lines):
    panels = _side_by_side(figure, LATERAL_COLOUR, len(lines))
    nm = lens.wavelengths_nm[shown_wavelengths(lens)]
    for number, (panel, line) in enumerate(zip(panels, lines, strict=True)):
        curves = displacement_um(lens, nm, *line.places_mm(line.along_mm))[..., number]
        draw_lateral_colour(panel, _line(lens, line, len(lines)), lens, nm, curves,
                            lateral_colour_title(lens) if line is lines[0] else "")
    draw_legend(panels[0], "best")
    label_wavelengths(panels[-1], nm, curves[:, -1])


def _side_by_side(figure, place, count):
    """Panels with a common vertical axis."""
    left, bottom, width, height = place
    each = (width - (count - 1) * PANEL_GAP) / count
    panels = []
    for number in range(count):
        panels.append(add_panel(figure, left + number * (each + PANEL_GAP), bottom, each, height))
        if number:
            panels[-1].sharey(panels[0])
            panels[-1].tick_params(labelleft=False)
    return panels


def _line(lens: GridLens, path: Path, count: int) -> Line:
    """A path as a line of `count` panels side by side."""
    return Line(path.along_mm, path.along_mm[0], lambda along_mm: angle_rad(lens, *path.places_mm(along_mm)),
                f"{path.name} in mm", ticks=TICKS[count])
