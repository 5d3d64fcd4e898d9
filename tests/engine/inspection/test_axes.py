"""Axes: their ticks and labels, and where values are on a page."""

from itertools import pairwise

import numpy as np
import pytest

from lensfield.engine.inspection.axes import Axis, Panel, labels_of, write_legend
from lensfield.engine.inspection.canvas import Box, Page, Pen
from seed import SEED
from written import check_legible, written

BOX = Box(0.7, 0.6, 3.0, 2.0)
DPI = 100


def panel(x, y):
    return Panel(Page(4, 3, DPI), BOX, x, y)


@pytest.mark.parametrize("low, high, most, expected", [
    (0, 1.03, 7, [0, 0.2, 0.4, 0.6, 0.8, 1.0]), (0, 21.63, 7, [0, 4, 8, 12, 16, 20]), (-14.6, 2.1, 6, [-12, -8, -4, 0]),
    (-2.4, 2.4, 3, [-2, 0, 2]), (0, 1e-4, 3, [0, 4e-5, 8e-5]), (99.5, 100.2, 4, [99.6, 99.8, 100, 100.2]),
    (0.1, 0.3, 1, [0.2])])
def test_ticks_are_round(low, high, most, expected):
    ticks = Axis(low, high).ticks(most)
    assert ticks == pytest.approx(expected) and not np.signbit(ticks[ticks == 0]).any()


@pytest.mark.parametrize("low, high, most, expected", [
    (0.007, 0.6, 7, [0.01, 0.02, 0.05, 0.1, 0.2, 0.5]), (2e-7, 0.08, 7, 10.0 ** np.arange(-6, -1)),
    (1e-9, 1e3, 5, 10.0 ** np.arange(-9, 4, 3)), (1.1, 1.9, 6, [1.2, 1.4, 1.6, 1.8]), (1, 10, 6, [1, 2, 5, 10])])
def test_ticks_of_logarithmic_axes(low, high, most, expected):
    assert Axis(low, high, log=True).ticks(most) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("log", [False, True])
@pytest.mark.parametrize("most", [2, 4, 7])
def test_ticks_are_on_their_axis_few_and_evenly_spaced(log, most):
    random = np.random.default_rng(SEED)
    for _ in range(200):
        low, high = np.sort(10 ** random.uniform(-5, 3, 2)) + (0, 1e-6) if log else np.sort(random.normal(0, 10, 2))
        ticks = Axis(low, high, log).ticks(most)
        assert ticks.size <= most and (ticks >= low * (1 - 1e-6 * np.sign(low))).all()
        assert (ticks <= high * (1 + 1e-6 * np.sign(high))).all()
        if not log:
            assert ticks.size >= most / 3 - 1
            assert np.diff(ticks, 2) == pytest.approx(0, abs=1e-9 * (high - low))


@pytest.mark.parametrize("log, low, high, ticks", [
    (False, 0, 1, []), (True, 5, 210, [5, 6, 7, 8, 9, 10, 20, 30, 40, 50, 60, 70, 80, 90, 100, 200])])
def test_small_ticks_are_the_multiples_of_decades(log, low, high, ticks):
    assert Axis(low, high, log).small_ticks() == pytest.approx(ticks)


@pytest.mark.parametrize("ticks, labels", [
    ([0, 0.5, 1], ["0.0", "0.5", "1.0"]), ([-10, -5, 0], ["−10", "−5", "0"]),
    ([0.01, 0.02, 0.05], ["0.01", "0.02", "0.05"]),
    ([0.5, 1, 2, 5, 10], ["0.5", "1", "2", "5", "10"]), ([1e-7, 1e-5, 1e-3], ["10⁻⁷", "10⁻⁵", "10⁻³"]),
    ([1, 10, 100, 1e4], ["1", "10", "10²", "10⁴"]), ([0, 2e4], ["0", "20000"]),
    ([2e-5, 4e-5], ["2·10⁻⁵", "4·10⁻⁵"]), ([0, 5e6], ["0", "5·10⁶"]), ([-0.2, -0.0], ["−0.2", "0.0"]), ([], [])])
def test_labels(ticks, labels):
    assert labels_of(np.array(ticks, dtype=float)) == labels


@pytest.mark.parametrize("values, margin, log, ends", [
    ([1, 3], 0.1, False, (0.8, 3.2)), ([1, 100], 0.1, True, (10**-0.2, 10**2.2)), ([0, 0.0], 0.1, False, (-0.5, 0.5)),
    ([np.nan, 2, np.inf], 0.1, False, None), ([], 0.1, True, None),
    ([5, 0, -1], 0.1, True, (5 * 10**-0.15, 5 * 10**0.15))])
def test_axes_around_values(values, margin, log, ends):
    axis = Axis.around(values, margin, log=log)
    assert axis.low < axis.high and (ends is None or (axis.low, axis.high) == pytest.approx(ends))


