"""Prescription: what a lens is made of, as one frozen value, whatever file it came from."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from ..errors import LensError
from .glasses import LARGEST_INDEX, Glass

APERTURES = ("stop", "entrance_pupil_diameter_mm", "f_number", "working_f_number", "object_na")
FIELDS = ("angle_deg", "image_height_mm", "object_height_mm")
FOCUSES = ("as given", "paraxial", "best", "field")
HIGHEST_F_NUMBER = 22.0  # of an f-stop ring of which nothing is told
CLOSEST_FOCUS = 10  # focal lengths, of a focus ring of which nothing is told
LEAST_F_NUMBER = 0.5  # light comes from no more than a half space


@dataclass(frozen=True)
class Surface:
    """One surface of revolution, and what follows it.

    Attributes
    ----------
    radius_mm : float
        Radius of curvature, positive where the centre lies towards the image; inf for a plane.
    thickness_mm : float
        Axial distance to the next surface, or to the image plane.
    gaps_mm : tuple of float
        The same at each of `Prescription.focused_at_mm`, where it changes for focusing; () where it does not.
    glass : str
        What follows: "" for air, one of `Prescription.glasses`, a catalogue glass ("N-BK7", "SCHOTT N-BK7"), or "n/V",
        its index and Abbe number.
    semi_aperture_mm : float
        Light farther from the axis is stopped; inf where nothing is known.
    conic : float
    aspheric : tuple of float
        Coefficients of r^2, r^4, r^6 ... in mm.
    stop : bool
        Whether it is the aperture stop.
    odd_aspheric : tuple of float
        Coefficients of r, r^3, r^5 ... in mm.
    glass_figures : str
        "n/V" that a file tells beside the glass's name, for one that no catalogue has; "" where it tells none.
    """

    radius_mm: float = np.inf
    thickness_mm: float = 0.0
    glass: str = ""
    semi_aperture_mm: float = np.inf
    conic: float = 0.0
    aspheric: tuple[float, ...] = ()
    stop: bool = False
    odd_aspheric: tuple[float, ...] = ()
    glass_figures: str = ""
    gaps_mm: tuple[float, ...] = ()

    def scaled(self, factor: float) -> Self:
        """The surface of a lens `factor` times as large."""
        return replace(self, radius_mm=self.radius_mm * factor, thickness_mm=self.thickness_mm * factor,
                       gaps_mm=tuple(gap * factor for gap in self.gaps_mm),
                       semi_aperture_mm=self.semi_aperture_mm * factor,
                       aspheric=tuple(a * factor ** (1 - 2 * n) for n, a in enumerate(self.aspheric, 1)),
                       odd_aspheric=tuple(a * factor ** (-2 * n) for n, a in enumerate(self.odd_aspheric)))


@dataclass(frozen=True)
class Prescription:
    """A rotationally symmetric lens of refracting surfaces.

    Attributes
    ----------
    name, maker, story, source, notes : str
        As `Lens` has them.
    title : str
        What it is called where people choose a lens.
    year : int or None
        Of its design.
    character : tuple of str
        What it does to a picture, in words to search by.
    surfaces : tuple of Surface
        From the first to the last before the image plane.
    glasses : tuple of Glass
        Of its own, that surfaces name before those of catalogues.
    object_distance_mm : float
        From the object plane to the first surface; inf for a lens focused at infinity.
    focused_at_mm : tuple of float
        Object distances from the first surface, descending, for which surfaces have `gaps_mm`; () where all of the
        lens moves for focusing.
    closest_focus_mm : float or None
        The least object distance from the first surface; None where nothing is told of it.
    aperture : (str, float)
        Which figure sets the size of the stop, one of `APERTURES`, and its value: "stop" with the stop's
        semi-aperture in mm. It is the widest that the lens has.
    highest_f_number : float
        How far it can be stopped down.
    field : (str, float)
        Which figure ends the field, one of `FIELDS`, and its value; the image height is a paraxial one.
    focal_length_mm : float or None
        The nominal one; None where nothing is told of it.
    sensor_mm : (float, float) or None
        Width and height of the sensor it is made for; None for the 4:3 rectangle that fills the field.
    reference_wavelength_nm : float
    focus : str
        Where the image plane lies: "as given" behind the last surface, at the "paraxial" focus, where the axis is
        sharpest ("best": highest mean MTF there at 20 and 30 line pairs a mm of full frame, in eye-weighted white), or
        where the light of the inner 70 % of the "field" is most concentrated (least mean square spot).
    """

    name: str
    surfaces: tuple[Surface, ...]
    aperture: tuple[str, float]
    field: tuple[str, float]
    object_distance_mm: float = np.inf
    sensor_mm: tuple[float, float] | None = None
    reference_wavelength_nm: float = 587.5618
    focus: str = "as given"
    maker: str = ""
    story: str = ""
    source: str = ""
    notes: str = ""
    title: str = ""
    year: int | None = None
    character: tuple[str, ...] = ()
    focal_length_mm: float | None = None
    focused_at_mm: tuple[float, ...] = ()
    closest_focus_mm: float | None = None
    highest_f_number: float = HIGHEST_F_NUMBER
    glasses: tuple[Glass, ...] = ()

    def __post_init__(self):
        _check(self)

    @property
    def stop_index(self) -> int:
        """Which of the surfaces is the stop."""
        return [surface.stop for surface in self.surfaces].index(True)

    def scaled(self, factor: float) -> Self:
        """A lens `factor` times as large, of the same f-number, angles and object distance.

        What is told of its focus ring scales with it, and so does its nominal focal length.
        """
        kind, value = self.aperture
        lengths = ("stop", "entrance_pupil_diameter_mm")
        field_kind, field = self.field
        return replace(self, surfaces=tuple(surface.scaled(factor) for surface in self.surfaces),
                       aperture=(kind, value * factor if kind in lengths else value),
                       field=(field_kind, field * factor if field_kind == "image_height_mm" else field),
                       focused_at_mm=tuple(distance * factor for distance in self.focused_at_mm),
                       closest_focus_mm=self.closest_focus_mm and self.closest_focus_mm * factor,
                       focal_length_mm=self.focal_length_mm and self.focal_length_mm * factor)

    def with_glasses(self, names: Mapping[str, str]) -> Self:
        """The same lens with glasses called otherwise: `names` maps those of this prescription to others."""
        return replace(self, surfaces=tuple(replace(surface, glass=names.get(surface.glass, surface.glass))
                                            for surface in self.surfaces))


def _check(prescription):
    """Raise a LensError that names the first figure that cannot be right."""
    def refuse(field, value, remedy):
        raise LensError(prescription.name or "prescription", field, value, remedy)

    if not prescription.surfaces:
        refuse("surfaces", "empty", "expected at least one")
    stops = sum(surface.stop for surface in prescription.surfaces)
    if stops != 1:
        refuse("stop", f"at {stops} surfaces", "expected one surface to be the aperture stop")
    for number, surface in enumerate(prescription.surfaces, 1):
        _check_surface(surface, f"surface {number}", refuse)
        if surface.gaps_mm and len(surface.gaps_mm) != len(prescription.focused_at_mm):
            refuse(f"surface {number}, gaps", f"{len(surface.gaps_mm)} numbers",
                   f"expected one for each of focused_at_mm, {len(prescription.focused_at_mm)}")
    _check_rings(prescription, refuse)
    _check_image_space(prescription, f"surface {len(prescription.surfaces)}", refuse)
    _check_aperture_and_field(prescription, refuse)
    if not prescription.object_distance_mm > 0:
        refuse("object_distance_mm", prescription.object_distance_mm, "expected a positive number, or inf")
    if prescription.sensor_mm and not all(0 < side < np.inf for side in prescription.sensor_mm):
        refuse("sensor_mm", prescription.sensor_mm, "expected a positive width and height")
    if prescription.focus not in FOCUSES:
        refuse("focus", prescription.focus, f"expected one of {', '.join(FOCUSES)}")
    if not 100 < prescription.reference_wavelength_nm < 1e5:
        refuse("reference_wavelength_nm", prescription.reference_wavelength_nm, "expected nanometres")
    for glass in prescription.glasses:
        index, = glass.index_at([prescription.reference_wavelength_nm])
        if not 1 < index < LARGEST_INDEX:
            refuse(f"glass {glass.name}", f"of index {index:.4g} at {prescription.reference_wavelength_nm:g} nm",
                   f"expected 1 to {LARGEST_INDEX:g}: its coefficients take micrometres, its range nanometres")


def _check_aperture_and_field(prescription, refuse):
    for field, kinds in (("aperture", APERTURES), ("field", FIELDS)):
        kind, value = getattr(prescription, field)
        if kind not in kinds:
            refuse(field, kind, f"expected one of {', '.join(kinds)}")
        if not (np.isfinite(value) and value > 0):
            refuse(f"{field}, {kind}", value, "expected a positive number")
        if kind == "angle_deg" and value >= 90:
            refuse("field, angle_deg", value, "expected less than 90: no plane image holds more")
        if kind.endswith("f_number") and value < LEAST_F_NUMBER:
            refuse(f"aperture, {kind}", value, f"no lens in air is below {LEAST_F_NUMBER}")
        if kind == "object_na" and value >= 1:
            refuse("aperture, object_na", value, "expected less than 1: the object is in air")
        if kind in ("object_na", "object_height_mm") and np.isinf(prescription.object_distance_mm):
            refuse(field, kind, "an object at infinity has none: give another of " + ", ".join(kinds))


def _check_rings(prescription, refuse):
    """What is told of focus and f-stop rings, and of the lens's name."""
    positions = prescription.focused_at_mm
    if positions and (np.any(np.diff(positions) >= 0) or not positions[-1] > 0):
        refuse("focused_at_mm", positions, "expected positive distances, the farthest first")
    if positions and not any(surface.gaps_mm for surface in prescription.surfaces):
        refuse("focused_at_mm", positions, "no surface has a thickness for each of these: expected one at least")
    for name in ("closest_focus_mm", "focal_length_mm"):
        value = getattr(prescription, name)
        if value is not None and not 0 < value < np.inf:
            refuse(name, value, "expected a positive number")
    if not LEAST_F_NUMBER <= prescription.highest_f_number < np.inf:
        refuse("highest_f_number", prescription.highest_f_number, f"expected at least {LEAST_F_NUMBER}")


