"""Prescription: the design of a lens as one frozen value, independent of the file format."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from pathlib import Path
from typing import Self

import numpy as np

from ..runtime.errors import LensError
from .coatings import BUILT_IN, IDEAL, NONE, Coating
from .glasses import LARGEST_INDEX, Glass
from .photographs import Agreement

APERTURES = ("stop", "entrance_pupil_diameter_mm", "f_number", "working_f_number", "object_na")
FIELDS = ("angle_deg", "image_height_mm", "object_height_mm")
FOCUSES = ("as given", "paraxial", "best", "field")
PARTS = ("figures", "surfaces", "aspheres", "glasses", "stop", "apertures", "coatings")
"""Parts of a design; "figures" are all that are not listed."""
ESTIMATED, GUESSED, FITTED, TYPICAL = ("estimated", "guessed", "fitted to photographs",
                                       "typical of photographed lenses")
ORIGINS = ("patent", "published", ESTIMATED, GUESSED, FITTED, TYPICAL)
HIGHEST_F_NUMBER = 22.0  # default of the aperture ring
CLOSEST_FOCUS = 10  # default of the focus ring, in focal lengths
LEAST_MM, LARGEST_MM = 1e-6, 1e12  # lengths: squares outside this range lose digits
ALUMINIUM = 0.9  # reflectance of a mirror that states none: protected aluminium in the visible, 0.85 to 0.92
POSE_DIGITS = 10  # after the decimal point, of lengths and degrees: the rest is rounding
LEAST_F_NUMBER = 0.5  # light from a half space
MOST_SURFACES, MOST_TERMS = 300, 100  # several times as many as in any lens: more is damage, and takes minutes


@dataclass(frozen=True)
class Pose:
    """Displacement of a surface, or of the image plane, from its place on the axis.

    It is turned about its vertex, and then moved; the surfaces behind it stay in place.

    Attributes
    ----------
    offset_mm : (float, float, float)
        Along x, y and z.
    tilt_deg : (float, float, float)
        Turns about x, then y, then z, axes that stay fixed: right-handed, so that a positive turn about x moves +y
        towards +z, along the light.
    """

    offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @classmethod
    def of(cls, offset_mm: np.ndarray, rotation: np.ndarray) -> Self:
        """The pose with this offset and this `rotation`, without digits that are rounding."""
        turns = (np.arctan2(rotation[2, 1], rotation[2, 2]), -np.arcsin(np.clip(rotation[2, 0], -1, 1)),
                 np.arctan2(rotation[1, 0], rotation[0, 0]))
        (x, y, z), (about_x, about_y, about_z) = ((round(float(value), POSE_DIGITS) + 0.0 for value in values)
                                                  for values in (offset_mm, np.degrees(turns)))
        return cls((x, y, z), (about_x, about_y, about_z))

    @property
    def rotation(self) -> np.ndarray:
        """Matrix (3, 3) of the tilt: from directions in the axes of the surface to the axes of the lens."""
        turns = []
        for axis, angle in enumerate(np.radians(self.tilt_deg)):
            (first, second), turn = [(1, 2), (2, 0), (0, 1)][axis], np.eye(3)
            turn[[first, second], [first, second]] = np.cos(angle)
            turn[second, first], turn[first, second] = np.sin(angle), -np.sin(angle)
            turns.append(turn)
        about_x, about_y, about_z = turns
        return about_z @ about_y @ about_x

    def scaled(self, factor: float) -> Self:
        """The displacement in a lens `factor` times as large."""
        x, y, z = self.offset_mm
        return replace(self, offset_mm=(factor * x, factor * y, factor * z))


@dataclass(frozen=True)
class Surface:
    """A surface, and the medium behind it: a surface of revolution, unless `radius_x_mm` is given.

    With `radius_x_mm`, its sections along x and y differ. It is biconic, or with `profile` a toroid: the profile, along
    x or y, has this section's radius, conic and aspheric terms, and is turned about an axis parallel to it, at the
    distance of the other section's radius. A cylinder is a surface with one infinite radius.

    Attributes
    ----------
    radius_mm : float
        Radius of curvature, positive if the centre is on the image side; inf for a plane.
    thickness_mm : float
        Axial distance to the next surface, or to the image plane.
    gaps_mm : tuple of float
        Thickness at each of `Prescription.focused_at_mm` if it varies with focus, otherwise ().
    radius_x_mm : float or None
        Radius of curvature of the section along x, with `conic_x`; `radius_mm` and `conic` are then those along y.
    conic_x : float
    profile : str
        "x" or "y" for a toroid with its profile along this axis, "" for a biconic surface.
    skews : tuple of float
        For each of `aspheric` of a biconic surface, the p of an anamorphic asphere: r^2 is replaced by
        (1 - p) x^2 + (1 + p) y^2. () for zeros.
    pose : Pose or None
        Its displacement from the axis.
    coating : str
        One of `Prescription.coatings` or `BUILT_IN`; "" for the coating of the lens.
    mirror : bool
        Whether it reflects: the light stays in its medium, which `glass` names again. Up to the next mirror, light
        travels backwards, and thicknesses are negative. Radii keep their sign.
    reflectance : float
        Share of the light that a mirror reflects, at all wavelengths and angles.
    semi_obstruction_mm : float
        Light nearer to the axis is blocked: by the back of a smaller mirror in front, or at a mirror's hole. 0 without
        a central obstruction.
    glass : str
        Medium behind: "" for air, one of `Prescription.glasses`, a catalogue glass ("N-BK7", "SCHOTT N-BK7"), or
        "n/V", its index and Abbe number.
    semi_aperture_mm : float
        Light farther from the axis is blocked; inf if unknown.
    half_widths_mm : (float, float) or ()
        Half-widths along x and y of a rectangular aperture: light beyond them is blocked as well, at the stop, too. ()
        without one.
    conic : float
    aspheric : tuple of float
        Coefficients of r^2, r^4, r^6 ... in mm; of the coordinate along the profile, for a toroid.
    stop : bool
        Whether it is the aperture stop.
    odd_aspheric : tuple of float
        Coefficients of r, r^3, r^5 ... in mm.
    glass_figures : str
        "n/V" next to the glass's name in the file, in case it is not in any catalogue; "" without one.
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
    radius_x_mm: float | None = None
    conic_x: float = 0.0
    profile: str = ""
    skews: tuple[float, ...] = ()
    pose: Pose | None = None
    coating: str = ""
    mirror: bool = False
    reflectance: float = ALUMINIUM
    semi_obstruction_mm: float = 0.0
    half_widths_mm: tuple[float, ...] = ()

    @property
    def rolls(self) -> bool:
        """Whether turns about its own axis leave it as it is."""
        return self.radius_x_mm is None and not self.half_widths_mm

    @property
    def of_revolution(self) -> bool:
        """Whether it is rotationally symmetric about the axis of the lens."""
        return self.rolls and self.pose is None

    def scaled(self, factor: float) -> Self:
        """The surface of a lens `factor` times as large."""
        return replace(self, radius_mm=self.radius_mm * factor, thickness_mm=self.thickness_mm * factor,
                       gaps_mm=tuple(gap * factor for gap in self.gaps_mm),
                       semi_aperture_mm=self.semi_aperture_mm * factor,
                       semi_obstruction_mm=self.semi_obstruction_mm * factor,
                       half_widths_mm=tuple(half * factor for half in self.half_widths_mm),
                       radius_x_mm=self.radius_x_mm and self.radius_x_mm * factor,
                       pose=self.pose and self.pose.scaled(factor),
                       aspheric=tuple(a * factor ** (1 - 2 * n) for n, a in enumerate(self.aspheric, 1)),
                       odd_aspheric=tuple(a * factor ** (-2 * n) for n, a in enumerate(self.odd_aspheric)))


