"""Distortion of the library's lenses beside Lensfun's calibration of the lenses that were sold.

    python benchmarks/lensfun_distortion.py [FOLDER]

FOLDER holds Lensfun's XML files, as Debian's liblensfun-data-v1 installs them. Both curves are compared up to the
corner of the camera that was calibrated, but for one factor, the focal length that neither knows. Exit status 1 where
one is off by more than the tolerance.
"""

import sys
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import minimize_scalar

from lensfield.engine.bake.focus import build_system
from lensfield.engine.bake.prescriptions.toml import read_lensfield
from lensfield.engine.bake.rays import HalfPupil, trace_pupil
from lensfield.engine.library import PRESCRIPTIONS

FOLDER = Path("/usr/share/lensfun/version_1")
TOLERANCE = 0.7  # percent points
FULL_FRAME_HALF_MM = 12.0, np.hypot(18.0, 12.0)  # half the short side, which is Lensfun's unit; half the diagonal
SAME = {  # of the library, and what Lensfun calls it; the same lens or one of the same design
    "canon-rf-85mm-f1.2": "Canon RF 85mm F1.2L USM",
    "leica-summicron-50mm": "Summicron-M 1:2/50",
    "minolta-macro-100mm": "Minolta/Sony AF 100mm F2.8 Macro (D)",
    "nikkor-28mm": "Nikon AI-S Nikkor 28mm f/2.8",
    "nikkor-35mm-f1.4": "Nikon AI-S Nikkor 35mm f/1.4",
    "nikkor-50mm-f1.2": "Nikon AI-S Nikkor 50mm f/1.2",
    "nikkor-58mm-f1.4": "Nikon AF-S Nikkor 58mm f/1.4G",
    "nikkor-z-50mm-f1.8": "NIKKOR Z 50mm f/1.8 S",
    "sony-zeiss-55mm-f1.8": "FE 55mm f/1.8 ZA",
    "zeiss-planar-50mm-f1.4": "Carl Zeiss Planar T* 1,4/50 ZF.2"}


@dataclass(frozen=True)
class Calibration:
    """Lensfun's polynomial, over heights in half the picture's short side, and the sensor's crop."""

    crop: float
    powers: tuple[float, float, float]

    def scale(self, heights: np.ndarray) -> np.ndarray:
        """Real over undistorted height, at undistorted heights in half short sides."""
        a, b, c = self.powers
        return a * heights**3 + b * heights**2 + c * heights + 1 - a - b - c


def calibrations(folder: Path) -> dict[str, Calibration]:
    """Those of lenses of one focal length, by model."""
    found = {}
    for path in sorted(folder.glob("*.xml")):
        for lens in ET.parse(path).getroot().iter("lens"):
            distortions = list(lens.iter("distortion"))
            if len(distortions) == 1:
                told = {name: float(value) for name, value in distortions[0].attrib.items() if name != "model"}
                powers = (told.get("a", 0.0), told.get("b", 0.0) + told.get("k1", 0.0), told.get("c", 0.0))
                found.setdefault(lens.findtext("model"), Calibration(float(lens.findtext("cropfactor")), powers))
    return found


def largest_difference(name: str, calibration: Calibration) -> tuple[float, float, float]:
    """In percent points, of the library's lens and Lensfun's; and both curves' distortion at the corner."""
    unit_mm, corner_mm = np.array(FULL_FRAME_HALF_MM) / calibration.crop
    lens = read_lensfield(PRESCRIPTIONS / f"{name}.toml")
    still = tuple(replace(surface, gaps_mm=()) for surface in lens.surfaces)
    system = build_system(replace(lens, surfaces=still, focused_at_mm=()))
    paraxial_mm = np.linspace(0, min(1.05 * corner_mm, system.last_height_mm), 41)[1:]
    rays = trace_pupil(system, paraxial_mm, [system.prescription.reference_wavelength_nm], HalfPupil(1, 1))
    ours = rays.chief_height_mm[0] / paraxial_mm

    def difference(factor):
        return factor * ours - calibration.scale(factor * paraxial_mm / unit_mm)

    best = minimize_scalar(lambda factor: np.abs(difference(factor)).max(), bounds=(0.9, 1.1), method="bounded")
    theirs = calibration.scale(paraxial_mm / unit_mm)
    return 100 * best.fun, 100 * (ours[-1] / ours[0] - 1), 100 * (theirs[-1] / theirs[0] - 1)


def main(folder: Path = FOLDER) -> int:
    """Print the table."""
    known = calibrations(folder)
    print(f"{'lens':26}{'at the corner':>14}{'Lensfun':>9}{'largest difference':>20}")
    worst = 0.0
    for name, model in SAME.items():
        difference, ours, theirs = largest_difference(name, known[model])
        print(f"{name:26}{ours:13.2f}%{theirs:8.2f}%{difference:19.2f}%")
        worst = max(worst, difference)
    return int(worst > TOLERANCE)


if __name__ == "__main__":
    sys.exit(main(*map(Path, sys.argv[1:])))
