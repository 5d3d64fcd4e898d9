"""Drawing on a page: where lines, areas and texts are, and how smooth they are."""

import numpy as np
import pytest

from lensfield.engine.inspection.canvas import (
    DASHED,
    FINE,
    FONTS,
    MARKERS,
    POINT,
    Box,
    Page,
    Pen,
    first_free,
    load_font,
)
from lensfield.engine.inspection.colour_map import INFERNO, smooth, stepped
from lensfield.engine.library import bundled_names, prescription_of
from lensfield.engine.spectral.colour import REC709_LUMINANCE
from seed import SEED

DPI = 100
BLACK = "#000000"
NO_GLYPH = "\uffff"
SIGNS = "…°±×µ−–’ ⁰¹²³⁴⁵⁶⁷⁸⁹⁻·→↗↘"
"""What the sheets themselves write besides ASCII."""


@pytest.fixture
def page():
    return Page(4, 3, DPI)


def ink(page):
    """How black the page is: array (row, column), 0 to 1."""
    return 1 - page.pixels()[..., 0] / 255


def places_px(page):
    """x and y of the middles of pixels, from the lower left corner, in pixels."""
    rows, columns = page.pixels().shape[:2]
    return np.arange(columns) + 0.5, (rows - 0.5 - np.arange(rows))[:, None]


@pytest.mark.parametrize("width_pt", [0.6, 1.8, 5.0])
def test_lines_are_where_their_points_are_and_as_wide_as_their_pen(page, width_pt):
    """Pillow rounds the corners of lines to subpixels, and widths are odd numbers of them: both edges of a line are off
    by less than one, and the width by one more."""
    ends = np.random.default_rng(SEED).uniform((0.5, 0.5), (3.5, 2.5), (2, 2))
    ends[1] = ends[0] + (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0])) * 0.5
    page.lines([ends], Pen(BLACK, width_pt))
    drawn, (x, y), along = ink(page), places_px(page), (ends[1] - ends[0]) / 0.5
    off_px = (x - ends[0, 0] * DPI) * -along[1] + (y - ends[0, 1] * DPI) * along[0]
    at_px = (x - ends[0, 0] * DPI) * along[0] + (y - ends[0, 1] * DPI) * along[1]
    assert abs(np.average(off_px, weights=drawn)) < 1 / FINE
    assert np.average(at_px, weights=drawn) == pytest.approx(25, abs=2 / FINE)
    assert drawn.sum() / 50 == pytest.approx(width_pt * POINT * DPI, abs=3 / FINE)


def test_slanted_edges_are_smooth(page):
    """Along an edge that rises by one pixel in ten, the ink of each column rises steadily, by a tenth of a pixel."""
    page.areas([np.array([(0.5, 0.5), (3.5, 0.5), (3.5, 1.8), (0.5, 1.5)])], BLACK)
    heights_px = ink(page).sum(axis=0)[52:348]
    expected_px = 100 + (np.arange(52, 348) + 0.5 - 50) / 10
    assert np.abs(heights_px - expected_px).max() < 1.5 / FINE


def test_the_area_of_an_outline(page):
    outline = np.array([(0.5, 0.5), (3.1, 0.9), (2.0, 2.6)])
    page.areas([outline], BLACK)
    (a, b), (c, d) = outline[1] - outline[0], outline[2] - outline[0]
    perimeter_px = DPI * np.hypot(*(outline - np.roll(outline, 1, axis=0)).T).sum()
    assert ink(page).sum() == pytest.approx(abs(a * d - b * c) / 2 * DPI**2, abs=perimeter_px / FINE)


def test_a_dashed_line_has_the_share_of_its_dashes(page):
    page.lines([np.array([(0.5, 1.0), (3.5, 2.0)])], Pen(BLACK, 2.0))
    solid, dashed = ink(page).sum(), Page(4, 3, DPI)
    dashed.lines([np.array([(0.5, 1.0), (3.5, 2.0)])], Pen(BLACK, 2.0, DASHED))
    assert ink(dashed).sum() / solid == pytest.approx(DASHED[0] / sum(DASHED), rel=0.03)  # of about twenty dashes


