"""Depth: the range of object distances for which lens data, computed for one object plane, are valid.

Distances are measured from the entrance pupil, the position of the capture's camera, along the optical axis: all points
of a plane that faces the camera have the same depth.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..field.in_capture import from_capture
from ..image.layers import BACKGROUND_MM
from ..image.pixel_grid import PixelGrid
from ..lens.entrance_pupil import entrance_pupil_diameter_mm, focus_nearness
from ..lens.lens import Lens
from ..runtime.errors import ImageError, InputError

AUTO, OFF, TRACED = DEPTHS = "auto", "off", "traced"
"""Depth in layers, if the lens data are not valid for the complete scene; off; or by rays traced through the lens."""
SHARP_PX, BLURRED_PX = 0.8, 2.0  # blur that pixels hide, and blur that is visible


@dataclass(frozen=True)
class DepthCheck:
    """A picture's depths, compared with the range for which the lens data are valid.

    Attributes
    ----------
    blur_um : float
        Allowed diameter of the defocus blur on the sensor.
    near_mm, far_mm : float
        Range of depths with at most this blur, on the axis; far_mm may be inf.
    nearest_mm, farthest_mm : float
        Range of depths in the picture; inf for the background.
    outside_fraction : float
        Fraction of the pixels whose depth is not in that range.
    leaning : bool
        Whether the plane of focus leans, so that the range depends on the place.
    outside_light : float or None
        Fraction of the light in these pixels; None if it is not known.
    """

    blur_um: float
    near_mm: float
    far_mm: float
    nearest_mm: float
    farthest_mm: float
    outside_fraction: float
    leaning: bool = False
    outside_light: float | None = None

    @property
    def text(self) -> str:
        """One line for a report."""
        on_axis = " on the axis" if self.leaning else ""
        of_light = "" if self.outside_light is None else f" and {self.outside_light:.1%} of its light"
        return (f"In focus: {_metres(self.near_mm)} to {_metres(self.far_mm)}{on_axis}, within {self.blur_um:.3g} um; "
                f"out of focus: {self.outside_fraction:.1%} of the frame{of_light}; the scene spans "
                f"{_metres(self.nearest_mm)} to {_metres(self.farthest_mm)}")


def sharp_range_mm(lens: Lens, blur_um: float) -> tuple[float, float]:
    """Nearest and farthest depths at which defocus blurs by at most `blur_um`.

    A point at the depth s sends a cone of light through the entrance pupil of diameter D. The cone is D |s - S| / s
    wide in the plane of focus at the distance S, and |m| times as wide on the sensor. With the lens's
    `capture_focal_length_mm` f, which is |m| S, this is D |f / s - |m||; for focus at infinity, f D / s. The same holds
    off the axis, for planes that face the pupil.

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
        If the blur is not a positive number.
    """
    if not 0 < blur_um < np.inf:
        raise InputError("options", "blur", blur_um, "expected a positive number of micrometres")
    pupil_mm, focal_mm = entrance_pupil_diameter_mm(lens), lens.capture_focal_length_mm
    magnification = 0.0 if np.isinf(lens.object_distance_mm) else abs(lens.magnification)
    blur_mm = 1e-3 * blur_um
    beyond = magnification * pupil_mm - blur_mm  # the blur at infinity, minus the allowed blur
    return focal_mm * pupil_mm / (magnification * pupil_mm + blur_mm), (
        focal_mm * pupil_mm / beyond if beyond > 0 else np.inf)


def focus_in_capture(lens: Lens, capture: PixelGrid, rows: np.ndarray, columns: np.ndarray) -> float | np.ndarray:
    """The inverse depth in focus at pixels of a capture, per mm: an array if the plane of focus leans.

    Beyond 90 degrees from the axis, it is as on the axis.
    """
    if not any(lens.focus_slope):
        return focus_nearness(lens)
    nearness = focus_nearness(lens, *from_capture(*capture.position_mm(rows, columns), lens, capture))
    return np.where(np.isnan(nearness), focus_nearness(lens), nearness)


def blur_px(lens: Lens, pitch_um: float, depth_mm: ArrayLike,
            in_focus: float | np.ndarray | None = None) -> np.ndarray:
    """Diameter of the defocus blur of points at these depths, signed: positive nearer than the plane of focus.

    It is D f (1 / s - 1 / S), in the notation of `sharp_range_mm`. The difference in blur between two depths is
    therefore independent of the focus distance. A squeezed picture has the blur of its height or width, whichever is
    larger.

    Parameters
    ----------
    lens : Lens
    pitch_um : float
    depth_mm : array
    in_focus : array, optional
        Inverse depths in focus, per mm; by default that on the axis.

    Returns
    -------
    array, in pixels of this pitch
    """
    with np.errstate(divide="ignore"):
        nearness = 1 / np.asarray(depth_mm, dtype=float)
    return blur_per_nearness_px(lens, pitch_um) * (nearness - (focus_nearness(lens) if in_focus is None else in_focus))


def blur_per_nearness_px(lens: Lens, pitch_um: float) -> float:
    """D f in pixels times mm: the derivative of `blur_px` with respect to the inverse depth."""
    per_nearness_px = entrance_pupil_diameter_mm(lens) * lens.capture_focal_length_mm / (pitch_um * 1e-3)
    return per_nearness_px * max(1.0, lens.squeeze**-2)  # along the width, pupil and focal length are over the squeeze


def focus_range_px(lens: Lens, pitch_um: float) -> tuple[float, float]:
    """Largest blur for the in-focus PSFs alone, and smallest blur for rays alone, in pixels of this pitch.

    A wave of defocus is a blur 8 lambda N wide. Up to a quarter of this, diffraction and aberrations are the same as in
    focus. From a wave on, geometry determines the blur, and its rays also determine occlusion. The limits are at least
    SHARP_PX and BLURRED_PX.
    """
    wave_px = 8e-3 * lens.reference_wavelength_nm * lens.rim_f_number / pitch_um
    return max(wave_px / 4, SHARP_PX), max(wave_px, BLURRED_PX)


def focus_share(blur: ArrayLike, range_px: tuple[float, float]) -> np.ndarray:
    """The share of light with this blur that counts as in focus: from 1 to 0, smoothly over `focus_range_px`."""
    sharp, blurred = range_px
    t = np.clip((np.abs(blur) - sharp) / (blurred - sharp), 0, 1)
    return 1 - t * t * (3 - 2 * t)


def planar_depth_mm(depth_mm: ArrayLike, lens: Lens, capture: PixelGrid) -> np.ndarray:
    """Depths along the optical axis, from the depth pass of Cycles.

    The pass contains depths for a perspective camera, but distances from the camera for a panoramic one. At the angle t
    from the axis, the depth is the distance times cos t, and NaN beyond 90 degrees.

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
    if capture.projection.is_plane:
        return depth_mm
    x_mm, y_mm = capture.axes_mm()
    angle_rad = capture.projection.angle_rad(np.hypot(x_mm[None, :], y_mm[:, None]) / lens.capture_focal_length_mm)
    return depth_mm * np.where(angle_rad <= np.pi / 2, np.cos(angle_rad), np.nan)


