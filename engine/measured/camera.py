"""What other programs measure of a lens: where light from each direction lands, in pixels."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from ..calibration.models import Model
from ..lens.pinhole import Pinhole, fitting_pitch_um
from ..runtime.errors import LensError
from .inverse import Straight, straight_places

MOST_SIDE_PX, MOST_FOCAL_PX = 65536, 1e7
SAME_FOCAL, CENTRED_PX = 1e-6, 1e-3  # of rotationally symmetric calibrations
CHANNELS_NM = 465.0, 540.0, 610.0
"""Of blue, green and red."""
Curve = Callable[[np.ndarray], np.ndarray]


class Fringes(NamedTuple):
    """Lateral colour: factors of the distances from the axis, in half diagonals of the frame, at which blue and red
    land, as functions of the distance of green."""

    blue: Curve
    red: Curve


class Measured(Protocol):
    """The distortion of a lens in front of a frame, and what else its file states."""

    @property
    def name(self) -> str: ...
    @property
    def program(self) -> str:
        """The kind of file, for the lens's source."""

    @property
    def size_px(self) -> tuple[int, int]:
        """Columns and rows."""

    @property
    def focal_px(self) -> tuple[float, float]:
        """Along rows and columns, on the axis."""

    @property
    def principal_px(self) -> tuple[float, float]:
        """Column and row of the axis."""

    @property
    def ending(self) -> str:
        """What happens where the field ends at less than MOST_ANGLE_DEG, in words."""

    @property
    def width_mm(self) -> float | None:
        """Of the frame, if the file states it."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about the reading of the file."""

    def straight(self, pixels: np.ndarray) -> Straight:
        """Where the light of pixels comes from: array (place, 2) of columns and rows, where 0, 0 is the middle of the
        upper left pixel."""


@dataclass(frozen=True, eq=False)
class ModelledCamera:
    """A `Measured` by a camera model.

    Attributes
    ----------
    name, program, size_px, focal_px, width_mm, notes
        As of `Measured`.
    principal_px : (float, float)
        Column and row of the axis, where 0, 0 is the middle of the upper left pixel.
    model : Model
    coefficients : tuple of float
    fringes : Fringes or None
    light : function or None
        Relative illumination by the distance from the axis in half diagonals of the frame.

    Raises
    ------
    LensError
        A value is not finite, or implausible.
    """

    name: str
    program: str
    size_px: tuple[int, int]
    focal_px: tuple[float, float]
    principal_px: tuple[float, float]
    model: Model
    coefficients: tuple[float, ...] = ()
    width_mm: float | None = None
    notes: tuple[str, ...] = ()
    fringes: Fringes | None = None
    light: Curve | None = None

    ending: ClassVar[str] = "the distortion folds"

    def __post_init__(self) -> None:
        check_size(self.name, self.size_px)
        check_focal(self.name, self.focal_px)
        if not np.isfinite(self.principal_px).all() or any(
                not -side <= place <= 2 * side for place, side in zip(self.principal_px, self.size_px, strict=True)):
            raise LensError(self.name, "principal point", _listed(self.principal_px),
                            f"expected pixels near the picture of {_listed(self.size_px)}")
        if not np.isfinite(self.coefficients).all():
            raise LensError(self.name, "coefficients", _listed(self.coefficients), "expected finite numbers")

    @property
    def symmetric(self) -> bool:
        """Whether it is rotationally symmetric about the middle of the frame."""
        fx, fy = self.focal_px
        off_px = np.subtract(self.principal_px, np.subtract(self.size_px, 1) / 2)
        asymmetric = np.array(self.coefficients)[~self.model.symmetric]
        return abs(fx - fy) <= SAME_FOCAL * fy and np.abs(off_px).max() <= CENTRED_PX and not asymmetric.any()

    def pixels(self, tangents: np.ndarray) -> np.ndarray:
        """Columns and rows of light in front of the camera, by its angle's tangents to the right and downwards: arrays
        (place, 2)."""
        ahead = np.concatenate([tangents, np.ones((len(tangents), 1))], axis=1)
        return self.model.place(ahead, np.array(self.coefficients)) * self.focal_px + self.principal_px

    def straight(self, pixels: np.ndarray) -> Straight:
        """See `Measured`."""
        places = (np.asarray(pixels, float) - self.principal_px) / self.focal_px
        return straight_places(self.model, self.coefficients, places)


def pixel_mm(name: str, sensor_mm: tuple[float, float], size_px: tuple[int, int]) -> float:
    """Side of the pixels of a picture that fits in a sensor, which is turned for a portrait picture.

    Raises
    ------
    LensError
        The sensor's sides are not positive.
    """
    if not all(0 < side < np.inf for side in sensor_mm):
        raise LensError(name, "sensor", sensor_mm, "expected a positive width and height in mm")
    return fitting_pitch_um(Pinhole(sensor_mm, 1.0, 1.0), size_px[::-1]) * 1e-3


def check_size(name: str, size_px: tuple[int, int]) -> None:
    """Raise a LensError for an implausible number of columns and rows."""
    if not all(2 <= side <= MOST_SIDE_PX for side in size_px):
        raise LensError(name, "picture size", _listed(size_px), f"expected 2 to {MOST_SIDE_PX} columns and rows")


def check_focal(name: str, focal_px: tuple[float, float]) -> None:
    """Raise a LensError for an implausible focal length."""
    if not all(0 < focal <= MOST_FOCAL_PX for focal in focal_px):
        raise LensError(name, "focal length", f"{_listed(focal_px)} px", "expected positive numbers of pixels")


def _listed(values):
    return " x ".join(f"{value:g}" for value in values)