@dataclass(frozen=True)
class Prescription:
    """A lens of refracting surfaces and mirrors.

    Attributes
    ----------
    name, maker, story, source, notes : str
        As in `Lens`.
    title : str
        Name in lists of lenses.
    year : int or None
        Year of its patent, or of its introduction if that is certain.
    character : tuple of str
        Search words for its effect on a picture.
    surfaces : tuple of Surface
        From the first to the last in front of the image plane.
    glasses : tuple of Glass
        Private glasses, which take precedence over catalogues.
    object_distance_mm : float
        From the object plane to the first surface; inf for a lens focused at infinity.
    focused_at_mm : tuple of float
        Object distances from the first surface, descending, for which surfaces have `gaps_mm`; () if the lens moves as
        a unit to focus.
    closest_focus_mm : float or None
        The least object distance from the first surface; None if unknown.
    aperture : (str, float)
        Quantity that sets the size of the stop, one of `APERTURES`, and its value: "stop" with the stop's
        semi-aperture in mm. It is the lens's widest aperture, except with `widest_stop_mm`.
    widest_stop_mm : float or None
        Semi-aperture of the widest stop for a lens that is stopped down; None if `aperture` is the widest.
    highest_f_number : float
        Limit of stopping down; not used with a central obstruction, around which the f-number is fixed.
    field : (str, float)
        Quantity that ends the field, one of `FIELDS`, and its value; the image height is paraxial.
    focal_length_mm : float or None
        Nominal focal length; None if unknown.
    sensor_mm : (float, float) or None
        Width and height of the sensor it is designed for; None for the 4:3 rectangle that fills the field.
    reference_wavelength_nm : float
    focus : str
        Position of the image plane: "as given" behind the last surface, at the "paraxial" focus, sharpest on the axis
        ("best": highest mean MTF there at 20 and 30 line pairs per mm on full frame, in eye-weighted white), or least
        mean square spot over the inner 70 % of the "field". Without rotational symmetry, "paraxial" is the mean of both
        sections' foci, and "best" the least mean square spot in the middle of the picture, in eye-weighted white.
    image_pose : Pose or None
        Displacement of the image plane: a tilted sensor.
    coating : str
        Of surfaces between glass and air that state none; cemented surfaces are then bare. "" if unknown: surfaces that
        state none then count as ideal.
    coatings : tuple of Coating
        Private coatings.
    provenance : tuple of (str, str)
        Parts of the design, of `PARTS`, and the origin of their figures, of `ORIGINS`: typed from a patent, published
        elsewhere (by the maker or in a book), estimated from other figures or drawings, guessed, fitted to photographs,
        or typical of photographed lenses. () if unknown. Lenses that differ only in it are equal, and share a bake.
    photographs : Agreement or None
        How closely the lens agrees with photographs; None if it was not compared. Does not count for equality either.
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
    widest_stop_mm: float | None = None
    image_pose: Pose | None = None
    coating: str = ""
    coatings: tuple[Coating, ...] = ()
    provenance: tuple[tuple[str, str], ...] = dataclass_field(default=(), compare=False)
    photographs: Agreement | None = dataclass_field(default=None, compare=False)

    def __post_init__(self):
        _check(self)

    @property
    def radial(self) -> bool:
        """Whether the lens is rotationally symmetric."""
        return self.image_pose is None and all(surface.of_revolution for surface in self.surfaces)

    def require_radial(self, what: str) -> None:
        """Check that the lens is rotationally symmetric, for `what` is about to be done with it.

        Raises
        ------
        LensError
            The first surface that is not of revolution about the axis of the lens, or a displaced image plane.
        """
        if self.radial:
            return
        crooked = [number for number, surface in enumerate(self.surfaces, 1) if not surface.of_revolution]
        raise LensError(self.name, f"surface {crooked[0]}" if crooked else "image_pose", "not rotationally symmetric",
                        f"{what} needs surfaces of revolution about the axis")

    @property
    def surface_coatings(self) -> tuple[str, ...]:
        """Name of the coating of each surface, with the lens's where it states none; ideal between equal media."""
        fronts = ("", *(surface.glass for surface in self.surfaces))
        return tuple(_coating_between(front, surface, self.coating)
                     for front, surface in zip(fronts, self.surfaces, strict=False))

    @property
    def coatings_in_air(self) -> tuple[str, ...]:
        """Names of the coatings of surfaces between glass and air, in their order; "" for unknown ones."""
        fronts = ("", *(surface.glass for surface in self.surfaces))
        return tuple(surface.coating or self.coating for front, surface in zip(fronts, self.surfaces, strict=False)
                     if front != surface.glass and "" in (front, surface.glass))

    @property
    def rectangles(self) -> tuple[int, ...]:
        """Indices of the surfaces with rectangular apertures."""
        return tuple(index for index, surface in enumerate(self.surfaces) if surface.half_widths_mm)

    @property
    def mirrors(self) -> tuple[int, ...]:
        """Indices of the mirrors among the surfaces."""
        return tuple(index for index, surface in enumerate(self.surfaces) if surface.mirror)

    @property
    def stop_index(self) -> int:
        """Index of the stop among the surfaces."""
        return [surface.stop for surface in self.surfaces].index(True)

    @property
    def stop_rim(self) -> float:
        """Semi-aperture of the widest stop over the current semi-aperture."""
        kind, value = self.aperture
        return self.widest_stop_mm / value if self.widest_stop_mm and kind == "stop" else 1.0

    @property
    def passport(self) -> str:
        """The provenance as text, such as "patent; apertures estimated"."""
        return "; ".join(origin if part == "figures" else f"{part} {origin}" for part, origin in self.provenance)

    @property
    def aperture_origin(self) -> str:
        """The origin of the sizes of the apertures, of `ORIGINS`; "" if unknown."""
        origins = dict(self.provenance)
        return origins.get("apertures", origins.get("figures", ""))

    def scaled(self, factor: float) -> Self:
        """A lens `factor` times as large, with the same f-number, angles and object distance.

        Its focus ring's range and its nominal focal length are scaled, too.
        """
        kind, value = self.aperture
        lengths = ("stop", "entrance_pupil_diameter_mm")
        field_kind, field = self.field
        return replace(self, surfaces=tuple(surface.scaled(factor) for surface in self.surfaces),
                       aperture=(kind, value * factor if kind in lengths else value),
                       field=(field_kind, field * factor if field_kind == "image_height_mm" else field),
                       focused_at_mm=tuple(distance * factor for distance in self.focused_at_mm),
                       closest_focus_mm=self.closest_focus_mm and self.closest_focus_mm * factor,
                       focal_length_mm=self.focal_length_mm and self.focal_length_mm * factor,
                       widest_stop_mm=self.widest_stop_mm and self.widest_stop_mm * factor,
                       image_pose=self.image_pose and self.image_pose.scaled(factor))

    def centred(self) -> Self:
        """The lens without displacements of its surfaces and of the image plane, except turns about the axis."""
        if self.image_pose is None and all(surface.pose is None for surface in self.surfaces):
            return self
        surfaces = (surface if surface.pose is None else
                    replace(surface, pose=Pose(tilt_deg=(0.0, 0.0, surface.pose.tilt_deg[2])))
                    for surface in self.surfaces)
        return replace(self, surfaces=tuple(surfaces), image_pose=None)

    def coated(self, name: str = "") -> Self:
        """The same lens with this built-in coating on all surfaces between glass and air; "" for unknown coatings."""
        surfaces = tuple(replace(surface, coating="") if surface.coating else surface for surface in self.surfaces)
        return replace(self, surfaces=surfaces, coating=name, coatings=())

    def with_glasses(self, names: Mapping[str, str]) -> Self:
        """The same lens with renamed glasses: `names` maps old names to new ones."""
        return replace(self, surfaces=tuple(replace(surface, glass=names.get(surface.glass, surface.glass))
                                            for surface in self.surfaces))


