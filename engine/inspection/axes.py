"""Panels of a page with linear or logarithmic axes: grids, labels, curves, bands and legends."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .canvas import ASCENT, CAP, LINE, POINT, Box, Page, Pen
from .style import GRID_COLOUR, INK, SMALL

LINE_PT, GRID_PT, TICK_PT, PAD_PT = 0.8, 0.6, 3.5, 3.5
ROUND_STEPS, LOG_STEPS = (1, 2, 4, 5), (1, 2, 5)
LEAST_DECADES = 0.3  # of a logarithmic axis
SMALLEST, LARGEST = 1e-4, {True: 1e6, False: 1e4}  # of labels without powers of ten, if ticks are evenly spaced or not
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
KEY_PT, KEY_GAP_PT, LEGEND_LINE = 19, 6, 1.4  # length of a legend's strokes, gap after them, height of its lines
CHECKED = 200  # points of a curve that a legend avoids
LABEL_GAP, NAME_GAPS = 0.06, (0.24, 0.52)  # between labels, and from a panel to the names of its axes, in inches
OUTSIDE = 1e-9  # of an axis: ticks so far beyond its end are on it


@dataclass(frozen=True)
class Axis:
    """The values from the beginning of an axis to its end.

    Attributes
    ----------
    low, high : float
    log : bool
        Whether it is logarithmic.
    """

    low: float
    high: float
    log: bool = False

    @classmethod
    def around(cls, values: ArrayLike, margin: float, *, log: bool = False) -> "Axis":
        """An axis that contains finite values, and beyond them on both sides this share of their range."""
        known = np.ravel(values)[np.isfinite(np.ravel(values))]
        known = np.log10(known[known > 0]) if log else known
        low, high = (known.min(), known.max()) if known.size else (0.0, 0.0)
        least = LEAST_DECADES if log else 1e-6 * max(abs(low), abs(high)) or 1.0
        spare = max(margin * (high - low), (least - (high - low)) / 2)
        return cls(10 ** (low - spare), 10 ** (high + spare), log) if log else cls(low - spare, high + spare)

    def shares(self, values: ArrayLike) -> np.ndarray:
        """Where values are: 0 at the beginning of the axis, 1 at its end."""
        low, high, places = (np.log10(part) if self.log else np.asarray(part, float) for part in
                             (self.low, self.high, values))
        return (places - low) / (high - low)

    def ticks(self, most: int) -> np.ndarray:
        """Up to `most` round values on the axis, evenly spaced; on a logarithmic one, if it is long enough, in each
        decade or each few of them."""
        if self.log:
            ticks = next(each for each in map(self._log_ticks, (LOG_STEPS, *range(1, 1000))) if each.size <= most)
            if ticks.size > 1:
                return ticks
        step = next(step for step in _round_steps((self.high - self.low) / most)
                    if self._multiples(step).size <= most)
        return self._multiples(step) * step

    def small_ticks(self) -> np.ndarray:
        """The multiples of decades on a logarithmic axis; none on a linear one."""
        return self._log_ticks(range(1, 10)) if self.log else np.empty(0)

    def _multiples(self, step):
        slack = OUTSIDE * (self.high - self.low) / step
        return np.arange(np.ceil(self.low / step - slack), np.floor(self.high / step + slack) + 1) + 0.0  # no -0

    def _log_ticks(self, spacing):
        """Values in each decade, at these multiples, or in every `spacing`-th decade."""
        decades = np.arange(np.floor(np.log10(self.low)), np.ceil(np.log10(self.high)) + 1)
        if isinstance(spacing, int):
            ticks = 10 ** decades[decades % spacing == 0]
        else:
            ticks = np.outer(10 ** decades, spacing).ravel()
        shares = self.shares(ticks)
        return ticks[(shares >= -OUTSIDE) & (shares <= 1 + OUTSIDE)]


def _round_steps(least):
    """1, 2, 4 and 5 times powers of ten, ascending from about a number."""
    decade = np.floor(np.log10(least))
    return (step * 10.0 ** (decade + number) for number in range(3) for step in ROUND_STEPS)


def labels_of(ticks: np.ndarray) -> list[str]:
    """Ticks as labels, with equal decimals if they are evenly spaced; very large and very small ones as powers of
    ten."""
    size, steps = np.abs(ticks[ticks != 0]), np.diff(ticks)
    even = bool(np.ptp(steps) <= OUTSIDE * np.abs(ticks).max()) if steps.size else True
    if size.size and (size.min() < SMALLEST or size.max() >= LARGEST[even]):
        return [_power(value) for value in ticks]
    decimals = max((len(f"{value:.6g}".partition(".")[2]) for value in ticks), default=0)
    return [(f"{value + 0.0:.{decimals}f}" if even else f"{value:g}").replace("-", "−") for value in ticks]


def _power(value):
    """A number as a power of ten, with its factor unless that is 1."""
    if value in (0, 1, 10):
        return f"{value:g}"
    factor, _, exponent = f"{value:.2e}".partition("e")
    factor = f"{float(factor):g}".replace("-", "−")
    power = f"10{str(int(exponent)).translate(SUPERSCRIPTS)}"
    return power if factor == "1" else f"{factor}·{power}"


@dataclass(frozen=True, eq=False)
class Panel:
    """A rectangle of a page, with two axes that assign its places to values.

    Attributes
    ----------
    page : Page
    box : Box
    x, y : Axis
    drawn : list of arrays (point, 2)
        Curves so far, on the page.
    """

    page: Page
    box: Box
    x: Axis
    y: Axis
    drawn: list[np.ndarray] = field(default_factory=list)

    @classmethod
    def to_scale(cls, page: Page, place: Box, low: ArrayLike, high: ArrayLike, *, across: float = 0.5,
                 up: float = 0.5) -> "Panel":
        """A panel from x and y at its lower left corner to those at its upper right one, with the same scale on both
        axes: as large as a place permits, and in it from its left (0) to its right (1) and from its lower end (0) to
        its upper one (1)."""
        size = np.subtract(high, low)
        width, height = size * min(np.array([place.width, place.height]) / size)
        left, bottom = place.left + across * (place.width - width), place.bottom + up * (place.height - height)
        x, y = map(Axis, np.ravel(low), np.ravel(high))
        return cls(page, Box(left, bottom, width, height), x, y)

    def places(self, x: ArrayLike, y: ArrayLike) -> np.ndarray:
        """Places on the page, in inches: array (point, 2)."""
        x, y = np.broadcast_arrays(*map(np.atleast_1d, (self.x.shares(x), self.y.shares(y))))
        return np.stack([self.box.left + self.box.width * x, self.box.bottom + self.box.height * y], axis=-1)

    def curve(self, x: ArrayLike, y: ArrayLike, pen: Pen) -> None:
        """Draw a curve through points, within the panel."""
        self.drawn.append(self.places(x, y))
        self.page.lines(self.drawn[-1:], pen, self.box)

    def band(self, x: ArrayLike, low: ArrayLike, high: ArrayLike, colour: Any) -> None:
        """Fill the area between two curves, within the panel."""
        outline = np.concatenate([self.places(x, low), self.places(x, high)[::-1]])
        self.page.areas([outline], colour, self.box)

    def mark(self, x: float, pen: Pen) -> None:
        """Draw a vertical line at a value."""
        self.page.lines([self.places([x, x], [self.y.low, self.y.high])], pen)

    def fitting_ticks(self, most: int, labels: Callable[[np.ndarray], list[str]],
                      room: float = np.inf) -> tuple[np.ndarray, list[str]]:
        """Ticks of the x axis and their labels: as many as do not touch, and without those that end more than `room`
        inches beyond the panel."""
        for count in range(most, 0, -1):
            ticks = self.x.ticks(count)
            named = [(tick, text, self.page.text_box(x, 0, text, SMALL, across=0.5)) for tick, text, (x, _) in
                     zip(ticks, labels(ticks), self.places(ticks, self.y.low), strict=True)]
            named = [each for each in named if each[2].left > self.box.left - room
                     and each[2].right < self.box.right + room]
            if all(box.right + LABEL_GAP < other.left for (*_, box), (*_, other) in pairwise(named)):
                break
        return np.array([tick for tick, *_ in named]), [text for _, text, _ in named]

    def dress(self, x_ticks: np.ndarray, x_labels: Sequence[str], y_ticks: np.ndarray, y_labels: Sequence[str],
              size_pt: float = SMALL) -> None:
        """Draw a grid, the left and the lower axis, and their labels; `y_labels` may be empty."""
        for place in self.places(x_ticks, self.y.low):
            self.page.rule(Box(place[0], self.box.bottom, 0, self.box.height), GRID_COLOUR, GRID_PT)
        for place in self.places(self.x.low, y_ticks):
            self.page.rule(Box(self.box.left, place[1], self.box.width, 0), GRID_COLOUR, GRID_PT)
        self.across(x_ticks, x_labels, size_pt)
        self.upwards(y_ticks, y_labels, size_pt)

    def across(self, ticks: np.ndarray, labels: Sequence[str], size_pt: float = SMALL, *,
               above: bool = False) -> None:
        """Draw the x axis below or above the panel, with its ticks and labels."""
        edge, sign = (self.box.top, 1) if above else (self.box.bottom, -1)
        self.page.rule(Box(self.box.left, edge, self.box.width, 0), INK, LINE_PT)
        for length_pt, values in ((TICK_PT, ticks), (TICK_PT / 2, self.x.small_ticks())):
            for share in self.x.shares(values):
                ends = sorted((edge, edge + sign * length_pt * POINT))
                self.page.rule(Box(self.box.left + share * self.box.width, ends[0], 0, ends[1] - ends[0]), INK, LINE_PT)
        for share, label in zip(self.x.shares(ticks), labels, strict=True):
            self.page.write(self.box.left + share * self.box.width, edge + sign * (TICK_PT + PAD_PT) * POINT, label,
                            size_pt, across=0.5, up=0.0 if above else 1.0)

    def upwards(self, ticks: np.ndarray, labels: Sequence[str], size_pt: float = SMALL) -> None:
        """Draw the left axis, with its ticks and labels."""
        self.page.rule(Box(self.box.left, self.box.bottom, 0, self.box.height), INK, LINE_PT)
        for length_pt, values in ((TICK_PT, ticks), (TICK_PT / 2, self.y.small_ticks())):
            for _, y in self.places(self.x.low, values):
                self.page.rule(Box(self.box.left - length_pt * POINT, y, length_pt * POINT, 0), INK, LINE_PT)
        for (x, y), label in zip(self.places(self.x.low, ticks), labels, strict=bool(labels)):
            write_middle(self.page, x - (TICK_PT + PAD_PT) * POINT, y, label, size_pt, across=1.0)

    def name_axes(self, across: str, up: str, size_pt: float) -> None:
        """Write the names of both axes beyond their labels."""
        self.page.write(self.box.left + self.box.width / 2, self.box.bottom - NAME_GAPS[0], across, size_pt, across=0.5)
        self.page.write(self.box.left - NAME_GAPS[1], self.box.bottom + self.box.height / 2, up, size_pt, across=0.5,
                        up=0.0, turned=True)

    def entitle(self, title: str, size_pt: float, *, across: float = 0.0) -> Box:
        """Write a title above the panel."""
        left = self.box.left + across * self.box.width
        size_pt = self.page.fitting_size(title, size_pt, left if across else self.page.width - left)
        return self.page.write(left, self.box.top + 4 * POINT, title, size_pt, across=across, up=0.0)

    def legend(self, names: Sequence[tuple[str, Pen]], size_pt: float = SMALL) -> None:
        """Name curves in the corner that covers the fewest of them; of equal ones, in the lower left."""
        width, height = legend_size(self.page, names, size_pt)
        pad = size_pt / 2 * POINT
        corners = [Box(left, bottom, width, height) for left in (self.box.left + pad, self.box.right - pad - width)
                   for bottom in (self.box.bottom + pad, self.box.top - pad - height)]
        chosen = min(corners, key=self.covered)
        write_legend(self.page, chosen.left, chosen.top, names, size_pt)

    def covered(self, box: Box) -> int:
        """How much of the curves is in a box, in points of them."""
        count = 0
        for line in self.drawn:
            at = np.linspace(0, len(line) - 1, CHECKED)
            x, y = (np.interp(at, range(len(line)), along) for along in line.T)
            count += int(np.sum((x > box.left) & (x < box.right) & (y > box.bottom) & (y < box.top)))
        return count


def write_middle(page: Page, x: float, y: float, text: str, size_pt: float, colour: Any = INK, *, bold: bool = False,
                 across: float = 0.0) -> Box:
    """Write text with the middle of its capitals and digits at a height."""
    half = (CAP + LINE * text.count("\n")) * size_pt * POINT / 2
    return page.write(x, y + half + (ASCENT - CAP) * size_pt * POINT, text, size_pt, colour, bold=bold, across=across)


def legend_size(page: Page, names: Sequence[tuple[str, Pen]], size_pt: float) -> tuple[float, float]:
    """Width and height of a legend."""
    widest = max(page.text_box(0, 0, name, size_pt).width for name, _ in names)
    return (KEY_PT + KEY_GAP_PT) * POINT + widest, len(names) * LEGEND_LINE * size_pt * POINT


def write_legend(page: Page, left: float, top: float, names: Sequence[tuple[str, Pen]], size_pt: float) -> None:
    """Write the names of curves below each other, each after a stroke of its pen."""
    for number, (name, pen) in enumerate(names):
        y = top - (number + 0.5) * LEGEND_LINE * size_pt * POINT
        ends = np.array([(left, y), (left + KEY_PT * POINT, y)])
        page.lines([ends], Pen(pen.colour, pen.width_pt, pen.dashes))
        page.lines([ends.mean(axis=0, keepdims=True)], Pen(pen.colour, 0, (), pen.marker, pen.marker_pt, pen.face))
        write_middle(page, left + (KEY_PT + KEY_GAP_PT) * POINT, y, name, size_pt)
