"""Readers of prescriptions: each file format becomes a `Prescription`."""

from dataclasses import replace
from pathlib import Path

from ...runtime import inputs
from ...runtime.errors import LensError
from ..prescription import Prescription
from .codev import read_codev
from .dot_lens import read_dot_lens
from .json_files import read_json
from .optbench import read_optbench
from .pbrt import read_pbrt
from .reading import AS_IT_IS, SEMI_DIAMETERS, Reading, ReadingOptions, checked
from .toml_files import read_toml_prescription
from .zemax import read_zemax

READERS = {".toml": read_toml_prescription, ".zmx": read_zemax, ".seq": read_codev, ".dat": read_pbrt,
           ".lens": read_dot_lens, ".json": read_json, ".txt": read_optbench}
READABLE = ("Lensfield or physical-camera .toml, Zemax .zmx, Code V .seq, pbrt .dat, Optical Bench .txt, .lens, or "
            ".json of Optiland, DeepLens or lentil")
"""The files that READERS read, for help."""
OF_SEVERAL = (".json", ".txt")  # several lenses, or a lens at several positions
WITH_SEMI_DIAMETERS = (".zmx",)  # in addition to apertures
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
    >>> from lensfield.engine import read_prescription
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
    inputs.check_input(path, "prescription", f"expected a file of kind {', '.join(READERS)}", error=LensError)
    kind = path.suffix.lower()
    if kind not in READERS:
        raise LensError(path, "kind of file", path.suffix or "without a suffix", f"expected {', '.join(READERS)}")
    _check_options(path, kind, options)
    with inputs.reading(path):
        return _read(path, kind, options)


def _read(path, kind, options):
    try:
        reading = READERS[kind](path, options)
        return replace(reading, prescription=_with_replacements(path, reading.prescription, options))
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


def _check_options(path, kind, options):
    """Reject options that do not apply to this kind of file."""
    if options.which is not None and kind not in OF_SEVERAL:
        raise LensError(path, "--which", options.which, "a file of this kind contains one lens: leave it out")
    if options.semi_diameters is None:
        return
    if options.semi_diameters not in SEMI_DIAMETERS:
        raise LensError(path, "--semi-diameters", options.semi_diameters, f"expected {' or '.join(SEMI_DIAMETERS)}")
    if kind not in WITH_SEMI_DIAMETERS:
        raise LensError(path, "--semi-diameters", options.semi_diameters,
                        "only Zemax files have semi-diameters in addition to apertures: leave it out")
