"""Readers of prescriptions: each file format becomes a `Prescription`."""

import json
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from ...runtime import inputs
from ...runtime.errors import LensError
from ...runtime.text import read_text
from ...runtime.toml_fields import read_any_toml
from ..prescription import Prescription
from .codev import read_codev
from .deeplens import read_deeplens
from .dot_lens import read_dot_lens
from .ghostlight import is_ghostlight, read_ghostlight
from .lentil import is_lentil, read_lentil
from .optbench import read_optbench
from .optiland_json import read_optiland
from .pbrt import read_pbrt
from .physical_camera import is_physical_camera, read_physical_camera
from .reading import AS_IT_IS, SEMI_DIAMETERS, Reading, ReadingOptions, checked
from .toml import read_native
from .zemax import read_zemax


class Reader(NamedTuple):
    """The reader of a kind of file, which its suffix and its contents identify.

    Attributes
    ----------
    suffix : str
    reads : callable (contents) -> bool
        Whether the contents are of this kind. They are a table of TOML, a dict of JSON, or text: see `_contents`.
    read : callable (path, contents, options) -> Reading
    of_several : bool
        Whether files contain several lenses, or a lens at several positions.
    with_semi_diameters : bool
        Whether they state semi-diameters in addition to apertures.
    """

    suffix: str
    reads: Callable[[Any], bool]
    read: Callable[[Path, Any, ReadingOptions], Reading]
    of_several: bool = False
    with_semi_diameters: bool = False


def _any(contents):
    return True


READERS = (
    Reader(".toml", is_physical_camera, read_physical_camera),
    Reader(".toml", _any, read_native),
    Reader(".zmx", _any, read_zemax, with_semi_diameters=True),
    Reader(".seq", _any, read_codev),
    Reader(".dat", _any, read_pbrt),
    Reader(".lens", is_ghostlight, read_ghostlight),
    Reader(".lens", _any, read_dot_lens),
    Reader(".json", is_lentil, read_lentil, of_several=True),
    Reader(".json", lambda contents: "surface_group" in contents, read_optiland),
    Reader(".json", lambda contents: "surfaces" in contents, read_deeplens),
    Reader(".txt", _any, read_optbench, of_several=True))
"""The first that fits reads a file."""
SUFFIXES = tuple(dict.fromkeys(reader.suffix for reader in READERS))
READABLE = ("Lensfield or physical-camera .toml, Zemax .zmx, Code V .seq, pbrt .dat, Optical Bench .txt, .lens, or "
            ".json of Optiland, DeepLens or lentil")
"""The files that READERS read, for help."""
DAMAGE = (ValueError, TypeError, IndexError, AttributeError, OverflowError, ZeroDivisionError, RecursionError)


def read_prescription(path: str | Path, options: ReadingOptions = AS_IT_IS) -> Prescription:
    """Read the prescription in a file of one of the kinds in `READABLE`.

    Raises
    ------
    LensError
        A file that is missing, damaged, inconsistent, or does not describe a lens of refracting surfaces and mirrors;
        or options that do not apply to it.

    Examples
    --------
    >>> from lensfield import read_prescription
    >>> from lensfield.engine.library import prescription_path
    >>> tessar = read_prescription(prescription_path("tessar-50mm"))
    >>> tessar.focal_length_mm, len(tessar.surfaces), tessar.field
    (50.0, 8, ('angle_deg', 24.0))
    """
    return checked(Path(path), read_file(path, options), options.allow_mismatch)


def read_file(path: str | Path, options: ReadingOptions = AS_IT_IS) -> Reading:
    """Read a file by these options, before `checked` compares its surfaces with the stated figures.

    Raises
    ------
    LensError
        As `read_prescription`.
    """
    path = Path(path)
    inputs.check_input(path, "prescription", f"expected a file of kind {', '.join(SUFFIXES)}", error=LensError)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise LensError(path, "kind of file", path.suffix or "without a suffix", f"expected {', '.join(SUFFIXES)}")
    with inputs.reading(path), _named(path):
        contents = _contents(path, suffix)
        reader = _reader(path, suffix, contents)
    _check_options(path, reader, options)
    with inputs.reading(path), _named(path):
        reading = reader.read(path, contents, options)
        return replace(reading, prescription=_with_replacements(path, reading.prescription, options))


def _contents(path, suffix):
    """The contents of a file with this suffix: a TomlTable, a dict of JSON, or text."""
    if suffix == ".toml":
        return read_any_toml(path)
    text = read_text(path)
    if suffix != ".json":
        return text
    contents = json.loads(text)
    return contents if isinstance(contents, dict) else {}


def _reader(path, suffix, contents):
    """The first reader that fits; only JSON may have none."""
    for reader in READERS:
        if reader.suffix == suffix and reader.reads(contents):
            return reader
    raise LensError(path, "surface_group", "missing",
                    "expected a file of Optiland's save_optiland_file, of DeepLens, or lentil's lenses.json")


@contextmanager
def _named(path):
    """Turn errors of damaged contents into LensErrors that name the file."""
    try:
        yield
    except LensError as error:
        raise error.at(path) from None
    except KeyError as error:
        raise LensError(path, str(error.args[0]), "missing", "the file may be damaged, or have another version"
                        ) from None
    except DAMAGE as error:
        text = " ".join(f"{type(error).__name__}: {error}".split())
        raise LensError(path, "prescription", "damaged", text) from None


def _with_replacements(path, prescription, options):
    """The prescription with the glasses and the sensor of the options."""
    names = sorted({surface.glass for surface in prescription.surfaces} - {""})
    prescription = prescription.with_glasses(
        {old: new for pair in options.glasses for old, new in _glass_names(path, pair, names)})
    return replace(prescription, sensor_mm=options.sensor_mm) if options.sensor_mm else prescription


def _glass_names(path, pair, names):
    """(old, new) names of the glasses that match OLD=NEW; OLD may omit the catalogue."""
    old, _, new = (word.strip() for word in pair.partition("="))
    matching = [name for name in names if old in (name, name.split()[-1])]
    if not new or not matching:
        raise LensError(path, "--glass", pair, f"expected OLD=NEW with one of {', '.join(names)}")
    return [(name, new) for name in matching]


def _check_options(path, reader, options):
    """Reject options that do not apply to this kind of file."""
    if options.which is not None and not reader.of_several:
        raise LensError(path, "--which", options.which, "the file contains one lens: leave it out")
    if options.semi_diameters is None:
        return
    if options.semi_diameters not in SEMI_DIAMETERS:
        raise LensError(path, "--semi-diameters", options.semi_diameters, f"expected {' or '.join(SEMI_DIAMETERS)}")
    if not reader.with_semi_diameters:
        raise LensError(path, "--semi-diameters", options.semi_diameters,
                        "only Zemax files have semi-diameters in addition to apertures: leave it out")
