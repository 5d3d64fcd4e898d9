"""Reader and writer of Lensfield prescriptions: TOML with the fields of `Prescription` and a table per surface."""

import json
import re
from dataclasses import fields, replace
from pathlib import Path
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np

from ...runtime.build_identity import MARK
from ...runtime.toml_fields import WIDTH, TomlTable, check_known, pairs, read_toml
from ...spectral.dispersion import FORMULAS
from ...spectral.refraction import Formula
from ..coatings import Coating, MeasuredReflectance
from ..glasses import Glass
from ..photographs import FIGURES, MOST_LIGHT, Agreement, Vignetting
from ..prescription import APERTURES, FIELDS, MOST_TERMS, ORIGINS, PARTS, Pose, Prescription, Surface
from .reading import AS_IT_IS, Reading, ReadingOptions, with_stop

FORMAT, VERSION = "lensfield-prescription", 1
TEXTS = ("name", "title", "maker", "story", "source", "notes", "focus", "coating")
NUMBERS = ("object_distance_mm", "reference_wavelength_nm", "highest_f_number")
OF_THE_LENS = ("focal_length_mm", "closest_focus_mm")  # numbers that `scale` does not change; sensor_mm neither
FIELDS_OF_FILE = ("format", "version", "scale", "aperture", "field", "sensor_mm", "surfaces", "year", "character",
                  "focused_at_mm", "glasses", "provenance", "photographs", "image_pose", "coatings", *TEXTS, *NUMBERS,
                  *OF_THE_LENS)
SURFACE_NUMBERS = ("radius_mm", "semi_aperture_mm", "semi_obstruction_mm", "conic", "radius_x_mm", "conic_x",
                   "reflectance")
FIELDS_OF_GLASS = ("formula", "coefficients", "range_nm")
EVERYWHERE_NM = (0.0, np.inf)
FIELDS_OF_SURFACE = (*SURFACE_NUMBERS, "thickness_mm", "glass", "aspheric", "stop", "profile", "skews", "pose",
                     "coating", "mirror", "half_widths_mm")
MEASURED = ("wavelengths_nm", "angles_deg", "reflectance")
FIELDS_OF_COATING = ("name", "layers", *MEASURED)
FIELDS_OF_AGREEMENT = ("source", "date", *FIGURES)
FIELDS_OF_LIGHT = ("f_number", "focus_mm", "heights_mm", "light")
FIELDS_OF_POSE = ("offset_mm", "tilt_deg")
HIGHEST_POWER = 2 * MOST_TERMS
WRITTEN = ("name", "title", "maker", "year", "focal_length_mm", "character", "story", "source", "notes",
           "aperture", "highest_f_number", "field", "sensor_mm", "focus", "object_distance_mm",
           "focused_at_mm", "closest_focus_mm", "reference_wavelength_nm", "image_pose", "coating")
DEFAULTS = {field.name: field.default for value in (Prescription, Surface) for field in fields(value)}
SURFACES = re.compile(r"^(?:surfaces = |\[)", re.MULTILINE)  # the first line that is not about the lens as a whole


def read_lensfield(path: Path, options: ReadingOptions = AS_IT_IS) -> Prescription:
    """Read a Lensfield prescription."""
    field = options.field
    table = read_toml(path, FORMAT, VERSION)
    check_known(table, FIELDS_OF_FILE)
    scale = table.number("scale", 1.0)
    if not 0 < scale < np.inf:
        raise table.refusal("scale", "expected a positive number")
    facts: dict[str, Any] = {name: table.line(name) for name in TEXTS if name in table}
    facts |= {"focus": options.image_plane} if options.image_plane else {}
    facts |= {name: table.number(name) for name in NUMBERS if name in table}
    if "focused_at_mm" in table:  # the file's thicknesses are for the first of these
        facts["focused_at_mm"] = tuple(table.numbers("focused_at_mm"))
        facts = {"object_distance_mm": facts["focused_at_mm"][0]} | facts
    prescription = Prescription(
        **{"name": path.stem} | facts, surfaces=with_stop(path, _surfaces(table), options),
        aperture=_figure(table, "aperture", APERTURES), field=field or _figure(table, "field", FIELDS),
        year=_year(table), character=_character(table), glasses=_glasses(table),
        coatings=_coatings(table), provenance=_provenance(table), photographs=_agreement(table),
        image_pose=_pose(table, "image_pose"))
    prescription = prescription if scale == 1 else prescription.scaled(scale)
    of_the_lens: dict[str, Any] = {name: table.number(name) for name in OF_THE_LENS if name in table}
    of_the_lens |= {"field": field} if field else {}  # the requested field is not scaled
    return replace(prescription, sensor_mm=_sensor_mm(table), **of_the_lens)


