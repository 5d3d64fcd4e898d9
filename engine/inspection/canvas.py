"""A page to draw on: lines, areas, markers, pictures and texts, without stairs at any resolution.

Places on a page are in inches from its lower left corner, widths of lines and sizes of texts in points. Pillow draws
lines and areas with hard edges, so they are drawn several times as large, as the mask of their colour.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import ceil, floor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image, ImageColor, ImageDraw, ImageFont

from .style import INK

POINT = 1 / 72  # inch
FINE, FINE_TEXT = 8, 4  # subpixels across a pixel
BORDER_PX = 2
FREE = 0.04  # inches between texts in a line
TEXT_MARGIN_PX = 3  # for letters that extend beyond their advance, and for borders
FURTHEST = 10**6  # subpixels: beyond all pages, and within Pillow's 32 bits
ROUNDED_RAD = 0.1  # corners of lines by more than this are filled
CAP, ASCENT, DESCENT, LINE = 0.73, 0.76, 0.24, 1.2  # of the font, and from line to line, in sizes
FONTS = Path(__file__).parent / "fonts"
SOLID, DASHED, DOTTED = (), (3.7, 1.6), (1.0, 1.65)  # in widths of the line


class Box(NamedTuple):
    """A rectangle on a page, in inches."""

    left: float
    bottom: float
    width: float
    height: float

    @property
    def right(self) -> float:
        return self.left + self.width

    @property
    def top(self) -> float:
        return self.bottom + self.height

    def overlaps(self, other: "Box") -> bool:
        """Whether the two share more than an edge."""
        return (self.left < other.right and other.left < self.right
                and self.bottom < other.top and other.bottom < self.top)

    def contains(self, x: float, y: float) -> bool:
        """Whether a place is in the box or on its edge."""
        return self.left <= x <= self.right and self.bottom <= y <= self.top


@dataclass(frozen=True, eq=False)
class Pen:
    """How a curve looks.

    Attributes
    ----------
    colour : str or array (3,)
        #RRGGBB, or sRGB from 0 to 1.
    width_pt : float
        0 without a line.
    dashes : (float, float) or ()
        Lengths of dashes and gaps, in widths.
    marker : str
        A name in `MARKERS`, or empty.
    marker_pt : float
        Its diameter.
    face : str or None
        The marker's colour within its outline, if it is not `colour`.
    """

    colour: Any
    width_pt: float = 0.0
    dashes: Sequence[float] = SOLID
    marker: str = ""
    marker_pt: float = 0.0
    face: str | None = None


def _regular(corners, turn=0.0, radii=(1.0,)):
    """A polygon about the origin: its first corner is at the top, or turned from there; radii take turns."""
    angles = 2 * np.pi * (np.arange(corners) + turn) / corners
    return np.stack([np.sin(angles), np.cos(angles)], axis=-1) * np.resize(radii, corners)[:, None] / 2


_PLUS = np.array([(1, 3), (1, 1), (3, 1)]) / 6
MARKERS = {"circle": _regular(48), "square": _regular(4, 0.5, (1.25,)), "diamond": _regular(4, 0, (1.4,)),
           "up": _regular(3, 0, (1.2,)), "down": _regular(3, 0.5, (1.2,)), "star": _regular(10, 0, (1.0, 0.382)),
           "plus": np.concatenate([_PLUS, _PLUS[::-1] * (1, -1), -_PLUS, _PLUS[::-1] * (-1, 1)])}
"""Outlines of markers with a diameter of about 1."""


class Page:
    """A white page.

    Parameters
    ----------
    width, height : float
        Inches.
    dpi : int
        Pixels per inch.
    """

    def __init__(self, width: float, height: float, dpi: int) -> None:
        self.width, self.height, self.dpi = width, height, dpi
        self._image = Image.new("RGB", (round(width * dpi), round(height * dpi)), "white")

    def pixels(self) -> np.ndarray:
        """The page: uint8 array (row, column, 3)."""
        return np.array(self._image)

    def lines(self, lines: Sequence[np.ndarray], pen: Pen, within: Box | None = None) -> None:
        """Draw lines, arrays (point, 2), and the markers of their points. They have gaps at NaN, and end at a box."""
        if pen.width_pt:
            step = np.multiply(pen.dashes, pen.width_pt * POINT)
            parts = [part for line in lines for known in _known(line) for part in _dashed(known, *step)]
            width = 2 * round((pen.width_pt * POINT * self.dpi * FINE - 1) / 2) + 1  # Pillow's odd widths are centred
            self._paint(parts, pen.colour, lambda draw, line: _draw_line(draw, line, width), within, pen.width_pt / 2)
        if pen.marker:
            size = pen.marker_pt * POINT
            places = np.concatenate([known for line in lines for known in _known(line)] or [np.empty((0, 2))])
            self.areas([place + size * MARKERS[pen.marker] for place in places], pen.colour, within)
            if pen.face:
                self.areas([place + (size - 2 * POINT) * MARKERS[pen.marker] for place in places], pen.face, within)

    def areas(self, outlines: Sequence[np.ndarray], colour: Any, within: Box | None = None) -> None:
        """Fill outlines, arrays (point, 2)."""
        self._paint(outlines, colour, lambda draw, line: draw.polygon(line.ravel().tolist(), fill=255), within)

    def rectangle(self, box: Box, colour: Any) -> None:
        """Fill a box with sharp edges: it ends between pixels, and has one at least in width and height."""
        left, top, right, bottom = self._box_px(box)
        self._image.paste(rgb(colour), (left, top, max(right, left + 1), max(bottom, top + 1)))

    def rule(self, box: Box, colour: Any, width_pt: float) -> None:
        """A sharp line along a box without width or without height."""
        width = max(1, round(width_pt * POINT * self.dpi))
        left, top = (floor(side * self.dpi - width / 2 + 0.5) for side in (box.left, self.height - box.top))
        right, bottom = left + round(box.width * self.dpi) + width, top + round(box.height * self.dpi) + width
        self._image.paste(rgb(colour), (left, top, right, bottom))

    def frame(self, box: Box, colour: Any, width_pt: float) -> None:
        """Sharp lines around a box."""
        for side in (box._replace(width=0), box._replace(height=0), box._replace(left=box.right, width=0),
                     box._replace(bottom=box.top, height=0)):
            self.rule(side, colour, width_pt)

    def picture(self, pixels: np.ndarray, box: Box) -> None:
        """Draw a picture, a uint8 array (row, column, 3), into a box; unchanged if it has the box's size in pixels."""
        left, top, right, bottom = self._box_px(box)
        picture, size = Image.fromarray(pixels), (right - left, bottom - top)
        self._image.paste(picture if picture.size == size else picture.resize(size, Image.Resampling.BICUBIC),
                          (left, top))

    def write(self, x: float, y: float, text: str, size_pt: float, colour: Any = INK, *, bold: bool = False,
              across: float = 0.0, up: float = 1.0, turned: bool = False, halo: str = "") -> Box:
        """Write lines of text, and return their box.

        Parameters
        ----------
        x, y : float
            The place.
        text : str
        size_pt : float
        colour : str or array (3,)
        bold : bool
        across : float
            The place in the text: from 0, its left end, to 1, its right end. Lines are aligned accordingly.
        up : float
            From 0, its lower end, to 1, its upper end.
        turned : bool
            Written upwards.
        halo : str
            Colour of a border, for texts on curves or pictures.
        """
        box = self.text_box(x, y, text, size_pt, bold=bold, across=across, up=up, turned=turned)
        left, top = box.left * self.dpi, (self.height - box.top) * self.dpi
        size = (box.height, box.width) if turned else (box.width, box.height)
        shift = (left % 1, top % 1) if not turned else (0.0, 0.0)
        for border_px, ink in ((BORDER_PX, halo), (0, colour)) if halo else ((0, colour),):
            mask = self._text_mask(text.split("\n"), size, load_font(bold, self._font_px(size_pt)), across, shift,
                                   border_px)
            mask = mask.transpose(Image.Transpose.ROTATE_90) if turned else mask
            self._tint(mask, ink, (floor(left) - TEXT_MARGIN_PX, floor(top) - TEXT_MARGIN_PX))
        return box

    def fitting_size(self, text: str, size_pt: float, room: float, *, bold: bool = False) -> float:
        """The size of a text, reduced until it fits a width: hinting makes widths uneven."""
        while size_pt > 1 and (width := self.text_box(0, 0, text, size_pt, bold=bold).width) > room:
            size_pt *= min(room / width, 0.995)
        return size_pt

    def text_box(self, x: float, y: float, text: str, size_pt: float, *, bold: bool = False, across: float = 0.0,
                 up: float = 1.0, turned: bool = False) -> Box:
        """The box of lines of text that `write` would write."""
        lines, font = text.split("\n"), load_font(bold, self._font_px(size_pt))
        long = max(map(font.getlength, lines)) / FINE_TEXT / self.dpi
        high = (ASCENT + DESCENT + LINE * (len(lines) - 1)) * size_pt * POINT
        if turned:
            return Box(x - (1 - up) * high, y - across * long, high, long)
        return Box(x - across * long, y - up * high, long, high)

    def _font_px(self, size_pt):
        return size_pt * POINT * self.dpi * FINE_TEXT

    def _text_mask(self, lines, size, font, across, shift_px, border_px):
        """The mask of lines of text in a box of this size in inches, with a margin."""
        px = [ceil(side * self.dpi + shift) + 2 * TEXT_MARGIN_PX for side, shift in zip(size, shift_px, strict=True)]
        mask = Image.new("L", tuple(FINE_TEXT * side for side in px))
        for number, line in enumerate(lines):
            spare = size[0] * self.dpi - font.getlength(line) / FINE_TEXT
            x, y = ((TEXT_MARGIN_PX + shift) * FINE_TEXT for shift in shift_px)
            ImageDraw.Draw(mask).text((x + across * spare * FINE_TEXT, y + (ASCENT + LINE * number) * font.size), line,
                                      fill=255, font=font, anchor="ls", stroke_width=border_px * FINE_TEXT)
        return mask.reduce(FINE_TEXT)

    def _paint(self, shapes, colour, draw, within, room_pt=0.0):
        """Draw shapes, arrays (point, 2), in one colour: what several of them cover is not covered twice."""
        if not len(shapes):
            return
        ends = np.concatenate(shapes)
        room = room_pt * POINT + 1 / self.dpi
        low, high = ends.min(axis=0) - room, ends.max(axis=0) + room
        left, top, right, bottom = _common(self._box_px(Box(*low, *(high - low))), (0, 0, *self._image.size),
                                           *([self._box_px(within)] if within else []))
        if left >= right or top >= bottom:
            return
        mask = Image.new("L", ((right - left) * FINE, (bottom - top) * FINE))
        pencil = ImageDraw.Draw(mask)
        for shape in shapes:
            x, y = np.transpose(shape)
            px = np.stack([x * self.dpi - left, (self.height - y) * self.dpi - top], axis=-1)
            draw(pencil, np.rint(np.clip(px * FINE - 0.5, -FURTHEST, FURTHEST)))
        self._tint(mask.reduce(FINE), colour, (left, top))

    def _tint(self, mask, colour, corner):
        self._image.paste(rgb(colour), (*corner, corner[0] + mask.width, corner[1] + mask.height), mask)

    def _box_px(self, box):
        """Left, top, right and bottom of a box, between pixels."""
        return [floor(side * self.dpi + 0.5) for side in
                (box.left, self.height - box.top, box.right, self.height - box.bottom)]


