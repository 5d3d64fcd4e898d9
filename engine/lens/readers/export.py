"""Export folders: `lens.toml` beside the listings that the project's own macros for Zemax, CODE V and ZOSPy write.

    format = "lensfield-export"
    version = 1
    program = "zemax"               # or "codev" or "zospy": whose files the PSFs are
    name = "..."                    # and, if you like, maker, story, source, notes
    efl_mm, magnification, f_number_effective, entrance_pupil_mm, reference_wavelength_nm = numbers, a line each
    object_distance_mm = 250.0      # or inf
    sensor_mm = [4.8, 3.6]          # default: 4 : 3 with the last height at its corners
    wavelengths_nm = [...]          # ascending
    heights_mm = [...]              # paraxial image heights, ascending from 0
    image_side = "+y"               # or "-y": where the PSFs' image points lie
    real_height = "real_height.txt"
    relative_illumination = "ri.txt"
    psf = "psf_{height}_{wavelength}.txt"    # numbers from 1
    psf_pitch_um = 0.25             # for CODE V alone, whose files do not tell
    transmittance = [...]           # one for each wavelength; default 1

The two tables have one number for each height and wavelength, wavelength fastest; signs of heights do not matter. Or
they are Zemax listings (field curvature and distortion; relative illumination), one of all wavelengths, or, with
{wavelength} in the name, one for each.
"""

import tomllib
from pathlib import Path, PureWindowsPath

import numpy as np
from scipy.interpolate import make_interp_spline

from ...errors import LensError
from . import codev, zemax_text, zospy
from .assembly import SAME_WAVELENGTH_NM, build_lens, check_count, four_by_three
from .psf_grid import NEGLIGIBLE_MM
from .text import number_table, read_text, shown

DESCRIPTION = "lens.toml"
FORMAT = "lensfield-export"
VERSION = 1
PROGRAMS = ("zemax", "codev", "zospy")
FIRST_ORDER = ("efl_mm", "magnification", "f_number_effective", "object_distance_mm", "entrance_pupil_mm",
               "reference_wavelength_nm")
TEXTS = ("maker", "story", "source", "notes")
LONGEST_DESCRIPTION = 2**20
REACHED = 1e-3  # of the last height: how much of it a listing may lack


def read_export(path):
    """The lens of an export folder, by its description.

    Raises
    ------
    LensError
        A field that is missing or wrong; a file that is missing, damaged or at odds with the others.
    """
    path = Path(path)
    told = _description(path)
    heights, wavelengths = (np.array(_numbers(told, field, path)) for field in ("heights_mm", "wavelengths_nm"))
    if heights.size < 2 or heights[0] != 0 or np.any(np.diff(heights) <= 0):
        raise LensError(path, "heights_mm", shown(str(heights.tolist())), "expected two or more, ascending from 0")
    if np.any(np.diff(wavelengths) <= 0):
        raise LensError(path, "wavelengths_nm", shown(str(wavelengths.tolist())), "expected ascending ones")
    check_count(path, wavelengths, heights)
    facts = {field: _number(told, field, path) for field in FIRST_ORDER}
    facts |= {field: _text(told, field, path, "") for field in TEXTS}
    facts["sensor_mm"] = _numbers(told, "sensor_mm", path, four_by_three(heights[-1]), 2)
    facts["transmittance"] = _numbers(told, "transmittance", path, [1.0] * wavelengths.size, wavelengths.size)
    facts["real_height_mm"] = _real_heights(told, wavelengths, heights, path)
    facts["relative_illumination"] = _relative_illumination(told, wavelengths, heights, facts, path)
    side = _choice(told, "image_side", ("+y", "-y"), path)
    return build_lens(path, _psf_reader(told, wavelengths.size, heights.size, side, path), side,
                      name=_text(told, "name", path), wavelengths_nm=wavelengths, heights_mm=heights, **facts)


