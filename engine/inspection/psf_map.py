"""The PSFs of a lens in one picture: field heights across, wavelengths down, and a row in white light.

The functions that draw tiles serve maps of other arrangements, too.
"""

from typing import TYPE_CHECKING

import numpy as np

from ..lens import Lens, RadialLens
from ..spectral.colour import encode_srgb
from .curves import Field, field_angle_rad
from .page import LEFT, add_panel, write
from .style import INK, PALE_INK, SMALL, degree_labels
from .white_light import wavelength_colours, white_psfs

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

MOST_HEIGHTS, MOST_WAVELENGTHS = 6, 7
GAP_PX = 3
WHITE_ROW_GAP = 0.3  # of a row
DECADES = 3  # range of irradiance below the peak
FRAMED_LEVEL = 0.01  # of the peak: samples above it are within the tiles
FRAMED_SHARE = 90  # per cent of the PSFs to which this applies: a few wide PSFs may exceed their tiles
BURNT_OUT = 6.0  # exposure of the peaks in the white row, relative to white, because lateral colour is faint
COLOUR_MAP, COLOUR_STEPS = "inferno", 24
SCALE_BAR_SHARE = 0.5  # of a tile, at most
WORTH_REPORTING = 0.005  # of the light


def draw_psf_map(figure: "Figure", corner: tuple[float, float], largest: tuple[float, float], lens: RadialLens,
                 field: Field) -> "tuple[AxesImage, float, float, float]":
    """Draw the map into a figure.

    Parameters
    ----------
    figure : matplotlib Figure
    corner, largest : (float, float)
        The upper left corner, from the figure's lower left one, and the largest width and height, in inches.
    lens : RadialLens
    field : Field

    Returns
    -------
    shown : matplotlib image
        The PSFs, for a colour bar.
    right, bottom : float
        The map's right and lower edges, in inches.
    hidden : float
        The largest share of a PSF's light that is not shown: too dim for the colours, or beyond its tile.
    """
    heights, wavelengths = shown_heights(lens, field), shown_wavelengths(lens)
    rows, columns = wavelengths.size, heights.size
    side_px = int(figure.dpi * min(largest[0] / MOST_HEIGHTS, largest[1] / (rows + 1 + WHITE_ROW_GAP)))
    side = side_px / figure.dpi  # makes samples of the tiles coincide with pixels of the figure
    left, top = corner
    single = add_map(figure, left, top, columns * side, rows * side)
    white = add_map(figure, left, top - (rows + WHITE_ROW_GAP) * side, columns * side, side)
    psfs = lens.psf[np.ix_(wavelengths, heights)]
    shown = draw_single(single, psfs, lens.psf_pitch_um, side_px)
    draw_white(white, white_psfs(lens, heights)[None], lens.psf_pitch_um, side_px)
    _label_columns(single, lens, field, heights)
    _label_rows(single, white, lens.wavelengths_nm[wavelengths])
    return (shown, left + columns * side, top - (rows + 1 + WHITE_ROW_GAP) * side,
            hidden_share(psfs, lens.psf_pitch_um))


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


def add_map(figure: "Figure", left: float, top: float, width: float, height: float) -> "Axes":
    """Axes without ticks or frame, with their upper left corner at a point in inches."""
    size = figure.get_size_inches()
    axes = figure.add_axes((left / size[0], (top - height) / size[1], width / size[0], height / size[1]))
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0, labelsize=SMALL, colors=INK)
    axes.set_xticks([])
    axes.set_yticks([])
    return axes


def draw_single(axes: "Axes", psfs: np.ndarray, pitch_um: float, side_px: int) -> "AxesImage":
    """Draw PSFs (row, column, v, u), each relative to its peak, on a logarithmic scale."""
    from matplotlib import colormaps

    half_um = _half_width_um(psfs / psfs.max(axis=(2, 3), keepdims=True), pitch_um)
    tiles = np.stack([[tile(psf, pitch_um, half_um, side_px - 2 * GAP_PX) for psf in row] for row in psfs])
    tiles /= tiles.max(axis=(2, 3), keepdims=True)
    shown = axes.imshow(_montage(np.log10(np.maximum(tiles, 10.0**-DECADES)), np.nan), aspect="auto", vmin=-DECADES,
                        vmax=0, cmap=colormaps[COLOUR_MAP].resampled(COLOUR_STEPS), interpolation="nearest",
                        extent=(0, psfs.shape[1], psfs.shape[0], 0))
    _draw_scale_bar(axes, half_um, side_px)
    return shown


