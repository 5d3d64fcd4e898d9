"""The trade-off plot: error against time for every method of filtering, with memory and the number of wavelengths."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..pictures.preview import save_png
from .axes import Axis, Panel, labels_of, legend_size, write_legend
from .canvas import DASHED, DOTTED, POINT, SOLID, Box, Page, Pen, first_free
from .tradeoff import AS_WRITTEN, EXACT, Row


@dataclass(frozen=True)
class Style:
    """The style of a curve: its name in the legend, its pen, and the field that labels it."""

    legend: str
    pen: Pen
    labelled_by: str = "section_size"


def _pen(colour, marker, dashes=SOLID):
    return Pen(colour, 1.4, dashes, marker, 5.5)


STYLES = {"paper": Style("the paper: one PSF per section (px)", _pen("#000000", "square", DASHED)),
          "pixels": Style("pixel by pixel (azimuths)", _pen("#E69F00", "diamond"), "azimuths"),
          "sections": Style("sections (azimuths)", _pen("#009E73", "plus"), "azimuths"),
          "accuracy": Style("target accuracy", _pen("#D55E00", "up", DOTTED), "accuracy"),
          "PSF support": Style("PSF support (enclosed energy)", _pen("#999999", "down", DOTTED), "psf_energy")}
"""In colours of Okabe and Ito."""
FRONTIER, WAVELENGTHS = Pen("#F3E968", 8, SOLID, "circle", 8), Pen("#0072B2", 1.4, SOLID, "circle", 4.5)
WRITTEN = Pen("#000000", marker="star", marker_pt=14)
PLACES_PT = [(0, 9), (0, -9), (10, 4), (-10, 4), (10, -5), (-10, -5), (0, 15), (0, -15), (14, 11), (-14, 11), (14, -11),
             (-14, -11)]
DPI, HEIGHT = 150, 6.0  # inches, as all lengths here
LEFT, BOTTOM, TOP, RIGHT = 0.85, 1.15, 4.85, 0.2  # of the panels, and from the last one to the edge
LARGE, SMALL, GAP, ROW_GAP = 3.95, 2.95, 0.85, 0.75  # widths of panels, and distances
TITLE_PT, PANEL_PT, NAME_PT, TICK_PT, LEGEND_PT, LABEL_PT = 11, 9.5, 9, 8, 8.5, 7
MOST_TICKS, MARGIN = 7, 0.1
COLUMN_GAP = 0.35  # of the legend


def frontier(rows: list[Row]) -> list[Row]:
    """The Pareto-optimal rows in time and error, by ascending time."""
    best, optimal = np.inf, []
    for row in sorted(rows, key=lambda row: (row.seconds, row.relative_l2)):
        if row.relative_l2 < best:
            best = row.relative_l2
            optimal.append(row)
    return optimal


def write_plot(rows: list[Row], path: Path, title: str) -> None:
    """Draw error against time for up to two pictures, with memory and wavelengths, as a PNG.

    The file appears complete or not at all.
    """
    by_image = {}
    for row in rows:
        if row.against == EXACT:
            by_image.setdefault(row.image, []).append(row)
    shown = list(by_image.items())[:2]
    spectral = [row for row in rows if row.curve == "wavelengths" and row.relative_l2 > 0]
    right = LEFT + len(shown) * (LARGE + GAP)
    page = Page(right + SMALL + RIGHT, HEIGHT, DPI)
    for number, (name, image_rows) in enumerate(shown):
        names = _draw_errors(page, Box(LEFT + number * (LARGE + GAP), BOTTOM, LARGE, TOP - BOTTOM), image_rows, name)
    half = (TOP - BOTTOM - ROW_GAP) / 2
    upper = Box(right, TOP - half, SMALL, half)
    _draw_memory(page, upper if spectral else Box(right, BOTTOM, SMALL, TOP - BOTTOM), *shown[0][::-1])
    if spectral:
        _draw_wavelengths(page, upper._replace(bottom=BOTTOM), spectral)
    page.write(LEFT, 0.97 * HEIGHT, title, page.fitting_size(title, TITLE_PT, page.width - LEFT - RIGHT))
    _draw_legend(page, names, 4 if len(shown) > 1 else 3)
    save_png(page.pixels(), path)


def _draw_errors(page, place, rows, name):
    """Draw relative L2 error against seconds: a line for each curve, and the frontier below them. Returns the names and
    pens of the curves."""
    curves = _curves(rows)
    best = frontier([row for row in rows if row.relative_l2 > 0])
    paper = [row for row in rows if row.curve == AS_WRITTEN]  # none without rotational symmetry
    drawn = [*best, *paper, *(row for _, points in curves for row in points)]
    panel = _panel(page, place, [row.seconds for row in drawn], [row.relative_l2 for row in drawn],
                   ("seconds (cold)", f"Error against time: {name}"), above=bool(paper))
    _plot(panel, best, FRONTIER)
    for style, points in curves:
        _plot(panel, points, style.pen)
    _plot(panel, paper, WRITTEN)
    labels = []
    for style, points in curves:
        texts = {f"{value:.3g}": row for row in points if (value := getattr(row, style.labelled_by)) is not None}
        labels += [(row.seconds, row.relative_l2, text, style.pen.colour) for text, row in texts.items()]
    _label_points(panel, labels, [(row.seconds, row.relative_l2) for row in paper])
    for row in paper:
        above = replace(panel, x=Axis(panel.x.low / row.seconds, panel.x.high / row.seconds, log=True))
        above.across(*above.fitting_ticks(MOST_TICKS, labels_of), TICK_PT, above=True)
        page.write(place.left + place.width / 2, place.top + 0.24, "times the paper's method", NAME_PT, across=0.5,
                   up=0.0)
    return [("best of all", FRONTIER), *((style.legend, style.pen) for style, _ in curves),
            *((AS_WRITTEN, WRITTEN) for _ in paper)]


def _curves(rows):
    """The style and the rows of each curve that has an error."""
    curves = ((style, [row for row in rows if row.curve == curve and row.relative_l2 > 0])
              for curve, style in STYLES.items())
    return [(style, points) for style, points in curves if points]


def _plot(panel, rows, pen):
    if rows:
        panel.curve([row.seconds for row in rows], [row.relative_l2 for row in rows], pen)


def _draw_memory(page, place, rows, name):
    """Draw relative L2 error against peak memory, the other cost of the curves in the large panels."""
    curves = _curves(rows)
    drawn = [row for _, points in curves for row in points]
    panel = _panel(page, place, [row.peak_mb for row in drawn], [row.relative_l2 for row in drawn],
                   ("peak MB", f"Memory beyond the picture: {name}"))
    for style, points in curves:
        panel.curve([row.peak_mb for row in points], [row.relative_l2 for row in points],
                    replace(style.pen, width_pt=0, marker_pt=4.5))


def _draw_wavelengths(page, place, rows):
    """Draw colour error against seconds, for several numbers of wavelengths."""
    panel = _panel(page, place, [row.seconds for row in rows], [row.relative_l2 for row in rows],
                   ("seconds (cold)", f"Colour error against {rows[0].against.split(' in ')[0]}"))
    _plot(panel, rows, WAVELENGTHS)
    _label_points(panel, [(row.seconds, row.relative_l2, str(row.wavelengths), WAVELENGTHS.colour) for row in rows])


def _panel(page, place, x, y, names, *, above=False):
    """A panel with logarithmic axes around values, a light grid, and the names of its x axis and of itself."""
    panel = Panel(page, place, Axis.around(x, MARGIN, log=True), Axis.around(y, MARGIN, log=True))
    y_ticks = panel.y.ticks(MOST_TICKS)
    x_ticks, x_labels = panel.fitting_ticks(MOST_TICKS, labels_of)
    panel.dress(x_ticks, x_labels, y_ticks, labels_of(y_ticks), TICK_PT)
    panel.name_axes(names[0], "relative L2 error", NAME_PT)
    page.write(place.left, place.top + (0.45 if above else 0.06), names[1], PANEL_PT, up=0.0)
    return panel


def _draw_legend(page, names, columns):
    """Draw the names of curves in the middle of the lower edge, column by column."""
    rows = -(-len(names) // columns)
    parts = [names[start:start + rows] for start in range(0, len(names), rows)]
    widths = [legend_size(page, part, LEGEND_PT)[0] + COLUMN_GAP for part in parts]
    left, top = (page.width - sum(widths) + COLUMN_GAP) / 2, 0.05 + legend_size(page, parts[0], LEGEND_PT)[1]
    for part, width in zip(parts, widths, strict=True):
        write_legend(page, left, top, part, LEGEND_PT)
        left += width


def _label_points(panel, labels, around=()):
    """Write each (x, y, text, colour) next to its point without covering labels or points, or omit it.

    `around` are the places of larger markers.
    """
    points = [(label[:2], 4) for label in labels] + [(place, 7) for place in around]
    taken = [Box(x - half_pt * POINT, y - half_pt * POINT, 2 * half_pt * POINT, 2 * half_pt * POINT)
             for place, half_pt in points for x, y in panel.places(*place)]
    for *place, text, colour in labels:
        (x, y), = panel.places(*place)
        boxes = (panel.page.text_box(x + right * POINT, y + up * POINT, text, LABEL_PT, across=0.5, up=0.5)
                 for right, up in PLACES_PT)
        if free := first_free(boxes, taken, panel.box):
            taken.append(panel.page.write(free.left, free.top, text, LABEL_PT, colour, halo="#FFFFFF"))
