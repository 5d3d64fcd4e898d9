"""Export folders: `lens.toml` and the listings that Lensfield's macros for Zemax, CODE V and ZOSPy write.

    format = "lensfield-export"
    version = 1
    program = "zemax"               # or "codev" or "zospy": the program that wrote the PSFs
    name = "..."                    # and, optionally, maker, story, source, notes
    efl_mm, magnification, f_number_effective, entrance_pupil_mm, reference_wavelength_nm = numbers, a line each
    object_distance_mm = 250.0      # or inf
    sensor_mm = [4.8, 3.6]          # default: 4 : 3 with the last height at its corners
    wavelengths_nm = [...]          # ascending
    heights_mm = [...]              # paraxial image heights, ascending from 0
    image_side = "+y"               # or "-y": the side of the axis with the PSFs' image points
    real_height = "real_height.txt"
    relative_illumination = "ri.txt"
    psf = "psf_{height}_{wavelength}.txt"    # numbers from 1
    psf_pitch_um = 0.25             # only for CODE V, whose files do not state it
    transmittance = [...]           # one for each wavelength; default 1

The two tables contain one number for each height and wavelength, with the wavelength varying fastest. Signs of heights
do not matter. Alternatively they are Zemax listings (field curvature and distortion; relative illumination): one for
all wavelengths, or, with {wavelength} in the name, one for each.
"""

import os
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np

from ..lens.conventions import four_by_three
from ..lens.lens import FIRST_ORDER, TEXTS
from ..lens.radial_lens import RadialLens
from ..lens.spline import Spline
from ..runtime.errors import LensError
from ..runtime.text import number_table, read_text
from ..runtime.toml_fields import read_toml
from ..runtime.unread import unread_names, unread_note
from . import codev, zemax_text, zospy
from .assembly import SAME_WAVELENGTH_NM, build_lens, check_count
from .psf_grid import NEGLIGIBLE_MM

DESCRIPTION = "lens.toml"
FORMAT = "lensfield-export"
VERSION = 1
KNOWN = ("format", "version", "program", *TEXTS, *FIRST_ORDER, "sensor_mm", "transmittance", "wavelengths_nm",
         "heights_mm", "image_side", "real_height", "relative_illumination", "psf", "psf_pitch_um")
PROGRAMS = ("zemax", "codev", "zospy")
LONGEST_NAME = 255  # characters, the limit of most file systems
REACHED = 1e-3  # of the last height: by how much a listing may fall short at either end


def read_export(path: str | Path) -> RadialLens:
    """Read the lens in an export folder, from its description.

    Raises
    ------
    LensError
        A field is missing or invalid; or a file is missing, damaged or inconsistent with the others.
    """
    description = read_toml(Path(path), FORMAT, VERSION)
    heights, wavelengths = _axes(description)
    facts: dict[str, Any] = {field: description.number(field) for field in FIRST_ORDER}
    facts |= {field: description.text(field, "") for field in TEXTS if field != "name"}
    unread = unread_note(unread_names(description.values, KNOWN))
    facts["notes"] = " ".join(filter(None, (facts["notes"], unread)))
    facts["sensor_mm"] = (description.numbers("sensor_mm", 2) if "sensor_mm" in description else
                          four_by_three(heights[-1]))
    if "transmittance" in description:
        facts["transmittance"] = description.numbers("transmittance", wavelengths.size)
    facts["real_height_mm"] = _real_heights(description, wavelengths, heights)
    facts["relative_illumination"] = _relative_illumination(description, wavelengths, heights, facts)
    side = description.choice("image_side", ("+y", "-y"))
    return build_lens(path, _psf_reader(description, wavelengths.size, heights.size, side), side,
                      name=description.text("name"), wavelengths_nm=wavelengths, heights_mm=heights, **facts)


def _axes(description):
    """Heights in mm and wavelengths in nm: float arrays."""
    heights = np.array(description.numbers("heights_mm"))
    wavelengths = np.array(description.numbers("wavelengths_nm"))
    if heights.size < 2 or heights[0] != 0 or np.any(np.diff(heights) <= 0):
        raise description.refusal("heights_mm", "expected two or more, ascending from 0")
    if np.any(np.diff(wavelengths) <= 0):
        raise description.refusal("wavelengths_nm", "expected ascending values")
    check_count(description.path, wavelengths, heights)
    return heights, wavelengths


def _name(description, field):
    """The file name in a field, which must be inside the folder."""
    name = description.text(field)
    parts = PureWindowsPath(name)
    if parts.is_absolute() or parts.drive or parts.root or ".." in parts.parts or not name.isprintable() \
            or len(name) > LONGEST_NAME:
        raise description.refusal(field, "expected the name of a file inside the folder")
    return name


def _file(description, field, **places):
    """The file that a field names, with {height} and {wavelength} replaced. It is never outside the folder."""
    name, folder = _name(description, field), description.path.parent
    for place, number in places.items():
        name = name.replace(f"{{{place}}}", str(number))
    file = folder / name
    if not file.resolve().is_relative_to(folder.resolve()):
        raise description.refusal(field, "expected a file inside the folder, not a link out of it")
    return file


