"""The panels of the sheet of a rotationally symmetric lens: curves over image height."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..lens import RadialLens
from .curves import (
    cosine_fourth,
    distortion_grid,
    distortion_percent,
    field_angle_rad,
    field_of,
    lateral_colour_um,
    relative_illumination,
    white_mtf,
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
from .psf_map import draw_colour_bar, draw_note, draw_psf_map, even_indices, shown_wavelengths
from .style import PALE_INK, SMALL, TEXT, TITLE

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def radial_facts(lens: RadialLens) -> tuple[str, str]:
    """The focal length and the field of a lens, as text."""
    degrees = np.degrees(field_angle_rad(lens, lens.heights_mm[-1]))
    return focal_length_text(lens.efl_mm), f"±{degrees:.3g}°"


def draw_radial_panels(figure: "Figure", lens: RadialLens, frequencies_per_mm: Sequence[float]) -> None:
    """Draw the PSFs of a lens, and its curves over image height."""
    field = field_of(lens)
    line = _line(lens, field)
    _draw_psfs(figure, lens, field)
    _draw_distortion(add_panel(figure, *DISTORTION), lens, field)
    _draw_mtf(add_panel(figure, *MTF), lens, line, frequencies_per_mm)
    _draw_illumination(add_panel(figure, *ILLUMINATION), lens, line)
    _draw_lateral_colour(add_panel(figure, *LATERAL_COLOUR), lens, line)


def _line(lens, field):
    """The line from the axis outwards."""
    def angle_rad(height_mm):
        return field_angle_rad(lens, field.geometry.paraxial_height_mm(height_mm))

    return Line(field.optics.real_height_mm, 0.0, angle_rad, "image height in mm, field angle",
                np.hypot(*lens.sensor_mm) / 2 if field.reaches_corner else None)


def _draw_psfs(figure, lens, field):
    """Draw the map of PSFs, and its colour bar."""
    write(figure, LEFT, MAP_TOP + 0.76, "Point spread functions", TITLE)
    shown, right, bottom, hidden = draw_psf_map(figure, (LEFT, MAP_TOP), (LEFT_WIDTH, MAP_HEIGHT), lens, field)
    write(figure, right, MAP_TOP + 0.72, "outwards →", TEXT, ha="right")
    draw_colour_bar(figure, shown, right, MAP_TOP)
    draw_note(figure, bottom, hidden)


def _draw_distortion(panel, lens, field):
    from matplotlib.patches import Circle

    edge_mm = field.geometry.distortion(field.edge_mm)
    half_mm = np.array(lens.sensor_mm) / 2
    title = distortion_title([distortion_percent(field, field.edge_mm)], field.reaches_corner)
    angle = f"±{np.degrees(field_angle_rad(lens, field.edge_mm)):.3g}°"

    def draw_end(panel, sensor):
        circle = Circle((0, 0), edge_mm, facecolor="none", edgecolor=PALE_INK, linestyle=DASHES, zorder=3)
        panel.add_patch(circle).set_clip_path(sensor)

    draw_distortion(panel, lens, distortion_grid(lens, field), edge_mm * half_mm / np.hypot(*half_mm),
                    f"{title}, {angle}", None if field.reaches_corner else draw_end)


def _draw_mtf(panel, lens, line, frequencies_per_mm):
    tangential, sagittal = white_mtf(lens, frequencies_per_mm)
    draw_mtf(panel, line, frequencies_per_mm, sagittal, tangential, "MTF in white light")
    label_mtf(panel, frequencies_per_mm, sagittal, "solid: sagittal   dashed: tangential")


def _draw_illumination(panel, lens, line):
    nm = lens.wavelengths_nm[even_indices(lens.wavelengths_nm.size, MOST_ILLUMINATIONS)]
    curves = relative_illumination(lens, nm)
    draw_illumination(panel, line, nm, curves, cosine_fourth(lens, lens.heights_mm), curves.max(),
                      "Relative illumination")
    draw_legend(panel, labelspacing=0.25)
    if line.corner_mm is not None:
        panel.text(line.corner_mm, 0.98, "corner ", fontsize=SMALL - 1, color=PALE_INK, ha="right", va="top",
                   rotation=90, transform=panel.get_xaxis_transform())


def _draw_lateral_colour(panel, lens, line):
    nm = lens.wavelengths_nm[shown_wavelengths(lens)]
    curves = lateral_colour_um(lens, nm)
    draw_lateral_colour(panel, line, lens, nm, curves, lateral_colour_title(lens))
    draw_legend(panel)
    label_wavelengths(panel, nm, curves[:, -1])
