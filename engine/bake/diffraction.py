"""Point spread functions: the plane waves of a pupil summed up on the flat image plane.

The wavefront is a polynomial over direction cosines, known on an even grid of them. So the sum over x is a product of
matrices, and that over y a Fourier transform, in single precision.
"""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from scipy.fft import fft, next_fast_len
from scipy.linalg import lstsq
from scipy.ndimage import binary_dilation

from ..errors import LensError
from .pupil import covered
from .wavefront import Wavefront

LEAST_PARTS = 2  # into which a sample is divided along each side
LEAST_ROWS = 96  # of the pupil: an edge that crosses fewer is rough
MOST_PLACES = 1 << 26  # of the sum, or of the pupil: some hundred MB
EDGE_DEGREE = 12  # of the polynomials of apertures' edges and of density, which are smooth
RANK = 1e-9  # of the polynomial's terms: what rays tell less of stays 0
INSIDE = 2 / 3
WORST_FIT_WAVES = 0.3  # RMS
MARGIN = 1.02  # of the disc of cosines about its rays


@dataclass(frozen=True)
class Sums:
    """How finely PSFs are summed up.

    Attributes
    ----------
    degree : int
        Of the polynomial that a wavefront is.
    oversampling : float
        Parts of a sample, against those that tell the finest plane waves apart.
    repeat : float
        The sum repeats itself at a distance: at so many windows.
    """

    degree: int
    oversampling: float
    repeat: float


def point_spread(wavefront: Wavefront, pitch_um: float, samples: int, sums: Sums) -> np.ndarray:
    """PSF of a wavefront: Huygens' sum over the sphere about the chief ray's image point, as plane waves.

    Parameters
    ----------
    wavefront : Wavefront
    pitch_um : float
        Distance between samples; each is the mean over a square of this side.
    samples : int
        Along v and u; odd, so that the chief ray has a sample and the mirror image is the same array.
    sums : Sums

    Returns
    -------
    array (v, u)
        In shares of all the light; the chief ray at `samples // 2`, +v away from the axis. Zeros where none passes.

    Raises
    ------
    LensError
        A window too wide to sum up, or a wavefront that no polynomial follows.
    """
    if not wavefront.passing.any():
        return np.zeros((samples, samples))
    fit = _fit(wavefront, sums.degree)
    if not fit.error_waves < WORST_FIT_WAVES:
        raise LensError("PSF", "wavefront", f"{fit.error_waves:.2g} waves from smooth", "end the field earlier, or ask "
                                                                                        "for a finer quality")
    return _even_sum(fit, wavefront.wavelength_nm * 1e-3, pitch_um, samples, sums)


def _parts_of_a_sample(fit, wavelength_um, pitch_um, sums):
    """Into how many parts along each side a sample is divided.

    The sum of plane waves needs those that tell the waves apart. Light has finer detail, up to twice as fine; but what
    that is mistaken for is as fine as the parts, and vanishes in the samples' means: so one part more is enough.
    """
    finest_um = wavelength_um / (2 * max(fit.half_x, fit.half_y))
    return max(LEAST_PARTS, int(np.ceil(pitch_um / finest_um * sums.oversampling)) + 1)


@dataclass(frozen=True, eq=False)
class _Fit:
    """A wavefront as Chebyshev polynomials over a disc of direction cosines, even in x.

    `path` is in waves; `edges` are density and limits, of which the stop's rim is the first.
    """

    half_x: float
    half_y: float
    middle_y: float
    path: np.ndarray
    edges: np.ndarray
    error_waves: float
    densities: np.ndarray


def _fit(wavefront, degree):
    """The polynomials, by least squares over the rays of the smallest disc about those that pass, and their nearest."""
    x, y = wavefront.cosine
    near = binary_dilation(wavefront.passing, np.ones((3, 3)))
    half_x, low, high = np.abs(x[near]).max(), y[near].min(), y[near].max()
    half_y, middle = (high - low) / 2, (high + low) / 2
    grown = MARGIN * max(1.0, np.hypot(x[near] / half_x, (y[near] - middle) / half_y).max())
    half_x, half_y = half_x * grown, half_y * grown
    x, y = x / half_x, (y - middle) / half_y
    radius = np.broadcast_to(wavefront.pupil.radii[:, None], x.shape)
    weight = np.sqrt(np.maximum(radius, wavefront.pupil.radii[1] / 4))  # rings hold light by their radius
    path, error = _polynomials(x[near], y[near], weight[near], wavefront.path_mm[None, near], degree)
    inside = np.hypot(x, y) <= 1
    limits = wavefront.limits[np.any(wavefront.limits[:, near] > 1, axis=1)]
    edges, _ = _polynomials(x[inside], y[inside], weight[inside],
                            np.stack([wavefront.density, radius**2, *limits])[:, inside], min(degree, EDGE_DEGREE))
    wavelength_mm = wavefront.wavelength_nm * 1e-6
    return _Fit(half_x, half_y, middle, path[0] / wavelength_mm, edges, error / wavelength_mm,
                wavefront.density[wavefront.passing])


