"""Lenses in Lensfun's database, which is fitted to photographs of real copies, through lensfunpy and its data.

The data are under CC BY-SA 3.0 and stay in lensfunpy: only differences from them leave this module's callers.
"""

from typing import Any, NamedTuple

import numpy as np

from ..prescription.photographs import MM_PER_M, Vignetting
from ..prescription.prescription import Prescription
from ..prescription.system import system_of
from ..rays.rings import ring_ends, turned
from ..runtime.errors import InputError, LensError, listed

FULL_FRAME_MM = 36.0, 24.0
FAR_M = 100.0  # distances from here on are infinity: Lensfun writes 1000
SHARES = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95])
"""Of the half diagonal. Lensfun's polynomials of third order in r^2 are least certain in the corner itself."""
PICTURE_PX = 2400, 1600
MOST_NAMED = 3


class Photographed(NamedTuple):
    """A lens in the database.

    Attributes
    ----------
    lens : lensfunpy.Lens
    name : str
        Its maker and model, or the model alone if that begins with the maker.
    """

    lens: Any
    name: str

    @property
    def sensor_mm(self) -> tuple[float, float]:
        """Width and height, at 3:2, of the sensor that the photographs are from."""
        width, height = FULL_FRAME_MM
        return width / self.lens.crop_factor, height / self.lens.crop_factor

    @property
    def half_diagonal_mm(self) -> float:
        """Of the sensor; Lensfun's unit of length."""
        return float(np.hypot(*self.sensor_mm) / 2)


def find_photographed(name: str) -> Photographed:
    """The fixed-focal lens with this "MAKER MODEL", measured on the largest sensor.

    Raises
    ------
    InputError
        lensfunpy is not installed, or its data contain no such lens.
    """
    lenses = fixed_focal_lenses()
    found = [each for each in lenses if each.name.casefold() == name.casefold()]
    if not found:
        words = name.casefold().split()
        similar = listed([each.name for each in lenses if all(word in each.name.casefold() for word in words)],
                         MOST_NAMED)
        raise InputError("lensfun", "lens", name, "expected the maker and the model of a lens with one focal length, "
                         f"as Lensfun names them{f', such as {similar}' if similar else ''}")
    return min(found, key=lambda each: each.lens.crop_factor)


def fixed_focal_lenses() -> list[Photographed]:
    """All lenses in the database with one focal length.

    Raises
    ------
    InputError
        lensfunpy is not installed.
    """
    return [Photographed(lens, _name(lens)) for lens in _lensfunpy().Database(load_common=False).lenses
            if lens.min_focal == lens.max_focal]


def _name(lens):
    return lens.model if lens.model.casefold().startswith(lens.maker.casefold()) else f"{lens.maker} {lens.model}"


def _lensfunpy():
    try:
        import lensfunpy
    except ImportError:
        raise InputError("lensfun", "lensfunpy", "missing", "install it, with Lensfun's data: pip install lensfunpy"
                         ) from None
    return lensfunpy


def vignetting_of(photographed: Photographed, prescription: Prescription) -> list[Vignetting]:
    """The light of even fields at the f-stops and distances of a lens's photographs.

    Distances that differ in name alone are one, and those closer than the lens focuses are left out. Lensfun counts
    them from the sensor.

    Raises
    ------
    LensError
        Lensfun has no vignetting of this lens.
    """
    settings = {(each.aperture, each.distance) for each in photographed.lens.calib_vignetting}
    if not settings:
        raise LensError(prescription.name, "vignetting", "missing", f"Lensfun has none of {photographed.name}")
    length_mm = _pupil_to_sensor_mm(prescription)
    closest_mm = ring_ends(prescription)[1].focus_mm or 0.0
    curves: dict[tuple, Vignetting] = {}
    for f_number, distance_m in sorted(settings, key=lambda each: (each[0], -each[1])):
        focus_mm = np.inf if distance_m >= FAR_M else distance_m * MM_PER_M - length_mm
        light = light_at(photographed, f_number, distance_m)
        if focus_mm >= closest_mm:
            curves.setdefault((f_number, light.tobytes()), Vignetting(
                round(float(f_number), 2), float(focus_mm), SHARES * photographed.half_diagonal_mm, light))
    return list(curves.values())


def _pupil_to_sensor_mm(prescription):
    """From the entrance pupil to the sensor, focused at infinity."""
    system = system_of(turned(prescription, ring_ends(prescription)[0]).prescription)
    return sum(surface.thickness_mm for surface in system.prescription.surfaces) - system.entrance_pupil_mm


def light_at(photographed: Photographed, f_number: float, distance_m: float) -> np.ndarray:
    """The light at `SHARES` relative to the axis: the inverse of Lensfun's correction of an even picture."""
    modifier = _modifier(photographed, f_number, distance_m)
    picture = np.ones((PICTURE_PX[1], PICTURE_PX[0], 3), np.float32)
    modifier.apply_color_modification(picture)
    x_px, y_px = (_diagonal_px(side) for side in PICTURE_PX)
    return 1 / picture[y_px, x_px, 1].astype(float)


def _diagonal_px(side_px):
    """Pixels at `SHARES` of the way from the middle to a corner."""
    return np.round((1 + SHARES) * (side_px - 1) / 2).astype(int)


def _modifier(photographed, f_number=0.0, distance_m=1000.0):
    lens = photographed.lens
    modifier = _lensfunpy().Modifier(lens, lens.crop_factor, *PICTURE_PX)
    modifier.initialize(lens.min_focal, f_number, distance_m, scale=1.0, pixel_format=np.float32)
    return modifier


def straight_and_real_mm(photographed: Photographed) -> tuple[np.ndarray, np.ndarray] | None:
    """Distances from the axis without and with distortion, along the diagonal up to 0.95 of it; None if Lensfun has no
    distortion of the lens."""
    if not photographed.lens.calib_distortion:
        return None
    places = _modifier(photographed).apply_geometry_distortion()
    x_px, y_px = (_diagonal_px(side) for side in PICTURE_PX)
    straight = np.stack([x_px, y_px], axis=-1).astype(float)
    return _distance_mm(photographed, straight), _distance_mm(photographed, places[y_px, x_px])


def channel_heights_mm(photographed: Photographed) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Distances from the axis at which red, green and blue meet the sensor, for `SHARES` of the diagonal; None if
    Lensfun has no lateral colour of the lens."""
    if not photographed.lens.calib_tca:
        return None
    places = _modifier(photographed).apply_subpixel_distortion()
    x_px, y_px = (_diagonal_px(side) for side in PICTURE_PX)
    radii = _distance_mm(photographed, places[y_px, x_px])
    return radii[:, 0], radii[:, 1], radii[:, 2]


def _distance_mm(photographed, places_px):
    """Distances of places (..., 2), x and y in pixels, from the middle of the picture."""
    middle = (np.array(PICTURE_PX) - 1) / 2
    pitch_mm = 2 * photographed.half_diagonal_mm / np.hypot(*np.array(PICTURE_PX) - 1)
    return np.hypot(*np.moveaxis(places_px - middle, -1, 0)) * pitch_mm
