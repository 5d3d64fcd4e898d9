"""Readers of prescriptions: every kind of file becomes one `Prescription`."""

import os
from pathlib import Path

from ...errors import LensError, absence
from ...lens.readers.text import shown
from ..prescription import Prescription
from .codev import read_codev
from .optiland_json import read_optiland
from .pbrt import read_pbrt
from .toml import read_lensfield
from .zemax import read_zemax

READERS = {".toml": read_lensfield, ".zmx": read_zemax, ".seq": read_codev, ".json": read_optiland, ".dat": read_pbrt}
DAMAGE = (ValueError, TypeError, KeyError, IndexError, AttributeError, OverflowError, ZeroDivisionError, RecursionError)


def read_prescription(path: str | Path, field: tuple[str, float] | None = None) -> Prescription:
    """The prescription in a file: Lensfield's .toml, Zemax .zmx, Code V .seq, Optiland .json or pbrt .dat.

    Parameters
    ----------
    path : path
    field : (str, float) or None
        Where the field ends, as `Prescription.field`, in place of what the file says or for a file that says nothing.

    Raises
    ------
    LensError
        A file that is not there, damaged, or tells of what is no centred lens of refracting surfaces.
    """
    path = Path(path)
    if not os.path.isfile(path):
        raise LensError(path, "prescription", absence(path), f"expected a file of kind {', '.join(READERS)}")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise LensError(path, "kind of file", path.suffix or "without a suffix", f"expected {', '.join(READERS)}")
    try:
        return reader(path, field)
    except LensError as error:
        value = shown(error.value) if isinstance(error.value, str) else error.value
        raise LensError(path, shown(error.field), value, error.remedy) from None
    except DAMAGE as error:
        told = " ".join(f"{type(error).__name__}: {error}".split())
        raise LensError(path, "prescription", "damaged", told) from None
