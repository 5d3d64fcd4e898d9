"""The rule for rims that are not known: the light of lenses in Lensfun's database, and how well it predicts others.

    python validation/typical_light.py [PAGE.md]

fits `TypicalLight` to the lenses for full frame, predicts by it the light of each lens whose rims are fitted to
photographs, without that lens in the fit, and compares these predictions with estimated apertures. It prints the
tables, and replaces them in the page. It needs lensfunpy; no figure of Lensfun's data is printed or written.
"""

import sys
from typing import NamedTuple

import numpy as np
import scipy

from lensfield.engine.fitting.lensfun import SHARES, find_photographed, fixed_focal_lenses, light_at
from lensfield.engine.fitting.typical import STOPPED_DOWN, TypicalLight, with_typical_rims
from lensfield.engine.fitting.vignetting import light_of
from lensfield.engine.library import prescription_of
from lensfield.engine.prescription.photographs import Vignetting
from lensfield.engine.prescription.prescription import ESTIMATED, TYPICAL
from lensfield.engine.rays.rings import ring_ends
from photographs import ESTIMATED_MM, PHOTOGRAPHED, SHOWN, estimated, show, table

FULL_FRAME = 0.75, 1.1  # crop factors: up to 44 x 33 mm
SLOWEST, SMALLEST = 4.1, 16.5  # widest f-numbers, and f-numbers without diffraction in the photographs
START = 1.0, 0.0, 2.0  # of the fit
STOPS = 0, 1, 2, 3, 4  # below the widest
RULE_HEAD = ("| lenses | half of the light at, for f/2 | grows with the f-number to the power | steepness "
             "| spread of the place |")
PREDICTED_HEAD = "| lens | estimated, at 0.5, 0.75, 0.9, 0.95 | typical |"
ERRORS_HEAD = "| apertures | f-stops below the widest | 0.5 | 0.75 | 0.9 | 0.95 |"


class WideOpen(NamedTuple):
    """A photographed lens: its widest f-number, and its light there over its light stopped down, at `SHARES`."""

    name: str
    f_number: float
    light: np.ndarray


def wide_open():
    """The lenses for full frame whose light is measured wide open and stopped down."""
    lenses = [_wide_open(each) for each in fixed_focal_lenses() if _is_for_full_frame(each.lens)]
    return [each for each in lenses if each]


def _is_for_full_frame(lens):
    return (FULL_FRAME[0] < lens.crop_factor < FULL_FRAME[1] and lens.type.name == "RECTILINEAR"
            and len(lens.calib_vignetting) > 1)


def _wide_open(photographed):
    far = {each.aperture: each.distance for each in
           sorted(photographed.lens.calib_vignetting, key=lambda each: each.distance)}
    widest, smallest = min(far), max((f_number for f_number in far if f_number < SMALLEST), default=0.0)
    if "converter" in photographed.name or widest > SLOWEST or smallest < 0.98 * STOPPED_DOWN * widest:
        return None
    wide, closed = (light_at(photographed, f_number, far[f_number]) for f_number in (widest, smallest))
    return WideOpen(photographed.name, widest, wide / closed)


def fit_typical(lenses):
    """The TypicalLight of lenses."""
    light = np.array([each.light for each in lenses])

    def off(unknowns):
        typical = TypicalLight(*unknowns)
        return (np.array([typical.at(each.f_number, SHARES) for each in lenses]) - light).ravel()

    return TypicalLight(*scipy.optimize.least_squares(off, START).x)


def spread(typical, lenses):
    """Relative standard deviation of the place of half the light among lenses."""
    def scale(lens):
        found = scipy.optimize.least_squares(
            lambda half: typical._replace(half=half[0]).at(lens.f_number, SHARES) - lens.light, [typical.half])
        return found.x[0] / typical.half

    return float(np.std(np.log([scale(each) for each in lenses])))


def predictions(name, lenses):
    """Light of a lens with fitted rims at `STOPS`, and the light that its estimated apertures and typical rims give it;
    the rule is that of the other lenses: dict of lists of arrays (height,) by origin, "" for the first."""
    others = [each for each in lenses if each.name != find_photographed(PHOTOGRAPHED[name]).name]
    lens = prescription_of(name)
    heights_mm = SHARES * np.hypot(*lens.sensor_mm) / 2
    far, _ = ring_ends(lens)
    curves = [Vignetting(far.f_number * 2**(stops / 2), far.focus_mm, heights_mm, heights_mm) for stops in STOPS]
    return {origin: light_of(each, curves) for origin, each in (
        ("", lens), (ESTIMATED, estimated(name)), (TYPICAL, with_typical_rims(lens, fit_typical(others))))}


class Errors:
    """Differences of predictions from fitted rims, for all lenses with them."""

    def __init__(self, lenses):
        found = [predictions(name, lenses) for name in ESTIMATED_MM]
        self._light = {origin: np.array([_shown(each[origin]) for each in found])
                       for origin in ("", ESTIMATED, TYPICAL)}

    def wide_open(self, origin):
        """Differences in light wide open: array (lens, share of `SHOWN`)."""
        return (self._light[origin] - self._light[""])[:, 0]

    def relative(self, origin):
        """Root mean squares over the lenses of relative differences: array (stop, share of `SHOWN`)."""
        return np.sqrt(np.mean(np.log(self._light[origin] / self._light[""])**2, axis=0))


def _shown(light):
    return [np.interp(SHOWN, SHARES, each) for each in light]


def rule_table(lenses):
    typical = fit_typical(lenses)
    return table(RULE_HEAD, [f"| {len(lenses)} | {typical.half:.2f} | {typical.by_f_number:.2f} | "
                             f"{typical.steepness:.2f} | ± {100 * spread(typical, lenses):.0f} % |"])


def predicted_table(errors):
    columns = [errors.wide_open(origin) for origin in (ESTIMATED, TYPICAL)]
    rows = [f"| `{name}` | {' | '.join(' '.join(f'{each:+.2f}' for each in column[number]) for column in columns)} |"
            for number, name in enumerate(ESTIMATED_MM)]
    means = [" ".join(f"{each:.2f}" for each in np.sqrt(np.mean(column**2, axis=0))) for column in columns]
    return table(PREDICTED_HEAD, [*rows, f"| root mean square | {' | '.join(means)} |"])


def errors_table(errors):
    return table(ERRORS_HEAD, [
        f"| {origin} | {stops} | {' | '.join(f'{100 * each:.0f} %' for each in row)} |"
        for origin in (ESTIMATED, TYPICAL) for stops, row in zip(STOPS, errors.relative(origin), strict=True)])


def tables():
    """The tables of the page, by head."""
    lenses = wide_open()
    errors = Errors(lenses)
    return {RULE_HEAD: rule_table(lenses), PREDICTED_HEAD: predicted_table(errors), ERRORS_HEAD: errors_table(errors)}


if __name__ == "__main__":
    show(tables(), *sys.argv[1:])
