"""Point spread functions: sums of a pupil's plane waves on the flat image plane where the light is, and rays around.

The wavefront is a polynomial over direction cosines, evaluated on a regular grid. The sum is therefore a Fourier
transform over y and x, in single precision. If light is symmetric about the meridional plane, it is a cosine transform
over x.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from ..kernels.library import NUMPY, running
from ..kernels.waves import waves as compiled_waves
from ..rays.pupil import covered
from ..runtime.errors import LensError
from .polynomials import along_rows, of_rows
from .pupil_fit import PupilFit, fit_pupils
from .spots import spot_diagram
from .wavefront import Wavefront

LEAST_PARTS = 2  # per sample along each side
MORE_PARTS = 4  # per sample, at most, than fringes
EIGHT = 8  # columns are padded to a multiple, for vector instructions
LEAST_ROWS = 96  # across the pupil: edges that cross fewer rows are rough
MOST_PLACES = 1 << 26  # in the sum, or in the pupil: some hundred MB
RAYS_ALONE = 3.0  # lengthening: a PSF with more consists of rays alone
MARGIN_FRINGES = 8.0  # of the box of waves: closer to the rays, light beyond the edge of the pupil has fringes
FEW_FRINGES = 150  # across a box: in a wider one, less of the light returns from the next period
LONGEST = 100.0  # longest waves, relative to the wavelength: a wider window would exceed any blur worth a PSF
INSIDE = 2 / 3
WORST_FIT_WAVES = 0.3  # RMS


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
        Period of the sum, in boxes. For a box of more than `FEW_FRINGES`, the distance to the next period remains that
        of a box of so many.
    fringes : float
        Limit of the finest fringes in the width of a sample. Light with more is summed at a longer wavelength: rays
        keep their directions, and diffraction is wider, but still far narrower than a sample.
    beyond : float
        Share of the light along each axis outside the box of the sum.
    """

    degree: int
    oversampling: float
    repeat: float
    fringes: float = np.inf
    beyond: float = 0.0


