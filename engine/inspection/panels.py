"""The panels of a lens sheet: distortion, and MTF, illumination and lateral colour along paths through the field."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..lens import Lens
from ..prescription.photographs import Vignetting
from .axes import Axis, Panel, labels_of, write_middle
from .canvas import DASHED, DOTTED, POINT, Box, Page, Pen
from .curves import airy_radius_um
from .illumination_band import illumination_band
from .page import ILLUMINATION, LATERAL_COLOUR, MTF
from .psf_map import even_indices, shown_wavelengths
from .style import INK, PALE_INK, SMALL, TITLE, degree_labels
from .white_light import wavelength_colours

REAL_COLOUR, IDEAL_COLOUR, AIRY_COLOUR, BAND_COLOUR = "#0072B2", "#B5B5B5", "#E6E6E6", "#E6E6E6"
FREQUENCY_COLOURS = "#08306B", "#2F7EBC", "#8FC1E3", "#5A5A5A", "#A5A5A5"
END = Pen(PALE_INK, 1.2, (2, 2))  # of the sensor or of the lens data
CURVE_PT, MTF_PT, BAND_PT = 1.8, 2, 7  # widths of curves, and of a band in a legend
MOST_TICKS, MOST_ILLUMINATIONS = 7, 3
LABEL_LINE, HEADROOM = 1.2, 1.03  # distance of labels in their sizes; heights of a panel
MARGIN = 0.05  # of an axis, beyond the values
PANEL_GAP = 0.3  # in inches, as all lengths here
LABEL_ROOM, LABEL_GAP = 0.3, 0.07  # for the labels at the right ends of curves
NAME_GAP, KEY_GAP = 0.42, 0.06  # from a panel down to the name of its axis, and to a key
FRAME_PT = 0.5
CORNER = "corner"
EDGE = 0.08  # of the sheet, without labels
PHOTOGRAPHED = Pen(INK, marker="circle", marker_pt=5, face="#FFFFFF")


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


def draw_curves(page: Page, lens: Lens, paths: Sequence[PathCurves], frequencies_per_mm: Sequence[float],
                key: str) -> None:
    """Draw the curves of a lens, with a panel for each path side by side; `key` names solid and dashed curves."""
    _draw_mtf(page, paths, frequencies_per_mm, key)
    _draw_illumination(page, paths, illumination_nm(lens))
    _draw_lateral_colour(page, [path for path in paths if path.lateral_um is not None], lens)


def _draw_mtf(page, paths, frequencies_per_mm, key):
    panels = _side_by_side(page, MTF, paths, Axis(0, HEADROOM))
    for number, (panel, path) in enumerate(zip(panels, paths, strict=True)):
        _dress(panel, path, number, len(paths))
        for colour, one, other in zip(FREQUENCY_COLOURS, path.solid.T, path.dashed.T, strict=False):  # of five
            panel.curve(path.along_mm, one, Pen(colour, MTF_PT))
            panel.curve(path.along_mm, other, Pen(colour, MTF_PT, DASHED))
    panels[0].entitle("MTF in white light", TITLE)
    panels[-1].entitle(key, SMALL, across=1.0)
    _label_ends(panels[-1], paths[-1].solid[-1], [f"{frequency:g}/mm" for frequency in frequencies_per_mm],
                FREQUENCY_COLOURS)


def _draw_illumination(page, paths, wavelengths_nm):
    """Draw the relative illumination along each path, in photographs too, and the cosine fourth law."""
    alone = len(paths) == 1
    place = ILLUMINATION if alone else ILLUMINATION._replace(width=ILLUMINATION.width - LABEL_ROOM)
    most = max(np.max(path.illumination) for path in paths)
    panels = _side_by_side(page, place, paths, Axis(0, HEADROOM * max(1, most)))
    for number, (panel, path) in enumerate(zip(panels, paths, strict=True)):
        if path.band is not None:
            panel.band(path.along_mm, *path.band, BAND_COLOUR)
        _dress(panel, path, number, len(paths))
        curves = _illumination_curves(path, wavelengths_nm)
        for _, x, y, pen in curves:
            panel.curve(x, y, pen)
        if path.corner_mm is not None:
            _name_corner(panel, path.corner_mm)
    panels[0].entitle("Relative illumination", TITLE)
    if alone:
        uncertain = [] if paths[0].band is None else [("uncertain rims", Pen(BAND_COLOUR, BAND_PT))]
        panels[0].legend(uncertain + [(name, pen) for name, *_, pen in curves])
    else:
        key = "dotted: cos⁴ of the field angle" if paths[0].band is None else "dotted: cos⁴   grey: uncertain rims"
        panels[-1].entitle(key, SMALL, across=1.0)
        _label_wavelengths(panels[-1], wavelengths_nm, paths[-1].illumination[:, -1])


def _name_corner(panel, corner_mm):
    """Name the line of the corner at the end that curves cover less."""
    (x, bottom), (_, top) = panel.places(corner_mm, [panel.y.low, panel.y.high])
    style = {"size_pt": SMALL - 1, "up": 0.0, "turned": True}
    ends = [(top - 2 * POINT, 1.0), (bottom + 2 * POINT, 0.0)]
    y, across = min(ends, key=lambda end: panel.covered(
        panel.page.text_box(x - 2 * POINT, end[0], CORNER, across=end[1], **style)))
    panel.page.write(x - 2 * POINT, y, CORNER, colour=PALE_INK, across=across, **style)


def _illumination_curves(path, wavelengths_nm):
    """The curves of illumination along a path: list of name, x, y and pen."""
    curves = [(f"{nm:.4g} nm", path.along_mm, curve, Pen(colour, CURVE_PT)) for nm, colour, curve in
              zip(wavelengths_nm, wavelength_colours(wavelengths_nm), path.illumination, strict=True)]
    curves += [(f"photograph, {one}", one.heights_mm, one.light, PHOTOGRAPHED) for one in path.photographed]
    return [*curves, ("cos⁴ of the field angle", path.along_mm, path.cosine, Pen("#000000", CURVE_PT, DOTTED))]


def _draw_lateral_colour(page, paths, lens):
    """Draw the lateral colour along each path, and the size of the Airy disk."""
    wavelengths_nm, airy_um = lateral_nm(lens), airy_radius_um(lens, lens.reference_wavelength_nm)
    values_um = np.concatenate([[-airy_um, airy_um], *(np.ravel(path.lateral_um) for path in paths)])
    panels = _side_by_side(page, LATERAL_COLOUR, paths, Axis.around(values_um, MARGIN))
    for number, (panel, path) in enumerate(zip(panels, paths, strict=True)):
        panel.band([panel.x.low, panel.x.high], [-airy_um] * 2, [airy_um] * 2, AIRY_COLOUR)
        _dress(panel, path, number, len(paths))
        for colour, curve in zip(wavelength_colours(wavelengths_nm), path.lateral_um, strict=True):
            panel.curve(path.along_mm, curve, Pen(colour, CURVE_PT))
    panels[0].entitle(f"Lateral colour in µm, relative to {lens.reference_wavelength_nm:.4g} nm", TITLE)
    panels[0].legend([("Airy disk", Pen(AIRY_COLOUR, BAND_PT))])
    _label_wavelengths(panels[-1], wavelengths_nm, paths[-1].lateral_um[:, -1])


def _side_by_side(page, place, paths, y):
    """Panels for paths, with a common vertical axis."""
    width = (place.width - (len(paths) - 1) * PANEL_GAP) / len(paths)
    return [Panel(page, place._replace(left=place.left + number * (width + PANEL_GAP), width=width),
                  Axis(path.start_mm, path.along_mm[-1]), y) for number, path in enumerate(paths)]


def _label_wavelengths(panel, wavelengths_nm, ends):
    """Label curves at their right ends with wavelengths."""
    _label_ends(panel, ends, [f"{one:.4g} nm" for one in wavelengths_nm], wavelength_colours(wavelengths_nm))


def draw_distortion(page: Page, place: Box, lens: Lens, lines_mm: Sequence[np.ndarray], corners_mm: np.ndarray,
                    title: str, end_mm: np.ndarray | None) -> None:
    """Draw the ideal grid in grey, and in colour its image by the chief rays.

    Parameters
    ----------
    page : Page
    place : Box
        The panel: the picture has the sensor's proportions, in its upper left corner.
    lens : Lens
    lines_mm : arrays (line, point, 2)
        The ideal grid, and its image.
    corners_mm : array (2, corner)
        x and y of the places that the title refers to.
    title : str
    end_mm : array (point, 2) or None
        The outline of the lens data, if they end before the sensor's corners.
    """
    half_mm = np.array(lens.sensor_mm) / 2
    panel = Panel.to_scale(page, place, -half_mm, half_mm, across=0, up=1)
    for lines, colour, width_pt in zip(lines_mm, (IDEAL_COLOUR, REAL_COLOUR), (0.9, 1.5), strict=True):
        page.lines([panel.places(*line.T) for line in lines], Pen(colour, width_pt), panel.box)
    page.frame(panel.box, INK, FRAME_PT)
    key = "grey: ideal picture   blue: through the lens"
    if end_mm is not None:
        panel.curve(end_mm[:, 0], end_mm[:, 1], END)
        key += "   dashed: end of the lens data"
    page.lines([panel.places(*corners_mm)], Pen(REAL_COLOUR, marker="circle", marker_pt=6))
    panel.entitle(title, TITLE)
    page.write(panel.box.left, panel.box.bottom - KEY_GAP, key, SMALL)


def distortion_title(percents: Sequence[float], reaches_corner: bool) -> str:
    """The title of the panel: distortion in the corners, or at the end of the lens data."""
    least, most = (f"{round(extreme, 1) + 0.0:+.1f}".replace("-", "−") for extreme in (min(percents), max(percents)))
    place = "in the corner" if reaches_corner else "where the lens data end"
    if least == most:
        return f"Distortion {least} % {place}"
    return f"Distortion {least} to {most} % {place}{'s' * reaches_corner}"


def _dress(panel, path, number, count):
    """Draw the light grid and the axis labels of one of several panels: places with their field angles, as many as fit;
    mark the sensor's corner."""
    room = np.inf if count == 1 else PANEL_GAP / 2
    ticks_mm, labels = panel.fitting_ticks(MOST_TICKS, lambda ticks_mm: _place_labels(path, ticks_mm), room)
    values = panel.y.ticks(MOST_TICKS)
    panel.dress(ticks_mm, labels, values, () if number else labels_of(values))
    panel.page.write(panel.box.left + panel.box.width / 2, panel.box.bottom - NAME_GAP, path.label, SMALL, across=0.5)
    if path.corner_mm is not None:
        panel.mark(path.corner_mm, END)


def _place_labels(path, ticks_mm):
    angles = degree_labels(np.degrees(path.angle_rad(ticks_mm)))
    return [f"{mm:g}\n{angle}".replace("-", "−") for mm, angle in zip(ticks_mm, angles, strict=True)]


def _label_ends(panel, values, texts, colours):
    """Label curves at their right ends in their colours, and move overlapping labels apart."""
    spacing = LABEL_LINE * SMALL * POINT / panel.box.height
    wanted = panel.y.shares(values)
    order = np.argsort(wanted)
    places = wanted[order]
    for _ in range(50 * places.size):
        tight = np.maximum(spacing - np.diff(places), 0) / 2
        places[:-1] -= tight
        places[1:] += tight
        places = np.clip(places, 0, 1)
    left = panel.box.right + LABEL_GAP
    size = min(panel.page.fitting_size(text, SMALL, panel.page.width - EDGE - left, bold=True) for text in texts)
    for place, index in zip(places, order, strict=True):
        write_middle(panel.page, left, panel.box.bottom + place * panel.box.height, texts[index], size, colours[index],
                     bold=True)
