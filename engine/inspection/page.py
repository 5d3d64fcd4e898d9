"""The page of a lens sheet: its size, and where panels and texts are on it."""

from typing import TYPE_CHECKING, Any

import numpy as np

from .style import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIDE, DPI = 12, 140  # the sheet is square; inches, like all positions here
MARGIN, LEFT, RIGHT = 0.3, 1.05, 6.85  # of the sheet, and of its two columns
LEFT_WIDTH, RIGHT_WIDTH = 4.9, 4.4
MAP_TOP, MAP_HEIGHT = 9.55, 6.15
DISTORTION, MTF, ILLUMINATION, LATERAL_COLOUR = (
    (RIGHT, 7.15, RIGHT_WIDTH, 2.9), (RIGHT, 3.9, RIGHT_WIDTH, 2.4), (LEFT, 0.95, LEFT_WIDTH, 1.8),
    (RIGHT, 0.95, RIGHT_WIDTH, 1.8))
"""Left, bottom, width and height of the panels."""
HINTING = 0.97  # each letter of a smaller font may be up to a pixel wider


def add_panel(figure: "Figure", left: float, bottom: float, width: float, height: float) -> "Axes":
    """An empty panel at this place."""
    return figure.add_axes(np.array((left, bottom, width, height)) / SIDE)


def write(figure: "Figure", left: float, top: float, text: str, size: float, colour: Any = INK, **style: Any) -> None:
    """Write text below a point, reduced to fit on the sheet. It may contain any characters, including dollars."""
    written = figure.text(left / SIDE, top / SIDE, text, fontsize=size, color=colour, va="top", parse_math=False,
                          **style)
    width = written.get_window_extent(figure.canvas.get_renderer()).width / DPI
    room = left - MARGIN if style.get("ha") == "right" else SIDE - MARGIN - left
    if width > room:
        written.set_fontsize(size * HINTING * room / width)


def focal_length_text(efl_mm: float) -> str:
    """A focal length as text, with four digits."""
    return f"f = {efl_mm:#.4g}".rstrip(".") + " mm"