def _coating_between(front, surface, of_lens):
    """Name of the coating of a surface behind the glass `front`."""
    if front == surface.glass:
        return IDEAL
    if surface.coating or not of_lens:
        return surface.coating or IDEAL
    cemented = front and surface.glass
    return NONE if cemented and of_lens != IDEAL else of_lens


def check_surface_count(place: str | Path, number: int) -> None:
    """Raise a LensError for more surfaces than any lens has, before a loop over them takes time."""
    if number > MOST_SURFACES:
        raise LensError(place, "surfaces", number, f"expected at most {MOST_SURFACES}")


def _check(prescription):
    """Raise a LensError for the first invalid value."""
    def refuse(field, value, remedy):
        raise LensError(prescription.name or "prescription", field, value, remedy)

    if not prescription.surfaces:
        refuse("surfaces", "empty", "expected at least one")
    check_surface_count(prescription.name or "prescription", len(prescription.surfaces))
    stops = sum(surface.stop for surface in prescription.surfaces)
    if stops != 1:
        refuse("stop", f"at {stops} surfaces", "expected one surface to be the aperture stop: give its number (--stop)")
    for number, surface in enumerate(prescription.surfaces, 1):
        _check_surface(surface, f"surface {number}", refuse)
        if surface.gaps_mm and len(surface.gaps_mm) != len(prescription.focused_at_mm):
            refuse(f"surface {number}, gaps", f"{len(surface.gaps_mm)} numbers",
                   f"expected one for each of focused_at_mm, {len(prescription.focused_at_mm)}")
    _check_mirrors(prescription, refuse)
    _check_rings(prescription, refuse)
    _check_image_space(prescription, f"surface {len(prescription.surfaces)}", refuse)
    _check_aperture_and_field(prescription, refuse)
    _check_pose(prescription.image_pose, "image_pose", refuse)
    if not prescription.object_distance_mm > 0:
        refuse("object_distance_mm", prescription.object_distance_mm, "expected a positive number, or inf")
    if prescription.sensor_mm and not all(0 < side < np.inf for side in prescription.sensor_mm):
        refuse("sensor_mm", prescription.sensor_mm, "expected a positive width and height")
    if prescription.year is not None and not 0 < prescription.year < 10000:
        refuse("year", prescription.year, "expected a whole number, of four digits at most")
    if prescription.focus not in FOCUSES:
        refuse("focus", prescription.focus, f"expected one of {', '.join(FOCUSES)}")
    if not 100 < prescription.reference_wavelength_nm < 1e5:
        refuse("reference_wavelength_nm", prescription.reference_wavelength_nm, "expected nanometres")
    _check_coatings(prescription, refuse)
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
            refuse("field, angle_deg", value, "expected less than 90: a plane image cannot cover more")
        if kind.endswith("f_number") and value < LEAST_F_NUMBER:
            refuse(f"aperture, {kind}", value, f"no lens in air is below {LEAST_F_NUMBER}")
        if kind == "object_na" and value >= 1:
            refuse("aperture, object_na", value, "expected less than 1: the object is in air")
        if kind in ("object_na", "object_height_mm") and np.isinf(prescription.object_distance_mm):
            refuse(field, kind, "undefined for an object at infinity: give another of " + ", ".join(kinds))


