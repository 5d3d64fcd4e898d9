"""ISET bundles, written by the macros of the paper's authors for Zemax and CODE V.

A bundle consists of a parameter file of MATLAB assignments, tables of real chief-ray heights (`_DI_`) and relative
illumination (`_RI_`), and a listing of each PSF. Image points are at -y in PSFs from Zemax, and at +y from CODE V. The
lens was traced at paraxial image heights from 0 to imgHeightMax. Dialects differ in tables (rows, or one value per
line), encoding, names of PSF files (`_PSF_h_w` or `_2D_PSF_Fldh_Wavew`), and heights (CODE V writes an `imgHeight`
range instead of imgHeightNum and imgHeightMax).
"""

import re
from pathlib import Path, PureWindowsPath

import numpy as np

from ..lens.conventions import four_by_three
from ..lens.radial_lens import RadialLens
from ..runtime.errors import LensError, shown
from ..runtime.inputs import is_below
from ..runtime.text import number_table, object_distance, read_text
from ..runtime.unread import unread_names, unread_note
from . import codev, zemax_text
from .assembly import ISET_ASSUMED, MOST_PSFS, build_lens, check_count, entrance_pupil

PARAMETER_FILE = "isetparms.txt"
TABLE_ENDING = "_di_.dat"
PSF_NAMES = ("{base}_PSF_{height}_{wavelength}.dat", "{base}_2D_PSF_Fld{height}_Wave{wavelength}.dat")
ASSIGNMENT = re.compile(r"""^[ \t"]*([A-Za-z]\w*)[ \t]*=[ \t]*('[^'\n]*'|[^;%"'\n]*)""", re.MULTILINE)
KNOWN = ("lensFile", "baseLensFileName", "imgHeight", "imgHeightNum", "imgHeightMax", "wave", "psfSpacing")
HARMLESS = ("psfSize", "fnumber")  # listings state their size, and irradiance follows the effective f-number
NUMBERS = ("objDist", "mag", "refWave", "fov", "efl", "fnumber_eff")


def is_parameter_file(path: str | Path) -> bool:
    """Whether a file has the name of a bundle's parameter file."""
    return Path(path).name.lower().endswith(PARAMETER_FILE)


def find_parameter_file(folder: str | Path) -> Path | None:
    """The parameter file in a folder; None if it is missing.

    Raises
    ------
    LensError
        There are several.
    """
    candidates = sorted(path for path in Path(folder).iterdir() if is_parameter_file(path))
    if len(candidates) > 1:
        raise LensError(folder, "parameter file", f"{candidates[0].name} or {candidates[1].name}",
                        "give the file itself")
    return candidates[0] if candidates else None


def read_iset(path: str | Path) -> RadialLens:
    """Read the lens in an ISET bundle, from its parameter file.

    Raises
    ------
    LensError
        A file is missing, damaged, or inconsistent with the others.
    """
    path = Path(path)
    parameters = _parameters(path)
    files = {file.name.lower(): file for file in path.parent.iterdir()
             if not file.is_symlink() or is_below(file, path.parent)}
    base = _base(path, parameters, files)
    heights, wavelengths = _heights_mm(parameters, path), _axis(parameters, "wave", path)
    shape = (wavelengths.size, heights.size)
    check_count(path, wavelengths, heights)
    real = np.abs(_table(base, "DI", shape, files, path))
    object_mm = object_distance(parameters["objDist"])
    pupil_mm, pupil_note = entrance_pupil(parameters["fov"], heights[-1], parameters["mag"], object_mm,
                                          parameters["efl"])
    return build_lens(
        path, _psf_reader(base, shape, parameters, files, path), _image_side(base, files),
        name=PureWindowsPath(parameters.get("lensFile") or base).stem, source=f"ISET bundle {base}",
        efl_mm=parameters["efl"], magnification=parameters["mag"], f_number_effective=parameters["fnumber_eff"],
        object_distance_mm=object_mm, entrance_pupil_mm=pupil_mm, reference_wavelength_nm=parameters["refWave"],
        sensor_mm=four_by_three(heights[-1]), wavelengths_nm=wavelengths, heights_mm=heights, real_height_mm=real,
        relative_illumination=_table(base, "RI", shape, files, path),
        notes=" ".join(filter(None, (
            pupil_note, ISET_ASSUMED, unread_note(unread_names(parameters, (*KNOWN, *HARMLESS, *NUMBERS)))))))


