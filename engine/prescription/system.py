"""A prescription prepared for tracing: glasses, stop, first-order figures, fields."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ..runtime.errors import LensError
from .coatings import BUILT_IN, Coating, on_glass, reflectance
from .glasses import Glass, find_glass
from .paraxial import FirstOrder, first_order
from .prescription import Prescription

MOST_SYSTEMS = 64  # in the cache
LEAST_HEIGHT_MM = 1e-12


@dataclass(frozen=True, eq=False)
class System(FirstOrder):
    """A lens ready to trace: prescription, glasses and first-order figures, of its section along y.

    Attributes
    ----------
    across : FirstOrder
        Figures of the section along x, for the same stop.
    prescription : Prescription
        Its aperture is the stop's size, its last thickness the distance to the image plane.
    glasses : tuple of Glass
        Behind each surface.
    last_height_mm : float
        Paraxial image height at the end of the field.
    """

    across: FirstOrder
    prescription: Prescription
    glasses: tuple[Glass, ...]
    last_height_mm: float

    @property
    def paraxial_focus_mm(self) -> float:
        """From the last surface to the image of the object: the mean of both sections."""
        return (self.image_distance_mm + self.across.image_distance_mm) / 2

    @property
    def squeeze(self) -> float:
        """Magnification of the section along y over the one along x, at this focus: 1 for a radial lens."""
        if self.object_at_infinity:
            return self.efl_mm / self.across.efl_mm
        return self.magnification / self.across.magnification

    @property
    def capture_focal_length_mm(self) -> float:
        """As in `Lens`."""
        if self.object_at_infinity:
            return self.efl_mm
        return abs(self.magnification) * (self.prescription.object_distance_mm + self.entrance_pupil_mm)

    @property
    def object_at_infinity(self) -> bool:
        """Whether fields are angles rather than heights."""
        return bool(np.isinf(self.prescription.object_distance_mm))

    @property
    def semi_apertures_mm(self) -> np.ndarray:
        """Semi-aperture of each surface: array, inf for unlimited ones and for the stop."""
        sizes = np.array([surface.semi_aperture_mm for surface in self.prescription.surfaces])
        sizes[self.prescription.stop_index] = np.inf
        return sizes

    @property
    def all_semi_apertures_mm(self) -> np.ndarray:
        """Semi-aperture of each surface, including the stop's: array (surface,), inf for unlimited ones."""
        sizes = self.semi_apertures_mm
        sizes[self.prescription.stop_index] = self.stop_semi_aperture_mm
        return sizes

    @property
    def half_widths_mm(self) -> np.ndarray:
        """Half-widths along x and y of the rectangular apertures: array (2 * rectangle,)."""
        return np.array([half for index in self.prescription.rectangles
                         for half in self.prescription.surfaces[index].half_widths_mm])

    @property
    def rim_surfaces(self) -> np.ndarray:
        """Index of the surface of each of `rims`: int array (limit,)."""
        return np.append(np.arange(len(self.glasses)), np.repeat(self.prescription.rectangles, 2)).astype(int)

    def rims(self, square_mm2: np.ndarray) -> np.ndarray:
        """Squared heights of rays over squared semi-apertures, and then squares of x and y over squared half-widths:
        array (limit, ...), up to 1 for rays that pass.

        Parameters
        ----------
        square_mm2 : array (square, ...)
            As `BothWays.square_mm2`.
        """
        square_mm2 = np.asarray(square_mm2)
        sizes_mm = np.append(self.semi_apertures_mm, self.half_widths_mm)
        return square_mm2 / np.reshape(sizes_mm**2, (-1, *(1,) * (square_mm2.ndim - 1)))

    @property
    def central_obstruction(self) -> float:
        """Diameter of the hole in the pupil relative to the diameter of the pupil, on the axis and to first order; 0
        without one."""
        holes_mm = [surface.semi_obstruction_mm for surface in self.prescription.surfaces]
        return float(np.max(holes_mm / np.maximum(np.abs(self.marginal_heights_mm), LEAST_HEIGHT_MM)))

    def limits(self, square_mm2: np.ndarray) -> np.ndarray:
        """What blocks rays, except the stop: array (limit, ...) of smooth functions, up to 1 for rays that pass.

        The first are `rims`. The others, of central obstructions, fall with the height on the scale of the axial beam,
        and do not diverge.

        Parameters
        ----------
        square_mm2 : array (square, ...)
            As `BothWays.square_mm2`.
        """
        square_mm2 = np.asarray(square_mm2)
        over_places = (-1, *(1,) * (square_mm2.ndim - 1))
        holes_mm = np.array([surface.semi_obstruction_mm for surface in self.prescription.surfaces])
        number = np.flatnonzero(holes_mm)
        hole_mm2, beam_mm2 = (np.reshape(each[number]**2, over_places) for each in (holes_mm, self.marginal_heights_mm))
        return np.concatenate([self.rims(square_mm2), (hole_mm2 + beam_mm2) / (square_mm2[number] + beam_mm2)])

    @property
    def exit_pupil_distance_mm(self) -> float:
        """From the image plane to the exit pupil, positive along the light."""
        return self.exit_pupil_mm - self.prescription.surfaces[-1].thickness_mm

    def fields_of(self, heights_mm: Sequence[float] | np.ndarray) -> np.ndarray:
        """Fields of paraxial image heights: angles in radians, or object heights in mm."""
        heights_mm = np.asarray(heights_mm, dtype=float)
        if self.object_at_infinity:
            return np.arctan(heights_mm / self.efl_mm)
        return heights_mm / self.magnification

    def heights_of(self, fields: np.ndarray) -> np.ndarray:
        """Paraxial image heights in mm of angles in radians, or of object heights in mm."""
        if self.object_at_infinity:
            return self.efl_mm * np.tan(fields)
        return self.magnification * fields

    def height_slopes(self, fields: np.ndarray) -> np.ndarray:
        """Derivatives of `heights_of`, in mm per radian, or per mm."""
        if self.object_at_infinity:
            return self.efl_mm / np.cos(fields)**2
        return np.full_like(fields, self.magnification)

    def indices_at(self, wavelengths_nm: Sequence[float] | np.ndarray) -> np.ndarray:
        """Refractive indices in front of each surface and behind the last: array (surface + 1, wavelength).

        They are negative where light travels backwards, behind an odd number of mirrors. Reflection is then refraction
        to the negative index, of rays whose directions still point along the axis and whose lengths are negative.

        Raises
        ------
        LensError
            A wavelength outside the range of a glass.
        """
        return _indices(self.prescription, self.glasses, wavelengths_nm)

    @property
    def coatings(self) -> tuple[Coating, ...]:
        """Coating of each surface, as it is designed for its glass."""
        known = BUILT_IN | {coating.name: coating for coating in self.prescription.coatings}
        indices = np.abs(self.indices_at([self.prescription.reference_wavelength_nm])[:, 0])
        return tuple(on_glass(known[name], index) for name, index in
                     zip(self.prescription.surface_coatings, np.maximum(indices[:-1], indices[1:]), strict=True))

    def reflectances(self, wavelengths_nm: Sequence[float] | np.ndarray,
                     invariants: Sequence[float] | np.ndarray) -> np.ndarray:
        """Reflectance of each surface for unpolarised light, from either side: array (surface, wavelength, invariant).

        Mirrors count as surfaces between equal media, with a reflectance of 0.

        Parameters
        ----------
        wavelengths_nm : sequence of float
        invariants : sequence of float, or array (surface, wavelength, invariant)
            (n sin(angle))^2 of rays, which refraction keeps.

        Raises
        ------
        LensError
            A wavelength outside the range of a glass or of a measured coating.
        """
        nm = np.asarray(wavelengths_nm, dtype=float)
        indices = np.abs(self.indices_at(nm)[..., None])
        invariants = np.broadcast_to(invariants, (len(self.glasses), nm.size, np.shape(invariants)[-1]))
        shares = np.stack([reflectance(coating, (before, behind), nm[:, None], squares) for coating, before, behind,
                           squares in zip(self.coatings, indices[:-1], indices[1:], invariants, strict=True)])
        unknown = np.argwhere(np.isnan(shares))
        if unknown.size:
            surface, wavelength, _ = unknown[0]
            raise LensError(self.prescription.name, f"surface {surface + 1}, coating", self.coatings[surface].name,
                            f"not known at {nm[wavelength]:g} nm: give other wavelengths, or another coating "
                            "(--coating)")
        return shares

    @property
    def mirror_reflectance(self) -> float:
        """The share of the light that all mirrors together reflect."""
        return float(np.prod([self.prescription.surfaces[index].reflectance for index in self.prescription.mirrors]))

    def glass_transmittance(self, wavelengths_nm: Sequence[float] | np.ndarray) -> np.ndarray:
        """T of the bulk glass along the axis: array (wavelength,), without losses of model glasses."""
        return np.exp(-self.optical_depths(wavelengths_nm).sum(axis=0))

    def optical_depths(self, wavelengths_nm: Sequence[float] | np.ndarray) -> np.ndarray:
        """Absorption times thickness, on the axis, of the medium behind each surface: array (surface, wavelength)."""
        nm = np.asarray(wavelengths_nm, dtype=float)
        return np.stack([4 * np.pi * glass.extinction_at(nm) * abs(surface.thickness_mm) / (nm * 1e-6)
                         for glass, surface in zip(self.glasses, self.prescription.surfaces, strict=True)])


