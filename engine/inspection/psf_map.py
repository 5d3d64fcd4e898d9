"""The PSFs of a lens in one picture: field heights across, wavelengths down, and a row in white light.

The functions that draw tiles serve maps of other arrangements, too.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..lens import Lens, RadialLens
from ..spectral.colour import encode_srgb
from .axes import write_middle
from .canvas import POINT, Box, Page
from .colour_map import INFERNO, stepped
from .curves import Field, field_angle_rad
from .page import LEFT, write
from .style import INK, PALE_INK, SMALL, degree_labels
from .white_light import wavelength_colours, white_psfs

MOST_HEIGHTS, MOST_WAVELENGTHS = 6, 7
GAP_PX = 3
WHITE_ROW_GAP = 0.3  # of a row
DECADES = 3  # range of irradiance below the peak
FRAMED_LEVEL = 0.01  # of the peak: samples above it are within the tiles
FRAMED_SHARE = 90  # per cent of the PSFs to which this applies: a few wide PSFs may exceed their tiles
BURNT_OUT = 6.0  # exposure of the peaks in the white row, relative to white, because lateral colour is faint
SCALE_BAR_SHARE = 0.5  # of a tile, at most
WORTH_REPORTING = 0.005  # of the light
COLUMN_GAP, ROW_GAP = 0.06, 0.05  # from a map to its labels, in inches
BAR = 0.08, 0.1, 1.55  # gap, width and height of the colour bar


def draw_psf_map(page: Page, corner: tuple[float, float], largest: tuple[float, float], lens: RadialLens,
                 field: Field) -> tuple[float, float, float]:
    """Draw the map on a page.

    Parameters
    ----------
    page : Page
    corner, largest : (float, float)
        The upper left corner, from the page's lower left one, and the largest width and height, in inches.
    lens : RadialLens
    field : Field

    Returns
    -------
    right, bottom : float
        The map's right and lower edges, in inches.
    hidden : float
        The largest share of a PSF's light that is not shown: too dim for the colours, or beyond its tile.
    """
    heights, wavelengths = shown_heights(lens, field), shown_wavelengths(lens)
    rows, columns = wavelengths.size, heights.size
    side_px = int(page.dpi * min(largest[0] / MOST_HEIGHTS, largest[1] / (rows + 1 + WHITE_ROW_GAP)))
    side = side_px / page.dpi  # makes samples of the tiles coincide with pixels of the page
    left, top = corner
    single = Box(left, top - rows * side, columns * side, rows * side)
    white = Box(left, single.bottom - (1 + WHITE_ROW_GAP) * side, columns * side, side)
    psfs = lens.psf[np.ix_(wavelengths, heights)]
    draw_single(page, single, psfs, lens.psf_pitch_um, side_px)
    draw_white(page, white, white_psfs(lens, heights)[None], lens.psf_pitch_um, side_px)
    degrees = np.degrees(field_angle_rad(lens, lens.heights_mm[heights]))
    label_columns(page, single, [f"{mm:.3g} mm\n{angle}" for mm, angle in
                                 zip(field.optics.real_height_mm[heights], degree_labels(degrees), strict=True)])
    nm = lens.wavelengths_nm[wavelengths]
    label_rows(page, single, [f"{each:.4g} nm" for each in nm], wavelength_colours(nm), bold=True)
    label_rows(page, white, ["white\nlight"], bold=True)
    return single.right, white.bottom, hidden_share(psfs, lens.psf_pitch_um)


def shown_heights(lens: RadialLens, field: Field) -> np.ndarray:
    """Indices of up to MOST_HEIGHTS field heights, evenly spaced in the picture from the axis to the field's edge."""
    places_mm = np.linspace(0, field.geometry.distortion(field.edge_mm), MOST_HEIGHTS)
    return np.unique(np.abs(field.optics.real_height_mm[:, None] - places_mm).argmin(axis=0))


def shown_wavelengths(lens: Lens) -> np.ndarray:
    """Indices of up to MOST_WAVELENGTHS wavelengths, evenly spaced from the first to the last."""
    return even_indices(lens.wavelengths_nm.size, MOST_WAVELENGTHS)


def even_indices(number: int, most: int) -> np.ndarray:
    """Up to `most` of `number` indices, evenly spaced from the first to the last."""
    return np.rint(np.linspace(0, number - 1, min(number, most))).astype(int)


def draw_single(page: Page, place: Box, psfs: np.ndarray, pitch_um: float, side_px: int) -> None:
    """Draw PSFs (row, column, v, u), each relative to its peak, on a logarithmic scale."""
    half_um = _half_width_um(psfs / psfs.max(axis=(2, 3), keepdims=True), pitch_um)
    tiles = np.stack([[tile(psf, pitch_um, half_um, side_px - 2 * GAP_PX) for psf in row] for row in psfs])
    tiles /= tiles.max(axis=(2, 3), keepdims=True)
    colours = stepped(1 + np.log10(np.maximum(tiles, 10.0**-DECADES)) / DECADES)
    page.picture(_montage(colours, 255), place)
    _draw_scale_bar(page, place, half_um, side_px)


def draw_white(page: Page, place: Box, psfs: np.ndarray, pitch_um: float, side_px: int) -> None:
    """Draw PSFs (row, column, v, u, colour) in white light, exposed to make lateral colour visible."""
    brightest = psfs.max(axis=-1)
    half_um = _half_width_um(BURNT_OUT * brightest / brightest.max(axis=(2, 3), keepdims=True), pitch_um)
    tiles = np.stack([[np.stack([tile(psf[..., colour], pitch_um, half_um, side_px - 2 * GAP_PX)
                                 for colour in range(3)], axis=-1) for psf in row] for row in psfs])
    tiles *= BURNT_OUT / tiles.max(axis=(2, 3, 4), keepdims=True)
    page.picture(_montage(np.rint(255 * encode_srgb(tiles)).astype(np.uint8), 255), place)
    _draw_scale_bar(page, place, half_um, side_px)