def _check_coatings(prescription, refuse):
    """Check that each name is one of the private coatings or a built-in one, and not both."""
    private = [coating.name for coating in prescription.coatings]
    for name in private:
        if name in BUILT_IN or private.count(name) > 1:
            refuse("coatings", name, f"expected a name of its own, and none of {', '.join(BUILT_IN)}")
    names = ("coating", prescription.coating), *((f"surface {number}, coating", surface.coating)
                                                 for number, surface in enumerate(prescription.surfaces, 1))
    for field, name in names:
        if name and name not in BUILT_IN and name not in private:
            refuse(field, name, f"expected one of {', '.join((*private, *BUILT_IN))}")


def _check_mirrors(prescription, refuse):
    """Check that the light stays in its medium at each mirror, and that mirrors leave the picture unmirrored."""
    media = ("", *(surface.glass for surface in prescription.surfaces))
    for index in prescription.mirrors:
        surface, name = prescription.surfaces[index], f"surface {index + 1}"
        if surface.glass != media[index]:
            refuse(f"{name}, glass", surface.glass or "air", f"expected {media[index] or 'air'}, the medium in front "
                                                             "of the mirror, which also is behind it")
        if surface.coating:
            refuse(f"{name}, coating", surface.coating, "expected the mirror's reflectance instead")
        if not 0 < surface.reflectance <= 1:
            refuse(f"{name}, reflectance", surface.reflectance, "expected more than 0, and at most 1")
    if len(prescription.mirrors) % 2:
        refuse("mirrors", len(prescription.mirrors), "expected an even number: otherwise, the picture is mirrored, and "
                                                     "its sensor faces away from the scene")
    for first, second in zip(prescription.mirrors[::2], prescription.mirrors[1::2], strict=True):
        back_mm = sum(surface.thickness_mm for surface in prescription.surfaces[first:second])
        if not back_mm < 0:
            refuse(f"surface {first + 1}, thickness_mm", f"{back_mm:g} in total up to the mirror, surface {second + 1}",
                   "expected a negative distance: light travels back between these mirrors")


