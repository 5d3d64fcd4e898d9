"""Lenses by name or path: bundled lenses, prescriptions and packages."""

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from os import PathLike
from pathlib import Path

import numpy as np

from ..bake.sampling import sensor_mm
from ..lens.lens import Lens
from ..lens.pinhole import Pinhole
from ..lens_files import IMPORT_FIRST, is_import
from ..lens_files.package import read_package
from ..prescription.prescription import Prescription
from ..prescription.readers import AS_IT_IS, SUFFIXES, ReadingOptions, checked, read_file, read_prescription
from ..prescription.readers.toml import Description, read_description, read_lensfield
from ..rays.focus import build_system
from ..rays.rings import AT_REST, Rings, is_stopped_down, turned
from ..runtime.errors import LensError
from ..runtime.inputs import check_input
from .baked import Edges, baked_lens, with_prescription

BUNDLED = Path(__file__).resolve().parent
PRESCRIPTIONS, PICTURES = BUNDLED / "prescriptions", BUNDLED / "pictures"
ALL_LENSES = "`lensfield lens list` lists them"
LensSource = str | PathLike[str] | Prescription
"""What a lens comes from: its name, its file, or its prescription."""


@lru_cache
def bundled_names() -> tuple[str, ...]:
    """Names of the bundled lenses."""
    return tuple(sorted(path.stem for path in PRESCRIPTIONS.glob("*.toml")))


@lru_cache
def bundled_lenses() -> dict[str, Prescription]:
    """The bundled lenses, by name."""
    return {name: _bundled(name) for name in bundled_names()}


@lru_cache
def described_lenses() -> dict[str, Description]:
    """Descriptions of the bundled lenses, by name, for lists and searches."""
    return {name: read_description(prescription_path(name)) for name in bundled_names()}


@lru_cache
def _bundled(name):
    return read_lensfield(prescription_path(name))


def prescription_path(name_or_path: str | PathLike[str]) -> Path:
    """The file of a prescription: of the bundled lens with this name, or at this path."""
    name = str(name_or_path)
    return PRESCRIPTIONS / f"{name}.toml" if name in bundled_names() else Path(name)


def find_bundled(words: list[str]) -> dict[str, Description]:
    """The bundled lenses that match every word: in name, maker, year, focal length ("50mm"), character or story."""
    wanted = [word.casefold() for word in words]
    return {name: lens for name, lens in described_lenses().items()
            if all(word in _search_text(name, lens) for word in wanted)}


def _search_text(name, lens):
    focal = f"{lens.focal_length_mm:g}mm" if lens.focal_length_mm else ""
    return " ".join((name, lens.title, lens.maker, str(lens.year or ""), focal, *lens.character, lens.story,
                     lens.source)).casefold()


def load_lens(source: LensSource, rings: Rings = AT_REST, quality: str = "standard",
              progress: Callable[[float, str], object] = lambda fraction, label: None,
              wavelengths_nm: Sequence[float] | np.ndarray | None = None,
              edges_mm: Edges | None = None) -> Lens:
    """Load the lens with this name, in this file or of this prescription, set to a focus distance and an f-number.

    Parameters
    ----------
    source : str, path or Prescription
        A bundled lens, a lens package, or a prescription of any kind that `read_prescription` reads. To read a file
        with other options than its own, pass the Prescription that `read_prescription` returns.
    rings : Rings
        The focus distance and f-number. They can be set only for lenses with a prescription.
    quality : str
        Sampling of the bake of a prescription: one of `QUALITIES`.
    progress : function (fraction, label)
    wavelengths_nm : sequence of float or None
        Of the pictures: a prescription is baked for these alone, which is faster and more accurate if they are few.
        None for lens data over all wavelengths.
    edges_mm : (float, float, float, float) or None
        Of the pictures' frame, as `PixelGrid.edges_mm`, on the sensor of the lens in its own size: a prescription
        without rotational symmetry is baked up to these, within its image circle. None for the sensor.

    Raises
    ------
    LensError
        The lens is unknown, damaged or of an unknown kind; or rings are given for a lens without a prescription.

    Examples
    --------
    >>> from lensfield import load_lens
    >>> lens = load_lens("tessar-50mm", quality="preview", wavelengths_nm=[550])
    >>> lens.sensor_mm, round(lens.efl_mm)
    ((36.0, 24.0), 50)
    """
    if isinstance(source, Prescription):
        return baked_lens(source, rings, quality, progress, wavelengths_nm, edges_mm)
    package, fixed = package_path(source), not has_rings(source)
    if package and fixed and rings != AT_REST:
        raise LensError(source, "focus and f-number", "fixed",
                        "a package is baked for one of each: omit them, or give the lens's prescription")
    if package and (fixed or replace(rings, coating=None) == AT_REST):
        return _package_lens(package, source, rings)
    prescription = prescription_of(source)
    try:
        return baked_lens(prescription, rings, quality, progress, wavelengths_nm, edges_mm)
    except LensError as error:
        raise error.at(source) from None


