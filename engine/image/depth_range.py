"""Depth: over which object distances lens data, made for an object in one plane, hold.

Distances are counted from the entrance pupil, where the capture's camera stands, along the optical axis: all of a plane
that faces the camera is at one depth.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ImageError, InputError
from .pixel_grid import PLANE, PixelGrid

if TYPE_CHECKING:
    from ..lens.lens import Lens

AUTO, OFF, TRACED = DEPTHS = "auto", "off", "traced"
"""Depth in layers, where the lens's data do not hold for all of a scene; none; or by rays traced through the lens."""
SHARP_PX, BLURRED_PX = 0.5, 2.0  # blur that pixels hide, and that they show
BACKGROUND_MM = 1e12  # and beyond: renderers write a large number, Cycles 1e10 m, where they see nothing


@dataclass(frozen=True)
class DepthCheck:
    """How much of a picture lies where the lens data do not hold.

    Attributes
    ----------
    blur_um : float
        Diameter of the defocus blur on the sensor that is allowed.
    near_mm, far_mm : float
        Depths between which the blur is at most that; far_mm may be inf.
    nearest_mm, farthest_mm : float
        Depths seen; inf where nothing is.
    outside_fraction : float
        Fraction of the pixels whose depth is not between near_mm and far_mm.
    """

    blur_um: float
    near_mm: float
    far_mm: float
    nearest_mm: float
    farthest_mm: float
    outside_fraction: float

    @property
    def text(self) -> str:
        """One line for a report."""
        return (f"{self.outside_fraction:.1%} of the frame is out of the lens data's depth, {_metres(self.near_mm)} to "
                f"{_metres(self.far_mm)}, where defocus blurs by at most {self.blur_um:.3g} um; the scene is at "
                f"{_metres(self.nearest_mm)} to {_metres(self.farthest_mm)}")


def entrance_pupil_diameter_mm(lens: "Lens") -> float:
    """Diameter of the entrance pupil, from the lens's f-number and magnification.

    By the sine condition the marginal ray leaves an object on the axis at the angle u with sin u = |m| sin u', where
    sin u' = 0.5 / f_number_effective; it meets the pupil's rim, S tan u off the axis at the distance S. For an object
    at infinity the ray enters at the height f sin u'. For the bundled lenses that is within 5 % of the diameter by
    paraxial rays: the f-number is that of real ones.
    """
    sine = 0.5 / lens.f_number_effective
    if np.isinf(lens.object_distance_mm):
        return 2 * lens.efl_mm * sine
    object_sine = min(abs(lens.magnification) * sine, 1 - 1e-9)
    return 2 * (lens.object_distance_mm + lens.entrance_pupil_mm) * object_sine / np.sqrt(1 - object_sine**2)


def sharp_range_mm(lens: "Lens", blur_um: float) -> tuple[float, float]:
    """Nearest and farthest depths at which defocus blurs by at most `blur_um`.

    A point at the depth s sends a cone through the entrance pupil, of diameter D, that is D |s - S| / s wide in the
    plane in focus, S away, and |m| times that on the sensor. With f the lens's `capture_focal_length_mm`, which is
    |m| S, that is D |f / s - |m||: at infinite focus f D / s. The same holds off the axis, for planes that face the
    pupil.

    Parameters
    ----------
    lens : Lens
    blur_um : float
        Diameter of the blur on the sensor.

    Returns
    -------
    near_mm, far_mm : float
        From the entrance pupil; far_mm may be inf.

    Raises
    ------
    InputError
        The blur is no positive number.
    """
    if not 0 < blur_um < np.inf:
        raise InputError("options", "blur", blur_um, "expected a positive number of micrometres")
    pupil_mm, focal_mm = entrance_pupil_diameter_mm(lens), lens.capture_focal_length_mm
    magnification = 0.0 if np.isinf(lens.object_distance_mm) else abs(lens.magnification)
    blur_mm = 1e-3 * blur_um
    beyond = magnification * pupil_mm - blur_mm  # the blur of what is infinitely far, less what is allowed
    return focal_mm * pupil_mm / (magnification * pupil_mm + blur_mm), (
        focal_mm * pupil_mm / beyond if beyond > 0 else np.inf)