def test_lines_have_gaps_at_unknown_points_and_round_corners(page):
    line = np.array([(0.5, 1.0), (1.0, 1.0), (np.nan, 1.0), (2.0, 1.0), (2.5, 1.0), (2.5, 1.5)])
    page.lines([line], Pen(BLACK, 8.0))
    drawn = ink(page)
    assert not drawn[:, 102:198].any() and drawn[200, 60:90].min() == 1 and drawn[200, 210:240].min() == 1
    assert drawn[202, 252] > 0.9 and drawn[205, 255] < 0.1  # beyond the corner, which is round


def test_lines_and_areas_end_at_their_box(page):
    box = Box(1.0, 1.0, 2.0, 1.0)
    page.lines([np.array([(-1e7, 0.5), (1e7, 2.5)]), np.array([(0.5, 0.5), (3.5, 2.5)])], Pen(BLACK, 3.0), box)
    page.areas([np.array([(0.0, 0.0), (2.0, 1.5), (0.0, 3.0)])], BLACK, box)
    inside = ink(page)[100:200, 100:300]
    assert inside.any() and inside.sum() == pytest.approx(ink(page).sum())


@pytest.mark.parametrize("name", MARKERS)
def test_markers_are_centred_on_their_points(page, name):
    page.lines([np.array([(1.3, 1.7)])], Pen(BLACK, marker=name, marker_pt=20))
    drawn, (x, y) = ink(page), places_px(page)
    centre_px = np.average(x + 0 * y, weights=drawn), np.average(y + 0 * x, weights=drawn)
    assert centre_px == pytest.approx((130, 170), abs=1.5 / FINE)
    assert drawn.any(axis=0).sum() == pytest.approx(20 / 72 * DPI, rel=0.5)


def test_a_marker_has_a_face_in_its_outline(page):
    page.lines([np.array([(1.3, 1.7)])], Pen("#FF0000", marker="circle", marker_pt=20, face="#0000FF"))
    pixels = page.pixels()
    assert tuple(pixels[129, 130]) == (0, 0, 255) and (pixels == (255, 0, 0)).all(axis=-1).any()


@pytest.mark.parametrize("left", [1.0, 1.004, 1.005, 1.006])
def test_rules_are_sharp_and_equally_wide_wherever_they_are(page, left):
    page.rule(Box(left, 0.5, 0, 2.0), BLACK, 1.0)
    page.frame(Box(left + 0.5, left, 1.0, 1.0), BLACK, 1.0)
    pixels = page.pixels()
    assert set(np.unique(pixels)) == {0, 255}
    assert (pixels[60, :, 0] == 0).sum() == 1 and (pixels[150, :, 0] == 0).sum() == 3
    assert (pixels[:, 200, 0] == 0).sum() == 2
    assert np.flatnonzero(pixels[60, :, 0] == 0) + 0.5 == pytest.approx(left * DPI, abs=0.51)


def test_pictures_of_the_size_of_their_box_are_unchanged(page):
    picture = np.random.default_rng(0).integers(0, 256, (30, 50, 3), np.uint8)
    page.picture(picture, Box(1.0, 1.0, 0.5, 0.3))
    assert np.array_equal(page.pixels()[170:200, 100:150], picture)
    page.picture(np.full((2, 3, 3), 77, np.uint8), Box(2.0, 1.0, 1.0, 1.0))
    assert (page.pixels()[100:200, 200:300] == 77).all()


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("across, up", [(0, 1), (0.5, 0.5), (1, 0)])
def test_texts_fill_their_boxes(page, across, up, turned):
    """Capitals and descenders almost reach the edges; a pixel is the blur of their borders."""
    box = page.write(2.0, 1.5, "Apg\nHello", 14, BLACK, across=across, up=up, turned=turned)
    rows, columns = (np.flatnonzero(ink(page).any(axis=axis)) for axis in (1, 0))
    assert box.left * DPI - 1 <= columns[0] and columns[-1] <= box.right * DPI + 1
    assert (3 - box.top) * DPI - 1 <= rows[0] and rows[-1] <= (3 - box.bottom) * DPI + 1
    assert columns[-1] - columns[0] > 0.8 * box.width * DPI and rows[-1] - rows[0] > 0.8 * box.height * DPI
    assert box == page.text_box(2.0, 1.5, "Apg\nHello", 14, across=across, up=up, turned=turned)
    assert (box.left + across * box.width if not turned else box.bottom + across * box.height) == pytest.approx(
        1.5 if turned else 2.0)


