"""The panels of a lens sheet: distortion, and MTF, illumination and lateral colour along lines of the field."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..lens import Lens
from .curves import airy_radius_um
from .style import GRID_COLOUR, INK, PALE_INK, SMALL, TITLE, degree_labels
from .white_light import wavelength_colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Patch

REAL_COLOUR, IDEAL_COLOUR, AIRY_COLOUR = "#0072B2", "#B5B5B5", "#E6E6E6"
FREQUENCY_COLOURS = "#08306B", "#2F7EBC", "#8FC1E3", "#5A5A5A", "#A5A5A5"
DASHES = (0, (2, 2))
MOST_TICKS, MOST_ILLUMINATIONS = 6, 3
LABEL_SPACING, HEADROOM = 0.09, 1.03  # in heights of a panel


@dataclass(frozen=True, eq=False)
class Line:
    """A line from the middle of the picture, or through it, along which panels show curves.

    Attributes
    ----------
    places_mm : array (place,), ascending
        Of the curves' points, relative to the middle.
    start_mm : float
        Left end of the panels.
    angle_rad : callable
        Field angles at places.
    label : str
    corner_mm : float or None
        The sensor's corner, to be marked.
    ticks : int
        Most labels on it.
    """

    places_mm: np.ndarray
    start_mm: float
    angle_rad: Callable[[np.ndarray], np.ndarray]
    label: str
    corner_mm: float | None = None
    ticks: int = MOST_TICKS


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


def draw_mtf(panel: "Axes", line: Line, frequencies_per_mm: Sequence[float], solid: np.ndarray, dashed: np.ndarray,
             title: str) -> None:
    """Draw two MTFs, arrays (place, frequency), in white light along a line."""
    for colour, one, other in zip(FREQUENCY_COLOURS, solid.T, dashed.T, strict=False):  # of five
        panel.plot(line.places_mm, one, color=colour, linewidth=2)
        panel.plot(line.places_mm, other, "--", color=colour, linewidth=2)
    panel.set_ylim(0, HEADROOM)
    _dress(panel, line, title)


def label_mtf(panel: "Axes", frequencies_per_mm: Sequence[float], solid: np.ndarray, key: str) -> None:
    """Label the curves of `draw_mtf`."""
    panel.set_title(key, fontsize=SMALL, loc="right", color=INK)
    _label_ends(panel, solid[-1], [f"{frequency:g}/mm" for frequency in frequencies_per_mm], FREQUENCY_COLOURS)


def draw_illumination(panel: "Axes", line: Line, wavelengths_nm: np.ndarray, curves: np.ndarray, cosine: np.ndarray,
                      most: float, title: str) -> None:
    """Draw the relative illumination (wavelength, place), of up to `most`, along a line, and the cosine fourth law
    (place,)."""
    for one, colour, curve in zip(wavelengths_nm, wavelength_colours(wavelengths_nm), curves, strict=True):
        panel.plot(line.places_mm, curve, color=colour, linewidth=1.8, label=f"{one:.4g} nm")
    panel.plot(line.places_mm, cosine, ":", color="black", linewidth=1.8, label="cos⁴ of the field angle")
    panel.set_ylim(0, HEADROOM * max(1, most))
    _dress(panel, line, title)


def draw_lateral_colour(panel: "Axes", line: Line, lens: Lens, wavelengths_nm: np.ndarray, curves: np.ndarray,
                        title: str) -> None:
    """Draw the lateral colour (wavelength, place) in um along a line, and the size of the Airy disk."""
    airy_um = airy_radius_um(lens, lens.reference_wavelength_nm)
    panel.axhspan(-airy_um, airy_um, color=AIRY_COLOUR, linewidth=0, zorder=0, label="Airy disk")
    for colour, curve in zip(wavelength_colours(wavelengths_nm), curves, strict=True):
        panel.plot(line.places_mm, curve, color=colour, linewidth=1.8)
    _dress(panel, line, title)


def lateral_colour_title(lens: Lens) -> str:
    """The title of the panel."""
    return f"Lateral colour in µm, relative to {lens.reference_wavelength_nm:.4g} nm"


def label_wavelengths(panel: "Axes", wavelengths_nm: np.ndarray, ends: np.ndarray) -> None:
    """Label curves at their right ends with wavelengths."""
    _label_ends(panel, ends, [f"{one:.4g} nm" for one in wavelengths_nm], wavelength_colours(wavelengths_nm))


def draw_legend(panel: "Axes", place: str = "lower left", **style: float) -> None:
    """Draw the names of the curves."""
    panel.legend(loc=place, fontsize=SMALL, frameon=False, **style)


def _dress(panel, line, title):
    """Draw a light grid and axis labels: places with their field angles; mark the sensor's corner."""
    from matplotlib.ticker import MaxNLocator

    start_mm, end_mm = line.start_mm, line.places_mm[-1]
    panel.set_xlim(start_mm, end_mm)
    ticks_mm = MaxNLocator(line.ticks).tick_values(start_mm, end_mm)
    slack_mm = 1e-9 * end_mm
    ticks_mm = ticks_mm[(ticks_mm >= start_mm - slack_mm) & (ticks_mm <= end_mm + slack_mm)]
    degrees = np.degrees(line.angle_rad(ticks_mm))
    panel.set_xticks(ticks_mm, [f"{mm:g}\n{angle}".replace("-", "−") for mm, angle in
                                zip(ticks_mm, degree_labels(degrees), strict=True)])
    panel.set_xlabel(line.label, fontsize=SMALL, color=INK, labelpad=1)
    panel.grid(color=GRID_COLOUR, linewidth=0.6)
    panel.set_axisbelow(True)
    panel.spines[["top", "right"]].set_visible(False)
    panel.tick_params(labelsize=SMALL, colors=INK)
    if line.corner_mm is not None:
        panel.axvline(line.corner_mm, color=PALE_INK, linewidth=1.2, linestyle=DASHES)
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
