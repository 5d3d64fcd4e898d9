"""The panels of a lens sheet: distortion, and MTF, illumination and lateral colour along paths through the field."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..lens import Lens
from ..prescription.photographs import Vignetting
from .curves import airy_radius_um
from .illumination_band import illumination_band
from .page import ILLUMINATION, LATERAL_COLOUR, MTF, add_panel
from .psf_map import even_indices, shown_wavelengths
from .style import GRID_COLOUR, INK, PALE_INK, SMALL, TITLE, degree_labels
from .white_light import wavelength_colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

REAL_COLOUR, IDEAL_COLOUR, AIRY_COLOUR, BAND_COLOUR = "#0072B2", "#B5B5B5", "#E6E6E6", "#E6E6E6"
FREQUENCY_COLOURS = "#08306B", "#2F7EBC", "#8FC1E3", "#5A5A5A", "#A5A5A5"
DASHES = (0, (2, 2))
MOST_TICKS, MOST_ILLUMINATIONS = {1: 6, 2: 5, 3: 3, 4: 2}, 3  # ticks on each of as many panels side by side
LABEL_SPACING, HEADROOM = 0.09, 1.03  # in heights of a panel
PANEL_GAP = 0.3  # in inches
LABEL_ROOM = 0.3  # for the labels at the right ends of curves


@dataclass(frozen=True, eq=False)
class PathCurves:
    """A path from the middle of the picture, or through it, and the curves of a lens along it.

    Attributes
    ----------
    along_mm : array (place,), ascending
        Of the curves' points, relative to the middle.
    start_mm : float
        Left end of the panels.
    angle_rad : callable
        Field angles at places.
    label : str
    solid, dashed : arrays (place, frequency)
        MTF in white light.
    illumination : array (wavelength of `illumination_nm`, place)
        Relative to the middle.
    cosine : array (place,)
        The cosine fourth law.
    lateral_um : array (wavelength of `lateral_nm`, place) or None
        Lateral colour, if it is drawn.
    corner_mm : float or None
        The sensor's corner, to be marked.
    band : array (2, place) or None
        Limits of the illumination at the middle one of `illumination_nm`, by `illumination_band`.
    photographed : tuple of Vignetting
        The light in photographs, along a path from the middle.
    """

    along_mm: np.ndarray
    start_mm: float
    angle_rad: Callable[[np.ndarray], np.ndarray]
    label: str
    solid: np.ndarray
    dashed: np.ndarray
    illumination: np.ndarray
    cosine: np.ndarray
    lateral_um: np.ndarray | None
    corner_mm: float | None = None
    band: np.ndarray | None = None
    photographed: tuple[Vignetting, ...] = ()


def illumination_nm(lens: Lens) -> np.ndarray:
    """The wavelengths of the curves of illumination."""
    return lens.wavelengths_nm[even_indices(lens.wavelengths_nm.size, MOST_ILLUMINATIONS)]


def limits_of(lens: Lens, shares: np.ndarray, illumination: np.ndarray) -> np.ndarray | None:
    """The `band` of curves of illumination at shares of the half diagonal."""
    return illumination_band(lens.prescription, shares, illumination[len(illumination) // 2])


def lateral_nm(lens: Lens) -> np.ndarray:
    """The wavelengths of the curves of lateral colour."""
    return lens.wavelengths_nm[shown_wavelengths(lens)]


def draw_curves(figure: "Figure", lens: Lens, paths: Sequence[PathCurves], frequencies_per_mm: Sequence[float],
                key: str) -> None:
    """Draw the curves of a lens, with a panel for each path side by side; `key` names solid and dashed curves."""
    _draw_mtf(figure, paths, frequencies_per_mm, key)
    _draw_illumination(figure, paths, illumination_nm(lens))
    _draw_lateral_colour(figure, [path for path in paths if path.lateral_um is not None], lens)


def _draw_mtf(figure, paths, frequencies_per_mm, key):
    panels = _side_by_side(figure, MTF, len(paths))
    for panel, path in zip(panels, paths, strict=True):
        for colour, one, other in zip(FREQUENCY_COLOURS, path.solid.T, path.dashed.T, strict=False):  # of five
            panel.plot(path.along_mm, one, color=colour, linewidth=2)
            panel.plot(path.along_mm, other, "--", color=colour, linewidth=2)
        panel.set_ylim(0, HEADROOM)
        _dress(panel, path, len(paths), "MTF in white light" if path is paths[0] else "")
    panels[-1].set_title(key, fontsize=SMALL, loc="right", color=INK)
    _label_ends(panels[-1], paths[-1].solid[-1], [f"{frequency:g}/mm" for frequency in frequencies_per_mm],
                FREQUENCY_COLOURS)


def _draw_illumination(figure, paths, wavelengths_nm):
    """Draw the relative illumination along each path, in photographs too, and the cosine fourth law."""
    left, bottom, width, height = ILLUMINATION
    alone = len(paths) == 1
    panels = _side_by_side(figure, (left, bottom, width if alone else width - LABEL_ROOM, height), len(paths))
    most = max(np.max(path.illumination) for path in paths)
    for panel, path in zip(panels, paths, strict=True):
        if path.band is not None:
            panel.fill_between(path.along_mm, *path.band, color=BAND_COLOUR, linewidth=0, zorder=0,
                               label="uncertain rims")
        for one, colour, curve in zip(wavelengths_nm, wavelength_colours(wavelengths_nm), path.illumination,
                                      strict=True):
            panel.plot(path.along_mm, curve, color=colour, linewidth=1.8, label=f"{one:.4g} nm")
        for photograph in path.photographed:
            panel.plot(photograph.heights_mm, photograph.light, "o", color=INK, markersize=4, markerfacecolor="white",
                       zorder=3, label=f"photograph, {photograph}")
        panel.plot(path.along_mm, path.cosine, ":", color="black", linewidth=1.8, label="cos⁴ of the field angle")
        panel.set_ylim(0, HEADROOM * max(1, most))
        _dress(panel, path, len(paths), "Relative illumination" if path is paths[0] else "")
    if alone:
        _draw_legend(panels[0], "lower left", labelspacing=0.25)
    else:
        key = "dotted: cos⁴ of the field angle" if paths[0].band is None else "dotted: cos⁴   grey: uncertain rims"
        panels[-1].set_title(key, fontsize=SMALL, loc="right", color=INK)
        _label_wavelengths(panels[-1], wavelengths_nm, paths[-1].illumination[:, -1])
    if paths[0].corner_mm is not None:
        panels[0].text(paths[0].corner_mm, 0.98, "corner ", fontsize=SMALL - 1, color=PALE_INK, ha="right", va="top",
                       rotation=90, transform=panels[0].get_xaxis_transform())


def _draw_lateral_colour(figure, paths, lens):
    """Draw the lateral colour along each path, and the size of the Airy disk."""
    panels, wavelengths_nm = _side_by_side(figure, LATERAL_COLOUR, len(paths)), lateral_nm(lens)
    airy_um = airy_radius_um(lens, lens.reference_wavelength_nm)
    title = f"Lateral colour in µm, relative to {lens.reference_wavelength_nm:.4g} nm"
    for panel, path in zip(panels, paths, strict=True):
        panel.axhspan(-airy_um, airy_um, color=AIRY_COLOUR, linewidth=0, zorder=0, label="Airy disk")
        for colour, curve in zip(wavelength_colours(wavelengths_nm), path.lateral_um, strict=True):
            panel.plot(path.along_mm, curve, color=colour, linewidth=1.8)
        _dress(panel, path, len(paths), title if path is paths[0] else "")
    _draw_legend(panels[0], "lower left" if len(paths) == 1 else "best")
    _label_wavelengths(panels[-1], wavelengths_nm, paths[-1].lateral_um[:, -1])


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


def _label_wavelengths(panel, wavelengths_nm, ends):
    """Label curves at their right ends with wavelengths."""
    _label_ends(panel, ends, [f"{one:.4g} nm" for one in wavelengths_nm], wavelength_colours(wavelengths_nm))


def _draw_legend(panel, place, **style):
    """Draw the names of the curves."""
    panel.legend(loc=place, fontsize=SMALL, frameon=False, **style)


def draw_distortion(panel: "Axes", lens: Lens, lines_mm: Sequence[np.ndarray], corners_mm: np.ndarray, title: str,
                    draw_end: "Callable[[Axes, Patch], None] | None") -> None:
    """Draw the ideal grid in grey, and in colour its image by the chief rays.

    Parameters
    ----------
    panel : matplotlib Axes
    lens : Lens
    lines_mm : arrays (line, point, 2)
        The ideal grid, and its image.
    corners_mm : array (2, corner)
        x and y of the places that the title refers to.
    title : str
    draw_end : callable or None
        Draws the outline of the lens data in the panel within a patch, if they end before the sensor's corners.
    """
    from matplotlib.collections import LineCollection
    from matplotlib.patches import Rectangle

    half_mm = np.array(lens.sensor_mm) / 2
    sensor = panel.add_patch(Rectangle(-half_mm, *lens.sensor_mm, facecolor="none", edgecolor=INK, zorder=3))
    for lines, colour, width in zip(lines_mm, (IDEAL_COLOUR, REAL_COLOUR), (0.9, 1.5), strict=True):
        panel.add_collection(LineCollection(lines, colors=colour, linewidths=width)).set_clip_path(sensor)
    key = "grey: ideal picture   blue: through the lens"
    if draw_end:
        draw_end(panel, sensor)
        key += "   dashed: end of the lens data"
    panel.plot(*corners_mm, "o", color=REAL_COLOUR, markersize=6, zorder=4, clip_on=False)
    panel.set_aspect("equal", anchor="NW")
    panel.set(xlim=(-half_mm[0], half_mm[0]), ylim=(-half_mm[1], half_mm[1]))
    panel.axis("off")
    _entitle(panel, title)
    panel.text(0, -0.02, key, fontsize=SMALL, color=INK, va="top", transform=panel.transAxes)


def distortion_title(percents: Sequence[float], reaches_corner: bool) -> str:
    """The title of the panel: distortion in the corners, or at the end of the lens data."""
    least, most = (f"{round(extreme, 1) + 0.0:+.1f}".replace("-", "−") for extreme in (min(percents), max(percents)))
    place = "in the corner" if reaches_corner else "where the lens data end"
    if least == most:
        return f"Distortion {least} % {place}"
    return f"Distortion {least} to {most} % {place}{'s' * reaches_corner}"


def _dress(panel, path, count, title):
    """Draw a light grid and axis labels: places with their field angles, as many as fit in one of `count` panels; mark
    the sensor's corner."""
    from matplotlib.ticker import MaxNLocator

    start_mm, end_mm = path.start_mm, path.along_mm[-1]
    panel.set_xlim(start_mm, end_mm)
    ticks_mm = MaxNLocator(MOST_TICKS[count]).tick_values(start_mm, end_mm)
    slack_mm = 1e-9 * end_mm
    ticks_mm = ticks_mm[(ticks_mm >= start_mm - slack_mm) & (ticks_mm <= end_mm + slack_mm)]
    degrees = np.degrees(path.angle_rad(ticks_mm))
    panel.set_xticks(ticks_mm, [f"{mm:g}\n{angle}".replace("-", "−") for mm, angle in
                                zip(ticks_mm, degree_labels(degrees), strict=True)])
    panel.set_xlabel(path.label, fontsize=SMALL, color=INK, labelpad=1)
    panel.grid(color=GRID_COLOUR, linewidth=0.6)
    panel.set_axisbelow(True)
    panel.spines[["top", "right"]].set_visible(False)
    panel.tick_params(labelsize=SMALL, colors=INK)
    if path.corner_mm is not None:
        panel.axvline(path.corner_mm, color=PALE_INK, linewidth=1.2, linestyle=DASHES)
    _entitle(panel, title)


def _entitle(panel, title):
    panel.set_title(title, fontsize=TITLE, loc="left", color=INK)


def _label_ends(panel, values, texts, colours):
    """Label curves at their right ends in their colours, and move overlapping labels apart."""
    low, high = panel.get_ylim()
    wanted = (np.asarray(values) - low) / (high - low)
    order = np.argsort(wanted)
    places = wanted[order]
    for _ in range(50 * places.size):
        gaps = LABEL_SPACING - np.diff(places)
        tight = np.maximum(gaps, 0) / 2
        places[:-1] -= tight
        places[1:] += tight
        places = np.clip(places, 0, 1)
    for place, index in zip(places, order, strict=True):
        panel.text(1.015, place, texts[index], color=colours[index], fontsize=SMALL, fontweight="bold", va="center",
                   transform=panel.transAxes)