@pytest.mark.parametrize("across", [0, 0.5, 1])
def test_lines_of_a_text_are_aligned(page, across):
    page.write(2.0, 2.0, "H\nHHHHHHHH", 20, BLACK, across=across)
    rows = np.flatnonzero(ink(page).any(axis=1))
    short, long = ink(page)[rows[0]:rows[0] + 10], ink(page)[rows[-1] - 10:rows[-1]]
    (start, *_, end), (first, *_, last) = (np.flatnonzero(line.any(axis=0)) for line in (short, long))
    assert start + (end - start) * across == pytest.approx(first + (last - first) * across, abs=1)


def test_a_turned_text_is_read_from_below(page):
    upright, turned = Page(4, 3, DPI), page
    upright.write(1.0, 1.0, "LT", 40, BLACK)
    turned.write(1.0, 1.0, "LT", 40, BLACK, turned=True)
    first, second = cut(ink(upright)), cut(np.rot90(ink(turned), -1))
    assert np.abs(first[:35, :50] - second[:35, :50]).mean() < 0.05 < first.std()


def cut(drawn):
    """The dark part of a page."""
    rows, columns = (np.flatnonzero((drawn > 0.5).any(axis=axis)) for axis in (1, 0))
    return drawn[rows[0]:rows[-1] + 1, columns[0]:columns[-1] + 1]


def test_a_border_separates_a_text_from_what_is_below(page):
    page.rectangle(Box(0, 0, 4, 3), BLACK)
    page.write(1.0, 2.0, "I", 40, "#FF0000", halo="#FFFFFF")
    white, red = (np.all(page.pixels() == colour, axis=-1) for colour in ((255, 255, 255), (255, 0, 0)))
    across_px = np.flatnonzero(white.any(axis=0)), np.flatnonzero(red.any(axis=0))
    assert across_px[0][0] < across_px[1][0] and across_px[1][-1] < across_px[0][-1]


@pytest.mark.parametrize("bold", [False, True])
@pytest.mark.parametrize("room", [0.2, 1.0, 3.0])
def test_texts_are_reduced_to_fit(page, bold, room):
    size = page.fitting_size("Any name of a lens", 20, room, bold=bold)
    assert page.text_box(0, 0, "Any name of a lens", size, bold=bold).width <= room or size <= 1
    assert page.fitting_size("f", 20, room, bold=bold) == 20


def test_the_first_free_box():
    taken = [Box(0, 0, 1, 1)]
    assert first_free([Box(0.5, 0.5, 1, 1), Box(1.01, 0, 1, 1), Box(1.1, 0, 1, 1)], taken) == Box(1.1, 0, 1, 1)
    assert first_free([Box(2, 0, 1, 1)], taken, Box(0, 0, 2.5, 1)) is None


@pytest.mark.parametrize("bold", [False, True])
def test_the_font_has_all_letters_of_the_bundled_lenses_and_all_signs_of_the_sheets(bold):
    lenses = [prescription_of(name) for name in bundled_names()]
    texts = [text for lens in lenses for text in (lens.name, lens.maker, lens.story, lens.source)]
    letters = set("".join([*texts, SIGNS, "Äßøčłőœñ", "Ωλπα", "Гелиос", *map(chr, range(33, 127))])) - set("\n ")
    font = load_font(bold, 40.0)
    missing = bytes(font.getmask(NO_GLYPH))
    assert [letter for letter in sorted(letters) if bytes(font.getmask(letter)) == missing] == []


def test_the_licence_is_with_the_font():
    assert "Bitstream" in (FONTS / "LICENCE.txt").read_text(encoding="utf-8")


def test_brighter_light_has_a_brighter_colour():
    assert (np.diff(smooth(np.linspace(0, 1, 500)) @ REC709_LUMINANCE) >= -1).all()  # of 255: rounding
    assert np.array_equal(smooth(np.linspace(0, 1, len(INFERNO))), INFERNO)
    assert np.array_equal(stepped(np.array([-1, 0, 0.999, 1, 2])), INFERNO[[0, 0, -1, -1, -1]])
