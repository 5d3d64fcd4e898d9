"""Rims fitted to photographs: as few as the light of even fields supports, within what mechanics allow.

At most one rim of each group of the lens is fitted, with the pixels' response to oblique light. Radii and glasses stay
as they are. Some of the f-stops and focus distances are left out, and judge the fit.
"""

import datetime
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy

from ..prescription.photographs import Agreement, Vignetting
from ..prescription.prescription import FITTED, Prescription
from ..rays.rings import ring_ends
from ..runtime.errors import LensError, listed
from .even_light import EvenField, picture_corner_mm
from .rims import GROUPS, RimRange, passing_chief_rays, rim_ends_mm, rim_ranges, with_rims
from .vignetting import light_of, measured_heights_mm

HELD_OUT_OF, LEAST_CURVES = 3, 4  # every third curve is left out, if there are as many
FIGURES_PER_CURVE = 3  # that are independent: curves are smooth, and Lensfun's have three terms
CHANCE = 0.05  # of an improvement at least as large by a rim that is not there, in the F-test
BETTER, WORSE = 0.7, 1.5  # sums of squares of the curves left out, relative to that without an unknown: the first
# justifies it, and the second forbids it
LEAST_NOISE = 0.002  # of the light: the error of its integral
SCANNED, TRIED = (0.0, 0.08, 0.2, 0.4, 0.7), 3  # places in a rim's range; and the best rims, which are fitted
MOST_PIXEL_LOSS = 3.0
STEP, SCALE, TOLERANCE, MOST_STEPS = 1e-3, 0.2, 1e-7, 30  # of the search
CANNOT_PASS = 0.1  # of the light on the axis: more than the lens's surfaces pass
WIDER = 0.9  # of the lens's lowest f-number: photographs with a lower one are of another lens
DIGITS, LIGHT_DIGITS = 3, 4  # of lengths and of the illumination in a file, and of the curves of light
MOST_NAMED = 3  # files
RESPONSE_DEG = 20.0  # at which the pixels' response is reported


@dataclass(frozen=True)
class FittedRim:
    """A rim.

    Attributes
    ----------
    surface : int
        Its number, from 1.
    group : str
    semi_aperture_mm, sigma_mm : float
        Its size, and the standard deviation of that.
    before_mm : float
        Its size before the fit.
    """

    surface: int
    group: str
    semi_aperture_mm: float
    sigma_mm: float
    before_mm: float

    def __str__(self):
        return (f"{self.group} rim, surface {self.surface}: {self.semi_aperture_mm:.2f} ± {self.sigma_mm:.2f} mm, "
                f"before {self.before_mm:.2f} mm")


@dataclass(frozen=True, eq=False)
class Comparison:
    """A measured curve, and the light of the lens at its heights.

    Attributes
    ----------
    curve : Vignetting
    judge : bool
        Whether it was left out of the fit.
    before, after : array (height,)
        Light of the lens before the fit, and with the fitted rims and pixels.
    """

    curve: Vignetting
    judge: bool
    before: np.ndarray
    after: np.ndarray

    @property
    def missed(self) -> tuple[float, float]:
        """The largest difference before and after the fit."""
        return tuple(float(np.abs(light - self.curve.light).max()) for light in (self.before, self.after))  # type: ignore[return-value]


@dataclass(frozen=True, eq=False)
class RimFit:
    """A lens with fitted rims.

    Attributes
    ----------
    prescription : Prescription
        With `provenance`: apertures fitted to photographs.
    rims : tuple of FittedRim
    pixel_loss, pixel_sigma : float
        As in `StopLight.at`, and its standard deviation; 0 if the photographs do not show it.
    comparisons : tuple of Comparison
    """

    prescription: Prescription
    rims: tuple[FittedRim, ...]
    pixel_loss: float
    pixel_sigma: float
    comparisons: tuple[Comparison, ...]

    @property
    def judged(self) -> float:
        """The largest difference at the f-stops and distances that were left out, or at all of them if none was."""
        judges = [each for each in self.comparisons if each.judge] or self.comparisons
        return max(each.missed[1] for each in judges)

    def lines(self) -> list[str]:
        """The fit as text."""
        kinds = {False: "fitted", True: "left out"}
        table = [f"{str(each.curve):<24} {kinds[each.judge]:<9} {each.missed[0]:8.3f} {each.missed[1]:8.3f}"
                 for each in self.comparisons]
        return [*map(str, self.rims), *self._pixel_lines(), "",
                f"{'largest difference':<34} {'before':>8} {'after':>8}", *table,
                f"at f-stops and distances left out of the fit: {self.judged:.3f}"
                if any(each.judge for each in self.comparisons) else
                f"too few f-stops and distances to leave any out: {self.judged:.3f}"]

    def _pixel_lines(self):
        if self.pixel_loss:
            square = np.sin(np.radians(RESPONSE_DEG))**2
            share = np.exp(-self.pixel_loss * square)
            yield (f"pixels: {share:.3f} ± {share * square * self.pixel_sigma:.3f} of the light at {RESPONSE_DEG:g} "
                   "degrees")


