"""The sampling of a bake: its wavelengths and PSF samples, and the notes on its limits."""

import numpy as np

from ..lens.conventions import four_by_three
from ..prescription.system import System
from ..rays.field_heights import image_radius_mm
from .quality import Quality

LEAST_SAMPLES, MOST_SAMPLES = 65, 129  # of a PSF along each side


def sensor_mm(system: System) -> tuple[float, float]:
    """Width and height of the sensor that the lens is designed for."""
    return system.prescription.sensor_mm or four_by_three(image_radius_mm(system))


def picture_samples(width_um: float, sensor_mm: tuple[float, float], quality: Quality) -> int:
    """Odd number of samples across a window, no larger than the pixels of a picture that fills the sensor."""
    number = int(np.ceil(width_um / (1e3 * sensor_mm[0] / quality.picture_px)))
    return min(max(number, LEAST_SAMPLES), MOST_SAMPLES) // 2 * 2 + 1


def limit_notes(notes: str, fringes: float, places: str, between: float, quality: Quality) -> str:
    """The prescription's notes, plus a line for each limit of the bake's accuracy."""
    lines = [notes] if notes else []
    lengthening = fringes / quality.sums.fringes
    if lengthening > 1:
        lines.append(f"Diffraction is computed with wavelengths lengthened by a factor of up to {lengthening:.2g}.")
    if between > quality.between:
        lines.append(f"{places}, {100 * between:.2g} % of the light is misplaced.")
    return "\n".join(lines)


def traced_nm(wavelengths_nm: np.ndarray, number: int) -> np.ndarray:
    """Wavelengths to trace: all if they are few, otherwise Chebyshev extrema over the wave number."""
    if wavelengths_nm.size <= number:
        return wavelengths_nm
    first, last = 1 / wavelengths_nm[0], 1 / wavelengths_nm[-1]
    return 1 / (first + (last - first) * (1 - np.cos(np.pi * np.arange(number) / (number - 1))) / 2)
