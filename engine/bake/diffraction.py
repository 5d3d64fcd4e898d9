"""Point spread functions: sums of a pupil's plane waves on the flat image plane.

The wavefront is a polynomial over direction cosines, evaluated on a regular grid. The sum is therefore a Fourier
transform over y and, because light is symmetric about the meridional plane, a cosine transform over x; in single
precision.
"""

from dataclasses import dataclass

import numpy as np
from scipy.fft import dct, fft, next_fast_len
from scipy.ndimage import binary_dilation

from .. import kernels
from ..rays.pupil import covered
from ..runtime.errors import LensError
from .polynomials import along_rows, fitted, of_rows
from .wavefront import Wavefront

LEAST_PARTS = 2  # per sample along each side
EIGHT = 8  # columns are padded to a multiple, for vector instructions
LEAST_ROWS = 96  # across the pupil: edges that cross fewer rows are rough
MOST_PLACES = 1 << 26  # in the sum, or in the pupil: some hundred MB
LONGEST = 100.0  # longest waves, relative to the wavelength: a wider window would exceed any blur worth a PSF
EDGE_DEGREE = 12  # of the polynomials of aperture edges and of density, which are smooth
RIM_DEGREE = 8  # of the polynomial of the stop's rim, which must also block the area beyond the rays
INSIDE = 2 / 3
WORST_FIT_WAVES = 0.3  # RMS
MARGIN = 1.02  # radius of the disc of cosines, relative to the disc around its rays


@dataclass(frozen=True)
class Sums:
    """Resolution of the PSF sums.

    Attributes
    ----------
    degree : int
        Degree of the wavefront's polynomial.
    oversampling : float
        Parts per sample, relative to the number that resolves the finest plane waves.
    repeat : float
        Period of the sum, in windows.
    fringes : float
        Limit of the finest fringes in the width of a sample. Light with more is summed at a longer wavelength: rays
        keep their directions, and diffraction is wider, but still far narrower than a sample.
    """

    degree: int
    oversampling: float
    repeat: float
    fringes: float = np.inf


def point_spread(wavefront: Wavefront, pitch_um: float, samples: int, sums: Sums) -> np.ndarray:
    """PSF of a wavefront: Huygens' sum over the sphere around the chief ray's image point, as plane waves.

    Parameters
    ----------
    wavefront : Wavefront
    pitch_um : float
        Distance between samples; each is the mean over a square of this side.
    samples : int
        Along v and u; odd, so that the chief ray is on a sample and the array equals its mirror image.
    sums : Sums

    Returns
    -------
    array (v, u)
        Shares of all light; the chief ray at `samples // 2`, +v away from the axis. Zeros if no light passes.

    Raises
    ------
    LensError
        A window too wide to compute, or a wavefront that a polynomial does not fit.
    """
    if not wavefront.passing.any():
        return np.zeros((samples, samples))
    fit = _fit(wavefront, sums.degree)
    if not fit.error_waves < WORST_FIT_WAVES:
        raise LensError("PSF", "wavefront", f"{fit.error_waves:.2g} waves from a smooth fit",
                        "reduce the field, or choose a finer quality")
    times = lengthening(wavefront, pitch_um, sums)
    if times > LONGEST:
        raise _too_wide(pitch_um, samples)
    wavelength_um = wavefront.wavelength_nm * 1e-3 * times
    return _sum_over_grid(fit, wavelength_um, pitch_um, samples, sums)


def _too_wide(pitch_um, samples):
    return LensError("PSF", "window", f"{pitch_um * samples * 1e-3:.3g} mm",
                     "too wide to compute: check that the lens is in focus here, or set a smaller window")


def lengthening(wavefront: Wavefront, pitch_um: float, sums: Sums) -> float:
    """Factor that lengthens the wavelength for fringes within the limit of `sums`; 1 if none is needed."""
    half_x, half_y, _ = _disc(wavefront)
    fringes = 2 * max(half_x, half_y) * pitch_um / (wavefront.wavelength_nm * 1e-3)
    return max(1.0, fringes / sums.fringes)


