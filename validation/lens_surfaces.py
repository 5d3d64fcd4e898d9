"""A lens as rays meet it at stated wavelengths: surfaces, indices and absorption, and how they are kept as JSON.

    .venv/bin/python validation/lens_surfaces.py engine/library/prescriptions/edmund-54852.toml \
        -o tests/data/edmund-54852_surfaces.json --wavelengths 453,562,655

focuses the lens as baking does, looks its glasses up, and writes the file.
"""

import argparse
import json
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from lensfield.engine.errors import LensError
from lensfield.engine.files import atomic_path


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Surfaces of revolution in the order of the light, with media for some wavelengths.

    Attributes
    ----------
    name : str
    entrance_pupil_mm : float
        From the first surface to the entrance pupil, towards the image.
    wavelengths_nm : array (wavelength,)
    radius_mm, thickness_mm, conic, semi_aperture_mm : arrays (surface,)
        Radii are positive where the centre lies towards the image, inf for a plane; the last thickness reaches the
        image plane; semi-apertures, that of the stop included, are inf where nothing stops light.
    aspheric : array (surface, term)
        Coefficients of r^2, r^4, r^6 ... in mm.
    index, absorption_per_mm : arrays (wavelength, surface)
        Of what follows each surface.
    """

    name: str
    entrance_pupil_mm: float
    wavelengths_nm: np.ndarray
    radius_mm: np.ndarray
    thickness_mm: np.ndarray
    conic: np.ndarray
    semi_aperture_mm: np.ndarray
    aspheric: np.ndarray
    index: np.ndarray
    absorption_per_mm: np.ndarray

    def at(self, wavelength_nm):
        """Index and absorption per mm behind each surface: two arrays (surface,); a LensError for other wavelengths."""
        found = np.flatnonzero(np.isclose(self.wavelengths_nm, wavelength_nm))
        if not found.size:
            raise LensError(self.name, "wavelength", f"{wavelength_nm:g} nm",
                            "expected one of " + ", ".join(f"{nm:g}" for nm in self.wavelengths_nm))
        return self.index[found[0]], self.absorption_per_mm[found[0]]


def read_surfaces(path):
    """The Surfaces in a file that `write_surfaces` made."""
    raw = json.loads(Path(path).read_text(encoding="utf-8"))
    return Surfaces(**{field.name: _restored(raw[field.name], field.type) for field in fields(Surfaces)})


def write_surfaces(surfaces, path):
    """Write Surfaces as JSON, one field a line."""
    lines = [f"{json.dumps(field.name)}: {json.dumps(_plain(getattr(surfaces, field.name)), allow_nan=False)}"
             for field in fields(surfaces)]
    with atomic_path(path) as temporary:
        temporary.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def _plain(value):
    """Lists and numbers that JSON has; None for infinity."""
    if isinstance(value, np.ndarray):
        return [_plain(part) for part in value]
    if isinstance(value, str):
        return value
    return float(value) if np.isfinite(value) else None


def _restored(value, kind):
    if kind is not np.ndarray:
        return value
    array = np.array(value, dtype=float)  # which makes NaN of None
    return np.where(np.isnan(array), np.inf, array)


def surfaces_of(prescription, wavelengths_nm):
    """Surfaces of a prescription, focused and with its stop as baking has them."""
    from lensfield.engine.bake.focus import build_system

    system = build_system(prescription)
    parts = system.prescription.surfaces
    semi_mm = np.array([part.semi_aperture_mm for part in parts])
    semi_mm[system.prescription.stop_index] = system.stop_semi_aperture_mm
    terms = max(len(part.aspheric) for part in parts)
    nm = np.array(wavelengths_nm, dtype=float)
    extinction = np.array([glass.extinction_at(nm) for glass in system.glasses]).T
    return Surfaces(
        prescription.name, system.entrance_pupil_mm, nm,
        np.array([part.radius_mm for part in parts]),
        np.array([part.thickness_mm for part in parts]), np.array([part.conic for part in parts]), semi_mm,
        np.array([[*part.aspheric, *(0.0,) * (terms - len(part.aspheric))] for part in parts]).reshape(len(parts), -1),
        system.indices_at(nm)[1:].T, 4 * np.pi * extinction / (nm[:, None] * 1e-6))


def main(arguments=None):
    from lensfield.engine.bake.prescriptions import read_prescription

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("prescription", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--wavelengths", default="453,562,655", help="nanometres, with commas between")
    asked = parser.parse_args(arguments)
    wavelengths_nm = [float(nm) for nm in asked.wavelengths.split(",")]
    write_surfaces(surfaces_of(read_prescription(asked.prescription), wavelengths_nm), asked.output)


if __name__ == "__main__":
    main()
