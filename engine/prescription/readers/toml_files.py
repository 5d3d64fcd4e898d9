"""TOML prescriptions of Lensfield or physical-camera, distinguished by their contents."""

from pathlib import Path

from ...runtime.toml_fields import read_any_toml
from .physical_camera import LENS, SURFACES, read_physical_camera
from .reading import Reading, ReadingOptions
from .toml import read_lensfield


def read_toml_prescription(path: Path, options: ReadingOptions) -> Reading:
    """Read a Lensfield prescription, where unknown names are errors, or a lens file of physical-camera."""
    table = read_any_toml(path)
    if {LENS, SURFACES} <= table.values.keys():
        return read_physical_camera(path, table, options)
    return Reading(read_lensfield(path, options), native=True)