@dataclass(frozen=True, eq=False)
class _Fit:
    """A wavefront as Chebyshev polynomials over a disc of direction cosines, even in x.

    `path` is in um; `edges` are the density, the stop's rim and then the other limits; `densities` are the least and
    the greatest density.
    """

    half_x: float
    half_y: float
    middle_y: float
    path: np.ndarray
    edges: np.ndarray
    error_waves: float
    densities: tuple[float, float]


def _near(wavefront):
    """Rays that pass, and their neighbours."""
    return binary_dilation(wavefront.passing, np.ones((3, 3)))


def _disc(wavefront):
    """Half widths along x and y of an elliptical disc around the cosines of these rays, and its centre's y."""
    x, y = wavefront.cosine[:, _near(wavefront)]
    half_x, half_y, middle = np.abs(x).max(), np.ptp(y) / 2, (y.max() + y.min()) / 2
    grown = MARGIN * max(1.0, np.hypot(x / half_x, (y - middle) / half_y).max())
    return half_x * grown, half_y * grown, middle


def _fit(wavefront, degree):
    """Fit the polynomials by least squares over the rays of the disc."""
    near = _near(wavefront)
    half_x, half_y, middle = _disc(wavefront)
    x, y = wavefront.cosine[0] / half_x, (wavefront.cosine[1] - middle) / half_y
    radius = np.broadcast_to(wavefront.pupil.radii[:, None], x.shape)
    weight = np.sqrt(np.maximum(radius, wavefront.pupil.radii[1] / 4))  # light of a ring is proportional to its radius
    path, error = fitted(x[near], y[near], weight[near], wavefront.path_mm[None, near], degree)
    inside = np.hypot(x, y) <= 1
    limits = wavefront.limits[np.any(wavefront.limits[:, near] > 1, axis=1)]
    edges, _ = fitted(x[inside], y[inside], weight[inside],
                      np.stack([wavefront.density, *map(_compressed, limits)])[:, inside], min(degree, EDGE_DEGREE))
    rim, _ = fitted(x[inside], y[inside], weight[inside], radius[None, inside]**2, RIM_DEGREE)
    rim = np.pad(rim, [(0, 0), *((0, more) for more in np.subtract(edges.shape[1:], rim.shape[1:]))])
    edges = np.concatenate([edges[:1], rim, edges[1:]])
    passing = wavefront.density[wavefront.passing]
    return _Fit(half_x, half_y, middle, path[0] * 1e3, edges.astype(np.float32),
                error / (wavefront.wavelength_nm * 1e-6), (passing.min(), passing.max()))


def _compressed(limits):
    """Limits compressed to less than 2, on the same side of 1: polynomials need not follow large values."""
    return 2 * limits / (1 + limits)