def point_spread(wavefront: Wavefront, pitch_um: float, samples: int, sums: Sums, fit: PupilFit | None = None
                 ) -> np.ndarray:
    """PSF of a wavefront: waves where most of the light is, and rays around it.

    Waves are Huygens' sum over the sphere around the chief ray's image point, as plane waves. They are summed in the
    box of samples that contains the light of the spot diagram except the share `Sums.beyond`. What diffraction at the
    edge of the pupil spreads beyond the box, the spot diagram contains, too.

    The error of a sum at a longer wavelength is proportional to the difference from the wavelength, and the error of
    rays, the limit of short waves, is proportional to the wavelength. Sums that need longer waves are therefore mixed
    with rays, in shares that fall from 1 at the wavelength to 0 at `RAYS_ALONE` times the wavelength.

    Parameters
    ----------
    wavefront : Wavefront
    pitch_um : float
        Distance between samples; each is the mean over a square of this side.
    samples : int
        Along v and u; odd, so that the chief ray is on a sample and the array equals its mirror image.
    sums : Sums
    fit : PupilFit or None
        Of the wavefront, from `fit_pupils`; None to compute it.

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
    fit = fit or fit_pupils([wavefront], sums.degree, [wavefront.wavelength_nm])[0]
    fringes = fit.fringes(wavefront.wavelength_nm, pitch_um)
    times = max(1.0, fringes / sums.fringes)
    if times > LONGEST:
        raise _too_wide(pitch_um, samples)
    psf = spot_diagram(wavefront, pitch_um, samples)
    waves_share = (RAYS_ALONE / times - 1) / (RAYS_ALONE - 1)
    if waves_share <= 0:
        return psf
    if not fit.error_um < WORST_FIT_WAVES * wavefront.wavelength_nm * 1e-3:
        raise LensError("PSF", "wavefront", f"{fit.error_um * 1e3 / wavefront.wavelength_nm:.2g} waves from a smooth "
                        "fit", "reduce the field, or choose a finer quality")
    box = _box(psf, sums.beyond, MARGIN_FRINGES / fringes, fit.even)
    summed = _sum_over_grid(fit, wavefront.wavelength_nm * 1e-3 * times, pitch_um,
                            [part.start - samples // 2 for part in box], psf[box].shape, sums)
    if psf[box].shape == psf.shape and times == 1:
        return summed
    psf[box] += waves_share * (summed * (psf[box].sum() / summed.sum()) - psf[box])
    return psf


def _box(psf, beyond, margin, even):
    """Rows and columns that contain all light except the share `beyond` in each direction, and a margin of samples."""
    samples, margin = len(psf), int(np.ceil(margin))
    rows = _extent(psf.sum(axis=1), beyond, margin)
    if not even:
        return rows, _extent(psf.sum(axis=0), beyond, margin)
    across = np.cumsum(psf.sum(axis=0)[samples // 2:])
    half = np.searchsorted(across, across[-1] - beyond / 2 * np.cumsum(psf.sum(axis=1))[-1]) + margin
    return rows, slice(max(samples // 2 - half, 0), samples // 2 + half + 1)


def _extent(light, beyond, margin):
    """The slice that contains all light along an axis except the share `beyond`, and a margin."""
    along = np.cumsum(light)
    first, last = (np.searchsorted(along, share * along[-1]) for share in (beyond / 2, 1 - beyond / 2))
    return slice(max(first - margin, 0), min(last + margin + 1, light.size))


def _too_wide(pitch_um, samples):
    return LensError("PSF", "window", f"{pitch_um * samples * 1e-3:.3g} mm",
                     "too wide to compute: check that the lens is in focus here, or set a smaller window")


def _sum_over_grid(fit, wavelength_um, pitch_um, first, shape, sums):
    """|sum of A exp(-2 pi i (n x + path) / wavelength)|^2 over a regular grid of direction cosines.

    |A|^2 dL dM is the light of a ray, uniform over the source's area. The integral over the plane is then wavelength^2
    times all light (Parseval).
    """
    halves = np.array([fit.half_x, fit.half_y])
    parts = _parts_of_a_sample(halves.max(), wavelength_um, pitch_um, sums)
    part_um, places = pitch_um / parts, np.array(shape[::-1]) * parts + 2  # one extra part at either end
    repeat = 1 + (sums.repeat - 1) * np.minimum(1, FEW_FRINGES * wavelength_um / (2 * halves * part_um * places))
    needed = np.ceil(np.maximum(repeat * places, LEAST_ROWS * wavelength_um / (2 * halves * part_um))).astype(int)
    length_x = 2 * scipy.fft.next_fast_len(-(-needed[0] // 2), real=True)
    length_y = scipy.fft.next_fast_len(needed[1])
    if length_x * length_y // 2 > MOST_PLACES:
        raise _too_wide(pitch_um, max(shape))
    step_x, step_y = wavelength_um / (part_um * np.array([length_x, length_y]))
    rows = np.arange(min(np.ceil(2 * fit.half_y / step_y), length_y))
    x, y = _columns(fit, step_x, length_x), (rows + 0.5 - rows.size / 2) * step_y / fit.half_y
    first_um = part_um * (parts + 1) / 2 - pitch_um * np.array(first)
    path = of_rows(fit.path_um, y) / wavelength_um
    path[:, 0] -= first_um[0] * step_y * rows / wavelength_um
    if not fit.even:
        path[:, 1] -= first_um[1] * fit.half_x / wavelength_um
    edges = np.moveaxis(of_rows(fit.edges.astype(np.float32), y), 0, 1)
    waves_of = waves if running() == NUMPY else compiled_waves
    length, transform = (length_x // 2, _transformed) if fit.even else (length_x, _transformed_fully)
    amplitudes = np.zeros((2, y.size, max(length, x.size)), np.float32)
    hard, soft = waves_of(path, edges, x, y, fit.densities, amplitudes, fit.even)
    light = transform(amplitudes[..., :length], length_y, parts, shape)
    all_light = _light(hard, soft, np.array([length_x, length_y]) / places) / (step_x * step_y)
    if fit.even:
        light, all_light = np.hstack([light[:, :0:-1], light]), 2 * all_light
    return light * (part_um**2 / (wavelength_um**2 * all_light))


def _columns(fit, step, length):
    """Places of columns in the disc, in a multiple of eight; of one half of the disc if light is symmetric."""
    if fit.even:
        return (np.arange(EIGHT * np.ceil(fit.half_x / step / EIGHT)) + 0.5) * step / fit.half_x
    number = min(np.ceil(2 * fit.half_x / step), length)
    return (np.arange(EIGHT * np.ceil(number / EIGHT)) + 0.5 - number / 2) * step / fit.half_x


def _parts_of_a_sample(cosine, wavelength_um, pitch_um, sums):
    """Parts per sample along each side.

    The sum of plane waves needs enough parts to resolve the waves. Light has detail up to twice as fine, but its
    aliases are as fine as the parts and vanish in the samples' means, so one extra part is enough.
    """
    fringes = 2 * cosine * pitch_um / wavelength_um
    return max(LEAST_PARTS, int(np.ceil(fringes + min(fringes * (sums.oversampling - 1), MORE_PARTS))) + 1,
               int(fringes) + 1)


def _transformed(amplitudes, length_y, parts, shape):
    """Light in samples (v, u), from the central u on.

    The centre is on a part if `parts` is odd, otherwise between two. `amplitudes` (real and imaginary part, y, x) are
    overwritten.
    """
    odd, rows = parts % 2, amplitudes.shape[1]
    along_x = scipy.fft.dct(amplitudes, 2 if odd else 4, overwrite_x=True)
    along_x = along_x[..., :shape[1] // 2 * parts + (parts + odd) // 2 + 1]
    field = np.zeros((length_y, along_x.shape[2]), np.complex64)
    field.real[:rows], field.imag[:rows] = along_x
    field = scipy.fft.fft(field, axis=0, overwrite_x=True)[:shape[0] * parts + 2]
    light = _binned(field.real**2 + field.imag**2, parts).T
    return _binned(np.concatenate([light[odd:(parts + odd) // 2 + 1][::-1], light]), parts).T


def _transformed_fully(amplitudes, length_y, parts, shape):
    """As `_transformed`, from all columns of the pupil to all u."""
    rows = amplitudes.shape[1]
    along_x = np.empty(amplitudes.shape[1:], np.complex64)
    along_x.real, along_x.imag = amplitudes
    field = np.zeros((length_y, shape[1] * parts + 2), np.complex64)
    field[:rows] = scipy.fft.fft(along_x, axis=1, overwrite_x=True)[:, :field.shape[1]]
    field = scipy.fft.fft(field, axis=0, overwrite_x=True)[:shape[0] * parts + 2]
    return _binned(_binned(field.real**2 + field.imag**2, parts).T, parts).T


def waves(path: np.ndarray, edges: np.ndarray, x: np.ndarray, y: np.ndarray, densities: tuple[float, float],
          out: np.ndarray, even: bool = True) -> tuple[float, float]:
    """As `kernels.waves.waves`, in numpy; the reference for its tests."""
    inside = x**2 + y[:, None]**2 <= 1
    share = np.where(inside, covered(along_rows(np.moveaxis(edges[:, 1:], 1, 0), x, even)), np.float32(0))
    phase = np.where(inside, along_rows(path, x, even), 0)  # polynomials diverge outside
    least, most = (np.float32(limit) for limit in densities)
    amplitude = np.exp((np.clip(along_rows(edges[:, 0], x, even), least, most) - most) / 2)
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
