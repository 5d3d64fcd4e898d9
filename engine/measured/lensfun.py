"""Lenses in Lensfun's database: https://lensfun.github.io/manual/latest/el_lens.html

The user's copy is read; Lensfield contains none of it. Lensfun's radius is 1 at half the short side of the sensor that
the lens was photographed with; for vignetting, at its corner. Values between those of the database follow Lensfun's own
interpolation. The focal length of the file belongs to its undistorted picture, unless `real-focal` states the one on
the axis.
"""

import os
import sysconfig
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from ..calibration.models import LENSFUN_FISHEYES, Model, at_radius
from ..lens.formats import FORMATS
from ..runtime.errors import InputError, LensError, listed
from .camera import Fringes, ModelledCamera, pixel_mm
from .documents import read_xml
from .options import MeasuredOptions

FULL_FRAME_MM = float(np.hypot(*FORMATS["fullframe"][1]))  # its diagonal
INSTALLED = ("~/.local/share/lensfun/updates/version_1", "~/.local/share/lensfun", "/usr/local/share/lensfun/version_1",
             "/usr/share/lensfun/version_1", "/usr/share/lensfun", "/opt/homebrew/share/lensfun/version_1")
COLUMNS_PX = 6000  # of a picture whose size is not stated
ASPECT_RATIO = 1.5
MOST_NAMED = 6
NEARLY_ALL = 1.02
NEAR, POWER = 1e-4, 3.5  # of Lensfun's weights of vignetting
FAR_M, UNKNOWN_DISTANCE = 1000.0, 1.0
PROJECTIONS = {"rectilinear": np.tan} | LENSFUN_FISHEYES
"""Distance from the axis over the angle, by the type of the lens."""
DISTORTIONS = {"poly3": ("k1",), "poly5": ("k1", "k2"), "ptlens": ("a", "b", "c")}
TCA = {"linear": ("kr", "kb"), "poly3": ("vr", "vb", "cr", "cb", "br", "bb")}
TCA_DEFAULTS = {"kr": 1.0, "kb": 1.0, "vr": 1.0, "vb": 1.0}
NOT_SCALED = 2  # the first terms of lateral colour are interpolated as they are, and other terms times the focal length


class Entry(NamedTuple):
    """A lens in a file of the database."""

    path: Path
    element: Element
    maker: str
    model: str

    @property
    def name(self) -> str:
        """Its model, with its maker unless the model begins with it."""
        return self.model if self.model.casefold().startswith(self.maker.casefold()) else f"{self.maker} {self.model}"

    def number(self, field: str, default: float) -> float:
        """A positive number in an element; the default without it."""
        return _number(self.path, self.name, field, self.element.findtext(field), default)


@dataclass(frozen=True)
class Sensor:
    """Lengths of Lensfun on a picture.

    Attributes
    ----------
    size_px : (int, int)
    width_mm : float
        Of the picture.
    unit_mm, unit_px, corner_px : float
        Distances from the middle at which Lensfun's radius is 1: of distortion and lateral colour, and of vignetting.
        Lensfun's own sensor ends at the middles of the outermost pixels.
    """

    size_px: tuple[int, int]
    width_mm: float
    unit_mm: float
    unit_px: float
    corner_px: float


def installed_database() -> Path:
    """The folder of the installed database.

    Raises
    ------
    InputError
        Lensfun is not installed.
    """
    of_package = os.path.join(sysconfig.get_path("purelib"), "lensfunpy", "db_files")
    for folder in (Path(os.path.expanduser(each)) for each in (*INSTALLED, of_package)):
        if any(folder.glob("*.xml")):
            return folder
    raise InputError("lensfun", "database", "missing", "install Lensfun or give the folder of its database, or a file")