def _real_heights(description, wavelengths, heights):
    """float array (wavelength, height) from a table, or from listings of field curvature and distortion."""

    def from_listing(text, file, nm):
        listing = _of_wavelength(zemax_text.distortion(text, file), nm, file)
        return _at_heights(listing.field, listing.values, heights, file)

    return np.abs(_per_wavelength(description, "real_height", wavelengths, heights, from_listing))


def _relative_illumination(description, wavelengths, heights, facts):
    """float array (wavelength, height) from a table, or from listings of relative illumination."""

    def from_listing(text, file, nm):
        listing = _of_wavelength([zemax_text.relative_illumination(text, file)], nm, file)
        values = _at_heights(_paraxial_heights(listing, heights[-1], facts, file), listing.values, heights, file)
        if not values[0] > 0:
            raise LensError(file, "relative illumination", values[0], "expected a positive value on the axis")
        return values / values[0]

    return _per_wavelength(description, "relative_illumination", wavelengths, heights, from_listing)


def _per_wavelength(description, field, wavelengths, heights, from_listing):
    """float array (wavelength, height) from a table; or from listings, one for all wavelengths or one for each."""
    if "{wavelength}" in description.text(field):
        files = [_file(description, field, wavelength=number) for number in range(1, wavelengths.size + 1)]
        return np.stack([from_listing(read_text(file), file, nm) for file, nm in zip(files, wavelengths, strict=True)])
    file = _file(description, field)
    text = read_text(file)
    if not zemax_text.is_listing(text):
        return number_table(text, file, field, (wavelengths.size, heights.size))
    return np.stack([from_listing(text, file, nm) for nm in wavelengths])


def _of_wavelength(listings, wavelength_nm, file):
    """The listing of this wavelength; or the only listing, if it does not state its wavelength."""
    if len(listings) == 1 and listings[0].wavelength_nm is None:
        return listings[0]
    for listing in listings:
        if listing.wavelength_nm is not None and abs(listing.wavelength_nm - wavelength_nm) <= SAME_WAVELENGTH_NM:
            return listing
    raise LensError(file, "wavelength", f"not {wavelength_nm:g} nm", "expected a listing of that wavelength")


def _paraxial_heights(listing, last_mm, facts, file):
    """Field coordinates as paraxial image heights: they may be angles, object heights or image heights."""
    largest, magnification = listing.field.max(), abs(facts["magnification"])
    if not listing.unit.startswith("deg"):
        for scale in (1.0, magnification):
            if abs(scale * largest - last_mm) <= 0.005 * last_mm:
                return scale * listing.field
    elif largest < 90:
        focal_mm = (facts["efl_mm"] if np.isinf(facts["object_distance_mm"]) else
                    magnification * (facts["object_distance_mm"] + facts["entrance_pupil_mm"]))
        return focal_mm * np.tan(np.radians(listing.field))
    raise LensError(file, "field", f"up to {largest:g} {listing.unit}",
                    f"expected angles, or object or paraxial image heights, up to the last of {last_mm:g} mm")


def _at_heights(listed_mm, values, heights_mm, file):
    """Values at these heights by a spline of third degree, or of lower degree for very few points."""
    if listed_mm[0] > REACHED * heights_mm[-1] or listed_mm[-1] < (1 - REACHED) * heights_mm[-1]:
        raise LensError(file, "field", f"{listed_mm[0]:g} to {listed_mm[-1]:g} mm of paraxial height",
                        f"expected 0 to {heights_mm[-1]:g} mm")
    if np.any(np.diff(listed_mm) <= 0):
        raise LensError(file, "field", "not ascending", "expected field points from the axis outwards")
    return Spline.through(listed_mm, values)(heights_mm)


def _psf_reader(description, wavelengths, heights, side):
    """A function of (height number, wavelength number) that reads PSFs, after a check that all files exist."""
    program = description.choice("program", PROGRAMS)
    pitch_um = description.number("psf_pitch_um") if program == "codev" else None
    _check_psf_files(description, wavelengths, heights)

    def read(h, w):
        file = _file(description, "psf", height=h, wavelength=w)
        grid = _psf_grid(file, program, pitch_um)
        y = grid.image_mm[1] if grid.image_mm else 0.0
        if abs(y) > NEGLIGIBLE_MM and (y > 0) != (side == "+y"):
            raise description.refusal("image_side", f"{file.name} is of an image point at y = {y:g} mm")
        return grid

    return read


def _check_psf_files(description, wavelengths, heights):
    """Raise a LensError if any of the PSFs is missing."""
    name, folder = _name(description, "psf"), os.fspath(description.path.parent)
    if "{height}" not in name or "{wavelength}" not in name:
        raise description.refusal("psf", "expected a file name with {height} and {wavelength} in it")
    names = [name.replace("{height}", str(h)).replace("{wavelength}", str(w))
             for h in range(1, heights + 1) for w in range(1, wavelengths + 1)]
    missing = [name for name in names if not os.path.isfile(os.path.join(folder, name))]
    if missing:
        raise LensError(description.path, "PSF files", f"{len(missing)} of {len(names)} missing",
                        f"expected {os.path.basename(missing[0])}")


def _psf_grid(file, program, pitch_um):
    text = read_text(file)
    if program == "codev":
        return codev.psf_grid(text, file, pitch_um)
    return zemax_text.psf_grid(text, file) if program == "zemax" else zospy.psf_grid(text, file)