def blur_px(lens: "Lens", pitch_um: float, depth_mm: ArrayLike) -> np.ndarray:
    """Diameter of the defocus blur of points at these depths, signed: positive nearer than the plane in focus.

    D f (1 / s - 1 / S), with all as in `sharp_range_mm`. So how much two depths differ in blur does not depend on
    where the lens is focused.

    Returns
    -------
    array, in pixels of this pitch
    """
    with np.errstate(divide="ignore"):
        nearness = 1 / np.asarray(depth_mm, dtype=float)
    return blur_per_nearness_px(lens, pitch_um) * (nearness - focus_nearness(lens))


def blur_per_nearness_px(lens: "Lens", pitch_um: float) -> float:
    """D f in pixels times mm: by what `blur_px` grows with the inverse of the depth."""
    return entrance_pupil_diameter_mm(lens) * lens.capture_focal_length_mm / (pitch_um * 1e-3)


def focus_nearness(lens: "Lens") -> float:
    """The inverse of the depth in focus, per mm; 0 for a lens focused at infinity."""
    return 1 / (lens.object_distance_mm + lens.entrance_pupil_mm)


def focus_range_px(lens: "Lens", pitch_um: float) -> tuple[float, float]:
    """Blur up to which the lens's PSFs of focus tell all, and from which on rays do, in pixels of this pitch.

    A wave of defocus is a blur 8 lambda N wide. Up to a quarter of that, diffraction and aberrations are still those of
    focus; from a wave on, geometry tells the blur, whose rays also tell what hides what. Neither is told finer than by
    pixels.
    """
    wave_px = 8e-3 * lens.reference_wavelength_nm * lens.f_number_effective / pitch_um
    return max(wave_px / 4, SHARP_PX), max(wave_px, BLURRED_PX)


def focus_share(blur: ArrayLike, range_px: tuple[float, float]) -> np.ndarray:
    """How far what has this blur is taken to be in focus, where this is the `focus_range_px`: from 1 to 0, smoothly."""
    sharp, blurred = range_px
    t = np.clip((np.abs(blur) - sharp) / (blurred - sharp), 0, 1)
    return 1 - t * t * (3 - 2 * t)


def planar_depth_mm(depth_mm: ArrayLike, lens: "Lens", capture: PixelGrid) -> np.ndarray:
    """Depths along the optical axis, from what Cycles writes into its depth pass.

    That is the depth itself for a perspective camera, but the distance from the camera for a panoramic one. At the
    angle t from an equidistant camera's axis the depth is the distance times cos t, and none, NaN, beyond 90 degrees.

    Parameters
    ----------
    depth_mm : array (row, column)
    lens : Lens
    capture : PixelGrid

    Returns
    -------
    array (row, column), inf for the background
    """
    depth_mm = np.where(np.asarray(depth_mm) >= BACKGROUND_MM, np.inf, depth_mm)
    if capture.projection == PLANE:
        return depth_mm
    x_mm, y_mm = capture.axes_mm()
    angle = np.hypot(x_mm[None, :], y_mm[:, None]) / lens.capture_focal_length_mm
    return depth_mm * np.where(angle <= np.pi / 2, np.cos(angle), np.nan)


def check_depth(depth_mm: ArrayLike, lens: "Lens", pitch_um: float, blur_um: float | None = None) -> DepthCheck:
    """How much of a picture lies where the lens's PSFs, which are those of one object plane, do not hold.

    Parameters
    ----------
    depth_mm : array (row, column)
        Depth of every pixel of the frame along the optical axis from the entrance pupil; see `planar_depth_mm`. NaN
        where there is none: such pixels do not count.
    lens : Lens
    pitch_um : float
        Pixel pitch.
    blur_um : float, optional
        Diameter of the defocus blur that is allowed; one pixel pitch by default.

    Returns
    -------
    DepthCheck

    Raises
    ------
    ImageError
        No pixel has a depth.
    """
    depth_mm = np.asarray(depth_mm, dtype=float)
    seen = depth_mm[~np.isnan(depth_mm)]
    if not seen.size:
        raise ImageError("depth", "pixels", "empty", "expected at least one that has a depth")
    seen = np.where(seen >= BACKGROUND_MM, np.inf, seen)
    blur_um = float(pitch_um if blur_um is None else blur_um)
    near_mm, far_mm = sharp_range_mm(lens, blur_um)
    outside = (seen < near_mm) | (seen > far_mm)
    return DepthCheck(blur_um, float(near_mm), float(far_mm), float(seen.min()), float(seen.max()),
                      float(outside.mean()))


def _metres(distance_mm):
    return "infinity" if np.isinf(distance_mm) else f"{distance_mm * 1e-3:.3g} m"
