"""The trade-off plot: error against time for every method of filtering, with memory and the number of wavelengths."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..runtime.build_identity import software
from ..runtime.files import atomic_path
from .style import GRID_COLOUR, INK, require_matplotlib
from .tradeoff import AS_WRITTEN, EXACT, Row


@dataclass(frozen=True)
class Style:
    """The style of a curve: its name in the legend, one of Okabe and Ito's colours, and the field that labels it."""

    legend: str
    colour: str
    marker: str = "o"
    line: str = "-"
    labelled_by: str = "section_size"


STYLES = {"paper": Style("the paper: one PSF per section (px)", "#000000", "s", "--"),
          "pixels": Style("pixel by pixel (azimuths)", "#E69F00", "D", labelled_by="azimuths"),
          "sections": Style("sections (azimuths)", "#009E73", "P", labelled_by="azimuths"),
          "accuracy": Style("target accuracy", "#D55E00", "^", ":", "accuracy"),
          "PSF support": Style("PSF support (enclosed energy)", "#999999", "v", ":", "psf_energy")}
FRONTIER_COLOUR, WAVELENGTH_COLOUR = "#F0E442", "#0072B2"
PLACES_PT = [(0, 9), (0, -9), (10, 4), (-10, 4), (10, -5), (-10, -5), (0, 15), (0, -15), (14, 11), (-14, 11), (14, -11),
             (-14, -11)]


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

    Raises
    ------
    InputError
        matplotlib is not installed.
    """
    by_image = {}
    for row in rows:
        if row.against == EXACT:
            by_image.setdefault(row.image, []).append(row)
    shown = list(by_image.items())[:2]
    spectral = [row for row in rows if row.curve == "wavelengths" and row.relative_l2 > 0]
    width = 4.8 * len(shown) + 4
    left = 0.85 / width
    figure = require_matplotlib()(figsize=(width, 6), dpi=150)
    grid = figure.add_gridspec(2, len(shown) + 1, width_ratios=[1] * len(shown) + [0.66], left=left, right=0.985,
                               top=0.81, bottom=0.19, hspace=0.5, wspace=0.22)
    for column, (name, image_rows) in enumerate(shown):
        _draw_errors(figure.add_subplot(grid[:, column]), image_rows, name)
    _draw_memory(figure.add_subplot(grid[:1 if spectral else 2, -1]), *shown[0][::-1])
    if spectral:
        _draw_wavelengths(figure.add_subplot(grid[1, -1]), spectral)
    figure.suptitle(title, x=left, y=0.97, ha="left", fontsize=11, color=INK)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="lower center", ncols=4 if len(shown) > 1 else 3,
                  fontsize=8.5, frameon=False)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png", metadata={"Software": software()})


def _draw_errors(panel, rows, name):
    """Draw relative L2 error against seconds: a line for each curve, and the frontier below them."""
    _dress(panel, f"Error against time: {name}", "seconds (cold)", "relative L2 error")
    best = frontier([row for row in rows if row.relative_l2 > 0])
    panel.plot([row.seconds for row in best], [row.relative_l2 for row in best], color=FRONTIER_COLOUR, linewidth=8,
               alpha=0.8, solid_capstyle="round", solid_joinstyle="round", zorder=1, label="best of all")
    labels = []
    for curve, style in STYLES.items():
        points = [row for row in rows if row.curve == curve and row.relative_l2 > 0]
        if not points:
            continue
        panel.plot([row.seconds for row in points], [row.relative_l2 for row in points], style.line,
                   marker=style.marker, color=style.colour, markersize=5, linewidth=1.4, label=style.legend)
        texts = {f"{value:.3g}": row for row in points if (value := getattr(row, style.labelled_by)) is not None}
        labels += [(row.seconds, row.relative_l2, text, style.colour) for text, row in texts.items()]
    paper = next((row for row in rows if row.curve == AS_WRITTEN), None)
    if paper is None:  # without rotational symmetry
        _label_points(panel, labels)
        return
    panel.plot(paper.seconds, paper.relative_l2, "*k", markersize=14, zorder=5, label=AS_WRITTEN)
    ratio = panel.secondary_xaxis("top", functions=(lambda s: s / paper.seconds, lambda r: r * paper.seconds))
    _dress_axis(ratio.xaxis, "times the paper's method")
    _label_points(panel, labels, around=(paper.seconds, paper.relative_l2))


def _draw_memory(panel, rows, name):
    """Draw relative L2 error against peak memory, the other cost of the curves in the large panels."""
    _dress(panel, f"Memory beyond the picture: {name}", "peak MB", "relative L2 error")
    for curve, style in STYLES.items():
        points = [row for row in rows if row.curve == curve and row.relative_l2 > 0]
        panel.plot([row.peak_mb for row in points], [row.relative_l2 for row in points], style.marker,
                   color=style.colour, markersize=4, linestyle="none")


def _draw_wavelengths(panel, rows):
    """Draw colour error against seconds, for several numbers of wavelengths."""
    _dress(panel, f"Colour error against {rows[0].against.split(' in ')[0]}", "seconds (cold)", "relative L2 error")
    panel.plot([row.seconds for row in rows], [row.relative_l2 for row in rows], "-o", color=WAVELENGTH_COLOUR,
               markersize=4, linewidth=1.4)
    _label_points(panel, [(row.seconds, row.relative_l2, str(row.wavelengths), WAVELENGTH_COLOUR) for row in rows])


def _dress(panel, title, across, up):
    """Set logarithmic axes, a light grid, and names."""
    panel.set_xscale("log")
    panel.set_yscale("log")
    panel.margins(0.1)
    panel.grid(which="major", color=GRID_COLOUR, linewidth=0.6)
    panel.set_axisbelow(True)
    panel.spines[["top", "right"]].set_visible(False)
    panel.tick_params(which="both", labelsize=8, colors=INK)
    panel.set_title(title, fontsize=9.5, loc="left", color=INK)
    panel.set_ylabel(up, fontsize=9, color=INK)
    _dress_axis(panel.xaxis, across)


def _dress_axis(axis, name):
    """Set decimal labels at 1, 2 and 5 of each decade, and a name."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
    axis.set_tick_params(which="both", labelsize=8, colors=INK)
    axis.set_label_text(name, fontsize=9, color=INK)


def _label_points(panel, labels, around=None):
    """Write each (x, y, text, colour) next to its point without covering labels or points, or omit it.

    `around` is the position of a larger marker.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.patheffects import withStroke
    from matplotlib.transforms import Bbox

    renderer = FigureCanvasAgg(panel.figure).get_renderer()
    panel.autoscale_view()
    points = [(label[:2], 6) for label in labels] + ([(around, 14)] if around else [])
    taken = [Bbox(panel.transData.transform(at) + [[-half], [half]]) for at, half in points]
    for x, y, text, colour in labels:
        for place in PLACES_PT:
            note = panel.annotate(text, (x, y), place, textcoords="offset points", ha="center", va="center", fontsize=7,
                                  color=colour, path_effects=[withStroke(linewidth=2, foreground="white")], zorder=6)
            box = note.get_window_extent(renderer)
            if not any(box.overlaps(other) for other in taken):
                taken.append(box.padded(3))
                break
            note.remove()
