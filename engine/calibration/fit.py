"""Calibrations: models fitted to the rays of a frame, by least squares of their distances in pixels."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ..image.pixel_grid import PixelGrid
from ..lens import Lens
from ..lens.entrance_pupil import entrance_pupil_diameter_mm
from .models import Model
from .rays import FrameRays, frame_rays

TARGET_PX = 0.1
ALIKE = 1.1
TOLERANCE, MOST_STEPS = 1e-12, 200


@dataclass(frozen=True)
class Calibration:
    """A camera model of a lens in front of a frame.

    Attributes
    ----------
    model : Model
    frame : PixelGrid
    focal_px, principal_px : (float, float)
        fx and fy; cx and cy, where 0, 0 is the middle of the upper left pixel, as in OpenCV.
    coefficients : tuple of float
        Of the model.
    rms_px, largest_px : float
        Distances in the frame between the pixels of the model and of the lens.
    covered : float
        The fraction of the frame that the lens data cover: the model was fitted to it.
    lens : str
    focus_mm : float
        From the entrance pupil; inf for infinity.
    f_number, wavelength_nm : float
    largest_angle_deg : float
        Of light in the frame, from the axis.
    tangents : (float, float, float, float)
        The extent of the frame's light on a plane: to the left, upwards, to the right and downwards.
    f_stop : float
        Focal length over the diameter of the entrance pupil; `f_number` is the effective one, by the light.
    entrance_pupil_mm : float or None
        From the image plane towards the object; None for lens data without surfaces.
    """

    model: Model
    frame: PixelGrid
    focal_px: tuple[float, float]
    principal_px: tuple[float, float]
    coefficients: tuple[float, ...]
    rms_px: float
    largest_px: float
    covered: float
    lens: str
    focus_mm: float
    f_number: float
    wavelength_nm: float
    largest_angle_deg: float
    tangents: tuple[float, float, float, float]
    f_stop: float
    entrance_pupil_mm: float | None

    @property
    def size_px(self) -> tuple[int, int]:
        """Columns and rows."""
        rows, columns = self.frame.shape_px
        return columns, rows

    @property
    def by_name(self) -> dict[str, float]:
        """The coefficients by name."""
        return dict(zip(self.model.coefficients, self.coefficients, strict=True))

    def opencv_coefficients(self, count: int) -> list[float]:
        """The first coefficients in OpenCV's order, k1 k2 p1 p2 k3 ..., or k1 k2 k3 k4 of a fisheye; 0 if the model
        lacks them."""
        order = ("k1 k2 k3 k4" if self.model.fisheye else "k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4").split()
        return [self.by_name.get(name, 0.0) for name in order[:count]]

    @property
    def overscan_px(self) -> tuple[float, float, float, float]:
        """How far the undistorted frame reaches beyond the frame: to the left, upwards, to the right and downwards.

        Undistorted, pixels on the axis keep their size and place.
        """
        left, up, right, down = self.tangents
        (fx, fy), (cx, cy), (columns, rows) = self.focal_px, self.principal_px, self.size_px
        return (fx * left - cx - 0.5, fy * up - cy - 0.5, fx * right + cx - columns + 0.5, fy * down + cy - rows + 0.5)

    def pixels(self, directions: np.ndarray) -> np.ndarray:
        """Columns and rows of light from directions, (place, 3) as `FrameRays.directions`: array (place, 2)."""
        return self.model.place(directions, np.array(self.coefficients)) * self.focal_px + self.principal_px


def calibrate(lens: Lens, frame: PixelGrid, wavelength_nm: float, models: Sequence[Model],
              target_px: float = TARGET_PX) -> Calibration:
    """The calibration of a lens by the first model whose largest residual is at most `target_px`. Otherwise, by the
    first that is at most ALIKE times as far off as the closest.

    Parameters
    ----------
    lens : Lens
    frame : PixelGrid
        Without overscan.
    wavelength_nm : float
    models : sequence of Model
        From the simplest.
    target_px : float

    Returns
    -------
    Calibration

    Raises
    ------
    LensError
        As `frame_rays`.
    """
    rays, fits = frame_rays(lens, frame, wavelength_nm), []
    for model in models:
        fits.append((model, *_fit(rays, model)))
        if fits[-1][-1].max() <= target_px:
            break
    enough_px = max(target_px, ALIKE * min(fit[-1].max() for fit in fits))
    model, focal_px, principal_px, coefficients, off_px = next(fit for fit in fits if fit[-1].max() <= enough_px)
    return Calibration(
        model, frame, focal_px, principal_px, coefficients, float(np.sqrt(np.mean(off_px**2))), float(off_px.max()),
        rays.covered, lens.name, lens.object_distance_mm + lens.entrance_pupil_mm, lens.f_number_effective,
        wavelength_nm, float(np.degrees(np.arctan(np.hypot(*rays.directions[:, :2].T).max()))), rays.tangents,
        lens.efl_mm / entrance_pupil_diameter_mm(lens), _entrance_pupil_mm(lens))


def _entrance_pupil_mm(lens):
    if lens.prescription is None:
        return None
    return sum(surface.thickness_mm for surface in lens.prescription.surfaces) - lens.entrance_pupil_mm


def _fit(rays: FrameRays, model: Model):
    """Focal lengths, principal point, coefficients, and distances in pixels: array (place,).

    The principal point of a rotationally symmetric lens is its axis, and both focal lengths are equal.
    """
    free = model.symmetric if rays.symmetric else np.ones(len(model.coefficients), bool)
    focal_start = rays.focal_px[1:] if rays.symmetric or model.one_focal else rays.focal_px
    start = *focal_start, *(() if rays.symmetric else rays.axis_px)

    def parts(values):
        focal_px, principal_px = values[:len(focal_start)], values[len(focal_start):len(start)]
        coefficients = np.zeros(free.size)
        coefficients[free] = values[len(start):]
        return (np.broadcast_to(focal_px, 2), np.array(rays.axis_px) if rays.symmetric else principal_px, coefficients)

    def off_px(values):
        focal_px, principal_px, coefficients = parts(values)
        return model.place(rays.directions, coefficients) * focal_px + principal_px - rays.pixels

    limits = np.array([(-np.inf, np.inf)] * len(start) + [model.limits] * int(free.sum())).T
    solution = scipy.optimize.least_squares(
        lambda values: off_px(values).ravel(), (*start, *np.array(model.start)[free]), bounds=tuple(limits),
        x_scale="jac", ftol=TOLERANCE, xtol=TOLERANCE, gtol=TOLERANCE, max_nfev=MOST_STEPS).x
    focal_px, principal_px, coefficients = (tuple(each.tolist()) for each in parts(solution))
    return focal_px, principal_px, coefficients, np.hypot(*off_px(solution).T)