def _polynomials(x, y, weight, values, degree):
    """Chebyshev coefficients (quantity, y power, x power), even in x, of values (quantity, ray); error of the first."""
    across, up = chebvander(x, degree), chebvander(y, degree)
    rows, columns = np.array([(power_y, power_x) for power_x in range(0, degree + 1, 2)
                              for power_y in range(degree + 1 - power_x)]).T
    basis = up[:, rows] * across[:, columns]
    found = lstsq(basis * weight[:, None], (values * weight).T, cond=RANK, lapack_driver="gelsy", check_finite=False)[0]
    terms = np.zeros((len(values), degree + 1, degree + 1))
    terms[:, rows, columns] = found.T
    off = basis @ found[:, 0] - values[0]
    return terms, float(np.sqrt(np.average(off**2, weights=weight**2)))


def _even_sum(fit, wavelength_um, pitch_um, samples, sums):
    """|sum of A exp(-2 pi i (n x / wavelength + path))|^2 over an even grid of direction cosines.

    |A|^2 dL dM is the light of a ray, even over the source's area; the integral of the whole plane is then
    wavelength^2 times all light (Parseval).
    """
    parts = _parts_of_a_sample(fit, wavelength_um, pitch_um, sums)
    part_um, window_um = pitch_um / parts, pitch_um * samples
    places = samples * parts + 2  # one part more at either end
    transform = next_fast_len(int(np.ceil(max(sums.repeat * places,
                                              LEAST_ROWS * wavelength_um / (2 * fit.half_y * part_um)))))
    step_y = wavelength_um / (transform * part_um)
    rows = int(np.ceil(2 * fit.half_y / step_y))
    columns = int(np.ceil(max(fit.half_x * sums.repeat * window_um / wavelength_um, LEAST_ROWS / 2)))
    if transform * places // 2 > MOST_PLACES or rows * columns > MOST_PLACES:
        raise LensError("PSF", "window", f"{window_um * 1e-3:.3g} mm", "too wide to sum up: is the lens in focus here? "
                                                                       "Else give a smaller window")
    x, y = (np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5 - rows / 2) * step_y / fit.half_y
    density, share, path = _on_grid(fit, x, y)
    amplitude = np.sqrt(density) * share
    offset_um = (np.arange((samples // 2 + 1) * parts + 2) - (parts + 1) / 2) * part_um
    waves = amplitude * _phasor(path)
    cosines = 2 * _phasor(np.outer(x * fit.half_x, offset_um) / wavelength_um).real
    along_x = np.empty((rows, offset_um.size), np.complex64)
    along_x.real, along_x.imag = np.ascontiguousarray(waves.real) @ cosines, np.ascontiguousarray(waves.imag) @ cosines
    first = samples // 2 * parts + (parts + 1) / 2
    along_x *= _phasor(-first / transform * np.arange(rows))[:, None]
    field = fft(along_x, transform, axis=0, overwrite_x=True)[:places]
    light = _binned(_binned(field.real**2 + field.imag**2, parts).T, parts).T
    repeats = wavelength_um * columns / (fit.half_x * window_um), transform / places
    all_light = _light(density, share, repeats) * 2 * wavelength_um**2 * columns / (fit.half_x * step_y)
    return np.hstack([light[:, :0:-1], light]) * (part_um**2 / all_light)


def _on_grid(fit, x, y):
    """Light per area, the share of it that apertures and the stop's rim let pass, and path in waves: arrays (y, x)."""
    degree, edges = fit.path.shape[-1], fit.edges.shape[-1]
    across, up = chebvander(x, degree - 1), chebvander(y, degree - 1)
    path = up @ fit.path @ across.T
    rest = up[:, :edges].astype(np.float32) @ fit.edges.astype(np.float32) @ across[:, :edges].T.astype(np.float32)
    density, limits = rest[0], rest[1:]
    inside = x**2 + y[:, None]**2 <= 1
    share = np.where(inside, covered(limits), np.float32(0))
    path[~inside] = 0  # where polynomials go astray
    most = np.float32(fit.densities.max())
    return np.exp(np.clip(density, np.float32(fit.densities.min()), most) - most), share, path


def _light(density, share, repeats):
    """All light, for a sum that repeats itself at so many windows along each side.

    Edges that are softened over a cell spread less light far away than hard ones do: Parseval's sum lacks it. What of
    that would lie within the window goes with the reciprocal of the repeat; the factor is that of Airy's pattern.
    """
    hard, soft = (np.sum(density * cells, dtype=float) for cells in (share, share**2))
    return hard - INSIDE * np.mean(1 / np.array(repeats)) * (hard - soft)


def _phasor(waves):
    """exp(-2 pi i waves); in single precision, once the whole waves are off."""
    angle = ((waves - np.rint(waves)) * (-2 * np.pi)).astype(np.float32)
    result = np.empty(angle.shape, np.complex64)
    np.cos(angle, out=result.real)
    np.sin(angle, out=result.imag)
    return result


def _binned(light, parts):
    """Integrals over samples along the first axis, of values in the middle of their parts and one more at either end.

    The midpoint rule, with Euler and Maclaurin's first correction by the slopes at the borders between samples.
    """
    inner = light[1:-1]
    rise = np.diff(light, axis=0)[::parts] / 24
    return inner.reshape(-1, parts, *inner.shape[1:]).sum(axis=1, dtype=np.float64) + np.diff(rise, axis=0)