def fit_rims(prescription: Prescription, curves: list[Vignetting], source: str, date: str,
             keep_light: bool = False) -> RimFit:
    """Fit rims of a lens to the light of even fields in photographs.

    Parameters
    ----------
    prescription : Prescription
    curves : list of Vignetting
        Of one f-stop: one rim at most.
    source, date : str
        Of the photographs, and of the fit, for `Prescription.photographs`.
    keep_light : bool
        Whether `Prescription.photographs` also has the curves.

    Raises
    ------
    LensError
        The curves are of another lens, or the lens is not one that `EvenField` can trace.
    """
    problem = _Problem(prescription, curves)
    problem.check()
    chosen, state = _chosen_rims(problem)
    rims_mm = dict(zip((each.surface for each in chosen), problem.sizes_mm(chosen, state.x), strict=True))
    fitted = with_rims(prescription, problem.fields, rims_mm)
    pixel_loss = float(state.x[-1]) if problem.has_pixels(chosen, state.x) else 0.0
    sigmas = problem.sigmas(state)
    rims = tuple(FittedRim(each.surface + 1, each.group, rims_mm[each.surface],
                           sigma * (each.most_mm - each.least_mm),
                           prescription.surfaces[each.surface].semi_aperture_mm)
                 for each, sigma in zip(chosen, sigmas, strict=False))
    comparisons = [Comparison(curve, judge, before, after) for curve, judge, before, after in
                   zip(curves, problem.judges, light_of(prescription, curves), light_of(fitted, curves, pixel_loss),
                       strict=True)]
    fit = RimFit(fitted, rims, pixel_loss, float(sigmas[-1]) if pixel_loss else 0.0, tuple(comparisons))
    provenance = dict(prescription.provenance) | {"apertures": FITTED}
    light = tuple(map(_rounded, curves)) if keep_light else ()
    agreement = Agreement(source, date, round(fit.judged, DIGITS), light=light)
    return replace(fit, prescription=replace(fitted, provenance=tuple(provenance.items()), photographs=agreement))


def fit_to_files(prescription: Prescription, curves: list[Vignetting], paths: Sequence[Path]) -> RimFit:
    """As `fit_rims`, for photographs that the user took: `Prescription.photographs` also has their curves.

    Parameters
    ----------
    prescription : Prescription
    curves : list of Vignetting
    paths : sequence of Path
        The files of the photographs.
    """
    source = listed([path.name for path in paths], MOST_NAMED)
    return fit_rims(prescription, curves, source, datetime.date.today().isoformat(), keep_light=True)


def _rounded(curve):
    return replace(curve, heights_mm=curve.heights_mm.round(DIGITS), light=curve.light.round(LIGHT_DIGITS))


def with_rim_pair(prescription: Prescription, curve: Vignetting) -> Prescription:
    """A lens with one rim in front of the stop and one behind it, with which its light is closest to a curve.

    Both pass the light of the axis and all chief rays, at the closest focus, too.

    Parameters
    ----------
    prescription : Prescription
    curve : Vignetting
        Of the widest f-number.

    Raises
    ------
    LensError
        As `EvenField`.
    """
    problem = _Problem(prescription, [curve], lambda rim: rim.surface < prescription.stop_index,
                       [ring_ends(prescription)[1].focus_mm])
    problem.ranges = passing_chief_rays(problem.ranges, problem.fields)
    chosen = _Rims([], problem.searched([], np.zeros(0)))
    while longer := problem.extended(chosen):
        chosen = longer
    sizes_mm = problem.sizes_mm(chosen.ranges, chosen.state.x)
    return with_rims(prescription, problem.fields,
                     dict(zip((each.surface for each in chosen.ranges), sizes_mm, strict=True)))