def _check_rings(prescription, refuse):
    """Check the focus and aperture rings, and the nominal focal length."""
    positions = prescription.focused_at_mm
    if positions and (np.any(np.diff(positions) >= 0) or not positions[-1] > 0):
        refuse("focused_at_mm", positions, "expected positive distances, the farthest first")
    if positions and not any(surface.gaps_mm for surface in prescription.surfaces):
        refuse("focused_at_mm", positions, "no surface has a thickness for each of these: expected at least one")
    for name in ("closest_focus_mm", "focal_length_mm", "widest_stop_mm"):
        value = getattr(prescription, name)
        if value is not None and not 0 < value < np.inf:
            refuse(name, value, "expected a positive number")
    if not LEAST_F_NUMBER <= prescription.highest_f_number < np.inf:
        refuse("highest_f_number", prescription.highest_f_number, f"expected at least {LEAST_F_NUMBER}")


def _check_image_space(prescription, last, refuse):
    """Check that the image plane is in air, and not within the lens."""
    *before, surface = prescription.surfaces
    if surface.glass:
        refuse(f"{last}, glass", surface.glass, "expected air before the image plane")
    behind_mm = surface.thickness_mm
    for other, behind in zip(reversed(before), reversed(prescription.surfaces), strict=False):
        if other.glass or behind.mirror:
            break
        behind_mm += other.thickness_mm
    if prescription.focus == "as given" and not behind_mm > 0:
        refuse(f"{last}, thickness_mm", f"{surface.thickness_mm:.6g}",
               "expected an image plane behind the lens: give its distance, or set focus (--image-plane) to best or "
               "paraxial")