@pytest.mark.parametrize("x, y, function", [
    (Axis(-2, 3), Axis(0, 1.03), lambda x: 0.5 + 0.4 * np.sin(x)),
    (Axis(0.01, 20, log=True), Axis(1e-6, 0.1, log=True), lambda x: 1e-4 * x**-0.6)], ids=["linear", "logarithmic"])
def test_a_curve_s_pixels_are_where_its_values_are(x, y, function):
    """In each column, the middle of the ink is at the value, to the precision of subpixels."""
    here = panel(x, y)
    values = np.geomspace(x.low, x.high, 400) if x.log else np.linspace(x.low, x.high, 400)
    here.curve(values, function(values), Pen("#000000", 2.0))
    drawn = 1 - here.page.pixels()[..., 0] / 255
    columns = np.arange(80, 360)
    shares = (columns + 0.5 - BOX.left * DPI) / (BOX.width * DPI)
    at = x.low * (x.high / x.low) ** shares if x.log else x.low + (x.high - x.low) * shares
    limits = np.log10([y.low, y.high]) if y.log else np.array([y.low, y.high])
    wanted = ((np.log10(function(at)) if y.log else function(at)) - limits[0]) / np.ptp(limits)
    rows = np.average(np.broadcast_to(np.arange(300)[:, None] + 0.5, (300, 280)), axis=0, weights=drawn[:, columns])
    np.testing.assert_allclose(rows, (3 - BOX.bottom - BOX.height * wanted) * DPI, atol=0.2)


def test_a_band_is_between_its_curves():
    here = panel(Axis(0, 10), Axis(0, 1))
    here.band([0, 10], [0.2, 0.4], [0.5, 0.9], "#000000")
    dark = here.page.pixels()[:, 220, 0] < 128  # in the middle
    rows = np.flatnonzero(dark)
    assert (rows[0], rows[-1] + 1) == pytest.approx((240 - 0.7 * 200, 240 - 0.3 * 200), abs=1)


def test_panels_to_scale_have_square_units():
    here = Panel.to_scale(Page(4, 3, DPI), BOX, (-10, 0), (10, 5), across=0, up=1)
    assert here.box == pytest.approx((0.7, 2.6 - 0.75, 3.0, 0.75))
    assert (here.x, here.y) == (Axis(-10, 10), Axis(0, 5))


@pytest.mark.parametrize("label", ["{:.0f}", "{:.3f} mm\n{:.1f}°", "a long name {:g}"])
def test_labels_of_ticks_never_touch(label):
    random = np.random.default_rng(SEED)
    for _ in range(20):
        low, high = np.sort(random.normal(0, 100, 2))
        here = panel(Axis(low, high), Axis(0, 1))
        with written() as texts:
            here.dress(*here.fitting_ticks(9, lambda ticks: [label.format(tick, tick) for tick in ticks], 0.2), [], [])
        boxes = sorted(box for _, _, box in texts)
        assert all(one.right < other.left for one, other in pairwise(boxes))
        assert all(BOX.left - 0.2 < box.left and box.right < BOX.right + 0.2 for box in boxes)


@pytest.mark.parametrize("corner, curve", [
    ((0, 0), [1, 0.9]), ((0, 1), [0, 0.1]), ((0, 0), [0.5, 0.5]), ((0, 1), [0.1, 0.6]),
    ((1, 0), [0.0, 0.5, 1, 0.5, 0.4])])
def test_legends_are_where_the_curves_are_not(corner, curve):
    """Left or right, and lower or upper."""
    here = panel(Axis(0, len(curve) - 1), Axis(0, 1))
    if corner == (1, 0):
        here.curve([0, len(curve) - 1], [0.92, 0.92], Pen("#000000", 1))
    here.curve(range(len(curve)), curve, Pen("#000000", 1))
    with written() as texts:
        here.legend([("the name", Pen("#000000", 1))])
    ((_, _, box),) = texts
    assert (box.left > BOX.left + BOX.width / 2, box.bottom > BOX.bottom + BOX.height / 2) == corner


def test_a_legend_shows_pens_before_names():
    page = Page(4, 3, DPI)
    with written() as texts:
        write_legend(page, 1.0, 2.0, [("one", Pen("#FF0000", 3)), ("two", Pen("#0000FF", 0, (), "square", 8))], 10)
    check_legible(texts)
    for (_, _, box), colour in zip(texts, ((255, 0, 0), (0, 0, 255)), strict=True):
        middle = round((3 - box.bottom - box.height / 2) * DPI)
        left = page.pixels()[middle - 3:middle + 3, :round(box.left * DPI)]
        assert (left == colour).all(axis=-1).any()


def test_the_name_of_the_upward_axis_is_beyond_the_longest_labels():
    page = Page(6, 5, DPI)
    panel = Panel(page, Box(0.85, 0.6, 5, 4), Axis(1, 10, log=True), Axis(1e-6, 0.01, log=True))
    with written() as texts:
        panel.upwards(np.array([1e-4]), labels_of(np.array([1e-4])), 8)  # in the middle, as the name is
        panel.name_axes("seconds", "relative L2 error", 9)
    check_legible(texts)