def _chosen_rims(problem):
    """The rims that the curves support, and the search's result for them."""
    several = len({curve.f_number for curve in problem.curves}) > 1
    chosen = _Rims([], problem.searched([], np.full(int(several), 0.3)))
    for _ in range(len(GROUPS) if several else 1):
        longer = problem.extended(chosen)
        if longer is None or not problem.supports(longer, chosen):
            break
        chosen = longer
    if several:
        without = _Rims(chosen.ranges, problem.searched(chosen.ranges, chosen.state.x[:-1]))
        chosen = chosen if problem.supports(chosen, without) else without
    return chosen


class _Rims(NamedTuple):
    """Rims, and the result of the search for their sizes."""

    ranges: list[RimRange]
    state: Any

    @property
    def unknowns(self):
        return len(self.state.x)


class _Problem:
    """The light of a lens at measured heights as a function of rims: each a share of its range, and then, for curves
    at several f-stops, the loss of the pixels.

    Of each kind of rim, such as those of a group, one is fitted at most. `focuses_mm` are more focus distances at which
    the lens is used.
    """

    def __init__(self, prescription: Prescription, curves: list[Vignetting],
                 kind: Callable[[RimRange], Hashable] = attrgetter("group"),
                 focuses_mm: Sequence[float | None] = ()) -> None:
        self.prescription, self.curves, self._kind = prescription, curves, kind
        self.judges = _held_out(curves)
        by_focus = {focus: self._field(focus) for focus in self._focuses(focuses_mm)}
        self.fields = list(by_focus.values())
        self._lights = [by_focus[curve.focus_mm].through(curve.f_number) for curve in curves]
        self._places = [np.searchsorted(by_focus[curve.focus_mm].heights_mm, curve.heights_mm) for curve in curves]
        self.ranges = rim_ranges(prescription, self.fields)
        ends_mm = rim_ends_mm(prescription, self.fields)
        self._ends_mm = {index: end_mm for index, end_mm in enumerate(ends_mm) if np.isfinite(end_mm)}

    def _focuses(self, more_mm):
        """Focus distances: infinity or the farthest, the distances of the curves, and more."""
        return dict.fromkeys([ring_ends(self.prescription)[0].focus_mm, *(curve.focus_mm for curve in self.curves),
                              *more_mm])

    def _field(self, focus_mm):
        corner_mm = picture_corner_mm(self.prescription, focus_mm)
        return EvenField(self.prescription, focus_mm, measured_heights_mm(self.curves, focus_mm, corner_mm))

    def check(self):
        """Raise a LensError for curves that cannot be of this lens."""
        open_light = [self._predicted(number, [], [], 0.0) for number in range(len(self.curves))]
        for curve, light in zip(self.curves, open_light, strict=True):
            if curve.f_number < WIDER * self.fields[0].f_number:
                raise LensError(self.prescription.name, "f-number", f"{curve.f_number:g} in the photographs",
                                f"the lens has f/{self.fields[0].f_number:.3g}: give photographs of this lens")
            worst = np.argmax(curve.light - light)
            if curve.light[worst] - light[worst] > CANNOT_PASS:
                raise LensError(self.prescription.name, f"light at {curve.heights_mm[worst]:.3g} mm, {curve}",
                                f"{curve.light[worst]:.2f}", f"its surfaces pass {light[worst]:.2f} at most, with rims "
                                "as wide as the glass: another lens, or photographs corrected in the camera")

    def sizes_mm(self, chosen, x):
        """Semi-apertures of chosen rims."""
        return [each.least_mm + share * (each.most_mm - each.least_mm)
                for each, share in zip(chosen, x, strict=False)]

    @staticmethod
    def has_pixels(chosen, x):
        return len(x) > len(chosen)

    def _predicted(self, number, surfaces, sizes_mm, pixel_loss):
        rims_mm = self._ends_mm | dict(zip(surfaces, sizes_mm, strict=True))
        light = self._lights[number].at(list(rims_mm), np.array(list(rims_mm.values())), pixel_loss)
        return light[self._places[number]]

    def _residuals(self, chosen, x, judges=False):
        pixel_loss = x[-1] if self.has_pixels(chosen, x) else 0.0
        surfaces, sizes_mm = [each.surface for each in chosen], self.sizes_mm(chosen, x)
        return np.concatenate([self._predicted(number, surfaces, sizes_mm, pixel_loss) - curve.light
                               for number, curve in enumerate(self.curves) if self.judges[number] == judges])

    def searched(self, chosen, start):
        """The least squares over rims and pixels, from a start."""
        most = np.array([1.0] * len(chosen) + [MOST_PIXEL_LOSS] * (len(start) - len(chosen)))
        if not len(start):
            return scipy.optimize.OptimizeResult(x=start, fun=self._residuals(chosen, start), jac=None)
        found = scipy.optimize.least_squares(  # unknowns from 1 on, because steps are relative
            lambda x: self._residuals(chosen, x - 1), 1 + np.clip(start, STEP * most, (1 - STEP) * most),
            bounds=(np.ones_like(most), 1 + most), diff_step=STEP, x_scale=SCALE * most, ftol=TOLERANCE,
            xtol=TOLERANCE, max_nfev=MOST_STEPS)
        found.x = found.x - 1
        return found

    def extended(self, rims):
        """The rims with one more, each replaced by a better one if there is one; None without any left."""
        longer = self._best([*rims.ranges, None], rims.state.x, self._unlike(rims.ranges))
        for place in range(len(longer.ranges) if longer else 0):
            before, after = longer.ranges[:place], longer.ranges[place + 1:]
            replaced = self._best([*before, None, *after], np.delete(longer.state.x, place),
                                  self._unlike([*before, *after]))
            longer = min(longer, replaced, key=lambda each: np.sum(each.state.fun**2))
        return longer

    def _unlike(self, ranges):
        """The rims that are of none of the kinds of these."""
        used = {self._kind(each) for each in ranges}
        return [each for each in self.ranges if self._kind(each) not in used]

    def _best(self, ranges, others, candidates):
        """The rims with the best of the candidates in the place of None; None without candidates. `others` are the
        unknowns of the other rims and of the pixels."""
        place, scans = ranges.index(None), []
        for number, candidate in enumerate(candidates):
            tried = [*ranges[:place], candidate, *ranges[place + 1:]]
            starts = [np.insert(others, place, share) for share in SCANNED]
            costs = [np.sum(self._residuals(tried, start)**2) for start in starts]
            scans.append((min(costs), number, tried, starts[int(np.argmin(costs))]))
        results = [_Rims(tried, self.searched(tried, start)) for _, _, tried, start in sorted(scans)[:TRIED]]
        return min(results, key=lambda each: np.sum(each.state.fun**2), default=None)

    def supports(self, longer, shorter):
        """Whether the F-test, or the curves left out, support the longer of two fits, with one more unknown."""
        free = self._figures - longer.unknowns
        gained, left = np.sum(shorter.state.fun**2) - np.sum(longer.state.fun**2), _squares(longer.state.fun)
        if free <= 0 or gained <= 0:
            return False
        judged = self._judged(longer) / self._judged(shorter)
        by_chance = scipy.special.fdtrc(1, free, gained / left * free)
        return judged < BETTER or (by_chance < CHANCE and judged < WORSE)

    @property
    def _figures(self):
        """Number of independent figures of the fitted curves."""
        return FIGURES_PER_CURVE * self.judges.count(False)

    def _judged(self, rims):
        """Sum of squares of the curves that are left out; 1 without any."""
        return _squares(self._residuals(rims.ranges, rims.state.x, judges=True)) if any(self.judges) else 1.0

    def sigmas(self, state):
        """Standard deviations of the unknowns, by as many independent figures as the curves have."""
        variance = _squares(state.fun) / max(self._figures - len(state.x), 1)
        return np.sqrt(variance * np.diag(np.linalg.pinv(state.jac.T @ state.jac))) if len(state.x) else np.zeros(0)


def _squares(residuals):
    """Sum of squares, at least those of `LEAST_NOISE`."""
    return max(np.sum(residuals**2), residuals.size * LEAST_NOISE**2)


def _held_out(curves):
    """Whether each curve is left out: every third over f-stops and distances, and none of a few."""
    stops = sorted({curve.f_number for curve in curves})
    focuses = sorted({curve.focus_mm for curve in curves})
    if len(curves) < LEAST_CURVES or len(stops) < 2:
        return [False] * len(curves)
    return [(stops.index(curve.f_number) + focuses.index(curve.focus_mm)) % HELD_OUT_OF == 1 for curve in curves]
