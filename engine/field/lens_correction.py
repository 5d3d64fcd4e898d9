"""The correction of a lens's distortion, lateral colour and falloff, in the polynomials of raw files.

DNG's opcodes WarpRectilinear and FixVignetteRadial (DNG 1.6, chapter 7) measure radii from the optical axis in units of
the distance to the farthest pixel. The gain compensates for the falloff first. The warp then gives, for each place in
the straightened picture, the place in the lens's picture: for light of radius r, r (k0 + k1 r^2 + k2 r^4 + k3 r^6).
"""

from dataclasses import dataclass

import numpy as np

from ..image.pixel_grid import PixelGrid
from ..lens.lens import Lens
from ..runtime.values import Value
from .field_map import field_map

WARP_POWERS, GAIN_POWERS = np.arange(0, 8, 2), np.arange(2, 12, 2)
FIT_RADII = np.linspace(0, 1, 257)[1:]
STRONGEST_DISTORTION = 0.25  # beyond it, a lens is a fisheye: straightened, most of its picture would be lost
LARGEST_DISTORTION_ERROR = 3e-3  # of the distance from the axis: straight lines look straight
LARGEST_GAIN, LARGEST_GAIN_ERROR = 16.0, 0.05  # darker corners stay dark


@dataclass(frozen=True, eq=False, repr=False)
class LensCorrection(Value):
    """Polynomials that correct a lens's picture.

    Attributes
    ----------
    centre : (float, float)
        The optical axis: 0 in the first pixel of a column and of a row, 1 in the last.
    warp : array (channel, 4) or None
        Coefficients of r^0 to r^6; None if the lens's distortion is not corrected.
    gain : array (5,) or None
        Coefficients of r^2 to r^10 of the gain minus 1; None if the falloff is not corrected.
    distortion : float
        Of the lens at the farthest pixel, relative to the distance from the axis.
    distortion_error, gain_error : float
        Largest relative errors of the polynomials.
    magnification : float
        Of the straightened picture in its middle. It is 1 unless the lens's picture would not fill the frame.
    """

    centre: tuple[float, float]
    warp: np.ndarray | None
    gain: np.ndarray | None
    distortion: float
    distortion_error: float
    gain_error: float
    magnification: float

    @property
    def remarks(self) -> list[str]:
        """A line, with the reason, for each uncorrected aberration."""
        lines = []
        if self.warp is None:
            strong = abs(self.distortion) > STRONGEST_DISTORTION
            reason = f"more than {STRONGEST_DISTORTION:.0%}" if strong else self._reason(self.distortion_error)
            lines.append(f"the raw file does not correct the lens's distortion of {self.distortion:.1%}: {reason}")
        if self.gain is None:
            lines.append(f"the raw file does not correct the lens's falloff: {self._reason(self.gain_error)}")
        return lines

    def _reason(self, error):
        inside = all(0 <= place <= 1 for place in self.centre)
        return f"its polynomial would be {error:.2%} off" if inside else "the optical axis is outside the frame"


def lens_correction(lens: Lens, frame: PixelGrid, wavelengths_nm: np.ndarray, weights: np.ndarray) -> LensCorrection:
    """The correction of a lens's picture in a camera's channels.

    Parameters
    ----------
    lens : Lens
    frame : PixelGrid
        Of the raw picture, which may be off the lens's axis.
    wavelengths_nm : array (wavelength,)
    weights : array (channel, wavelength)
        Share of each wavelength in a channel's light in front of the lens.

    Returns
    -------
    LensCorrection
        Without polynomials that cannot describe this lens to LARGEST_DISTORTION_ERROR or LARGEST_GAIN_ERROR.
    """
    nearest_px, farthest_px = _border_px(frame)
    nm = lens.nearest_nm(wavelengths_nm)
    shares = weights * np.interp(nm, lens.wavelengths_nm, lens.transmittance)
    shares /= shares.sum(axis=1, keepdims=True)
    at_mm, axis_mm = FIT_RADII * farthest_px * frame.pitch_um * 1e-3, np.zeros_like(FIT_RADII)
    source = shares @ [field.source_mm(at_mm, axis_mm)[0] for field in _fields(lens, nm)] / at_mm
    shrinkage = min(1.0, float(source[:, FIT_RADII * farthest_px >= nearest_px].min()))
    landing = shares @ [field.landing_mm(shrinkage * at_mm, axis_mm)[0] for field in _fields(lens, nm)] / at_mm
    distortion = float(landing[:, -1].mean() / shrinkage - 1)
    warp, distortion_error = _fitted(landing, WARP_POWERS, landing)
    middle, = _fields(lens, [shares.mean(axis=0) @ nm])  # falloff hardly varies with wavelength
    gain = 1 / np.maximum(middle.relative_illumination(at_mm, axis_mm), 1 / LARGEST_GAIN)
    falloff, gain_error = _fitted(gain - 1, GAIN_POWERS, gain)
    straight = distortion_error <= LARGEST_DISTORTION_ERROR and abs(distortion) <= STRONGEST_DISTORTION
    even, inside = gain_error <= LARGEST_GAIN_ERROR, nearest_px >= 0
    return LensCorrection(_centre(frame), warp if inside and straight else None, falloff if inside and even else None,
                          distortion, distortion_error, gain_error, 1 / shrinkage)


def _fields(lens, wavelengths_nm):
    """The lens at each wavelength, one after another, because each may have its own PSFs in memory."""
    return (field_map(lens).at_wavelength(float(nm)) for nm in wavelengths_nm)


def _centre(frame):
    """Position of the axis, to the right and down, in the frame."""
    down, right = np.divide(frame.centre_px, np.maximum(np.subtract(frame.shape_px, 1), 1))
    return float(right), float(down)


def _border_px(frame):
    """Distances of the nearest border and of the farthest pixel from the axis."""
    before, after = np.array(frame.centre_px), np.subtract(frame.shape_px, 1) - frame.centre_px
    return float(np.minimum(before, after).min()), max(1.0, float(np.hypot(*np.maximum(before, after))))


def _fitted(values, powers, scale):
    """Coefficients of curves (..., radius) with the least relative squares, and the largest error relative to `scale`.
    """
    terms = FIT_RADII[:, None]**powers
    rows = np.atleast_2d(values)
    fits = np.stack([np.linalg.lstsq(terms / each[:, None], row / each, rcond=None)[0]
                     for row, each in zip(rows, np.atleast_2d(scale), strict=True)])
    error = float(np.abs((fits @ terms.T - rows) / scale).max())
    return fits.reshape(*values.shape[:-1], powers.size), error
