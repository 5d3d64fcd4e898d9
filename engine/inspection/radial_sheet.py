"""The panels of the sheet of a rotationally symmetric lens: curves over image height."""

from collections.abc import Sequence

import numpy as np

from ..lens import RadialLens
from ..prescription.photographs import Vignetting
from .canvas import Page
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
from .page import DISTORTION, LEFT, LEFT_WIDTH, MAP_HEIGHT, MAP_TOP, focal_length_text, write, write_after
from .panels import (
    PathCurves,
    distortion_title,
    draw_curves,
    draw_distortion,
    illumination_nm,
    lateral_nm,
    limits_of,
)
from .psf_map import draw_colour_bar, draw_note, draw_psf_map
from .style import TEXT, TITLE

OUTLINE_POINTS = 361


def radial_facts(lens: RadialLens) -> tuple[str, str]:
    """The focal length and the field of a lens, as text."""
    degrees = np.degrees(field_angle_rad(lens, lens.heights_mm[-1]))
    return focal_length_text(lens.efl_mm), f"±{degrees:.3g}°"


def draw_radial_panels(page: Page, lens: RadialLens, frequencies_per_mm: Sequence[float],
                       photographed: Sequence[Vignetting] = ()) -> None:
    """Draw the PSFs of a lens, and its curves over image height, with the light in photographs."""
    field = field_of(lens)
    _draw_psfs(page, lens, field)
    _draw_distortion(page, lens, field)
    draw_curves(page, lens, [_outwards(lens, field, frequencies_per_mm, photographed)], frequencies_per_mm,
                "solid: sagittal   dashed: tangential")


def _outwards(lens, field, frequencies_per_mm, photographed):
    """The curves from the axis outwards."""
    def angle_rad(height_mm):
        return field_angle_rad(lens, field.geometry.paraxial_height_mm(height_mm))

    tangential, sagittal = white_mtf(lens, frequencies_per_mm)
    corner_mm, heights_mm = np.hypot(*lens.sensor_mm) / 2, field.optics.real_height_mm
    illumination = relative_illumination(lens, illumination_nm(lens))
    return PathCurves(
        heights_mm, 0.0, angle_rad, "image height in mm, field angle", sagittal, tangential,
        illumination, cosine_fourth(lens, lens.heights_mm), lateral_colour_um(lens, lateral_nm(lens)),
        corner_mm if field.reaches_corner else None, limits_of(lens, heights_mm / corner_mm, illumination),
        tuple(photographed))


def _draw_psfs(page, lens, field):
    """Draw the map of PSFs, and its colour bar."""
    title = write(page, LEFT, MAP_TOP + 0.76, "Point spread functions", TITLE)
    right, bottom, hidden = draw_psf_map(page, (LEFT, MAP_TOP), (LEFT_WIDTH, MAP_HEIGHT), lens, field)
    write_after(page, title, right, MAP_TOP + 0.72, "outwards →", TEXT)
    draw_colour_bar(page, right, MAP_TOP)
    draw_note(page, bottom, hidden)


def _draw_distortion(page, lens, field):
    edge_mm = field.geometry.distortion(field.edge_mm)
    half_mm = np.array(lens.sensor_mm) / 2
    title = distortion_title([distortion_percent(field, field.edge_mm)], field.reaches_corner)
    angle = f"±{np.degrees(field_angle_rad(lens, field.edge_mm)):.3g}°"
    turns = np.linspace(0, 2 * np.pi, OUTLINE_POINTS)
    end_mm = edge_mm * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    draw_distortion(page, DISTORTION, lens, distortion_grid(lens, field), edge_mm * half_mm / np.hypot(*half_mm),
                    f"{title}, {angle}", None if field.reaches_corner else end_mm)