def first_free(boxes: Iterable[Box], taken: Sequence[Box], within: Box | None = None) -> Box | None:
    """The first box that neither overlaps one of those taken nor almost touches it, and is within another."""
    taken = [Box(box.left - FREE, box.bottom, box.width + 2 * FREE, box.height) for box in taken]
    return next((box for box in boxes if not any(box.overlaps(other) for other in taken) and
                 (within is None or within.contains(*box[:2]) and within.contains(box.right, box.top))), None)


def rgb(colour: Any) -> tuple[int, ...]:
    """A colour, #RRGGBB or sRGB from 0 to 1, as red, green and blue up to 255."""
    return ImageColor.getrgb(colour) if isinstance(colour, str) else tuple(round(255 * float(part)) for part in colour)


@lru_cache(maxsize=64)
def load_font(bold: bool, size_px: float) -> ImageFont.FreeTypeFont:
    """The font of all texts. Pillow's own lacks many letters and signs, such as é, µ and ×."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(FONTS / name, size_px, layout_engine=ImageFont.Layout.BASIC)


def _common(*boxes_px):
    """The common part of boxes (left, top, right, bottom)."""
    left, top, right, bottom = zip(*boxes_px, strict=True)
    return max(left), max(top), min(right), min(bottom)


def _known(line):
    """The parts of a line without NaN."""
    gaps = np.flatnonzero(~np.isfinite(line).all(axis=1))
    parts = (part[np.isfinite(part).all(axis=1)] for part in np.split(line, gaps))
    return [part for part in parts if len(part)]


def _dashed(line, on=0.0, off=0.0):
    """The dashes of a line, or the line itself."""
    if not on:
        return [line]
    at = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    dashes = []
    for start in np.arange(0, at[-1], on + off):
        end = min(start + on, at[-1])
        places = np.concatenate([[start], at[(at > start) & (at < end)], [end]])
        dashes.append(np.stack([np.interp(places, at, along) for along in line.T], axis=-1))
    return dashes


def _draw_line(draw, line, width):
    """A line of an odd width, with round corners."""
    line = line[np.append(True, np.diff(line, axis=0).any(axis=1))]
    draw.line(line.ravel().tolist(), fill=255, width=width)
    moved = np.diff(line, axis=0) @ [1, 1j]
    turned = np.abs(np.angle(moved[1:] / moved[:-1])) > ROUNDED_RAD
    for x, y in line[1:-1][turned]:
        draw.ellipse((x - width // 2, y - width // 2, x + width // 2, y + width // 2), fill=255)
