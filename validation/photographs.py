"""The library's lenses beside photographs: vignetting, distortion and lateral colour in Lensfun's database.

    python validation/photographs.py [PAGE.md]

prints the differences of the lenses in `PHOTOGRAPHED`, and replaces the tables in the page. It needs lensfunpy, with
Lensfun's data, which `make validate-photographs` installs. No figure of these data is printed or written.
"""

import re
import sys
import tomllib
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

import numpy as np
import scipy

from lensfield.engine.fitting.even_light import GREEN_NM
from lensfield.engine.fitting.fit import RESPONSE_DEG, fit_rims
from lensfield.engine.fitting.lensfun import (
    SHARES,
    channel_heights_mm,
    find_photographed,
    straight_and_real_mm,
    vignetting_of,
)
from lensfield.engine.fitting.vignetting import light_of
from lensfield.engine.library import prescription_of
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.rays import FullPupil, trace_pupil
from lensfield.engine.rays.rings import turned

PHOTOGRAPHED = {
    "canon-rf-85mm-f1.2": "Canon RF 85mm F1.2L USM",
    "fujifilm-gf-110mm": "Fujifilm GF110mmF2 R LM WR",
    "helios-44-2-58mm": "KMZ Helios-44 58mm 1:2",
    "leica-summicron-50mm": "Leica Camera AG Summicron-M 1:2/50",
    "meyer-lydith-30mm": "Meyer Optik Görlitz 3.5/30mm",
    "minolta-macro-100mm": "Sony Minolta/Sony AF 100mm F2.8 Macro (D)",
    "nikkor-28mm": "Nikon AI-S Nikkor 28mm f/2.8",
    "nikkor-35mm-f1.4": "Nikon AI-S Nikkor 35mm f/1.4",
    "nikkor-50mm-f1.2": "Nikon AI-S Nikkor 50mm f/1.2",
    "nikkor-58mm-f1.4": "Nikon AF-S Nikkor 58mm f/1.4G",
    "nikkor-reflex-500mm": "Nikon AI-S Nikkor 500mm f/8 Reflex",
    "nikkor-z-50mm-f1.8": "Nikon NIKKOR Z 50mm f/1.8 S",
    "sigma-35mm-f1.2": "Sigma 35mm F1.2 DG DN | Art 019",
    "sigma-40mm-f1.4": "Sigma 40mm F1.4 DG HSM | Art 018",
    "sony-zeiss-55mm-f1.8": "Sony FE 55mm f/1.8 ZA",
    "voigtlander-apo-lanthar-50mm": "Voigtländer Voigtlander APO-LANTHAR 50mm F2 Aspherical",
    "zeiss-distagon-25mm": "Zeiss Distagon T* 25mm f/2.8 ZF.2",
    "zeiss-flektogon-20mm": "Zeiss Carl Zeiss Jena Flektogon 4/20mm",
}
"""Lenses of the library, and their makers and models in Lensfun."""
ESTIMATED_MM = tomllib.loads(Path(__file__).with_name("estimated_apertures.toml").read_text(encoding="utf-8"))
"""Lenses whose rims are fitted by library_rims.py, and the semi-apertures of their surfaces before."""
SHOWN = 0.5, 0.75, 0.9, 0.95  # of `SHARES`
CHANNELS_NM = 600.0, GREEN_NM, 460.0  # near the middles of cameras' red, green and blue in daylight
CHIEF_RAYS = 65
TODAY = date.today().isoformat()
LIGHT_HEAD = "| lens | focus | widest f-stop, at 0.5, 0.75, 0.9, 0.95 | largest at each f-stop |"
RIMS_HEAD = ("| lens | rims in mm | pixels at 20° | widest f-stop: before, after | other f-stops: before, after "
             "| left out of the fit |")
SHAPE_HEAD = "| lens | focal length | distortion, largest | mean | red, largest | blue, largest |"


@dataclass(frozen=True)
class Shape:
    """Differences of chief rays from a photograph, in micrometres.

    Attributes
    ----------
    focal_mm : float
        With which they agree best.
    distortion_um, mean_um : float or None
        The largest and the mean difference up to 0.95 of the half diagonal; None if it was not measured.
    red_um, blue_um : float or None
        The largest differences of the distances between this channel and green.
    """

    focal_mm: float | None
    distortion_um: float | None
    mean_um: float | None
    red_um: float | None
    blue_um: float | None


def light_differences(name, prescription):
    """(curve, lens's light minus the photograph's) for the f-stops and distances of a lens; [] without any."""
    photographed = find_photographed(PHOTOGRAPHED[name])
    if not photographed.lens.calib_vignetting:
        return []
    curves = vignetting_of(photographed, prescription)
    return [(curve, light - curve.light) for curve, light in
            zip(curves, light_of(prescription, curves), strict=True)]


def shape(name):
    """The Shape of a lens."""
    photographed, chief = find_photographed(PHOTOGRAPHED[name]), ChiefRays(prescription_of(name))
    measured = straight_and_real_mm(photographed)
    focal_mm, off_um = chief.best(*measured) if measured else (None, None)
    channels = channel_heights_mm(photographed)
    red_um, blue_um = chief.colour(*channels) if channels else (None, None)
    largest, mean = (None, None) if off_um is None else (np.abs(off_um).max(), np.abs(off_um).mean())
    return Shape(focal_mm, largest, mean, red_um, blue_um)


