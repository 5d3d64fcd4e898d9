"""Distortion and relative illumination: polynomial fits over field height, applied pixel by pixel (section 2.2.2)."""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval

from .errors import LensError

ORDERS = range(4, 9)
DISTORTION_TOLERANCE = 1e-5  # of the last height: 0.03 um for a 3 mm field
ILLUMINATION_TOLERANCE = 1e-3
LARGEST_FOOTPRINT_PX = 16  # where a lens squeezes the picture more than this, the footprint's middle stands for it
INVERSE_SAMPLES = 4097  # linear interpolation between them is good to 1e-8 of the field


@dataclass(frozen=True, eq=False)
class PolynomialFit:
    """A polynomial in height / scale_mm, without terms below `first_power`.

    `residual` is the largest deviation from the table, in the table's unit.
    """

    coefficients: np.ndarray
    first_power: int
    scale_mm: float
    residual: float

    @property
    def order(self):
        return self.first_power + self.coefficients.size - 1

    @property
    def _all_coefficients(self):
        return np.concatenate([np.zeros(self.first_power), self.coefficients])

    def __call__(self, height_mm):
        return polyval(np.asarray(height_mm) / self.scale_mm, self._all_coefficients)

    def derivative(self, height_mm):
        """The polynomial's derivative by height, per mm."""
        return polyval(np.asarray(height_mm) / self.scale_mm, polyder(self._all_coefficients)) / self.scale_mm


def fit_polynomial(heights_mm, values, first_power, tolerance):
    """Least-squares polynomial in normalised height, of the least order from 4 to 8 that meets `tolerance`.

    Where none meets it, the order of the least residual. There are always two more heights than the order; a table
    too small for order 4 is interpolated by the polynomial that meets all its heights.

    Parameters
    ----------
    heights_mm, values : arrays (height,)
    first_power : int
        1 for a quantity that is zero on the axis, else 0.
    tolerance : float
        Largest deviation wanted, in the unit of `values`.

    Returns
    -------
    PolynomialFit
    """
    scale_mm = heights_mm[-1]
    orders = [order for order in ORDERS if order <= heights_mm.size - 2] or [heights_mm.size - 1]
    best = None
    for order in orders:
        powers = (heights_mm / scale_mm)[:, None] ** np.arange(first_power, order + 1)
        coefficients = np.linalg.lstsq(powers, values, rcond=None)[0]
        residual = float(np.abs(powers @ coefficients - values).max())
        if best is None or residual < best.residual:
            best = PolynomialFit(coefficients, first_power, float(scale_mm), residual)
        if best.residual <= tolerance:
            break
    return best


class FieldGeometry:
    """Chief-ray height and relative illumination over the field, at one wavelength.

    Beyond the last tabulated height the distortion goes on in a straight line and the relative illumination is
    held; `Options.out_of_field` says whether any light is put there.

    Raises
    ------
    LensError
        Where the distortion folds the field back over itself.
    """

    def __init__(self, optics, lens_name):
        heights = optics.heights_mm
        self.distortion = fit_polynomial(heights, optics.real_height_mm, 1, DISTORTION_TOLERANCE * heights[-1])
        self.illumination = fit_polynomial(heights, optics.relative_illumination, 0, ILLUMINATION_TOLERANCE)
        self._paraxial_mm = np.linspace(0, heights[-1], INVERSE_SAMPLES)
        self._real_mm = self.distortion(self._paraxial_mm)
        steps = np.diff(self._real_mm)
        if np.any(steps <= 0):
            turn = self._paraxial_mm[np.argmax(steps <= 0)]
            raise LensError(lens_name, "real_height_mm", f"falling at a paraxial height of {turn:.4g} mm",
                            f"distortion must be monotonic over the field used (at {optics.wavelength_nm:g} nm)")
        self.last_real_mm = float(self._real_mm[-1])
        self._magnification_on_axis = self._real_mm[1] / self._paraxial_mm[1]
        self._magnification_at_edge = (self._real_mm[-1] - self._real_mm[-2]) / self._paraxial_mm[1]

    def paraxial_height_mm(self, real_height_mm):
        """Paraxial height of the chief ray that meets the image plane at this real height."""
        beyond = np.maximum(real_height_mm - self.last_real_mm, 0)
        inside = np.interp(real_height_mm, self._real_mm, self._paraxial_mm)
        return inside + beyond / self._magnification_at_edge

    def paraxial_per_real(self, real_height_mm, paraxial_height_mm):
        """Ratio of the two heights, with its limit on the axis."""
        on_axis = real_height_mm < self._paraxial_mm[1] * 1e-3
        return np.where(on_axis, 1 / self._magnification_on_axis,
                        paraxial_height_mm / np.where(on_axis, 1, real_height_mm))

    def paraxial_slope(self, paraxial_height_mm):
        """Change of the paraxial height with the real one: how much a lens squeezes the picture, radially."""
        inside = paraxial_height_mm <= self._paraxial_mm[-1]
        magnification = self.distortion.derivative(np.where(inside, paraxial_height_mm, 0))
        return 1 / np.where(inside, magnification, self._magnification_at_edge)

    def relative_illumination(self, paraxial_height_mm):
        """Relative illumination at this paraxial height, held beyond the last tabulated one."""
        held = np.minimum(paraxial_height_mm, self._paraxial_mm[-1])
        return np.maximum(self.illumination(held), 0)