def _sum_over_grid(fit, wavelength_um, pitch_um, samples, sums):
    """|sum of A exp(-2 pi i (n x + path) / wavelength)|^2 over a regular grid of direction cosines.

    |A|^2 dL dM is the light of a ray, uniform over the source's area. The integral over the plane is then wavelength^2
    times all light (Parseval).
    """
    halves = np.array([fit.half_x, fit.half_y])
    parts = _parts_of_a_sample(halves.max(), wavelength_um, pitch_um, sums)
    part_um, places = pitch_um / parts, samples * parts + 2  # one extra part at either end
    needed = np.ceil(np.maximum(sums.repeat * places, LEAST_ROWS * wavelength_um / (2 * halves * part_um))).astype(int)
    length_x, length_y = 2 * next_fast_len(-(-needed[0] // 2), real=True), next_fast_len(needed[1])
    if length_x * length_y // 2 > MOST_PLACES:
        raise _too_wide(pitch_um, samples)
    step_x, step_y = wavelength_um / (part_um * np.array([length_x, length_y]))
    columns = np.arange(EIGHT * np.ceil(fit.half_x / step_x / EIGHT))
    rows = np.arange(min(np.ceil(2 * fit.half_y / step_y), length_y))
    x, y = (columns + 0.5) * step_x / fit.half_x, (rows + 0.5 - rows.size / 2) * step_y / fit.half_y
    first_um = pitch_um * (samples // 2) + part_um * (parts + 1) / 2
    path = of_rows(fit.path, y) / wavelength_um
    path[:, 0] -= first_um * step_y * rows / wavelength_um
    edges = np.moveaxis(of_rows(fit.edges, y), 0, 1)
    waves_of = waves if kernels.running() == kernels.NUMPY else kernels.waves
    amplitudes = np.zeros((2, y.size, max(length_x // 2, x.size)), np.float32)
    hard, soft = waves_of(path, edges, x, y, fit.densities, amplitudes)
    light = _transformed(amplitudes[..., :length_x // 2], length_y, parts, samples)
    all_light = 2 * _light(hard, soft, np.array([length_x, length_y]) / places) / (step_x * step_y)
    return np.hstack([light[:, :0:-1], light]) * (part_um**2 / (wavelength_um**2 * all_light))


def _parts_of_a_sample(cosine, wavelength_um, pitch_um, sums):
    """Parts per sample along each side.

    The sum of plane waves needs enough parts to resolve the waves. Light has detail up to twice as fine, but its
    aliases are as fine as the parts and vanish in the samples' means, so one extra part is enough.
    """
    fringes = 2 * cosine * pitch_um / wavelength_um
    return max(LEAST_PARTS, int(np.ceil(fringes * sums.oversampling)) + 1, int(fringes) + 1)


def _transformed(amplitudes, length_y, parts, samples):
    """Light in samples (v, u), from the central u on.

    The centre is on a part if `parts` is odd, otherwise between two. `amplitudes` (real and imaginary part, y, x) are
    overwritten.
    """
    odd, rows = parts % 2, amplitudes.shape[1]
    along_x = dct(amplitudes, 2 if odd else 4, overwrite_x=True)[..., :samples // 2 * parts + (parts + odd) // 2 + 1]
    field = np.zeros((length_y, along_x.shape[2]), np.complex64)
    field.real[:rows], field.imag[:rows] = along_x
    field = fft(field, axis=0, overwrite_x=True)[:samples * parts + 2]
    light = _binned(field.real**2 + field.imag**2, parts).T
    return _binned(np.concatenate([light[odd:(parts + odd) // 2 + 1][::-1], light]), parts).T


def waves(path: np.ndarray, edges: np.ndarray, x: np.ndarray, y: np.ndarray, densities: tuple[float, float],
          out: np.ndarray) -> tuple[float, float]:
    """As `kernels.waves`, in numpy; the reference for its tests."""
    inside = x**2 + y[:, None]**2 <= 1
    share = np.where(inside, covered(along_rows(np.moveaxis(edges[:, 1:], 1, 0), x)), np.float32(0))
    phase = np.where(inside, along_rows(path, x), 0)  # polynomials diverge outside
    least, most = (np.float32(limit) for limit in densities)
    amplitude = np.exp((np.clip(along_rows(edges[:, 0], x), least, most) - most) / 2)
    angle = ((phase - np.rint(phase)) * (-2 * np.pi)).astype(np.float32)
    out[..., :x.size] = amplitude * share * np.stack([np.cos(angle), np.sin(angle)])
    hard, soft = (float(np.sum(amplitude**2 * cells, dtype=float)) for cells in (share, share**2))
    return hard, soft


def _light(hard, soft, repeats):
    """All light, for a sum with a period of `repeats` windows along each axis.

    Edges softened over a cell spread less light far away than hard edges, and Parseval's sum lacks this light. Its
    share within the window is proportional to the reciprocal of the period, with the factor of the Airy pattern.
    """
    return hard - INSIDE * np.mean(1 / repeats) * (hard - soft)


def _binned(light, parts):
    """Integrals over samples along the first axis, from values at the centres of parts, with one more at either end.

    The midpoint rule, with the first Euler-Maclaurin correction by the slopes at the borders between samples.
    """
    inner = light[1:-1]
    rise = np.diff(light, axis=0)[::parts] / 24
    return inner.reshape(-1, parts, *inner.shape[1:]).sum(axis=1, dtype=np.float64) + np.diff(rise, axis=0)