@lru_cache(maxsize=MOST_SYSTEMS)
def system_of(prescription: Prescription) -> System:
    """System of a prescription, with the image plane at the last thickness.

    Raises
    ------
    LensError
        A glass that is not in any catalogue, or a lens without power.
    """
    glasses = tuple(_glass(prescription, number) for number in range(1, len(prescription.surfaces) + 1))
    indices = _indices(prescription, glasses, [prescription.reference_wavelength_nm])
    figures = first_order(prescription, indices[:, 0])
    prescription = replace(prescription, aperture=("stop", figures.stop_semi_aperture_mm))
    across = figures if prescription.radial else first_order(prescription, indices[:, 0], "x")
    return System(**vars(figures), across=across, prescription=prescription, glasses=glasses,
                  last_height_mm=_last_height_mm(prescription, figures))


def unknown_glasses(prescription: Prescription) -> dict[str, str]:
    """The glasses that `system_of` rejects, with "n/V" from the file, or "": by name, in the order of the surfaces."""
    unknown = {}
    for number, surface in enumerate(prescription.surfaces, 1):
        try:
            _glass(prescription, number)
        except LensError:
            unknown[surface.glass] = surface.glass_figures
    return unknown


def _glass(prescription, number):
    """The glass behind the surface with this number, from 1."""
    surface = prescription.surfaces[number - 1]
    private = {glass.name: glass for glass in prescription.glasses}
    return private.get(surface.glass) or find_glass(surface.glass, prescription.name, f"surface {number}, glass",
                                                    surface.glass_figures)