def read_lensfun(path: Path, options: MeasuredOptions) -> ModelledCamera:
    """A lens in a file of the database, or in a folder of such files, at a focal length, f-number and distance."""
    entry = _entry(path, options)
    focal_mm = _focal_mm(entry, options)
    sensor = _sensor(entry, options)
    kind = (entry.element.findtext("type") or "rectilinear").strip().casefold()
    if kind not in PROJECTIONS:
        raise LensError(entry.path, f"{entry.name}, type", kind, f"expected {', '.join(PROJECTIONS)}")
    model, terms = _distortion(entry, focal_mm)
    polynomial = _polynomial(model, terms)
    focal = (_axial_mm(entry, focal_mm) or focal_mm * polynomial(0.0)) / sensor.unit_mm
    focal_px = focal * sensor.unit_px
    placed = _placing(PROJECTIONS[kind], polynomial, focal)
    light = _vignetting(entry, focal_mm, options)
    return ModelledCamera(
        entry.name, f"Lensfun: {kind}, {model or 'no distortion'}", sensor.size_px, (focal_px, focal_px),
        tuple((side - 1) / 2 for side in sensor.size_px),
        Model("lensfun", (), placed, (), fisheye=kind != "rectilinear"), width_mm=sensor.width_mm,
        notes=tuple(_notes(entry, model, light, sensor)), fringes=_fringes(entry, focal_mm, sensor),
        light=light and _of_shares(light, np.hypot(*sensor.size_px) / 2 / sensor.corner_px))


def _entry(path, options):
    """The lens that the options name, measured on the largest sensor; the only one by default."""
    files = sorted(path.glob("*.xml")) if path.is_dir() else [path]
    if not files:
        raise LensError(path, "folder", "without .xml", "expected Lensfun's database")
    entries = [entry for file in files for entry in _entries(file)]
    if options.which is None and len({entry.name for entry in entries}) == 1:
        return min(entries, key=lambda entry: entry.number("cropfactor", 1.0))
    wanted = (options.which or "").casefold()
    found = [entry for entry in entries if wanted in (entry.name.casefold(), entry.model.casefold())]
    if not found:
        words = wanted.split()
        similar = listed(dict.fromkeys(entry.name for entry in entries
                                       if all(word in entry.name.casefold() for word in words)), MOST_NAMED)
        raise LensError(path, "lens", options.which or f"one of {len(entries)}", "name it with --which, as Lensfun does"
                        + (f": {similar}" if similar else ""))
    return min(found, key=lambda entry: entry.number("cropfactor", 1.0))


def _entries(path) -> Iterator[Entry]:
    root = read_xml(path)
    if root.tag != "lensdatabase":
        raise LensError(path, "root", root.tag, "expected Lensfun's lensdatabase")
    for element in root.iter("lens"):
        maker, model = (" ".join((element.findtext(field) or "").split()) for field in ("maker", "model"))
        yield Entry(path, element, maker, model)


def _focal_mm(entry, options):
    focals = {_number(entry.path, entry.name, "focal", each.get("focal")) for each in _terms(entry, "distortion")}
    focals |= {_number(entry.path, entry.name, "focal", each.get(end)) for each in entry.element.iter("focal")
               for end in ("value", "min", "max") if each.get(end)}
    if options.focal_mm is not None:
        if focals and not min(focals) * 0.99 <= options.focal_mm <= max(focals) * 1.01:
            raise LensError(entry.name, "--focal-length", options.focal_mm,
                            f"expected {min(focals):g} to {max(focals):g} mm")
        return options.focal_mm
    if len(focals) != 1:
        reach = f"from {min(focals):g} to {max(focals):g} mm" if focals else "missing"
        raise LensError(entry.name, "focal length", reach, "choose one with --focal-length")
    return focals.pop()


def _sensor(entry, options):
    """The picture on its sensor: by default, the sensor that the lens was photographed with."""
    crop, aspect = entry.number("cropfactor", 1.0), _aspect_ratio(entry)
    diagonal_mm, slope = FULL_FRAME_MM / crop, np.hypot(aspect, 1)
    calibrated_mm = diagonal_mm * aspect / slope, diagonal_mm / slope
    sensor_mm = options.sensor_mm or calibrated_mm
    size_px = options.size_px or (COLUMNS_PX, round(COLUMNS_PX * sensor_mm[1] / sensor_mm[0]))
    pitch_mm = pixel_mm(entry.name, sensor_mm, size_px)
    unit_mm, unit_px = diagonal_mm / slope / 2, diagonal_mm / slope / 2 / pitch_mm
    if options.size_px and not options.sensor_mm:
        unit_px *= np.hypot(*np.subtract(size_px, 1)) / np.hypot(*size_px)
    return Sensor(size_px, size_px[0] * pitch_mm, unit_mm, unit_px, unit_px * slope)


