"""The rims of a lens that may block light off the axis, and how small and large mechanics allow them to be."""

from dataclasses import dataclass, replace

import numpy as np

from ..prescription.prescription import Prescription, Surface
from ..prescription.surfaces import sag_and_slope
from .even_light import EvenField

GROUPS = "front", "inner front", "inner rear", "rear"
SCAN = np.linspace(0, 1, 2001)[1:]  # of the largest height that is searched for the end of the glass
FARTHEST = 2.0  # focal lengths from the axis in which glass ends
LEAST_RANGE = 2e-3  # relative: a rim with less between its limits is not a rim to fit
CLEARANCE = 1.01  # of a rim that blocks nothing, around the light


@dataclass(frozen=True)
class RimRange:
    """Limits of a rim's semi-aperture.

    Attributes
    ----------
    surface : int
        Index.
    group : str
        One of `GROUPS`: the first and last components of the lens, and those between them and the stop.
    least_mm : float
        The light of the widest f-number on the axis, which it must pass.
    most_mm : float
        Where the glass ends, or where no light of the picture arrives.
    """

    surface: int
    group: str
    least_mm: float
    most_mm: float


def rim_ranges(prescription: Prescription, fields: list[EvenField]) -> list[RimRange]:
    """The rims that may block light of these fields. The first field is focused at infinity or at the farthest."""
    on_axis_mm = fields[0].most_mm[:, 0]
    reached_mm = np.max([field.most_mm.max(axis=1) for field in fields], axis=0)
    most_mm = np.minimum(rim_ends_mm(prescription, fields), CLEARANCE * reached_mm)
    return [RimRange(surface, group, float(on_axis_mm[surface]), float(most_mm[surface]))
            for surface, group in _groups(prescription).items()
            if most_mm[surface] > (1 + LEAST_RANGE) * on_axis_mm[surface]]


def passing_chief_rays(ranges: list[RimRange], fields: list[EvenField]) -> list[RimRange]:
    """The rims that pass all chief rays of these fields, with their limits."""
    chief_mm = np.sqrt(np.max([field.square_mm2[:, :, 0, 0].max(axis=1) for field in fields], axis=0))
    passing = [replace(each, least_mm=max(each.least_mm, float(chief_mm[each.surface]))) for each in ranges]
    return [each for each in passing if each.most_mm > (1 + LEAST_RANGE) * each.least_mm]


def rim_ends_mm(prescription: Prescription, fields: list[EvenField]) -> np.ndarray:
    """Height at each surface where a rim ends: with the glass, but never in the light of the axis, as it would for a
    design whose surfaces cross there. The first field is focused at infinity or at the farthest."""
    return np.maximum(glass_ends_mm(prescription), fields[0].most_mm[:, 0])


def glass_ends_mm(prescription: Prescription) -> np.ndarray:
    """Height at each surface where an element, or the air between two, has no thickness left: array (surface,), inf if
    that is beyond `FARTHEST` or at the stop."""
    ends_mm = np.full(len(prescription.surfaces), np.inf)
    heights_mm = SCAN * FARTHEST * (prescription.focal_length_mm or 100.0)
    for number, (surface, behind) in enumerate(zip(prescription.surfaces, prescription.surfaces[1:], strict=False)):
        if not (_is_iris(surface) or _is_iris(behind)):
            thickness_mm = surface.thickness_mm + _sag_mm(behind, heights_mm) - _sag_mm(surface, heights_mm)
            thin = ~(thickness_mm > 0)
            if thin.any():
                ends_mm[number:number + 2] = np.minimum(ends_mm[number:number + 2], heights_mm[np.argmax(thin)])
    return ends_mm


def _sag_mm(surface, heights_mm):
    """Sag, NaN beyond the end of a conic."""
    beyond = (1 + surface.conic) * (heights_mm / surface.radius_mm)**2 > 1
    return np.where(beyond, np.nan, sag_and_slope(surface, heights_mm**2)[0])


def _is_iris(surface):
    return surface.stop and not surface.glass


def _groups(prescription):
    """The group of each surface that may have a rim to fit, by its index."""
    components = _components(prescription)
    front = [each for each in components if each[0] < prescription.stop_index]
    rear = components[len(front):]
    grouped = zip(GROUPS, (front[:1], front[1:], rear[:-1], rear[-1:]), strict=True)
    return {surface: group for group, parts in grouped for part in parts for surface in part
            if surface != prescription.stop_index}


def _components(prescription):
    """Indices of the surfaces of each component, cemented elements together; without plane-parallel plates."""
    components, glass = [], ""
    for index, surface in enumerate(prescription.surfaces):
        if not glass and not _is_iris(surface):
            components.append([])
        if not (_is_iris(surface) and not glass):
            components[-1].append(index)
        glass = surface.glass
    return [each for each in components
            if any(np.isfinite(prescription.surfaces[index].radius_mm) for index in each)]


def with_rims(prescription: Prescription, fields: list[EvenField], rims_mm: dict[int, float]) -> Prescription:
    """The lens with these rims, by index. The others are as wide as the light of the fields that these pass, with some
    clearance, and end with the glass. The stop and plane-parallel plates stay as they are."""
    grouped, ends_mm = _groups(prescription), rim_ends_mm(prescription, fields)
    clear_mm = np.max([_clear_mm(field, rims_mm) for field in fields], axis=0)

    def sized(index, surface: Surface) -> Surface:
        if index not in grouped:
            return surface
        size_mm = rims_mm.get(index) or min(CLEARANCE * clear_mm[index], ends_mm[index])
        return replace(surface, semi_aperture_mm=round(float(size_mm), 3))

    return replace(prescription, surfaces=tuple(sized(*each) for each in enumerate(prescription.surfaces)))


def _clear_mm(field, rims_mm):
    """Distance from the axis of the outermost ray at each surface that rims pass: array (surface,)."""
    blocked = field.lost.copy()
    for index, size_mm in rims_mm.items():
        blocked |= field.square_mm2[index] > size_mm**2
    return np.sqrt(np.where(blocked, 0.0, field.square_mm2).max(axis=(1, 2, 3)))