def _description(path):
    text = read_text(path)
    if len(text) > LONGEST_DESCRIPTION:
        raise LensError(path, "description", f"{len(text)} characters", f"expected at most {LONGEST_DESCRIPTION}")
    try:
        told = tomllib.loads(text.removeprefix("\ufeff").replace("\r\n", "\n"))
    except (ValueError, RecursionError) as error:
        raise LensError(path, "description", "not readable", f"expected TOML ({shown(str(error))})") from None
    _choice(told, "format", (FORMAT,), path)
    if told.get("version") != VERSION:
        raise LensError(path, "version", shown(str(told.get("version", "missing"))), f"expected {VERSION}")
    return told


def _choice(told, field, choices, path):
    value = _text(told, field, path)
    if value not in choices:
        raise LensError(path, field, shown(value), f"expected {' or '.join(choices)}")
    return value


def _text(told, field, path, default=None):
    value = told.get(field, default)
    if not isinstance(value, str) or (default is None and not value.strip()):
        raise LensError(path, field, shown(str(told.get(field, "missing"))), "expected a text")
    return value


def _number(told, field, path):
    value = told.get(field, "missing")
    if isinstance(value, bool) or not isinstance(value, (int, float)) or abs(value) > 1e300 and value != np.inf:
        raise LensError(path, field, shown(str(value)), "expected a number")
    return float(value)


def _numbers(told, field, path, default=None, count=None):
    """List of floats; of so many, where it is told."""
    values = told.get(field, default)
    if not isinstance(values, (list, tuple)) or not values or count not in (None, len(values)):
        raise LensError(path, field, shown(str("missing" if values is None else values)),
                        f"expected {'a list of' if count is None else count} numbers in brackets")
    return [_number({field: value}, field, path) for value in values]


def _file(told, field, path, **places):
    """The file that a field names, with its {height} and {wavelength} put in; never one outside of the folder."""
    name = _text(told, field, path)
    parts = PureWindowsPath(name)
    if parts.is_absolute() or parts.drive or parts.root or ".." in parts.parts or not name.isprintable():
        raise LensError(path, field, shown(name), "expected the name of a file inside the folder")
    for place, number in places.items():
        name = name.replace(f"{{{place}}}", str(number))
    file = path.parent / name
    if not file.resolve().is_relative_to(path.parent.resolve()):
        raise LensError(path, field, shown(name), "expected a file inside the folder, not a link out of it")
    return file


def _real_heights(told, wavelengths, heights, path):
    """float array (wavelength, height) from a table, or from listings of field curvature and distortion."""

    def from_listing(text, file, index):
        blocks = zemax_text.distortion(text, file)
        block = _of_wavelength(blocks, wavelengths[index], file)
        return _at_heights(block.field, block.values, heights, file)

    return np.abs(_per_wavelength(told, "real_height", wavelengths, heights, path, from_listing))


def _relative_illumination(told, wavelengths, heights, facts, path):
    """float array (wavelength, height) from a table, or from listings of relative illumination."""

    def from_listing(text, file, index):
        listing = _of_wavelength([zemax_text.relative_illumination(text, file)], wavelengths[index], file)
        values = _at_heights(_paraxial_heights(listing, heights[-1], facts, file), listing.values, heights, file)
        if not values[0] > 0:
            raise LensError(file, "relative illumination", values[0], "expected a positive one on the axis")
        return values / values[0]

    return _per_wavelength(told, "relative_illumination", wavelengths, heights, path, from_listing)


def _per_wavelength(told, field, wavelengths, heights, path, from_listing):
    """float array (wavelength, height) from a table; or from listings, one of all wavelengths or one of each."""
    if "{wavelength}" in _text(told, field, path):
        files = [_file(told, field, path, wavelength=index + 1) for index in range(wavelengths.size)]
        return np.stack([from_listing(read_text(file), file, index) for index, file in enumerate(files)])
    file = _file(told, field, path)
    text = read_text(file)
    if not zemax_text.is_listing(text):
        return number_table(text, file, field, (wavelengths.size, heights.size))
    return np.stack([from_listing(text, file, index) for index in range(wavelengths.size)])


