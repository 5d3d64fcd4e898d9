"""Distortion and relative illumination: polynomial fits over field height, applied pixel by pixel (section 2.2.2)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval

from ...image.pixel_grid import PixelGrid
from ...lens.radial_lens import MonochromaticLens
from ...runtime.errors import LensError
from ..footprints import Footprints

ORDERS = range(4, 9)
DISTORTION_TOLERANCE = 1e-5  # of the last height: 0.03 um for a 3 mm field
ILLUMINATION_TOLERANCE = 1e-3
INVERSE_SAMPLES = 8193  # linear interpolation between them is accurate to 3e-9 of the field

CaptureRadius = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class PolynomialFit:
    """A polynomial in height / scale_mm, without terms below `first_power`.

    `residual` is the largest deviation from the table, in the table's unit; `highest_order` is the highest order for
    the table's number of heights.
    """

    coefficients: np.ndarray
    first_power: int
    scale_mm: float
    residual: float
    highest_order: int

    @property
    def order(self) -> int:
        return self.first_power + self.coefficients.size - 1

    @property
    def _all_coefficients(self):
        return np.concatenate([np.zeros(self.first_power), self.coefficients])

    def __call__(self, height_mm: float | np.ndarray) -> np.ndarray:
        return polyval(np.asarray(height_mm) / self.scale_mm, self._all_coefficients)

    def derivative(self, height_mm: np.ndarray) -> np.ndarray:
        """The polynomial's derivative with respect to height, per mm."""
        return polyval(np.asarray(height_mm) / self.scale_mm, polyder(self._all_coefficients)) / self.scale_mm


def fit_polynomial(heights_mm: np.ndarray, values: np.ndarray, first_power: int, tolerance: float) -> PolynomialFit:
    """Least-squares polynomial in normalised height, of the lowest order from 4 to 8 that meets `tolerance`.

    If none meets it, the order with the smallest residual is used. A table has at least two more heights than the
    order; a table too small for order 4 is interpolated by the polynomial through all its heights.

    Parameters
    ----------
    heights_mm, values : arrays (height,)
    first_power : int
        1 for a quantity that is zero on the axis, else 0.
    tolerance : float
        Target for the largest deviation, in the unit of `values`.

    Returns
    -------
    PolynomialFit
    """
    scale_mm = heights_mm[-1]
    orders = [order for order in ORDERS if order <= heights_mm.size - 2] or [heights_mm.size - 1]
    fits: list[PolynomialFit] = []
    for order in orders:
        powers = (heights_mm / scale_mm)[:, None] ** np.arange(first_power, order + 1)
        coefficients = np.linalg.lstsq(powers, values, rcond=None)[0]
        residual = float(np.abs(powers @ coefficients - values).max())
        fits.append(PolynomialFit(coefficients, first_power, float(scale_mm), residual, orders[-1]))
        if residual <= tolerance:
            break
    return min(fits, key=lambda fit: fit.residual)