def read_native(path: Path, table: TomlTable, options: ReadingOptions) -> Reading:
    """Read a Lensfield prescription, where unknown names are errors."""
    return Reading(read_lensfield(path, options), native=True)


class Description(NamedTuple):
    """What lists and searches of lenses show, as in `Prescription`."""

    title: str
    maker: str
    year: int | None
    focal_length_mm: float | None
    character: tuple[str, ...]
    story: str
    source: str
    photographs: Agreement | None


def read_description(path: Path) -> Description:
    """Description of a lens, from the lines above its surfaces: reading these, too, takes several times as long."""
    table = read_toml(path, FORMAT, VERSION, before=SURFACES)
    focal_length_mm = table.number("focal_length_mm") if "focal_length_mm" in table else None
    return Description(table.line("title"), table.line("maker"), _year(table), focal_length_mm, _character(table),
                       table.line("story"), table.line("source"), _agreement(table))


def _year(table):
    year = table.values.get("year")
    if year is not None and (isinstance(year, bool) or not isinstance(year, int) or not 0 < year < 10000):
        raise table.refusal("year", "expected a whole number, of four digits at most")
    return year


def _character(table):
    words = table.values.get("character", [])
    if not isinstance(words, list) or not all(isinstance(word, str) for word in words):
        raise table.refusal("character", "expected a list of words")
    return tuple(words)


def _provenance(table):
    """(part, origin) of the design's figures."""
    origins = table.values.get("provenance", {})
    if not isinstance(origins, dict):
        raise table.refusal("provenance", 'expected a table such as { figures = "patent", apertures = "estimated" }')
    origins = TomlTable(table.path, origins, "provenance, ")
    check_known(origins, PARTS)
    return tuple((part, origins.choice(part, ORIGINS)) for part in PARTS if part in origins)


def _agreement(table):
    """Agreement with photographs; None without any."""
    if "photographs" not in table:
        return None
    if not isinstance(table.values["photographs"], dict):
        raise table.refusal("photographs", 'expected a table such as { source = "Lensfun", illumination = 0.03 }')
    stated = TomlTable(table.path, table.values["photographs"], "photographs, ")
    check_known(stated, (*FIELDS_OF_AGREEMENT, "light"))
    figures = {name: stated.number(name) for name in FIGURES if name in stated}
    return Agreement(stated.text("source"), stated.line("date"), **figures, light=_light(stated))


def _light(table):
    """Curves of the light in photographs."""
    rows = table.values.get("light", [])
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise table.refusal("light", "expected a list of [[photographs.light]]")
    return tuple(_curve(TomlTable(table.path, row, f"photographs, light {number}, "))
                 for number, row in enumerate(rows, 1))


def _curve(table):
    check_known(table, FIELDS_OF_LIGHT)
    f_number, focus_mm = table.number("f_number"), table.number("focus_mm")
    heights_mm = np.array(table.numbers("heights_mm"))
    light = np.array(table.numbers("light", heights_mm.size))
    for field, valid, expected in (
            ("f_number", 0 < f_number < np.inf, "a positive number"), ("focus_mm", focus_mm > 0, "a positive number"),
            ("heights_mm", 0 < heights_mm[0] and heights_mm[-1] < np.inf and np.all(heights_mm[1:] > heights_mm[:-1]),
             "ascending numbers above 0"),
            ("light", np.all((light > 0) & (light <= MOST_LIGHT)), f"numbers from 0 to {MOST_LIGHT:g}")):
        if not valid:
            raise table.refusal(field, f"expected {expected}")
    return Vignetting(f_number, focus_mm, heights_mm, light)


def _sensor_mm(table):
    if "sensor_mm" not in table:
        return None
    width, height = table.numbers("sensor_mm", 2)
    return width, height


def _glasses(table):
    """Private glasses of the prescription, from a table of tables by name."""
    rows = table.values.get("glasses", {})
    if not isinstance(rows, dict) or not all(name.strip() and name.isprintable() and isinstance(row, dict)
                                             for name, row in rows.items()):
        raise table.refusal("glasses", "expected tables by name, such as [glasses.MINE]")
    return tuple(Glass(" ".join(name.split()), _formula(TomlTable(table.path, row, f"glass {name}, ")))
                 for name, row in rows.items())