def _check_image_space(prescription, last, refuse):
    """The image plane lies in air, and not within the lens."""
    *before, surface = prescription.surfaces
    if surface.glass:
        refuse(f"{last}, glass", surface.glass, "expected air before the image plane")
    behind_mm = surface.thickness_mm
    for other in reversed(before):
        if other.glass:
            break
        behind_mm += other.thickness_mm
    if prescription.focus == "as given" and not behind_mm > 0:
        refuse(f"{last}, thickness_mm", f"{surface.thickness_mm:.6g}",
               "expected an image plane behind the lens: give its distance, or best or paraxial as the focus")


def _check_surface(surface, name, refuse):
    if surface.radius_mm == 0 or np.isnan(surface.radius_mm):
        refuse(f"{name}, radius_mm", surface.radius_mm, "expected a radius, or inf for a plane")
    if not np.all(np.isfinite((surface.thickness_mm, *surface.gaps_mm))):
        refuse(f"{name}, thickness_mm", surface.gaps_mm or surface.thickness_mm, "expected a number")
    if not surface.semi_aperture_mm > 0:
        refuse(f"{name}, semi_aperture_mm", surface.semi_aperture_mm, "expected a positive number")
    shape = (surface.conic, *surface.aspheric, *surface.odd_aspheric)
    if not np.all(np.isfinite(shape)):
        refuse(f"{name}, aspheric", shape, "expected numbers")
