"""The panels of a lens sheet: distortion, MTF, relative illumination and lateral colour over the field."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..lens.radial_lens import RadialLens
from .curves import (
    Field,
    airy_radius_um,
    cosine_fourth,
    distortion_grid,
    distortion_percent,
    field_angle_rad,
    lateral_colour_um,
    relative_illumination,
    white_mtf,
)
from .psf_map import even_indices, shown_wavelengths
from .style import GRID_COLOUR, INK, PALE_INK, SMALL, TITLE, degree_labels
from .white_light import wavelength_colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes

REAL_COLOUR, IDEAL_COLOUR, AIRY_COLOUR = "#0072B2", "#B5B5B5", "#E6E6E6"
FREQUENCY_COLOURS = "#08306B", "#2F7EBC", "#8FC1E3", "#5A5A5A", "#A5A5A5"
DASHES = (0, (2, 2))
MOST_TICKS, MOST_ILLUMINATIONS = 6, 3
LABEL_SPACING, HEADROOM = 0.09, 1.03  # in heights of a panel


def draw_distortion(panel: "Axes", lens: RadialLens, field: Field) -> None:
    """Draw the ideal grid in grey, and in colour its image by the chief rays."""
    from matplotlib.collections import LineCollection
    from matplotlib.patches import Circle, Rectangle

    half_mm, edge_mm = np.array(lens.sensor_mm) / 2, field.geometry.distortion(field.edge_mm)
    sensor = panel.add_patch(Rectangle(-half_mm, *lens.sensor_mm, facecolor="none", edgecolor=INK, zorder=3))
    for lines, colour, width in zip(distortion_grid(lens, field), (IDEAL_COLOUR, REAL_COLOUR), (0.9, 1.5),
                                    strict=True):
        panel.add_collection(LineCollection(lines, colors=colour, linewidths=width)).set_clip_path(sensor)
    key = "grey: ideal picture   blue: through the lens"
    if not field.reaches_corner:
        end = Circle((0, 0), edge_mm, facecolor="none", edgecolor=PALE_INK, linestyle=DASHES, zorder=3)
        panel.add_patch(end).set_clip_path(sensor)
        key += "   dashed: end of the lens data"
    panel.plot(*edge_mm * half_mm / np.hypot(*half_mm), "o", color=REAL_COLOUR, markersize=6, zorder=4, clip_on=False)
    panel.set_aspect("equal", anchor="NW")
    panel.set(xlim=(-half_mm[0], half_mm[0]), ylim=(-half_mm[1], half_mm[1]))
    panel.axis("off")
    _entitle(panel, _distortion_title(lens, field))
    panel.text(0, -0.02, key, fontsize=SMALL, color=INK, va="top", transform=panel.transAxes)


def _distortion_title(lens, field):
    percent = f"{round(distortion_percent(field, field.edge_mm), 1) + 0.0:+.1f} %".replace("-", "−")
    place = "in the corner" if field.reaches_corner else "where the lens data end"
    return f"Distortion {percent} {place}, ±{np.degrees(field_angle_rad(lens, field.edge_mm)):.3g}°"


def draw_mtf(panel: "Axes", lens: RadialLens, field: Field, frequencies_per_mm: Sequence[float]) -> None:
    """Draw the sagittal and tangential MTF in white light over image height."""
    tangential, sagittal = white_mtf(lens, frequencies_per_mm)
    for colour, along, across in zip(FREQUENCY_COLOURS, tangential.T, sagittal.T, strict=False):  # of five
        panel.plot(field.optics.real_height_mm, across, color=colour, linewidth=2)
        panel.plot(field.optics.real_height_mm, along, "--", color=colour, linewidth=2)
    panel.set_ylim(0, HEADROOM)
    _dress(panel, lens, field, "MTF in white light")
    panel.set_title("solid: sagittal   dashed: tangential", fontsize=SMALL, loc="right", color=INK)
    _label_ends(panel, sagittal[-1], [f"{frequency:g}/mm" for frequency in frequencies_per_mm], FREQUENCY_COLOURS)


def draw_illumination(panel: "Axes", lens: RadialLens, field: Field) -> None:
    """Draw the relative illumination at a few wavelengths over image height, and the cosine fourth law."""
    chosen = even_indices(lens.wavelengths_nm.size, MOST_ILLUMINATIONS)
    nm = lens.wavelengths_nm[chosen]
    curves = relative_illumination(lens, nm)
    for one, colour, curve in zip(nm, wavelength_colours(nm), curves, strict=True):
        panel.plot(field.optics.real_height_mm, curve, color=colour, linewidth=1.8, label=f"{one:.4g} nm")
    panel.plot(field.optics.real_height_mm, cosine_fourth(lens, lens.heights_mm), ":", color="black", linewidth=1.8,
               label="cos⁴ of the field angle")
    panel.set_ylim(0, HEADROOM * max(1, curves.max()))
    _dress(panel, lens, field, "Relative illumination")
    panel.legend(loc="lower left", fontsize=SMALL, frameon=False, labelspacing=0.25)
    if field.reaches_corner:
        panel.text(np.hypot(*lens.sensor_mm) / 2, 0.98, "corner ", fontsize=SMALL - 1, color=PALE_INK,
                   ha="right", va="top", rotation=90, transform=panel.get_xaxis_transform())


def draw_lateral_colour(panel: "Axes", lens: RadialLens, field: Field) -> None:
    """Draw the lateral colour of each wavelength relative to the reference, and the size of the Airy disk."""
    nm = lens.wavelengths_nm[shown_wavelengths(lens)]
    curves, colours = lateral_colour_um(lens, nm), wavelength_colours(nm)
    airy_um = airy_radius_um(lens, lens.reference_wavelength_nm)
    panel.axhspan(-airy_um, airy_um, color=AIRY_COLOUR, linewidth=0, zorder=0, label="Airy disk")
    for colour, curve in zip(colours, curves, strict=True):
        panel.plot(field.optics.real_height_mm, curve, color=colour, linewidth=1.8)
    _dress(panel, lens, field, f"Lateral colour in µm, relative to {lens.reference_wavelength_nm:.4g} nm")
    panel.legend(loc="lower left", fontsize=SMALL, frameon=False)
    _label_ends(panel, curves[:, -1], [f"{one:.4g} nm" for one in nm], colours)


def _dress(panel, lens, field, title):
    """Draw a light grid and axis labels: image heights with their field angles; mark the sensor's corner."""
    from matplotlib.ticker import MaxNLocator

    heights_mm = field.optics.real_height_mm
    panel.set_xlim(0, heights_mm[-1])
    ticks_mm = MaxNLocator(MOST_TICKS).tick_values(0, heights_mm[-1])
    ticks_mm = ticks_mm[ticks_mm <= heights_mm[-1] * (1 + 1e-9)]
    degrees = np.degrees(field_angle_rad(lens, field.geometry.paraxial_height_mm(ticks_mm)))
    panel.set_xticks(ticks_mm, [f"{mm:g}\n{angle}" for mm, angle in zip(ticks_mm, degree_labels(degrees), strict=True)])
    panel.set_xlabel("image height in mm, field angle", fontsize=SMALL, color=INK, labelpad=1)
    panel.grid(color=GRID_COLOUR, linewidth=0.6)
    panel.set_axisbelow(True)
    panel.spines[["top", "right"]].set_visible(False)
    panel.tick_params(labelsize=SMALL, colors=INK)
    if field.reaches_corner:
        panel.axvline(np.hypot(*lens.sensor_mm) / 2, color=PALE_INK, linewidth=1.2, linestyle=DASHES)
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