def _formula(table):
    check_known(table, FIELDS_OF_GLASS)
    number = table.number("formula")
    if number not in FORMULAS:
        raise table.refusal("formula", "expected 1 to 9, as refractiveindex.info numbers dispersion formulas")
    coefficients, most = table.numbers("coefficients"), FORMULAS[int(number)].most_coefficients
    if len(coefficients) > most:
        raise table.refusal("coefficients", f"expected at most {most} for formula {number:g}")
    first, last = table.numbers("range_nm", 2) if "range_nm" in table else EVERYWHERE_NM
    if not 0 <= first < last:
        raise table.refusal("range_nm", "expected two ascending nanometres")
    return Formula(int(number), tuple(coefficients), (first, last))


def _coatings(table):
    """Private coatings of the prescription, from a list of tables."""
    rows = table.values.get("coatings", [])
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise table.refusal("coatings", "expected a list of [[coatings]]")
    return tuple(_coating(TomlTable(table.path, row, f"coating {number}, ")) for number, row in enumerate(rows, 1))


def _coating(table):
    check_known(table, FIELDS_OF_COATING)
    name, layers = table.line("name"), _rows(table, "layers", 2)
    if not any(field in table for field in MEASURED):
        return Coating(name, layers)
    angles_deg = tuple(table.numbers("angles_deg")) if "angles_deg" in table else (0.0,)
    return Coating(name, layers, MeasuredReflectance(tuple(table.numbers("wavelengths_nm")), angles_deg,
                                                     _rows(table, "reflectance", len(angles_deg))))


def _rows(table, field, count):
    """Rows of this many numbers; the number alone for a row of one."""
    rows = table.values.get(field, [])
    if not isinstance(rows, list):
        raise table.refusal(field, f"expected a list of rows of {count} numbers")
    rows = TomlTable(table.path, {str(number): [row] if count == 1 and not isinstance(row, list) else row
                                  for number, row in enumerate(rows, 1)}, f"{table.place}{field}, row ")
    return tuple(tuple(rows.numbers(name, count)) for name in rows.values)


def _surfaces(table):
    rows = table.values.get("surfaces")
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise table.refusal("surfaces", "expected a list of [[surfaces]]")
    return tuple(_surface(TomlTable(table.path, row, f"surface {number}, ")) for number, row in enumerate(rows, 1))


def _surface(table):
    check_known(table, FIELDS_OF_SURFACE)
    numbers = {name: table.number(name) for name in SURFACE_NUMBERS if name in table}
    if isinstance(table.values.get("thickness_mm"), list):
        numbers["gaps_mm"] = tuple(table.numbers("thickness_mm"))
        numbers["thickness_mm"] = numbers["gaps_mm"][0]
    elif "thickness_mm" in table:
        numbers["thickness_mm"] = table.number("thickness_mm")
    if "half_widths_mm" in table:
        numbers["half_widths_mm"] = tuple(table.numbers("half_widths_mm", 2))
    even, odd = _by_power(table, "aspheric")
    skews, odd_skews = _by_power(table, "skews")
    if odd_skews:
        raise table.refusal("skews", "expected even powers")
    if "reflectance" in table and not table.flag("mirror"):
        raise table.refusal("reflectance", "expected mirror = true, too")
    return Surface(**numbers, glass=table.line("glass"), stop=table.flag("stop"), mirror=table.flag("mirror"),
                   aspheric=even, odd_aspheric=odd, profile=table.line("profile"), skews=skews,
                   coating=table.line("coating"), pose=_pose(table, "pose"))


def _by_power(table, field):
    """Figures for r^2, r^4 ... and for r, r^3 ... from a table of powers."""
    terms = table.values.get(field, {})
    if not isinstance(terms, dict) or not all(key.isdecimal() and int(key) in range(1, HIGHEST_POWER + 1)
                                              for key in terms):
        raise table.refusal(field, "expected a table of powers, such as {4 = 1e-3, 6 = -2e-5}")
    powers = TomlTable(table.path, terms, f"{table.place}{field}, ")
    figures = {int(key): powers.number(key) for key in terms}

    def series(first):
        last = max((power for power in figures if power % 2 == first % 2), default=0)
        return tuple(figures.get(power, 0.0) for power in range(first, last + 1, 2))

    return series(2), series(1)


def _pose(table, field):
    """The displacement of a surface or of the image plane; None without one."""
    if field not in table:
        return None
    if not isinstance(table.values[field], dict):
        raise table.refusal(field, "expected a table such as { offset_mm = [0.1, 0, 0], tilt_deg = [0, 1.5, 0] }")
    parts = TomlTable(table.path, table.values[field], f"{table.place}{field}, ")
    check_known(parts, FIELDS_OF_POSE)
    return Pose(**{part: tuple(parts.numbers(part, 3)) for part in FIELDS_OF_POSE if part in parts})