def _aspect_ratio(entry):
    text = entry.element.findtext("aspect-ratio")
    try:
        first, _, second = (text or "").partition(":")
        ratio = float(first) / float(second or 1) if text else ASPECT_RATIO
    except (ValueError, ZeroDivisionError):
        ratio = 0.0
    if not 1 <= ratio <= 100:
        raise LensError(entry.path, f"{entry.name}, aspect-ratio", text, "expected a number from 1, or such as 3:2")
    return ratio


def _terms(entry, tag) -> Iterable[Element]:
    return entry.element.iter(tag)


def _distortion(entry, focal_mm):
    """The model and its terms; None and no terms without any."""
    model, names, table = _table(entry, "distortion", DISTORTIONS)
    return model, () if model is None else _interpolated(table[:, 0], table[:, 1:], focal_mm, range(len(names)))


def _axial_mm(entry, focal_mm):
    """The focal length on the axis that the entry states; None if it does not."""
    stated = [[_number(entry.path, entry.name, name, each.get(name)) for name in ("focal", "real-focal")]
              for tag in ("real-focal-length", "distortion") for each in _terms(entry, tag) if each.get("real-focal")]
    if not stated:
        return None
    focals, reals = np.array(stated).T
    return float(_interpolated(focals, reals[:, None], focal_mm)[0])


def _table(entry, tag, models):
    """The model of the first element with this tag, its names of terms, and rows of focal length and terms of all
    elements with this model; None without any."""
    elements = [each for each in _terms(entry, tag) if each.get("model") not in (None, "none")]
    if not elements:
        return None, (), np.empty((0, 1))
    model = elements[0].get("model")
    if model not in models:
        raise LensError(entry.path, f"{entry.name}, {tag} model", model, f"expected {', '.join(models)}")
    rows = [[_number(entry.path, entry.name, "focal", each.get("focal")),
             *(_number(entry.path, entry.name, name, each.get(name), TCA_DEFAULTS.get(name, 0.0), signed=True)
               for name in models[model])] for each in elements if each.get("model") == model]
    return model, models[model], np.array(rows)


def _interpolated(focals, values, focal_mm, scaled=()):
    """Values (row, term) at a focal length, by Lensfun's cubic between four focal lengths; constant beyond them.

    Scaled terms are interpolated times the focal length.
    """
    order = np.argsort(focals, kind="stable")
    focals, values = focals[order], values[order]
    exact = np.flatnonzero(focals == focal_mm)
    if exact.size or focal_mm < focals[0] or focal_mm > focals[-1]:
        return values[exact[0] if exact.size else 0 if focal_mm < focals[0] else -1]
    after = int(np.searchsorted(focals, focal_mm))
    factors = np.ones_like(values)
    factors[:, list(scaled)] = focals[:, None]
    scaled_values = values * factors
    two, three = scaled_values[after - 1], scaled_values[after]
    rise = three - two
    first = (three - scaled_values[after - 2]) / 2 if after >= 2 else rise
    last = (scaled_values[after + 1] - two) / 2 if after + 1 < len(focals) else rise
    t = (focal_mm - focals[after - 1]) / (focals[after] - focals[after - 1])
    at = ((2 * t**3 - 3 * t**2 + 1) * two + (t**3 - 2 * t**2 + t) * first + (3 * t**2 - 2 * t**3) * three
          + (t**3 - t**2) * last)
    return at / np.where([number in scaled for number in range(values.shape[1])], focal_mm, 1)