def _check_surface(surface, name, refuse):
    if not abs(surface.radius_mm) >= LEAST_MM:
        refuse(f"{name}, radius_mm", surface.radius_mm, "expected a radius, or inf for a plane")
    if not np.all(np.abs((surface.thickness_mm, *surface.gaps_mm)) <= LARGEST_MM):
        refuse(f"{name}, thickness_mm", surface.gaps_mm or surface.thickness_mm,
               f"expected a number of at most {LARGEST_MM:g}")
    if not surface.semi_aperture_mm >= LEAST_MM:
        refuse(f"{name}, semi_aperture_mm", surface.semi_aperture_mm, "expected a positive number")
    halves_mm = surface.half_widths_mm
    if halves_mm and not (len(halves_mm) == 2 and all(LEAST_MM <= half <= LARGEST_MM for half in halves_mm)):
        refuse(f"{name}, half_widths_mm", halves_mm, "expected two positive numbers")
    if not 0 <= surface.semi_obstruction_mm < min(surface.semi_aperture_mm, LARGEST_MM):
        refuse(f"{name}, semi_obstruction_mm", surface.semi_obstruction_mm,
               f"expected 0, or less than the semi-aperture, {surface.semi_aperture_mm:g}")
    terms = len(surface.aspheric) + len(surface.odd_aspheric)
    if terms > MOST_TERMS:
        refuse(f"{name}, aspheric", f"{terms} terms", f"expected at most {MOST_TERMS}")
    shape = (surface.conic, *surface.aspheric, *surface.odd_aspheric)
    if not np.all(np.isfinite(shape)):
        refuse(f"{name}, aspheric", shape, "expected numbers")
    _check_sections(surface, name, refuse)
    _check_pose(surface.pose, f"{name}, pose", refuse)


def _check_sections(surface, name, refuse):
    """Check the section along x, and what only surfaces with it have."""
    if surface.radius_x_mm is None:
        for field in ("conic_x", "profile", "skews"):
            if getattr(surface, field):
                refuse(f"{name}, {field}", getattr(surface, field), "expected radius_x_mm, too")
        return
    if not abs(surface.radius_x_mm) >= LEAST_MM:
        refuse(f"{name}, radius_x_mm", surface.radius_x_mm, "expected a radius, or inf for a plane")
    if not np.isfinite(surface.conic_x):
        refuse(f"{name}, conic_x", surface.conic_x, "expected a number")
    if surface.profile not in ("", "x", "y"):
        refuse(f"{name}, profile", surface.profile, "expected x or y")
    if surface.odd_aspheric:
        refuse(f"{name}, odd_aspheric", surface.odd_aspheric, "expected even powers only, with radius_x_mm")
    if len(surface.skews) > len(surface.aspheric) or not np.all(np.isfinite(surface.skews)):
        refuse(f"{name}, skews", surface.skews, "expected a number for each of aspheric")
    if surface.profile and any(surface.skews):
        refuse(f"{name}, skews", surface.skews, "a toroid is not skewed: expected no profile")
    round_section = {"x": "conic", "y": "conic_x"}.get(surface.profile)
    if round_section and getattr(surface, round_section):
        refuse(f"{name}, {round_section}", getattr(surface, round_section),
               f"a toroid's section across its profile is a circle: expected 0 with profile {surface.profile}")


def _check_pose(pose, name, refuse):
    if pose is None:
        return
    if len(pose.offset_mm) != 3 or not np.all(np.abs(pose.offset_mm) <= LARGEST_MM):
        refuse(f"{name}, offset_mm", pose.offset_mm, f"expected three numbers of at most {LARGEST_MM:g}")
    if len(pose.tilt_deg) != 3 or not np.all(np.abs(pose.tilt_deg) < (90, 90, 360)):
        refuse(f"{name}, tilt_deg", pose.tilt_deg, "expected three angles: less than 90 about x and y, and 360 about z")
