"""The contact sheet: pictures of the same view in one picture, each with its label."""

import os
from collections.abc import Sequence
from math import sqrt

import numpy as np
from PIL import Image, ImageDraw

from ..pictures.preview import save_png
from .canvas import load_font

GAP_PX = 12
LEAST_WIDTH_PX = 320  # of a cell, so that labels are legible below small pictures
LEAST_TEXT_PX, MOST_TEXT_PX = 9, 32
TEXT_SHARE = 1 / 28  # of a cell's width, unless the longest label needs smaller text
LINE = 1.8  # height of a label, in text sizes
MOST_PIXELS = 36_000_000  # of a sheet: larger pictures are scaled down
PAPER, INK = (24, 24, 24), (230, 230, 230)
CUT = "\u2026"

Box = tuple[int, int, int, int]


def write_contact_sheet(pictures: Sequence[Sequence[np.ndarray]], labels: Sequence[Sequence[str]],
                        path: str | os.PathLike) -> list[list[Box]]:
    """Write pictures as a labelled sheet, a PNG that appears complete or not at all.

    Parameters
    ----------
    pictures : rows of uint8 arrays (row, column, 3)
        In sRGB, all of the same size. They keep their size unless the sheet would exceed MOST_PIXELS.
    labels : rows of str
        One for each picture, written below it.
    path : path

    Returns
    -------
    rows of (left, top, right, bottom)
        The pixels of the sheet that show each picture, counted from its upper left corner.
    """
    count = len(pictures), max(map(len, pictures))
    (height, width), scale = _shown_px(np.shape(pictures[0][0])[:2], count)
    cell_width = max(width, LEAST_WIDTH_PX)
    font = _font([text for texts in labels for text in texts], cell_width)
    step = cell_width + GAP_PX, height + round(LINE * font.size) + GAP_PX
    sheet = Image.new("RGB", tuple(n * side + GAP_PX for n, side in zip(count[::-1], step, strict=True)), PAPER)
    draw, boxes = ImageDraw.Draw(sheet), []
    for row, (in_row, texts) in enumerate(zip(pictures, labels, strict=True)):
        boxes.append([])
        for column, (pixels, text) in enumerate(zip(in_row, texts, strict=True)):
            left, top = GAP_PX + column * step[0] + (cell_width - width) // 2, GAP_PX + row * step[1]
            picture = Image.fromarray(pixels)
            sheet.paste(picture if scale == 1 else picture.resize((width, height), Image.Resampling.LANCZOS),
                        (left, top))
            middle = left + width / 2, top + height + LINE * font.size / 2
            draw.text(middle, _fitted(text, font, cell_width), fill=INK, font=font, anchor="mm")
            boxes[-1].append((left, top, left + width, top + height))
    save_png(np.asarray(sheet), path)
    return boxes


def _shown_px(shape_px, count):
    """The height and width of each picture on the sheet, and their scale."""
    scale = min(1.0, sqrt(MOST_PIXELS / (np.prod(shape_px, dtype=float) * np.prod(count))))
    return [max(1, int(scale * side)) for side in shape_px], scale


def _font(texts, width_px):
    """The font, small enough for all texts to fit a width, but at least LEAST_TEXT_PX."""
    font = load_font(False, min(width_px * TEXT_SHARE, MOST_TEXT_PX))
    too_wide = max(1.0, *(font.getlength(text) / width_px for text in texts))
    return font.font_variant(size=max(int(font.size / too_wide), LEAST_TEXT_PX))


def _fitted(text, font, width_px):
    """The text, cut to a width."""
    if font.getlength(text) <= width_px:
        return text
    return next((f"{text[:end]}{CUT}" for end in range(len(text) - 1, 0, -1)
                 if font.getlength(f"{text[:end]}{CUT}") <= width_px), CUT)
