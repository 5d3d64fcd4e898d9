"""Readers of prescriptions: every kind of file becomes one `Prescription`."""

import os
from pathlib import Path

from ...errors import LensError, absence
from ..prescription import Prescription
from .codev import read_codev
from .dot_lens import read_dot_lens
from .json_files import read_json
from .optbench import read_optbench
from .pbrt import read_pbrt
from .toml import read_lensfield
from .zemax import read_zemax

OF_ONE_LENS = {".toml": read_lensfield, ".zmx": read_zemax, ".seq": read_codev, ".dat": read_pbrt,
               ".lens": read_dot_lens}
OF_SEVERAL = {".json": read_json, ".txt": read_optbench}  # several lenses, or one at several positions
READERS = OF_ONE_LENS | OF_SEVERAL
MOST_SURFACES, MOST_TERMS = 1000, 100  # ten times what any lens has
DAMAGE = (ValueError, TypeError, IndexError, AttributeError, OverflowError, ZeroDivisionError, RecursionError)


def read_prescription(path: str | Path, field: tuple[str, float] | None = None,
                      which: str | None = None) -> Prescription:
    """The prescription in a file.

    Lensfield's .toml, Zemax .zmx, Code V .seq, pbrt .dat, Optical Bench .txt, .lens, and .json of Optiland, DeepLens
    and lentil.

    Parameters
    ----------
    path : path
    field : (str, float) or None
        Where the field ends, as `Prescription.field`, in place of what the file says or for a file that says nothing.
    which : str or None
        Of a file that holds several: the position's number (Optical Bench), or the lens's (lentil).

    Raises
    ------
    LensError
        A file that is not there, damaged, or tells of what is no centred lens of refracting surfaces.
    """
    path = Path(path)
    if not os.path.isfile(path):
        raise LensError(path, "prescription", absence(path), f"expected a file of kind {', '.join(READERS)}")
    kind = path.suffix.lower()
    if kind not in READERS:
        raise LensError(path, "kind of file", path.suffix or "without a suffix", f"expected {', '.join(READERS)}")
    if which is not None and kind in OF_ONE_LENS:
        raise LensError(path, "--which", which, "a file of this kind holds one lens: leave it out")
    try:
        lens = OF_ONE_LENS[kind](path, field) if kind in OF_ONE_LENS else OF_SEVERAL[kind](path, field, which)
        terms = max(len(surface.aspheric) + len(surface.odd_aspheric) for surface in lens.surfaces)
        if len(lens.surfaces) > MOST_SURFACES or terms > MOST_TERMS:
            raise LensError(path, "surfaces", f"{len(lens.surfaces)} of up to {terms} aspheric terms",
                            f"expected at most {MOST_SURFACES} and {MOST_TERMS}")
        return lens
    except LensError as error:
        raise error.at(path) from None
    except KeyError as error:
        raise LensError(path, str(error.args[0]), "missing", "the file may be damaged, or of another version"
                        ) from None
    except DAMAGE as error:
        told = " ".join(f"{type(error).__name__}: {error}".split())
        raise LensError(path, "prescription", "damaged", told) from None
