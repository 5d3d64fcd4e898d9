"""The panels of the sheet of a lens without rotational symmetry: PSFs as in the picture, and curves along x and y."""

from collections.abc import Sequence

import numpy as np

from ..field.field_map import field_map
from ..lens import GridLens
from .canvas import Box, Page
from .curves import WHITE_NM, reference_nm, white_contrast
from .grid_curves import (
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
from .psf_map import draw_colour_bar, draw_note, draw_single, draw_white, hidden_share, label_columns, label_rows
from .style import TEXT, TITLE, degree_labels
from .white_light import in_white_light

TILES = 3, 5  # along the short and the long side of the sensor
MAP_GAP = 0.27  # between the two maps, in inches, as all lengths here
OUTLINE_POINTS, HALVINGS = 721, 16  # directions, and steps in each, in search of the end of the lens data


def grid_facts(lens: GridLens) -> tuple[str, str]:
    """The focal lengths and the field of a lens, as text."""
    width, height = lens.sensor_mm
    across, up = np.degrees(angle_rad(lens, np.array([width / 2, 0.0]), np.array([0.0, height / 2])))
    squeeze = "" if lens.squeeze == 1 else f", squeeze {lens.squeeze:.3g}×"
    return focal_length_text(lens.efl_mm) + squeeze, f"±{across:.3g}° × ±{up:.3g}°"


def draw_grid_panels(page: Page, lens: GridLens, frequencies_per_mm: Sequence[float]) -> None:
    """Draw the PSFs of a lens over its picture, and its curves along x, y and diagonals."""
    reach = field_map(lens).covered_diagonal(lens.sensor_mm)
    _draw_psfs(page, lens, reach)
    _draw_distortion(page, lens, reach)
    draw_curves(page, lens, [_along(lens, number, path, frequencies_per_mm) for number, path in
                               enumerate(paths(lens))], frequencies_per_mm, "lines: solid vertical, dashed horizontal")


def _along(lens, number, path, frequencies_per_mm):
    """The curves along a path; lateral colour along x and y alone, which are the first two."""
    places_mm = path.places_mm(path.along_mm)
    moved_um = _along_psf(displacement_um(lens, WHITE_NM, *places_mm))
    horizontal, vertical = white_contrast(lens, psfs_at(lens, *places_mm), moved_um, frequencies_per_mm)
    illumination = relative_illumination(lens, illumination_nm(lens), *places_mm)
    return PathCurves(
        path.along_mm, path.along_mm[0], lambda along_mm: angle_rad(lens, *path.places_mm(along_mm)),
        f"{path.name} in mm", vertical, horizontal, illumination, np.cos(angle_rad(lens, *places_mm))**4,
        displacement_um(lens, lateral_nm(lens), *places_mm)[..., number] if number < 2 else None,
        band=limits_of(lens, np.hypot(*places_mm) / (np.hypot(*lens.sensor_mm) / 2), illumination))


def _draw_psfs(page, lens, reach):
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

    side_px = int(page.dpi * min(LEFT_WIDTH / columns, (MAP_HEIGHT - MAP_GAP) / (2 * rows)))
    side = side_px / page.dpi  # makes samples of the tiles coincide with pixels of the page
    upper = Box(LEFT, MAP_TOP - rows * side, columns * side, rows * side)
    lower = upper._replace(bottom=upper.bottom - MAP_GAP - rows * side)
    draw_single(page, upper, single, lens.psf_pitch_um, side_px)
    draw_white(page, lower, white, lens.psf_pitch_um, side_px)
    title = write(page, LEFT, MAP_TOP + 0.76, "Point spread functions, as in the picture", TITLE)
    write_after(page, title, upper.right, MAP_TOP + 0.72, f"at {lens.wavelengths_nm[wave]:.4g} nm", TEXT)
    write(page, upper.right, lower.top + 0.2, "in white light", TEXT, across=1.0)
    _label_tiles(page, lens, (upper, lower), x_mm, y_mm)
    draw_colour_bar(page, upper.right, MAP_TOP)
    draw_note(page, lower.bottom, hidden_share(single, lens.psf_pitch_um))


def upright(psfs: np.ndarray) -> np.ndarray:
    """PSFs (place, v, u, ...) with axes that `tile` draws to the right and downwards."""
    return mirror_image(psfs, 1).swapaxes(1, 2)


def _along_psf(displacement_um):
    """Displacements along v and u."""
    return displacement_um[..., ::-1]


def _label_tiles(page, lens, maps, x_mm, y_mm):
    """Label columns with x and rows with y, and with their field angles."""
    across, up = (np.degrees(angle_rad(lens, *place)) for place in
                  ((x_mm, np.zeros_like(x_mm)), (np.zeros_like(y_mm), y_mm)))
    label_columns(page, maps[0], _place_labels(x_mm, across))
    for each in maps:
        label_rows(page, each, _place_labels(y_mm, up))


def _place_labels(places_mm, degrees):
    return [f"{mm + 0.0:.3g} mm\n{angle}".replace("-", "−") for mm, angle in
            zip(places_mm, degree_labels(degrees), strict=True)]


def _draw_distortion(page, lens, reach):
    half_mm = np.array(lens.sensor_mm) / 2
    signs = np.array([(1, 1), (-1, 1), (1, -1), (-1, -1)]).T
    if lens.mirrored[1]:
        signs = signs[:, ::2]
    if lens.mirrored[0]:
        signs = signs[:, :signs.shape[1] // 2]
    corners_mm = signs * reach * half_mm[:, None]
    title = distortion_title(distortion_percent(lens, *corners_mm), reach == 1)
    draw_distortion(page, DISTORTION, lens, distortion_lines(lens), corners_mm, title,
                    None if reach == 1 else _end_mm(lens))


def _end_mm(lens):
    """The outline of the lens data, which end once in each direction, or where it is beyond the sensor: array (point,
    2)."""
    turns = np.linspace(0, 2 * np.pi, OUTLINE_POINTS)
    near_mm, far_mm = np.zeros(OUTLINE_POINTS), np.full(OUTLINE_POINTS, np.hypot(*lens.sensor_mm))
    for _ in range(HALVINGS):
        middle_mm = (near_mm + far_mm) / 2
        known = reference_field(lens).within(middle_mm * np.cos(turns), middle_mm * np.sin(turns))
        near_mm, far_mm = np.where(known, middle_mm, near_mm), np.where(known, far_mm, middle_mm)
    return near_mm[:, None] * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