class FieldGeometry:
    """Chief-ray height and relative illumination over the field, at one wavelength.

    Beyond the last tabulated height, the distortion is extrapolated linearly and the relative illumination is
    constant; `Options.out_of_field` sets whether light is placed there.

    Raises
    ------
    LensError
        If the distortion folds the field back over itself.
    """

    def __init__(self, optics: MonochromaticLens, lens_name: str) -> None:
        heights = optics.heights_mm
        self.distortion = fit_polynomial(heights, optics.real_height_mm, 1, DISTORTION_TOLERANCE * heights[-1])
        self.illumination = fit_polynomial(heights, optics.relative_illumination, 0, ILLUMINATION_TOLERANCE)
        self._point_flux = fit_polynomial(heights, optics.point_flux, 0, ILLUMINATION_TOLERANCE)
        self._paraxial_mm = np.linspace(0, heights[-1], INVERSE_SAMPLES)
        self._real_mm = self.distortion(self._paraxial_mm)
        steps = np.diff(self._real_mm)
        if np.any(steps <= 0):
            turn = self._paraxial_mm[np.argmax(steps <= 0)]
            raise LensError(lens_name, "real_height_mm", f"falling at a paraxial height of {turn:.4g} mm",
                            f"distortion must be monotonic over the field in use (at {optics.wavelength_nm:g} nm)")
        self.last_real_mm = float(self._real_mm[-1])
        self._magnification_on_axis = self._real_mm[1] / self._paraxial_mm[1]
        self._magnification_at_edge = float(self.distortion.derivative(heights[-1]))

    @property
    def nbytes(self) -> int:
        return self._paraxial_mm.nbytes + self._real_mm.nbytes

    def paraxial_height_mm(self, real_height_mm: np.ndarray) -> np.ndarray:
        """Paraxial height of the chief ray that meets the image plane at this real height."""
        beyond = np.maximum(real_height_mm - self.last_real_mm, 0)
        inside = np.interp(real_height_mm, self._real_mm, self._paraxial_mm)
        return inside + beyond / self._magnification_at_edge

    def real_height_mm(self, paraxial_height_mm: np.ndarray) -> np.ndarray:
        """Real height at which the chief ray of this paraxial height meets the image plane; the inverse."""
        beyond = np.maximum(paraxial_height_mm - self._paraxial_mm[-1], 0)
        inside = np.interp(paraxial_height_mm, self._paraxial_mm, self._real_mm)
        return inside + beyond * self._magnification_at_edge

    def paraxial_per_real(self, real_height_mm: np.ndarray, paraxial_height_mm: np.ndarray) -> np.ndarray:
        """Ratio of the two heights, with its limit on the axis."""
        on_axis = real_height_mm < self._paraxial_mm[1] * 1e-3
        return np.where(on_axis, 1 / self._magnification_on_axis,
                        paraxial_height_mm / np.where(on_axis, 1, real_height_mm))

    def paraxial_slope(self, paraxial_height_mm: np.ndarray) -> np.ndarray:
        """Derivative of the paraxial height with respect to the real height: the radial compression by the lens."""
        inside = paraxial_height_mm <= self._paraxial_mm[-1]
        magnification = self.distortion.derivative(np.where(inside, paraxial_height_mm, 0))
        return 1 / np.where(inside, magnification, self._magnification_at_edge)

    def relative_illumination(self, paraxial_height_mm: np.ndarray) -> np.ndarray:
        """Relative illumination at this paraxial height, constant beyond the last tabulated height."""
        held = np.minimum(paraxial_height_mm, self._paraxial_mm[-1])
        return np.maximum(self.illumination(held), 0)

    def relative_flux(self, paraxial_height_mm: np.ndarray) -> np.ndarray:
        """Relative flux of points at this paraxial height, before their PSFs spread it: relative illumination times
        `point_flux`."""
        held = np.minimum(paraxial_height_mm, self._paraxial_mm[-1])
        return self.relative_illumination(held) * np.maximum(self._point_flux(held), 0)


def footprints(capture: PixelGrid, x_mm: np.ndarray, y_mm: np.ndarray, field: FieldGeometry,
               capture_radius: CaptureRadius | None = None,
               precision: str = "float64", parts: float = 1) -> tuple[Footprints, np.ndarray]:
    """The areas of an ideal capture from which the pixels of a grid, distorted by the lens, receive their light.

    Each pixel averages the capture over its footprint, around the ideal position of the pixel's chief ray. This avoids
    overshoot and negative light. Where the lens stretches the picture, it is bilinear interpolation. An area factor on
    radiance is unnecessary: the change of area is part of the relative illumination.

    Parameters
    ----------
    capture : PixelGrid
        With a black rim of RIM_PX, which represents everything outside.
    x_mm, y_mm : arrays (column,) and (row,)
        Positions of the grid's pixels, with the same pitch, relative to the axis.
    field : FieldGeometry
    capture_radius : callable (paraxial_height_mm) -> (radius_mm, slope), optional
        Radius of a paraxial height in a capture other than a plane, and its derivative.
    precision : dtype
        Precision of the shares.

    Returns
    -------
    Footprints
    paraxial_height_mm : array (row, column)
        The height that each pixel's light comes from, for PSF and relative illumination.
    """
    real_mm = np.hypot(x_mm[None, :], y_mm[:, None])
    paraxial_mm, tangential, radial = squeeze(real_mm, field, capture_radius)
    row = capture.centre_px[0] - y_mm[:, None] * tangential / (capture.pitch_um * 1e-3)
    column = capture.centre_px[1] + x_mm[None, :] * tangential / (capture.pitch_um * 1e-3)
    cos_squared = (x_mm[None, :] / np.maximum(real_mm, np.finfo(float).tiny)) ** 2
    heights, widths = (parts * (one + (other - one) * cos_squared)
                       for one, other in ((radial, tangential), (tangential, radial)))
    return Footprints.of(row, column, heights, widths, capture.shape_px, precision), paraxial_mm


def squeeze(real_mm: np.ndarray, field: FieldGeometry,
            capture_radius: CaptureRadius | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Paraxial height and compression of a capture at real heights: (paraxial_mm, tangential, radial).

    The tangential compression is the radius in the capture over the real height; the radial one is the derivative of
    this radius.
    """
    paraxial_mm = field.paraxial_height_mm(real_mm)
    tangential = field.paraxial_per_real(real_mm, paraxial_mm)
    radial = field.paraxial_slope(paraxial_mm)
    if capture_radius:
        radius_mm, slope = capture_radius(paraxial_mm)
        tangential = tangential * np.divide(radius_mm, paraxial_mm, out=np.array(slope), where=paraxial_mm > 0)
        radial = radial * slope
    return paraxial_mm, tangential, radial
