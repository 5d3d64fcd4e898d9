"""The iris: blades that stop a lens down. Their opening has the area of the round stop for the lens's f-number."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy

from ..runtime.errors import InputError
from ..runtime.numbers import is_integer
from ..runtime.setting import setting
from . import Lens

MOST_BLADES = 64
AZIMUTHS = 4096  # for integrating the edge of half a blade: areas are accurate to 1e-7
SETTLED = 1e-12  # tolerance of the size of an opening


@dataclass(frozen=True)
class Iris:
    """Blades that stop a lens down.

    Attributes
    ----------
    blades : int
        3 to MOST_BLADES, or 0 for a round stop.
    rotation_deg : float
        Direction of the first blade's middle, anticlockwise from the right, as seen from the sensor.
    roundness : float
        From 0, a polygon, to 1, a circle.

    Raises
    ------
    InputError
        If a value is invalid.
    """

    blades: int = setting(
        0, name="Blades", kind=int, option="iris-blades", metavar="N", text="Number of iris blades; 0 for a round stop",
        unset="0")
    rotation_deg: float = setting(
        0.0, name="Rotation", kind=float, option="iris-rotation", metavar="DEG", unset="0",
        text="Rotation of the blades, anticlockwise")
    roundness: float = setting(
        0.0, name="Roundness", kind=float, option="iris-roundness", metavar="0..1", unset="0", limits=(0.0, 1.0),
        subtype="FACTOR",
        text="Shape of the opening when the lens is stopped down, from straight blades to a circle. The area of the "
             "opening, and so the exposure, stays the same")

    def __post_init__(self) -> None:
        if not is_integer(self.blades) or (self.blades and not 3 <= self.blades <= MOST_BLADES):
            raise InputError("iris", "blades", self.blades, f"expected 3 to {MOST_BLADES}, or 0 for a round stop")
        if not 0 <= self.roundness <= 1:
            raise InputError("iris", "roundness", self.roundness, "expected 0 (straight blades) to 1 (a circle)")
        if not np.isfinite(self.rotation_deg):
            raise InputError("iris", "rotation", self.rotation_deg, "expected a finite number of degrees")

    @property
    def directions(self) -> np.ndarray:
        """Directions that the blades face: float32 array (blade, 2)."""
        azimuth = np.radians(self.rotation_deg) + 2 * np.pi * np.arange(self.blades) / max(self.blades, 1)
        return np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1).astype(np.float32)


@dataclass(frozen=True)
class Opening:
    """The opening of an iris, of area pi, in semi-apertures of the round stop that it replaces.

    Attributes
    ----------
    iris : Iris
    corner : float
        Distance of the blades' corners from the axis. It exceeds `reach` if the lens's rim cuts the corners off.
    reach : float
        Distance of the opening's outermost point from the axis.
    """

    iris: Iris
    corner: float
    reach: float

    @property
    def shape(self) -> tuple[float, float, float]:
        """Margin, bend and slope: a point r is open if margin - bend r^2 - slope (r . direction) > 0 for all blades.

        Near the middle of a blade's edge this is the distance from the edge. The edge of a blade is a circle through
        two corners, with the radius corner / roundness.
        """
        if not self.iris.blades:
            return 1.0, 0.0, 0.0
        margin, bend, slope = _shape(self.iris.blades, self.iris.roundness)
        bend, slope = bend / self.corner**2, slope / self.corner
        change = float(np.sqrt(slope**2 + 4 * bend * margin))  # across the middle of the edge
        return margin / change, bend / change, slope / change

    def open_share(self, stop: np.ndarray, cell: float) -> np.ndarray:
        """The share of cells that is between the blades: 1 for a round stop.

        Parameters
        ----------
        stop : array (2, ...)
            Middles of the cells, to the right and up, in semi-apertures.
        cell : float
            Their side.
        """
        (margin, bend, slope), (x, y) = self.shape, stop
        inside = [margin - bend * (x * x + y * y) - slope * (x * across + y * along)
                  for across, along in self.iris.directions]
        return np.prod([np.clip(each / cell + 0.5, 0, 1) for each in inside], axis=0, initial=1.0)


def opening(iris: Iris | None, lens: Lens) -> Opening:
    """The opening of a lens with an iris; a round stop without one.

    Blades retract behind the rim of the widest stop. This rim cuts the corners off if the lens is only slightly stopped
    down, and a lens wide open has a round stop.
    """
    rim = lens.prescription.stop_rim if lens.prescription else np.inf
    return opening_within(iris or Iris(0), float(rim))


@lru_cache(maxsize=64)
def opening_within(iris: Iris, rim: float) -> Opening:
    """The opening of an iris behind a round rim of this radius, in semi-apertures of the stop."""
    if not iris.blades:
        return Opening(iris, 1.0, 1.0)
    edge = _edge(iris)
    corner = float(np.sqrt(1 / np.mean(edge**2)))
    if corner <= rim:
        return Opening(iris, corner, corner)
    if rim <= 1:
        return Opening(iris, 1 / float(edge.min()), 1.0)

    def excess(corner):
        return np.mean(np.minimum(corner * edge, rim) ** 2) - 1

    return Opening(iris, float(scipy.optimize.brentq(excess, 1.0, rim / edge.min(), xtol=SETTLED)), rim)


def _edge(iris):
    """Distance of a blade's edge from the axis at even azimuths from its middle to its corner, at the distance 1."""
    margin, bend, slope = _shape(iris.blades, iris.roundness)
    towards = slope * np.cos(np.pi / iris.blades * (np.arange(AZIMUTHS) + 0.5) / AZIMUTHS)
    return 2 * margin / (towards + np.sqrt(towards**2 + 4 * bend * margin))


def _shape(blades, roundness):
    """`Opening.shape` of blades with corners at the distance 1 from the axis."""
    half = np.pi / blades
    root = np.sqrt(1 - (roundness * np.sin(half)) ** 2)
    return (float(np.cos(half) * root - roundness * np.cos(2 * half) / 2), roundness / 2,
            float(root - roundness * np.cos(half)))
