"""The page of a lens sheet: its size, and where panels and texts are on it."""

from typing import Any

from .canvas import Box, Page
from .style import INK

SIDE, DPI = 12, 140  # the sheet is square; inches, like all positions here
MARGIN, LEFT, RIGHT = 0.3, 1.05, 6.85  # of the sheet, and of its two columns
LEFT_WIDTH, RIGHT_WIDTH = 4.9, 4.4
WORD_GAP = 0.2  # between texts side by side
MAP_TOP, MAP_HEIGHT = 9.55, 6.15
DISTORTION, MTF, ILLUMINATION, LATERAL_COLOUR = (
    Box(RIGHT, 7.15, RIGHT_WIDTH, 2.9), Box(RIGHT, 3.9, RIGHT_WIDTH, 2.4), Box(LEFT, 0.95, LEFT_WIDTH, 1.8),
    Box(RIGHT, 0.95, RIGHT_WIDTH, 1.8))
"""The panels."""


def new_sheet() -> Page:
    """An empty sheet."""
    return Page(SIDE, SIDE, DPI)


def write(page: Page, left: float, top: float, text: str, size: float, colour: Any = INK, *, bold: bool = False,
          across: float = 0.0) -> Box:
    """Write text below a point, reduced to fit on the sheet."""
    size = page.fitting_size(text, size, SIDE - MARGIN - left if across == 0 else left - MARGIN, bold=bold)
    return page.write(left, top, text, size, colour, bold=bold, across=across)


def write_after(page: Page, before: Box, right: float, top: float, text: str, size: float) -> None:
    """Write text that ends at a place, or further right if another text is in the way."""
    width = page.text_box(0, 0, text, size).width
    write(page, max(right, before.right + WORD_GAP + width), top, text, size, across=1.0)


def focal_length_text(efl_mm: float) -> str:
    """A focal length as text, with four digits."""
    return f"f = {efl_mm:#.4g}".rstrip(".") + " mm"