def _parameters(path):
    """Names and values (numbers and strings) of the MATLAB assignments, which are never evaluated."""
    parameters = {name: value.strip(" \t\r,").strip("'") for name, value in ASSIGNMENT.findall(read_text(path))}
    for name in NUMBERS:
        parameters[name] = _number(parameters.get(name), name, path)
    return parameters


def _number(text, name, path):
    if text is None:
        raise LensError(path, name, "missing", "expected an assignment such as " + name + "=1.5;")
    try:
        return float(text)
    except ValueError:
        raise LensError(path, name, text, "expected a number") from None


def _axis(parameters, name, path):
    """float array of a MATLAB range such as 400:50:700, or a list of numbers in brackets."""
    text = parameters.get(name, "")
    words = re.split(r"[\s,]+", text.strip("[] ")) if text.startswith("[") else []
    if any(words):
        return np.array([_number(word, name, path) for word in words])
    parts = [_number(part, name, path) for part in text.split(":")]
    first, last, step = parts[0], parts[-1], parts[1] if len(parts) == 3 else 1.0
    steps = (last - first) / step if len(parts) in (2, 3) and step else np.nan
    if not 0 <= steps < MOST_PSFS:
        raise LensError(path, name, text, "expected first:step:last")
    return np.linspace(first, last, round(steps) + 1)  # the step is rounded, the ends are not


def _heights_mm(parameters, path):
    """float array of paraxial image heights, from a range, or from their number and the last height."""
    if "imgHeight" in parameters:
        heights = _axis(parameters, "imgHeight", path)
        count, last = heights.size, heights[-1]
    else:
        count = _number(parameters.get("imgHeightNum"), "imgHeightNum", path)
        last = _number(parameters.get("imgHeightMax"), "imgHeightMax", path)
    if not (2 <= count < MOST_PSFS and count == int(count) and 0 < last < np.inf):
        raise LensError(path, "image heights", f"{count:g} up to {last:g} mm",
                        "expected two or more, up to a positive height")
    return heights if "imgHeight" in parameters else np.linspace(0, last, int(count))


def _base(path, parameters, files):
    """The prefix of the bundle's file names, from the existing files, because users rename folders."""
    stated = PureWindowsPath(parameters.get("baseLensFileName", "")).name or path.stem
    bases = [file.name[:-len(TABLE_ENDING)] for name, file in files.items() if name.endswith(TABLE_ENDING)]
    if len(bases) == 1:
        return bases[0]
    match = [base for base in bases if base.lower() == stated.lower()]
    if match:
        return match[0]
    if bases:
        raise LensError(path, "baseLensFileName", stated, f"expected one of: {', '.join(sorted(bases)[:5])}")
    raise LensError(path, "real heights", "missing", f"expected {shown(stated)}_DI_.dat next to it")


def _table(base, kind, shape, files, path):
    name = f"{base}_{kind}_.dat"
    if name.lower() not in files:
        raise LensError(path, {"DI": "real heights", "RI": "relative illumination"}[kind], "missing",
                        f"expected {name} next to it")
    file = files[name.lower()]
    return number_table(read_text(file), file, "table", shape)


def _image_side(base, files):
    """+y for CODE V, whose parameter file's name begins with the base name; -y for Zemax."""
    return "+y" if f"{base}_{PARAMETER_FILE}".lower() in files else "-y"


def _psf_reader(base, shape, parameters, files, path):
    """A function of (height number, wavelength number) that reads PSFs, after a check that all files exist."""
    wavelengths, heights = shape
    numbers = [(h + 1, w + 1) for h in range(heights) for w in range(wavelengths)]
    missing = []
    for pattern in PSF_NAMES:
        names = {(h, w): pattern.format(base=base, height=h, wavelength=w) for h, w in numbers}
        absent = [name for name in names.values() if name.lower() not in files]
        if not absent:
            return lambda h, w: _psf_grid(files[names[h, w].lower()], parameters, path)
        missing.append(absent)
    fewest = min(missing, key=len)
    raise LensError(path, "PSF files", f"{len(fewest)} of {len(numbers)} missing", f"expected {fewest[0]} next to it")


def _psf_grid(file, parameters, path):
    text = read_text(file)
    if zemax_text.is_listing(text):
        return zemax_text.psf_grid(text, file)
    return codev.psf_grid(text, file, 1e3 * _number(parameters.get("psfSpacing"), "psfSpacing", path))