def _of_wavelength(listings, wavelength_nm, file):
    """The one of these listings that is of this wavelength, or the only one where it does not tell."""
    if len(listings) == 1 and listings[0].wavelength_nm is None:
        return listings[0]
    for listing in listings:
        if listing.wavelength_nm is not None and abs(listing.wavelength_nm - wavelength_nm) <= SAME_WAVELENGTH_NM:
            return listing
    raise LensError(file, "wavelength", f"not {wavelength_nm:g} nm", "expected a listing of that wavelength")


def _paraxial_heights(listing, last_mm, facts, file):
    """Field coordinates as paraxial image heights: they may be angles, object heights or image heights."""
    near = np.isfinite(facts["object_distance_mm"])
    seen = abs(facts["magnification"]) * (facts["object_distance_mm"] + facts["entrance_pupil_mm"])
    scales = [1.0, abs(facts["magnification"])]
    if listing.unit.startswith("deg"):
        if listing.field.max() < 90:
            return (seen if near else facts["efl_mm"]) * np.tan(np.radians(listing.field))
        scales = []
    for scale in scales:
        if abs(scale * listing.field.max() - last_mm) <= 0.005 * last_mm:
            return scale * listing.field
    raise LensError(file, "field", f"up to {listing.field.max():g} {shown(listing.unit)}",
                    f"expected angles, or object or paraxial image heights, up to the last of {last_mm:g} mm")


def _at_heights(listed_mm, values, heights_mm, file):
    """Values at these heights by a spline of third degree, or as high as so few points allow."""
    if listed_mm[0] > REACHED * heights_mm[-1] or listed_mm[-1] < (1 - REACHED) * heights_mm[-1]:
        raise LensError(file, "field", f"{listed_mm[0]:g} to {listed_mm[-1]:g} mm of paraxial height",
                        f"expected 0 to {heights_mm[-1]:g} mm")
    if np.any(np.diff(listed_mm) <= 0):
        raise LensError(file, "field", "not ascending", "expected field points from the axis outwards")
    return make_interp_spline(listed_mm, values, k=min(3, listed_mm.size - 1))(heights_mm)


def _psf_reader(told, wavelengths, heights, side, path):
    """A function of (height number, wavelength number) that reads PSFs, all of which are there."""
    program = _choice(told, "program", PROGRAMS, path)
    name = _text(told, "psf", path)
    if "{height}" not in name or "{wavelength}" not in name:
        raise LensError(path, "psf", shown(name), "expected a file name with {height} and {wavelength} in it")
    pitch_um = _number(told, "psf_pitch_um", path) if program == "codev" else None
    numbers = [(h + 1, w + 1) for h in range(heights) for w in range(wavelengths)]
    files = {(h, w): _file(told, "psf", path, height=h, wavelength=w) for h, w in numbers}
    missing = [file for file in files.values() if not file.is_file()]
    if missing:
        raise LensError(path, "PSF files", f"{len(missing)} of {len(files)} missing",
                        f"expected {missing[0].name} there")

    def read(h, w):
        grid = _psf_grid(files[h, w], program, pitch_um)
        y = grid.image_mm[1] if grid.image_mm else 0.0
        if abs(y) > NEGLIGIBLE_MM and (y > 0) != (side == "+y"):
            raise LensError(path, "image_side", side, f"{files[h, w].name} is of an image point at y = {y:g} mm")
        return grid

    return read


def _psf_grid(file, program, pitch_um):
    if program == "zospy":
        return zospy.psf_grid_of_file(file)
    text = read_text(file)
    return zemax_text.psf_grid(text, file) if program == "zemax" else codev.psf_grid(text, file, pitch_um)