def draw_white(axes: "Axes", psfs: np.ndarray, pitch_um: float, side_px: int) -> None:
    """Draw PSFs (row, column, v, u, colour) in white light, exposed to make lateral colour visible."""
    brightest = psfs.max(axis=-1)
    half_um = _half_width_um(BURNT_OUT * brightest / brightest.max(axis=(2, 3), keepdims=True), pitch_um)
    tiles = np.stack([[np.stack([tile(psf[..., colour], pitch_um, half_um, side_px - 2 * GAP_PX)
                                 for colour in range(3)], axis=-1) for psf in row] for row in psfs])
    tiles *= BURNT_OUT / tiles.max(axis=(2, 3, 4), keepdims=True)
    axes.imshow(_montage(encode_srgb(tiles), 1.0), aspect="auto", interpolation="nearest",
                extent=(0, psfs.shape[1], psfs.shape[0], 0))
    _draw_scale_bar(axes, half_um, side_px)


def draw_colour_bar(figure: "Figure", shown: "AxesImage", right: float, top: float) -> None:
    """Draw the colour bar of a map of single wavelengths to the right of it."""
    bar = add_panel(figure, right + 0.08, top - 1.6, 0.1, 1.55)
    figure.colorbar(shown, cax=bar, ticks=range(-DECADES, 1))
    bar.set_yticklabels([f"{10.0**decade:g}" for decade in range(-DECADES, 1)])
    bar.tick_params(labelsize=SMALL - 1, colors=INK, length=2, pad=2)
    bar.set_title("of peak", fontsize=SMALL - 1, color=INK, loc="left", pad=6)


def draw_note(figure: "Figure", bottom: float, hidden: float) -> None:
    """Write below a map how its tiles are exposed, and the share of light that they do not show."""
    note = f"White light has equal energy; peaks are overexposed {BURNT_OUT:g} times."
    if hidden >= WORTH_REPORTING:
        note += (f"\nUp to {100 * hidden:.2g} % of a point's light is not shown: dimmer than 1/{10**DECADES} of its "
                 "peak, or beyond its tile.")
    write(figure, LEFT, bottom - 0.04, note, SMALL - 1, PALE_INK)


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


def _label_columns(axes, lens, field, heights):
    """Label columns with the chief ray's height on the sensor and its field angle."""
    degrees = np.degrees(field_angle_rad(lens, lens.heights_mm[heights]))
    axes.xaxis.tick_top()
    axes.set_xticks(np.arange(heights.size) + 0.5,
                    [f"{mm:.3g} mm\n{angle}" for mm, angle in
                     zip(field.optics.real_height_mm[heights], degree_labels(degrees), strict=True)])
    axes.tick_params(length=0)


def _label_rows(single, white, wavelengths_nm):
    names = [f"{nm:.4g} nm" for nm in wavelengths_nm]
    single.set_yticks(np.arange(wavelengths_nm.size) + 0.5, names, fontweight="bold")
    for label, colour in zip(single.get_yticklabels(), wavelength_colours(wavelengths_nm), strict=True):
        label.set_color(colour)
    white.set_yticks([0.5], ["white\nlight"], fontweight="bold")


def _draw_scale_bar(axes, half_um, side_px):
    """Draw a bar of a round length in the lower left corner of the last row."""
    tile_um = 2 * half_um * side_px / (side_px - 2 * GAP_PX)
    decade = 10 ** np.floor(np.log10(SCALE_BAR_SHARE * tile_um))
    length_um = max(step * decade for step in (1, 2, 5) if step * decade <= SCALE_BAR_SHARE * tile_um)
    bottom = axes.get_ylim()[0]
    axes.plot([0.1, 0.1 + length_um / tile_um], [bottom - 0.1] * 2, color="white", linewidth=2, solid_capstyle="butt")
    axes.text(0.1, bottom - 0.14, f"{length_um:g} µm", color="white", fontsize=SMALL - 1, va="bottom")
