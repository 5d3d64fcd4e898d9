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
SPARE = 2  # least number of heights that a table has beyond the order of its polynomial
DISTORTION_TOLERANCE = 1e-5  # of the last real height: 0.03 um for a 3 mm field
ILLUMINATION_TOLERANCE = 1e-3
STEEP = 2.0  # tangent of the last field angle: the data of wider lenses are smoother over angles, and a polynomial in
# height may meet all of them and swing by percents of the field between them
INVERSE_SAMPLES = 8193  # linear interpolation between them is accurate to 3e-9 of the field

CaptureRadius = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class PolynomialFit:
    """A polynomial in height / scale_mm, without terms below `first_power`; or, with a finite focal length, in the
    field angle relative to the one of scale_mm.

    `residual` is the largest deviation from the table, in the table's unit; `left_out` is the same for fits that each
    leave one height out, and predict its value. `highest_order` is the highest order for the table's number of heights.
    """

    coefficients: np.ndarray
    first_power: int
    scale_mm: float
    residual: float
    left_out: float
    highest_order: int
    focal_mm: float = np.inf

    @property
    def order(self) -> int:
        return self.first_power + self.coefficients.size - 1

    @property
    def _all_coefficients(self):
        return np.concatenate([np.zeros(self.first_power), self.coefficients])

    def __call__(self, height_mm: float | np.ndarray) -> np.ndarray:
        return polyval(variable(height_mm, self.scale_mm, self.focal_mm), self._all_coefficients)

    def derivative(self, height_mm: np.ndarray) -> np.ndarray:
        """The polynomial's derivative with respect to height, per mm."""
        slope = polyval(variable(height_mm, self.scale_mm, self.focal_mm), polyder(self._all_coefficients))
        if np.isinf(self.focal_mm):
            return slope / self.scale_mm
        last_rad = np.arctan(self.scale_mm / self.focal_mm)
        return slope / (last_rad * self.focal_mm * (1 + np.square(height_mm / self.focal_mm)))


def variable(height_mm: float | np.ndarray, scale_mm: float, focal_mm: float) -> np.ndarray:
    """The variable of a `PolynomialFit`: 0 on the axis, 1 at scale_mm."""
    if np.isinf(focal_mm):
        return np.asarray(height_mm) / scale_mm
    return np.arctan(np.asarray(height_mm) / focal_mm) / np.arctan(scale_mm / focal_mm)


def fit_polynomial(heights_mm: np.ndarray, values: np.ndarray, first_power: int, tolerance: float,
                   focal_mm: float = np.inf) -> PolynomialFit:
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
    focal_mm : float
        As of `PolynomialFit`.

    Returns
    -------
    PolynomialFit
    """
    scale_mm = heights_mm[-1]
    orders = [order for order in ORDERS if order <= heights_mm.size - SPARE] or [heights_mm.size - 1]
    fits: list[PolynomialFit] = []
    for order in orders:
        powers = variable(heights_mm, scale_mm, focal_mm)[:, None] ** np.arange(first_power, order + 1)
        coefficients = np.linalg.lstsq(powers, values, rcond=None)[0]
        deviation = np.abs(powers @ coefficients - values)
        leverage = np.square(np.linalg.qr(powers).Q).sum(axis=1)
        left_out = float((deviation / np.maximum(1 - leverage, np.finfo(float).eps)).max())
        residual = float(deviation.max())
        fits.append(PolynomialFit(coefficients, first_power, float(scale_mm), residual, left_out, orders[-1], focal_mm))
        if residual <= tolerance:
            break
    return min(fits, key=lambda fit: fit.residual)


def fit_distortion(optics: MonochromaticLens) -> PolynomialFit:
    """Real heights over the heights of lens data."""
    return _fit(optics, optics.real_height_mm, 1, DISTORTION_TOLERANCE * optics.real_height_mm[-1])


def fit_illumination(optics: MonochromaticLens) -> PolynomialFit:
    """Relative illumination over the heights of lens data, up to the last one that is lit."""
    return _fit_lit(optics, optics.relative_illumination)


def _fit_lit(optics, table):
    return _fit(optics, table[:lit_heights(optics.relative_illumination)], 0, ILLUMINATION_TOLERANCE)


def _fit(optics, table, first_power, tolerance):
    """The polynomial over the first heights of lens data, or over angles if these fit a very wide field well: within
    tolerance, or better between the heights, as heights that are left out show. A fit through all heights of a small
    table says nothing about the field between them."""
    heights_mm, focal_mm = optics.heights_mm[:table.size], optics.capture_focal_length_mm
    over_angles = heights_mm[-1] > STEEP * focal_mm and heights_mm.size - SPARE >= ORDERS[0]
    fits = []
    for focal in [focal_mm, np.inf] if over_angles else [np.inf]:
        fits.append(fit_polynomial(heights_mm, table, first_power, tolerance, focal))
        if fits[-1].residual <= tolerance:
            return fits[-1]
    return min(fits, key=lambda fit: fit.left_out)


def lit_heights(illumination: np.ndarray) -> int:
    """Number of heights up to the last one that is lit."""
    return int(np.flatnonzero(illumination)[-1]) + 1


def _evenly(last_mm, focal_mm):
    """Heights from 0 to the last, at equal distances or angles."""
    even = np.linspace(0, 1, INVERSE_SAMPLES)
    if np.isinf(focal_mm):
        return even * last_mm
    return focal_mm * np.tan(even * np.arctan(last_mm / focal_mm))


class FieldGeometry:
    """Chief-ray height and relative illumination over the field, at one wavelength.

    Beyond the last tabulated height, the distortion is extrapolated linearly and the relative illumination is
    constant; `Options.out_of_field` sets whether light is placed there. If the last heights of the data are dark, light
    ends at the first of these.

    Raises
    ------
    LensError
        If the distortion folds the field back over itself.
    """

    def __init__(self, optics: MonochromaticLens, lens_name: str) -> None:
        heights, lit = optics.heights_mm, lit_heights(optics.relative_illumination)
        self.distortion, self.illumination = fit_distortion(optics), fit_illumination(optics)
        self._point_flux = _fit_lit(optics, optics.point_flux)
        self._lit_mm, self._dark_mm = heights[lit - 1], heights[lit] if lit < heights.size else np.inf
        self._paraxial_mm = _evenly(heights[-1], self.distortion.focal_mm)
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
        """Relative illumination at this paraxial height: beyond the last tabulated height that is lit, constant, or 0
        from the next one on."""
        held = np.minimum(paraxial_height_mm, self._lit_mm)
        return np.maximum(self.illumination(held), 0) * self._lit_share(paraxial_height_mm)

    def relative_flux(self, paraxial_height_mm: np.ndarray) -> np.ndarray:
        """Relative flux of points at this paraxial height, before their PSFs spread it: relative illumination times
        `point_flux`."""
        held = np.minimum(paraxial_height_mm, self._lit_mm)
        return self.relative_illumination(paraxial_height_mm) * np.maximum(self._point_flux(held), 0)

    def _lit_share(self, paraxial_height_mm):
        """1 up to the last tabulated height that is lit, falling to 0 at the next one."""
        if np.isinf(self._dark_mm):
            return 1.0
        return np.interp(paraxial_height_mm, (self._lit_mm, self._dark_mm), (1.0, 0.0))


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