def _figure(table, name, kinds):
    """The single entry of a table such as {f_number = 2.0}."""
    figure = table.values.get(name)
    if not isinstance(figure, dict) or len(figure) != 1 or not figure.keys() <= set(kinds):
        raise table.refusal(name, f"expected a table with one of {', '.join(kinds)}")
    kind, = figure
    return kind, TomlTable(table.path, figure, f"{name}, ").number(kind)


def write_prescription(prescription: Prescription) -> str:
    """The text of a file, with a line per surface; reading it returns an equal prescription.

    Default values are left out. In texts, unprintable characters become spaces and repeated spaces are collapsed, as in
    reading. `glass_figures` are not written.
    """
    first_mm = prescription.focused_at_mm[0] if prescription.focused_at_mm else np.inf
    facts = vars(prescription) | {name: dict([getattr(prescription, name)]) for name in ("aperture", "field")}
    facts |= {"image_pose": _pose_table(prescription.image_pose)}
    origins = {f"provenance.{part}": origin for part, origin in prescription.provenance}
    agreed = prescription.photographs
    compared = {f"photographs.{name}": value for name in FIELDS_OF_AGREEMENT
                if agreed and (value := getattr(agreed, name)) not in (None, "")}
    lines = [f"# {MARK}", f'format = "{FORMAT}"', f"version = {VERSION}",
             *pairs({name: facts[name] for name in WRITTEN}, DEFAULTS | {"object_distance_mm": first_mm}),
             *pairs(origins | compared, {})]
    rows = (f"  {{ {', '.join(pairs(_fields_of(surface), DEFAULTS))} }}" for surface in prescription.surfaces)
    glasses = (line for glass in prescription.glasses for line in _glass_lines(glass))
    coatings = (line for coating in prescription.coatings for line in _coating_lines(coating))
    light = (line for curve in (agreed.light if agreed else ()) for line in _light_lines(curve))
    return "\n".join([*lines, "surfaces = [", ",\n".join(rows), "]", *glasses, *coatings, *light, ""])


def _fields_of(surface):
    """The fields of a surface's table."""
    return {"radius_mm": surface.radius_mm, "radius_x_mm": surface.radius_x_mm,
            "thickness_mm": surface.gaps_mm or surface.thickness_mm, "glass": surface.glass,
            "mirror": surface.mirror, "reflectance": surface.reflectance, "semi_aperture_mm": surface.semi_aperture_mm,
            "semi_obstruction_mm": surface.semi_obstruction_mm, "half_widths_mm": surface.half_widths_mm,
            "stop": surface.stop, "conic": surface.conic, "conic_x": surface.conic_x, "profile": surface.profile,
            "aspheric": _powers(surface.aspheric, surface.odd_aspheric), "skews": _powers(surface.skews),
            "pose": _pose_table(surface.pose), "coating": surface.coating}


def _powers(even, odd=()):
    """A table of powers, for `_by_power`; () if it is empty."""
    powers = sorted([*zip(range(2, HIGHEST_POWER + 1, 2), even, strict=False),
                     *zip(range(1, HIGHEST_POWER, 2), odd, strict=False)])
    last = (2 * len(even), 2 * len(odd) - 1)  # written even if 0: the terms are counted
    return {power: term for power, term in powers if term or power in last} or ()


def _pose_table(pose):
    return pose and vars(pose)


def _glass_lines(glass):
    """Lines of the table of a private glass."""
    formula = glass.dispersion
    facts = {"formula": formula.number, "coefficients": formula.coefficients, "range_nm": formula.range_nm}
    return ["", f"[glasses.{json.dumps(glass.name, ensure_ascii=False)}]", *pairs(facts, {"range_nm": EVERYWHERE_NM})]


def _coating_lines(coating):
    """Lines of the table of a private coating."""
    measured = zip(MEASURED, vars(coating.measured).values(), strict=True) if coating.measured else ()
    return ["", "[[coatings]]", *pairs({"name": coating.name, "layers": coating.layers, **dict(measured)},
                                       {"layers": ()})]


def _light_lines(curve):
    """Lines of the table of a curve of light."""
    lines = pairs({"f_number": curve.f_number, "focus_mm": curve.focus_mm, "heights_mm": tuple(curve.heights_mm),
                   "light": tuple(curve.light)}, {})
    return ["", "[[photographs.light]]", *(part for line in lines for part in wrap(line, WIDTH))]