class ChiefRays:
    """Distances from the axis of chief rays on the sensor, focused at infinity, over their paraxial heights."""

    def __init__(self, prescription):
        system = system_of(turned(prescription).prescription)
        self._focal_mm, last_mm = system.efl_mm, system.last_height_mm
        self._paraxial_mm = np.linspace(0, last_mm, CHIEF_RAYS)
        rays = trace_pupil(system, self._paraxial_mm, CHANNELS_NM, FullPupil(1, 1))
        self._real_mm = np.abs(rays.chief_height_mm)

    def best(self, straight_mm, real_mm):
        """The focal length in mm with which chief rays agree best with measured heights, and the differences in um."""
        curve = scipy.interpolate.make_interp_spline(self._paraxial_mm, self._real_mm[1])

        def off_mm(scale):
            return curve(scale * straight_mm) - real_mm

        scale, = scipy.optimize.least_squares(lambda x: off_mm(x[0]), [1.0]).x
        return float(self._focal_mm / scale), 1e3 * off_mm(scale)

    def colour(self, red_mm, green_mm, blue_mm):
        """The largest differences of red and of blue from green, in um, from measured ones."""
        own = [scipy.interpolate.make_interp_spline(self._real_mm[1], channel - self._real_mm[1])(green_mm)
               for channel in self._real_mm[[0, 2]]]
        return [float(1e3 * np.abs(each - (measured - green_mm)).max())
                for each, measured in zip(own, (red_mm, blue_mm), strict=True)]


def source_of(name):
    """The source of a lens's photographs, as its file names it."""
    return f"Lensfun: {find_photographed(PHOTOGRAPHED[name]).name}"


def estimated(name):
    """A lens of the library with the apertures that were estimated before its rims were fitted."""
    lens = prescription_of(name)
    return replace(lens, surfaces=tuple(replace(surface, semi_aperture_mm=size_mm) for surface, size_mm in
                                        zip(lens.surfaces, ESTIMATED_MM[name], strict=True)))


def fitted(name):
    """The RimFit of a lens of the library."""
    photographed, prescription = find_photographed(PHOTOGRAPHED[name]), estimated(name)
    return fit_rims(prescription, vignetting_of(photographed, prescription), source_of(name), TODAY)


def rims_row(name):
    """The line of the table of fitted rims."""
    fit = fitted(name)
    rims = "<br>".join(f"{rim.group}, surface {rim.surface}: {rim.semi_aperture_mm:.2f} ± {rim.sigma_mm:.2f}"
                       for rim in fit.rims)
    response = np.exp(-fit.pixel_loss * np.sin(np.radians(RESPONSE_DEG))**2)
    widest = min(each.curve.f_number for each in fit.comparisons)
    missed = [np.max([each.missed for each in fit.comparisons if (each.curve.f_number == widest) == at_widest], axis=0)
              for at_widest in (True, False)]
    cells = [f"{before:.2f}, {after:.2f}" for before, after in missed]
    return f"| `{name}` | {rims} | {response:.2f} | {' | '.join(cells)} | {fit.judged:.3f} |"


def light_rows(name):
    """Lines of the table of light: one for each focus."""
    differences = light_differences(name, prescription_of(name))
    for focus_mm in dict.fromkeys(curve.focus_mm for curve, _ in differences):
        at = [(curve, off) for curve, off in differences if curve.focus_mm == focus_mm]
        shown = " ".join(f"{each:+.2f}" for each in np.interp(SHOWN, SHARES, at[0][1]))
        largest = ", ".join(f"f/{curve.f_number:g} {off[np.abs(off).argmax()]:+.2f}" for curve, off in at)
        where = "infinity" if np.isinf(focus_mm) else f"{focus_mm / 1e3:.3g} m"
        yield f"| `{name}` | {where} | {shown} | {largest} |"


def shape_row(name):
    """The line of the table of distortion and lateral colour; None without either."""
    figures = shape(name)
    if figures.distortion_um is None and figures.red_um is None:
        return None
    focal = "" if figures.focal_mm is None else f"{figures.focal_mm:.1f} mm"
    others = figures.distortion_um, figures.mean_um, figures.red_um, figures.blue_um
    return f"| `{name}` | {focal} | {' | '.join('' if each is None else f'{each:.0f} µm' for each in others)} |"


def table(head, rows):
    return "\n".join([head, "|" + "---|" * (head.count("|") - 1), *rows])


def light_table():
    return table(LIGHT_HEAD, [row for name in PHOTOGRAPHED for row in light_rows(name)])


def rims_table():
    return table(RIMS_HEAD, map(rims_row, ESTIMATED_MM))


def shape_table():
    return table(SHAPE_HEAD, filter(None, map(shape_row, PHOTOGRAPHED)))


def with_tables(page, by_head):
    """The page with its tables replaced."""
    for head, text in by_head.items():
        page = re.sub(re.escape(head) + r"\n(?:\|.*\n)*", lambda _, text=text: text + "\n", page)
    return page


def show(by_head, page=None):
    """Print tables, and replace those of a page."""
    print("\n\n".join(by_head.values()))
    if page:
        path = Path(page)
        path.write_text(with_tables(path.read_text(encoding="utf-8"), by_head), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    show({LIGHT_HEAD: light_table(), RIMS_HEAD: rims_table(), SHAPE_HEAD: shape_table()}, *sys.argv[1:])
