"""This copy of a lens: how far its elements are from their places, drawn from the tolerances of a grade.

An element is the glass between two airspaces: cemented lenses move together, and so do the passes of light through a
mirror's glass. A mirror without glass is an element, too. Each is displaced and turned about the middle of its
thickness, and so is each group, the elements in front of the stop and those behind it. The stop, the spacing along the
axis and the sensor stay.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from hashlib import blake2b
from itertools import groupby

import numpy as np

from ..runtime.errors import LensError
from .prescription import Pose, Prescription, Surface

TERMS, WORD_BYTES = 12, 4  # of a normal number: the sum of 12 even ones has the variance 1
ARC_MINUTES = 60


@dataclass(frozen=True)
class Grade:
    """Standard deviations of displacements along x and along y, and of turns about x and about y.

    The figures are of the kind of ISO 10110-6, which states turns in arc minutes.

    Attributes
    ----------
    decentre_um, tilt_arcmin : float
        Of each element.
    group_decentre_um, group_tilt_arcmin : float
        Of each group.
    """

    decentre_um: float
    tilt_arcmin: float
    group_decentre_um: float
    group_tilt_arcmin: float


GRADES = {"prime": Grade(5.0, 0.5, 5.0, 0.5), "vintage": Grade(20.0, 1.5, 20.0, 1.5),
          "dropped": Grade(20.0, 1.5, 150.0, 10.0)}


@dataclass(frozen=True)
class Copy:
    """One copy of a lens.

    Attributes
    ----------
    seed : int
        Its number, from 1: a copy has the same displacements on every machine. In another grade, they differ in size
        only.
    grade : str
        One of GRADES.

    Raises
    ------
    LensError
        An attribute is invalid.
    """

    seed: int
    grade: str

    def __post_init__(self) -> None:
        if not self.seed > 0:
            raise LensError("copy", "seed", self.seed, "expected a whole number from 1")
        if self.grade not in GRADES:
            raise LensError("copy", "grade", self.grade, f"expected {', '.join(GRADES)}")


def copy_of(number: int, grade: str) -> Copy | None:
    """The copy with this number; None for 0, the design."""
    return Copy(number, grade) if number else None


@dataclass(frozen=True, eq=False)
class _Motion:
    """A turn about a point of the axis, and a displacement."""

    pivot_mm: float
    turn: np.ndarray
    displacement_mm: np.ndarray

    def moved(self, pose, vertex_mm):
        """The pose of a surface after the motion."""
        from_pivot = np.array([0.0, 0.0, vertex_mm - self.pivot_mm])
        offset_mm = self.turn @ (from_pivot + pose.offset_mm) - from_pivot + self.displacement_mm
        return Pose.of(offset_mm, self.turn @ pose.rotation)


def as_built(prescription: Prescription, copy: Copy) -> Prescription:
    """The prescription of a copy: its surfaces have poses."""
    surfaces, grade = list(prescription.surfaces), GRADES[copy.grade]
    vertices_mm = np.cumsum([0.0, *(surface.thickness_mm for surface in surfaces)])
    groups = groupby(elements(surfaces), key=lambda element: element[0] > prescription.stop_index)
    number = 0
    for behind, group in ((behind, list(members)) for behind, members in groups):
        ends = group[0][0], group[-1][-1]
        of_group = _drawn(copy.seed, f"group {int(behind)}", vertices_mm[list(ends)].mean(), grade.group_decentre_um,
                          grade.group_tilt_arcmin)
        for element in group:
            number += 1
            middle_mm = vertices_mm[[element[0], element[-1]]].mean()
            own = _drawn(copy.seed, f"element {number}", middle_mm, grade.decentre_um, grade.tilt_arcmin)
            for index in element:
                pose = own.moved(surfaces[index].pose or Pose(), vertices_mm[index])
                surfaces[index] = replace(surfaces[index], pose=of_group.moved(pose, vertices_mm[index]))
    return replace(prescription, surfaces=tuple(surfaces))


def elements(surfaces: Sequence[Surface]) -> list[range]:
    """The indices of each element's surfaces, from the front."""
    found, first = [], None
    for index, surface in enumerate(surfaces):
        if surface.glass and first is None:
            first = index
        elif first is not None and (not surface.glass or index == len(surfaces) - 1):
            found.append(range(first, index + 1))
            first = None
        elif surface.mirror and not surface.glass:
            found.append(range(index, index + 1))
    return found


def _drawn(seed, part, pivot_mm, decentre_um, tilt_arcmin):
    """The _Motion of a part."""
    x, y, about_x, about_y = (_normal(f"{seed} {part} {name}") for name in ("x", "y", "about x", "about y"))
    tilt_deg = tilt_arcmin / ARC_MINUTES
    turn = Pose(tilt_deg=(tilt_deg * about_x, tilt_deg * about_y, 0.0)).rotation
    return _Motion(pivot_mm, turn, decentre_um * 1e-3 * np.array([x, y, 0.0]))


def _normal(text):
    """A number of a nearly normal distribution with the variance 1, of at most 6, that a text determines exactly."""
    digest = blake2b(text.encode(), digest_size=TERMS * WORD_BYTES).digest()
    words = (int.from_bytes(digest[at:at + WORD_BYTES], "little") for at in range(0, TERMS * WORD_BYTES, WORD_BYTES))
    return (sum(words) + TERMS / 2) / 2**(8 * WORD_BYTES) - TERMS / 2