def _polynomial(model, terms):
    """The real over the undistorted radius, as a function of the latter."""
    if model == "poly3":
        return lambda radius: 1 - terms[0] + terms[0] * radius**2
    if model == "poly5":
        return lambda radius: 1 + terms[0] * radius**2 + terms[1] * radius**4
    if model == "ptlens":
        a, b, c = terms
        return lambda radius: 1 - a - b - c + radius * (c + radius * (b + radius * a))
    return lambda radius: 1.0 + 0 * radius


def _placing(projection, polynomial, focal):
    """A `Model.placed` at unit focal length on the axis, which is this many of Lensfun's units."""
    straight = focal / polynomial(0.0)  # focal length of the undistorted picture

    def placed(x, y, z):
        radius = straight * projection(np.arctan2(np.hypot(x, y), z))
        return at_radius(x, y, z, radius * polynomial(radius) / focal)

    return placed


def _fringes(entry, focal_mm, sensor):
    model, names, table = _table(entry, "tca", TCA)
    if model is None:
        return None
    terms = _interpolated(table[:, 0], table[:, 1:], focal_mm, scaled=range(NOT_SCALED, len(names)))
    red, blue = terms[::2], terms[1::2]
    scale = np.hypot(*sensor.size_px) / 2 / sensor.unit_px

    def factor(ascending):
        return _of_shares(lambda radius: np.polynomial.polynomial.polyval(radius, ascending), scale)

    return Fringes(factor(blue), factor(red))


def _of_shares(curve, scale):
    """A curve over half diagonals of the frame, from one over Lensfun's radius."""
    return lambda shares: curve(scale * shares)


def _vignetting(entry, focal_mm, options):
    """The light at a radius, by Lensfun's weights of the nearest settings; None if they differ too much."""
    rows = [[*(_number(entry.path, entry.name, name, each.get(name)) for name in ("focal", "aperture")),
             _number(entry.path, entry.name, "distance", each.get("distance"), UNKNOWN_DISTANCE),
             *(_number(entry.path, entry.name, name, each.get(name), 0.0, signed=True) for name in ("k1", "k2", "k3"))]
            for each in _terms(entry, "vignetting") if each.get("model") == "pa"]
    if not rows:
        return None
    table = np.array(rows)
    reach = np.ptp([_number(entry.path, entry.name, "focal", each.get(end)) for each in entry.element.iter("focal")
                    for end in ("min", "max", "value") if each.get(end)] or table[:, 0]) or 1.0
    distance_m = min(options.focus_mm * 1e-3, FAR_M)
    apart = np.sqrt(((table[:, 0] - focal_mm) / reach)**2 + (4 / table[:, 1] - 4 / options.f_number)**2
                    + (0.1 / table[:, 2] - 0.1 / distance_m)**2)
    nearest = np.argmin(apart)
    if apart[nearest] > 1:
        return None
    weights = np.eye(len(apart))[nearest] if apart[nearest] < NEAR else apart**-POWER
    k1, k2, k3 = np.average(table[:, 3:], axis=0, weights=weights)
    return lambda radius: np.maximum(1 + radius**2 * (k1 + radius**2 * (k2 + radius**2 * k3)), 0)


def _notes(entry, model, light, sensor):
    beyond = np.hypot(*np.subtract(sensor.size_px, 1)) / 2 / sensor.corner_px
    if beyond > NEARLY_ALL:
        yield f"Lensfun's data are continued: they end {1 / beyond:.0%} of the way to the corner of this sensor."
    if model is None:
        yield "Lensfun has no distortion of this lens."
    if light is None:
        yield "Lensfun has no vignetting near this f-number: the light is even."
    if any(True for _ in entry.element.iter("center")):
        yield "The displaced centre in Lensfun's entry is not used."


def _number(path, name, field, text, default=None, signed=False):
    if text is None and default is not None:
        return default
    try:
        value = float(text)
    except (TypeError, ValueError):
        value = np.nan
    if not (np.isfinite(value) and (signed or 0 < value < 1e6)):
        raise LensError(path, f"{name}, {field}", "missing" if text is None else text,
                        "expected a finite number" if signed else "expected a positive number")
    return value