def check_depth(depth_mm: ArrayLike, lens: Lens, pitch_um: float, blur_um: float | None = None, *,
                empty: ArrayLike = False, in_focus: np.ndarray | None = None,
                light: np.ndarray | None = None) -> DepthCheck:
    """Compare a picture's depths with the range for which the lens's PSFs, computed for one object plane, are valid.

    Parameters
    ----------
    depth_mm : array (row, column)
        Depth of every pixel of the frame along the optical axis from the entrance pupil; see `planar_depth_mm`. Pixels
        with NaN do not count.
    lens : Lens
    pitch_um : float
        Pixel pitch.
    blur_um : float, optional
        Allowed diameter of the defocus blur; one pixel pitch by default.
    empty : bool array (row, column), optional
        Pixels of the background without light, which cannot be out of focus.
    in_focus : array (row, column), optional
        Inverse depths in focus of a plane of focus that leans, per mm; by default that on the axis.
    light : array (row, column), optional
        Of these pixels, in any unit.

    Returns
    -------
    DepthCheck

    Raises
    ------
    ImageError
        If all pixels are NaN.
    """
    depth_mm = np.asarray(depth_mm, dtype=float)
    known = ~np.isnan(depth_mm)
    visible = known & ~np.asarray(empty)
    counted = visible if visible.any() else known
    known_mm = depth_mm[counted]
    if not known_mm.size:
        raise ImageError("depth", "pixels", "empty", "expected at least one pixel with a depth")
    known_mm = np.where(known_mm >= BACKGROUND_MM, np.inf, known_mm)
    blur_um = float(pitch_um if blur_um is None else blur_um)
    near_mm, far_mm = sharp_range_mm(lens, blur_um)
    outside = (known_mm < near_mm) | (known_mm > far_mm)
    if in_focus is not None:
        outside = np.abs(blur_px(lens, pitch_um, known_mm, in_focus[counted])) > blur_um / pitch_um
    return DepthCheck(blur_um, float(near_mm), float(far_mm), float(known_mm.min()), float(known_mm.max()),
                      float(outside.sum() / known.sum()) if visible.any() else 0.0, in_focus is not None,
                      None if light is None else _share(light[counted], outside))


def _share(light, chosen):
    """The share of some pixels in the light, without fireflies."""
    light = np.nan_to_num(np.maximum(light, 0), posinf=0.0)
    return float(light[chosen].sum(dtype=np.float64) / max(light.sum(dtype=np.float64), np.finfo(float).tiny))


def _metres(distance_mm):
    return "infinity" if np.isinf(distance_mm) else f"{distance_mm * 1e-3:.3g} m"
