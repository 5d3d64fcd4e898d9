"""Facts about a lens at its current settings, without a bake: computed in a fraction of a second."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from lensfield.engine.inspection.curves import field_angle_rad, reference_nm
from lensfield.engine.inspection.grid_curves import half_angles_rad, paths
from lensfield.engine.lens import Lens, RadialLens
from lensfield.engine.lens.conventions import four_by_three
from lensfield.engine.lens.entrance_pupil import focus_rise
from lensfield.engine.library import LensSource, has_rings, prescription_of
from lensfield.engine.prescription.photographs import Agreement
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays import field_heights, fields
from lensfield.engine.rays.light_end import light_end
from lensfield.engine.rays.rings import AT_REST, Rings, resized_rings, ring_ends, turned
from lensfield.engine.rays.view import focus_lean, sensor_axes, tilted

from .lens_cache import identity_of, load_lens
from .units import M_TO_MM

MOST_FACTS = 64
DIAGONAL = 2  # of `LensFacts.fields`


@dataclass(frozen=True)
class LensFacts:
    """Facts about a lens at its current settings.

    Attributes
    ----------
    rings : Rings
        Its settings; for a scaled lens, before scaling.
    efl_mm, capture_focal_length_mm, sensor_mm
        As in `Lens`.
    f_number, focus_mm : float
        As in `TurnedLens`.
    reach : (float, float, float) or None
        The widest and the highest f-number, and the closest focus in mm; None for a package, which has no rings.
    words : tuple of str
        A line for each requested setting that its rings do not have.
    fields : three tuples of (float, float)
        Along the width, the height and the diagonal of the picture, from the axis to the end of the field: distances in
        mm, and their angles to the axis in radians.
    radial : bool
        Whether the lens is rotationally symmetric.
    squeeze : float
        As in `Lens`.
    photographs : Agreement or None
        How closely it agrees with photographs, with their light at its settings; None if it was not compared.
    source : str
        Of a package: where its figures come from.
    """

    rings: Rings
    efl_mm: float
    capture_focal_length_mm: float
    sensor_mm: tuple[float, float]
    f_number: float
    focus_mm: float
    reach: tuple[float, float, float] | None
    words: tuple[str, ...]
    fields: tuple[tuple[tuple[float, float], ...], ...]
    radial: bool
    squeeze: float
    photographs: Agreement | None = None
    source: str = ""

    @property
    def last_mm(self):
        """Distance from the axis to the end of the field, along the diagonal."""
        return self.fields[DIAGONAL][-1][0]

    def angle_rad(self, distance_mm, along=0):
        """Angles to the axis of light at distances from it, along the picture's width, height or DIAGONAL."""
        return np.interp(distance_mm, *np.transpose(self.fields[along]))

    def field_on(self, edges_mm):
        """Angles of view in degrees across and up a picture, and the share of the distance from the axis to its
        farthest corner that the field covers.

        Parameters
        ----------
        edges_mm : (float, float, float, float)
            As `PixelGrid.edges_mm`.
        """
        left, lower, right, upper = (
            np.degrees(np.sign(edge_mm) * np.interp(abs(edge_mm), *np.transpose(field)))
            for edge_mm, field in zip(edges_mm, (*self.fields[:2], *self.fields[:2]), strict=True))
        farthest_mm = np.hypot(*np.abs(edges_mm).reshape(2, 2).max(axis=0))
        return right - left, upper - lower, min(1.0, self.last_mm / farthest_mm)


def lens_facts(source: LensSource, rings: Rings = AT_REST, focal_mm: float | None = None) -> LensFacts:
    """The LensFacts of a lens.

    Parameters
    ----------
    source : str, path or Prescription
    rings : Rings
        The requested settings; packages ignore them.
    focal_mm : float or None
        The capture focal length that the lens is scaled to; None for its own size.

    Raises
    ------
    LensError
        The lens does not exist, or forms no image at this focus.
    """
    return _facts(*identity_of(source), rings, focal_mm)


def squeeze_of(lens: Lens | LensSource) -> float:
    """The squeeze of a lens; 1 unless it is anamorphic."""
    return lens.squeeze if isinstance(lens, Lens) else lens_facts(lens).squeeze


def lean_per_m(source: LensSource, tilt_deg: tuple[float, float]) -> tuple[float, float]:
    """Rise of the inverse depth in focus, per m, with the tangents of angles to the right and up, for a lens at rest
    with this tilt; packages ignore it. Fast enough to follow a drag, once the lens's facts are known."""
    return _lean_per_m(*identity_of(source), tilt_deg)


@lru_cache(maxsize=MOST_FACTS)
def _lean_per_m(source, changed, tilt_deg):
    if not has_rings(source):
        per_mm = focus_rise(load_lens(source))
    elif any(tilt_deg):
        system = system_of(tilted(system_of(turned(prescription_of(source)).prescription), tilt_deg))
        per_mm = -focus_lean(system, sensor_axes(system.prescription))  # its picture is upside down
    else:
        return 0.0, 0.0
    return tuple((per_mm * M_TO_MM).tolist())


@lru_cache(maxsize=MOST_FACTS)
def _facts(source, changed, rings, focal_mm):
    if not has_rings(source):
        return facts_of(load_lens(source))
    prescription = prescription_of(source)
    if focal_mm is not None:
        rings = resized_rings(prescription, rings, focal_mm)
    lens = turned(prescription, rings)
    system = system_of(lens.prescription)
    curves = _curves(system)
    return LensFacts(
        rings, system.efl_mm, system.capture_focal_length_mm,
        lens.prescription.sensor_mm or four_by_three(curves[-1][-1][0]), lens.f_number, lens.focus_mm,
        _reach(source, changed), lens.words, curves, lens.prescription.radial, system.squeeze,
        prescription.photographs and prescription.photographs.at(lens.f_number, lens.focus_mm))


def _curves(system):
    """`LensFacts.fields` of a prescription."""
    if system.prescription.radial:
        last_mm = light_end(system, (system.prescription.reference_wavelength_nm,)).height_mm
        return 3 * (_pairs(*field_heights.chief_ray_curve(system, last_mm)),)
    end_mm, sides_mm = system.last_height_mm, system.prescription.sensor_mm or four_by_three(system.last_height_mm)
    ends_mm = (end_mm, 0.0), (0.0, end_mm), end_mm / np.hypot(*sides_mm) * np.array(sides_mm)
    return tuple(_pairs(*fields.chief_ray_curve(system, each)) for each in ends_mm)


@lru_cache(maxsize=MOST_FACTS)
def _reach(source, changed):
    widest, closest = ring_ends(prescription_of(source))
    return widest.f_number, closest.f_number, closest.focus_mm


def facts_of(lens):
    """The LensFacts of a Lens, as of a package."""
    radial = isinstance(lens, RadialLens)
    if radial:
        fields = 3 * (_pairs(lens.real_height_at(reference_nm(lens)), field_angle_rad(lens, lens.heights_mm)),)
    else:
        fields = tuple(_pairs(*half_angles_rad(lens, path)) for path in paths(lens)[:3])
    return LensFacts(AT_REST, lens.efl_mm, lens.capture_focal_length_mm, lens.sensor_mm, lens.f_number_effective,
                     lens.object_distance_mm + lens.entrance_pupil_mm, None, (), fields, radial, lens.squeeze,
                     source=lens.source)


def _pairs(*columns):
    return tuple(zip(*map(np.ndarray.tolist, columns), strict=True))
