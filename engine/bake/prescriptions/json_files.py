"""JSON prescriptions: Optiland's, DeepLens', or lentil's database, told apart by what is in them."""

import json
from pathlib import Path

from ...errors import LensError
from ...lens.readers.text import read_text
from ..prescription import Prescription
from .deeplens import read_deeplens
from .lentil import ELEMENTS, read_lentil
from .optiland_json import read_optiland


def read_json(path: Path, field: tuple[str, float] | None = None, which: str | None = None) -> Prescription:
    """Read what Optiland's `save_optiland_file` or DeepLens wrote, or an entry of lentil's `lenses.json`."""
    contents = json.loads(read_text(path))
    told = contents if isinstance(contents, dict) else {}
    if any(isinstance(entry, dict) and ELEMENTS in entry for entry in told.values()):
        return read_lentil(path, told, field, which)
    read = read_optiland if "surface_group" in told else read_deeplens if "surfaces" in told else None
    if read is None:
        raise LensError(path, "surface_group", "missing",
                        "expected what Optiland's save_optiland_file or DeepLens writes, or lentil's lenses.json")
    if which is not None:
        raise LensError(path, "--which", which, "the file holds one lens: leave it out")
    return read(path, told, field)