def _indices(prescription, glasses, wavelengths_nm):
    nm = np.asarray(wavelengths_nm, dtype=float)
    backwards = np.cumsum([0, *(surface.mirror for surface in prescription.surfaces)]) % 2
    indices = np.stack([np.ones_like(nm), *(glass.index_at(nm) for glass in glasses)])
    indices *= np.where(backwards, -1.0, 1.0)[:, None]
    unknown = np.argwhere(np.isnan(indices))
    if unknown.size:
        surface, wavelength = unknown[0]
        glass, stated = glasses[surface - 1], prescription.surfaces[surface - 1].glass_figures
        raise LensError(prescription.name, f"surface {surface}, glass", glass.name,
                        _out_of_range(glass, stated, nm[wavelength]))
    return indices


def _out_of_range(glass, stated, nm):
    """The problem and the remedy for a glass that is not known at this wavelength."""
    first, last = glass.range_nm
    figures = stated or glass.figures
    example = f" such as {figures}" if figures else ""
    return (f"known from {first:g} to {last:g} nm only, not at {nm:g} nm: give wavelengths in this range, another "
            f"glass, or its index and Abbe number as n/V{example} (--glass OLD=NEW)")


def _last_height_mm(prescription, figures):
    """Paraxial image height at the end of the field."""
    kind, value = prescription.field
    if kind == "image_height_mm":
        return value
    if kind == "object_height_mm":
        return abs(figures.magnification) * value
    tangent = np.tan(np.radians(value))
    if np.isinf(prescription.object_distance_mm):
        return figures.efl_mm * tangent
    return abs(figures.magnification) * tangent * (prescription.object_distance_mm + figures.entrance_pupil_mm)
