"""JSON prescriptions of Optiland, DeepLens, or lentil's database, distinguished by their contents."""

import json
from pathlib import Path

from ...runtime.errors import LensError
from ...runtime.text import read_text
from .deeplens import read_deeplens
from .lentil import ELEMENTS, read_lentil
from .optiland_json import read_optiland
from .reading import Reading, ReadingOptions


def read_json(path: Path, options: ReadingOptions) -> Reading:
    """Read a file of Optiland's `save_optiland_file` or of DeepLens, or an entry of lentil's `lenses.json`."""
    contents = json.loads(read_text(path))
    entries = contents if isinstance(contents, dict) else {}
    if any(isinstance(entry, dict) and ELEMENTS in entry for entry in entries.values()):
        return read_lentil(path, entries, options)
    read = read_optiland if "surface_group" in entries else read_deeplens if "surfaces" in entries else None
    if read is None:
        raise LensError(path, "surface_group", "missing",
                        "expected a file of Optiland's save_optiland_file, of DeepLens, or lentil's lenses.json")
    if options.which is not None:
        raise LensError(path, "--which", options.which, "the file contains one lens: leave it out")
    return read(path, entries, options)