def distort(framed, source_centre_px, x_mm, y_mm, pitch_um, field):
    """Lay an ideal image plane where the lens really puts it.

    Each target pixel averages the source over its own footprint there, about the ideal position of the chief ray
    that meets it. So neither even light nor single points gain or lose energy, nothing overshoots, and no light turns
    negative. Where the lens stretches the picture this is bilinear interpolation. What lies outside the source is
    black. Radiance needs no area factor: the change of area is part of the relative illumination.

    Parameters
    ----------
    framed : array (row, column)
        The source with a rim of one black pixel, which is read for all that lies outside.
    source_centre_px : (float, float)
        Row and column of the optical axis in it.
    x_mm, y_mm : arrays (column,) and (row,)
        Where the target's pixels are, about the axis.
    pitch_um : float
        Pixel pitch of the source.
    field : FieldGeometry

    Returns
    -------
    distorted : array (row, column) of the target
    paraxial_height_mm : array (row, column)
        The height that each target pixel's light came from, by which PSF and relative illumination are looked up.
    """
    real_mm = np.hypot(x_mm[None, :], y_mm[:, None])
    paraxial_mm = field.paraxial_height_mm(real_mm)
    tangential = field.paraxial_per_real(real_mm, paraxial_mm)
    radial = field.paraxial_slope(paraxial_mm)
    row = source_centre_px[0] - y_mm[:, None] * tangential / (pitch_um * 1e-3)
    column = source_centre_px[1] + x_mm[None, :] * tangential / (pitch_um * 1e-3)
    cos_squared = (x_mm[None, :] / np.maximum(real_mm, np.finfo(float).tiny)) ** 2
    height_px = radial + (tangential - radial) * cos_squared
    width_px = tangential + (radial - tangential) * cos_squared
    return _average_over(framed, row, height_px, column, width_px), paraxial_mm


def _average_over(framed, row, height_px, column, width_px):
    """Averages over rectangles about these positions, in index terms, of 1 to LARGEST_FOOTPRINT_PX each way."""
    first_row, row_shares = _overlaps(row, np.clip(height_px, 1, LARGEST_FOOTPRINT_PX))
    first_column, column_shares = _overlaps(column, np.clip(width_px, 1, LARGEST_FOOTPRINT_PX))
    columns = [np.clip(first_column + k, 0, framed.shape[1] - 1) for k in range(len(column_shares))]
    values = framed.ravel()
    total = np.zeros(row.shape)
    for k, row_share in enumerate(row_shares):
        start = np.clip(first_row + k, 0, framed.shape[0] - 1) * framed.shape[1]
        total += row_share * sum(share * values[start + across] for share, across in zip(column_shares, columns))
    return total


def _overlaps(position, extent_px):
    """First pixel that each interval about a position touches, and the shares of the interval in it and the next."""
    begin = position - extent_px / 2
    first = np.floor(begin + 0.5).astype(np.intp)
    up_to = [np.clip((first + k + 0.5 - begin) / extent_px, 0, 1) for k in range(int(np.ceil(extent_px.max())) + 1)]
    return first, [up_to[0], *(later - earlier for earlier, later in zip(up_to, up_to[1:]))]


def overscan_px(lens, frame_px, pitch_um, wavelengths_nm, psf_radius_px):
    """Rows and columns that a capture needs beyond the frame, for distortion and the reach of the PSFs.

    Parameters
    ----------
    lens : Lens
    frame_px : (int, int)
        Rows and columns of the sensor's frame, the axis in its middle.
    pitch_um : float
    wavelengths_nm : sequence of float
    psf_radius_px : int
        Pixels that a PSF reaches from its centre.

    Returns
    -------
    (int, int), at least psf_radius_px + 1 each
    """
    half = np.array(frame_px) / 2 + psf_radius_px
    side_mm = [np.linspace(0, extent, 65) * pitch_um * 1e-3 for extent in half]
    needed = half.copy()
    for wavelength_nm in wavelengths_nm:
        field = FieldGeometry(lens.at_wavelength(wavelength_nm), lens.name)
        for axis in (0, 1):
            edge_mm, along_mm = side_mm[axis][-1], side_mm[1 - axis]
            real_mm = np.hypot(edge_mm, along_mm)
            ratio = field.paraxial_per_real(real_mm, field.paraxial_height_mm(real_mm))
            needed[axis] = max(needed[axis], half[axis] * ratio.max())
    return tuple(int(np.ceil(needed[axis] - frame_px[axis] / 2)) + 1 for axis in (0, 1))