def _package_lens(package, name_or_path, rings):
    """The lens in a package, with its prescription and this coating if the prescription is also bundled."""
    lens = read_package(package)
    if not has_rings(name_or_path):
        return lens
    return with_prescription(lens, turned(prescription_of(name_or_path), rings).prescription)


def fits_all_frames(source: LensSource, rings: Rings = AT_REST) -> bool:
    """Whether lens data do not depend on the edges of the pictures: for a package, or with rotational symmetry."""
    return not has_rings(source) or turned(prescription_of(source), rings).prescription.radial


def pinhole_of(source: LensSource, rings: Rings = AT_REST) -> Pinhole:
    """The pinhole camera of a lens with a prescription at its settings, without a bake."""
    system = build_system(turned(prescription_of(source), rings).prescription)
    return Pinhole(sensor_mm(system), system.capture_focal_length_mm, system.squeeze)


def clamped_rings(source: LensSource, rings: Rings) -> tuple[str, ...]:
    """A line for each ring whose requested value is out of range, with the value that replaces it."""
    return turned(prescription_of(source), rings).words


def iris_is_visible(source: LensSource, rings: Rings) -> bool:
    """Whether a lens is stopped down below its widest aperture, which makes the shape of its iris visible."""
    return has_rings(source) and is_stopped_down(prescription_of(source), rings)


def has_rings(source: LensSource) -> bool:
    """Whether a lens can be focused and stopped down, because it has a prescription."""
    return (isinstance(source, Prescription) or str(source) in bundled_names()
            or Path(source).suffix.lower() in SUFFIXES)


def package_path(name_or_path: str | PathLike[str]) -> Path | None:
    """The package that a lens is read from; None if it is baked from a prescription."""
    bundled_package = BUNDLED / f"{name_or_path}.npz"
    if str(name_or_path) in bundled_names():
        return bundled_package if bundled_package.is_file() else None
    path = Path(name_or_path)
    check_input(name_or_path, "lens", IMPORT_FIRST if os.path.isdir(path) else
                f"give a lens package, a prescription or the name of a bundled lens: {ALL_LENSES}", error=LensError)
    if is_import(path):
        raise LensError(path, "lens data", "in another program's format", IMPORT_FIRST)
    if path.suffix.lower() != ".npz" and not has_rings(path):
        raise LensError(path, "kind of file", path.suffix or "without a suffix",
                        f"expected a .npz lens package or a prescription ({', '.join(SUFFIXES)}); {IMPORT_FIRST}, and "
                        "`lensfield lens measured` a calibration")
    return None if has_rings(path) else path


def prescription_of(source: LensSource) -> Prescription:
    """The prescription with this name or in this file; a Prescription itself.

    Raises
    ------
    LensError
        As `read_prescription`.
    """
    if isinstance(source, Prescription):
        return source
    return _bundled(str(source)) if str(source) in bundled_names() else read_prescription(str(source))


def prescription_as_stated(name_or_path: str | PathLike[str], options: ReadingOptions = AS_IT_IS) -> Prescription:
    """The prescription with the focal length that its file states, even if its surfaces contradict it, for checks.

    Raises
    ------
    LensError
        As `read_prescription`, except about the focal length and the f-number.
    """
    path = prescription_path(name_or_path)
    reading = read_file(path, options)
    accepted = checked(path, reading, allow_mismatch=True)
    return replace(accepted, focal_length_mm=reading.prescription.focal_length_mm)
