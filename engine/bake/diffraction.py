"""Point spread functions: the plane waves of a pupil summed up on the flat image plane."""

import finufft
import numpy as np

from ..errors import LensError
from .wavefront import Wavefront, sample_pupil

OVERSAMPLING = 1.25  # finer than Nyquist's pitch by this, so that sums over samples are integrals to 1e-3
ALIAS_WINDOWS = 2.0  # the sum repeats itself at a distance; this many windows must fit in
TOLERANCE = 1e-7
MOST_SAMPLES = 1 << 24  # of the pupil, and of the sum: some GB
COARSE = (24, 32)  # radii and azimuths of the first look at a pupil


def point_spread(wavefront: Wavefront, pitch_um: float, samples: int) -> tuple[np.ndarray, float]:
    """PSF of a wavefront: Huygens' sum over the sphere about the chief ray's image point, as plane waves.

    Parameters
    ----------
    wavefront : Wavefront
    pitch_um : float
        Distance between samples; each is the mean over a square of this side.
    samples : int
        Along v and u; odd, so that the chief ray has a sample and the mirror image is the same array.

    Returns
    -------
    psf : array (v, u)
        Of the sum of the light inside; the chief ray at `samples // 2`, +v away from the axis.
    illumination : float
        Area of the passing bundle in direction cosines at the image, whose ratio to the axis is the relative
        illumination (of a Lambertian object, for radiance is conserved along rays).

    Raises
    ------
    LensError
        A window too wide to sum up.
    """
    coarse = sample_pupil(wavefront, *COARSE)
    if not coarse.cosine_area.any():
        return np.zeros((samples, samples)), 0.0
    wavelength_um, window_um = wavefront.wavelength_nm * 1e-3, samples * pitch_um
    parts = _parts_of_a_sample(coarse, pitch_um, wavelength_um)
    radii, azimuths = _pupil_grid(coarse, window_um, wavelength_um)
    if max(radii * azimuths, (samples * parts) ** 2) > MOST_SAMPLES:
        raise LensError("PSF", "window", f"{window_um * 1e-3:.3g} mm", "too wide to sum up: is the lens in focus here? "
                                                                       "Else give a smaller window")
    pupil = sample_pupil(wavefront, radii, azimuths)
    light = _plane_wave_sum(pupil, wavelength_um, pitch_um / parts, samples * parts)
    binned = light.reshape(samples, parts, samples, parts).sum(axis=(1, 3))
    return (binned + binned[:, ::-1]) / 2, 2 * pupil.ray_area.sum()


def _parts_of_a_sample(pupil, pitch_um, wavelength_um):
    """Into how many parts along each side a sample is divided to see all of the PSF's detail; odd."""
    finest_um = wavelength_um / (4 * pupil.largest_sine * OVERSAMPLING)
    return 2 * int(np.ceil((pitch_um / finest_um - 1) / 2)) + 1 if pitch_um > finest_um else 1


def _pupil_grid(pupil, window_um, wavelength_um):
    """Radii and azimuths of a pupil whose sum does not repeat itself within the window."""
    growth = [max(step * ALIAS_WINDOWS * window_um / wavelength_um, 1.0) for step in pupil.largest_steps]
    return tuple(int(np.ceil(number * grown)) for number, grown in zip(COARSE, growth, strict=True))


def _plane_wave_sum(pupil, wavelength_um, pitch_um, samples):
    """Share of the light in each sample: |sum of A dL dM exp(-2 pi i (n x / wavelength + path))|^2.

    |A|^2 dL dM is the light of a ray, even over the source's area; the integral of the whole plane is then
    wavelength^2 times all light (Parseval).
    """
    amplitude = np.sqrt(pupil.source_area * pupil.cosine_area) * np.exp(-2j * np.pi * pupil.path)
    x, y = (2 * np.pi * pitch_um / wavelength_um * cosine.ravel() for cosine in (pupil.cosine_x, pupil.cosine_y))
    half = finufft.nufft2d1(y, x, amplitude.ravel(), (samples, samples), isign=-1, eps=TOLERANCE, nthreads=1)
    field = half + half[:, ::-1]  # of the other half of the pupil, which is the mirror image
    return (field.real**2 + field.imag**2) * pitch_um**2 / (wavelength_um**2 * 2 * pupil.source_area.sum())