def draw_colour_bar(page: Page, right: float, top: float) -> None:
    """Draw the colour bar of a map of single wavelengths to the right of it."""
    gap, width, height = BAR
    bar = Box(right + gap, top - height - 0.05, width, height)
    page.picture(np.repeat(np.repeat(INFERNO[::-1, None], 9, axis=0), 9, axis=1), bar)
    page.frame(bar, INK, 0.8)
    for decade in range(DECADES + 1):
        y = bar.top - height * decade / DECADES
        page.rule(Box(bar.right, y, 2 * POINT, 0), INK, 0.8)
        write_middle(page, bar.right + 5 * POINT, y, f"{10.0**-decade:g}", SMALL - 1)
    page.write(bar.left, bar.top + 6 * POINT, "of peak", SMALL - 1, up=0.0)


def draw_note(page: Page, bottom: float, hidden: float) -> None:
    """Write below a map how its tiles are exposed, and the share of light that they do not show."""
    note = f"White light has equal energy; peaks are overexposed {BURNT_OUT:g} times."
    if hidden >= WORTH_REPORTING:
        note += (f"\nUp to {100 * hidden:.2g} % of a point's light is not shown: dimmer than 1/{10**DECADES} of its "
                 "peak, or beyond its tile.")
    write(page, LEFT, bottom - 0.04, note, SMALL - 1, PALE_INK)


def _half_width_um(psfs, pitch_um):
    """Half the side of squares around the chief rays that frame FRAMED_SHARE of the PSFs (..., v, u)."""
    psfs = psfs.reshape(-1, *psfs.shape[-2:])
    v, u = (np.abs(np.arange(n) - n // 2) for n in psfs.shape[1:])
    reach = np.where(psfs >= FRAMED_LEVEL, np.maximum(v[:, None], u), 0).max(axis=(1, 2))
    return float((np.percentile(reach, FRAMED_SHARE) + 1.5) * pitch_um)


def hidden_share(psfs: np.ndarray, pitch_um: float) -> float:
    """The largest share of the light of PSFs (wavelength, height, v, u) that their tiles do not show."""
    peaked = psfs / psfs.max(axis=(2, 3), keepdims=True)
    v, u = (np.abs(np.arange(n) - n // 2) * pitch_um <= _half_width_um(peaked, pitch_um) for n in psfs.shape[2:])
    visible = (peaked >= 10.0**-DECADES) & v[:, None] & u
    return float(1 - ((psfs * visible).sum(axis=(2, 3)) / psfs.sum(axis=(2, 3))).min())


def tile(psf: np.ndarray, pitch_um: float, half_um: float, tile_px: int) -> np.ndarray:
    """A PSF (v, u) within `half_um` of its chief ray: array (tile_px, tile_px), outwards to the right."""
    place_um = ((np.arange(tile_px) + 0.5) / tile_px * 2 - 1) * half_um
    v, u = (_weights(place_um, (np.arange(n) - n // 2) * pitch_um, pitch_um) for n in psf.shape)
    return u @ psf.T @ v.T


def _weights(place_um, sample_um, pitch_um):
    """Weights of samples at places: linear interpolation, or averages if samples are finer than places."""
    reach_um = max(pitch_um, place_um[1] - place_um[0])
    return np.maximum(0, 1 - np.abs(place_um[:, None] - sample_um) / reach_um) * pitch_um / reach_um


def _montage(tiles, gap):
    """Tiles (row, column, y, x, ...) as one picture, with the value `gap` between them."""
    rows, columns = tiles.shape[:2]
    around = [(0, 0), (0, 0), (GAP_PX, GAP_PX), (GAP_PX, GAP_PX)] + [(0, 0)] * (tiles.ndim - 4)
    padded = np.pad(tiles, around, constant_values=gap)
    return padded.swapaxes(1, 2).reshape(rows * padded.shape[2], columns * padded.shape[3], *tiles.shape[4:])


def label_columns(page: Page, place: Box, labels: Sequence[str]) -> None:
    """Label the columns of a map above it."""
    for number, label in enumerate(labels):
        middle = place.left + place.width * (number + 0.5) / len(labels)
        page.write(middle, place.top + COLUMN_GAP, label, SMALL, across=0.5, up=0.0)


def label_rows(page: Page, place: Box, labels: Sequence[str], colours: Sequence[Any] | np.ndarray | None = None, *,
               bold: bool = False) -> None:
    """Label the rows of a map at its left."""
    for number, label in enumerate(labels):
        middle = place.top - place.height * (number + 0.5) / len(labels)
        write_middle(page, place.left - ROW_GAP, middle, label, SMALL, INK if colours is None else colours[number],
                     bold=bold, across=1.0)


def _draw_scale_bar(page, place, half_um, side_px):
    """Draw a bar of a round length in the lower left corner of the last row."""
    side = side_px / page.dpi
    tile_um = 2 * half_um * side_px / (side_px - 2 * GAP_PX)
    decade = 10 ** np.floor(np.log10(SCALE_BAR_SHARE * tile_um))
    length_um = max(step * decade for step in (1, 2, 5) if step * decade <= SCALE_BAR_SHARE * tile_um)
    bar = Box(place.left + 0.1 * side, place.bottom + 0.1 * side, side * length_um / tile_um, 0)
    page.rectangle(bar._replace(height=2 * POINT), "#FFFFFF")
    page.write(bar.left, bar.bottom + 4 * POINT, f"{length_um:g} µm", SMALL - 1, "#FFFFFF", up=0.0)
